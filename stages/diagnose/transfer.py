"""Where no name is given: the transfer function from the ship's own motion to what has none.

A motion of the main IMU is let through a short filter with free taps into the channel where the gap sits, beside the
nuisances and through the same whitening as every effect: H(f) = sum c_k exp(-2 pi i f tau_k). A flat gain in phase is a
scale or an axis, one that grows with the frequency at 90 degrees a delay, one that falls a lag of the structure. Where
no motion gains anything held out, what has no name follows none that was measured.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from schemas.diagnosis import Transfer
from schemas.rig import FloatArray
from stages.diagnose import whitening
from stages.diagnose.baseline import Baseline
from stages.diagnose.evidence import Fit, Table, held_out_sum, solve
from stages.diagnose.gap import restored_values
from stages.diagnose.regressors import view_of
from stages.diagnose.selection import Selection
from twin.effects._prediction import LogView, Signals

TAPS_S = np.linspace(-1.0, 1.0, 9)  # s, lags of the taps
FREQUENCY = np.geomspace(0.02, 0.5, 25)  # Hz, where ships move
RIDGE = 1e-6  # precision of a tap, columns of unit size: what the motion does not excite stays open, but finite
RATE, FORCE = "main.gyro", "main.accel"
UNITS = {
    ("sub.gyro", RATE): "1", ("sub.gyro", FORCE): "(rad/s)/(m/s²)",
    ("sub.accel", RATE): "(m/s²)/(rad/s)", ("sub.accel", FORCE): "1",
    ("phins_sub.attitude", RATE): "s", ("phins_sub.attitude", FORCE): "rad/(m/s²)",
}  # fmt: skip


def transfer(chosen: Selection, channel: str, axis: str, whole: bool) -> Transfer:
    """From the motion that gains most held out into a channel; whole: of all that departs from the twin, not of what
    the picks leave. A channel without samples of its own (stamps) shows in the gyros."""
    channel, axis = channel if (channel, RATE) in UNITS else "sub.gyro", axis or "x"
    base = chosen.base
    y = restored_values(chosen) if whole else chosen.without_events
    kept = chosen.nuisances if whole else chosen.steady
    y, gram = y[:, : base.whitened.values.shape[1]], chosen.gram
    columns = chosen.regressors.columns[:, : y.shape[1]]
    table = Table.of([gram.names[k] for k in kept], columns, y, base.t, gram.precision[kept], chosen=kept)
    view = view_of(base)
    found = [
        _through(table, base, view, channel, axis, source, place) for source in (RATE, FORCE) for place in range(3)
    ]
    return max(found, key=lambda one: one.evidence_nats)


def _through(table: Table, base: Baseline, view: LogView, channel: str, axis: str, source: str, place: int) -> Transfer:
    """From one axis of one motion."""
    motion = (view.omega_m if source == RATE else view.force_m - view.force_m.mean(axis=0))[:, place]
    own = whitening.whiten_columns(base.whitened, base.response.many(_taps(view, motion, channel, "xyz".index(axis))))
    size = np.maximum(np.sqrt(np.einsum("nmk,nmk->k", own, own)), 1e-300)
    names = [f"tap {k}" for k in range(len(TAPS_S))]
    joint = table.widened(names, own / size, np.full(len(names), RIDGE))
    places = joint.index(names)
    others = [k for k in range(len(joint.names)) if k not in places]
    fit = solve(joint.total, joint.precision, [*others, *places])
    last = slice(len(others), None)
    taps = Fit(fit.value[last] / size, fit.covariance[last, last] / np.outer(size, size), fit.gain)
    gain, gain_std, phase, phase_std = response_of(taps, FREQUENCY)
    return Transfer(
        channel=channel, axis=axis, source=source, source_axis="xyz"[place], unit=UNITS[channel, source],
        frequency=FREQUENCY, gain=gain, gain_std=gain_std, phase=phase, phase_std=phase_std,
        evidence_nats=held_out_sum(joint, others, places),
    )  # fmt: skip


def _taps(view: LogView, motion: FloatArray, channel: str, axis: int) -> Iterator[Signals]:
    """The motion (n,), later and later, along an axis of m, as what it is in the axes of the channel."""
    for lag in TAPS_S:
        late = np.interp(view.t - lag, view.t, motion)
        if channel == "sub.accel":
            yield Signals(accel=np.outer(late, view.R_m_s[axis]))
        elif channel == "sub.gyro":
            yield Signals(gyro=np.outer(late, view.R_m_s[axis]))
        else:
            yield Signals(phins=np.outer(late, np.eye(3)[axis]))


def response_of(taps: Fit, frequency: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Gain, its standard error, phase (rad) and its standard error, each (k,), of taps with a covariance."""
    turn = np.exp(-2j * np.pi * np.outer(frequency, TAPS_S))
    H = turn @ taps.value
    gain = np.abs(H)
    along = (np.conj(H) / np.maximum(gain, 1e-300))[:, None] * turn  # its real part moves the gain, the rest the phase
    std = [np.sqrt(np.maximum(np.einsum("fk,kl,fl->f", x, taps.covariance, x), 0.0)) for x in (along.real, along.imag)]
    return gain, std[0], np.angle(H), std[1] / np.maximum(gain, 1e-300)
