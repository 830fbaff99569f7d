"""Sensors: what the units measured, gyros and accelerometers apart, their clocks and their gaps."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics.interpolation import usual_interval
from physics.units import DEG
from schemas import scratch
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, Trial
from stages.publish.axis import span_of
from stages.publish.best import time_delay
from stages.publish.recording import layout
from stages.publish.recording.chart import key_view, log_key
from stages.publish.recording.scene import AXIS_COLOURS, BLUE, GREEN, ORANGE, PURPLE, Colour, Scene, stride
from stages.publish.recording.stream import send_band, send_lines, thin_extremes
from stages.slabs import slabs

UNIT_COLOURS: tuple[Colour, ...] = (GREEN, ORANGE, PURPLE)
CLOCK_RATE = 5.0  # Hz of the drawn sample intervals; minimum and maximum survive


def units(trial: Trial) -> dict[str, tuple[str, ImuSeries]]:
    """Inertial units present: entity name -> (name for people, series)."""
    known = {
        "main": ("main IMU", trial.main),
        "sub": ("sub-IMU", trial.sub),
        "sliding": ("sliding SINS", trial.sliding),
    }
    return {key: (name, series) for key, (name, series) in known.items() if series is not None and len(series)}


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Rates, specific forces, sample intervals and the delay."""
    for key, (name, series) in units(scene.trial).items():
        every = stride(series.stamp, scene.rate)
        for kind, values, unit in (("gyro", series.gyro, DEG), ("accel", series.accel, 1.0)):
            stamp, thinned = thin_extremes(series.stamp, values, every)
            names = [f"{name} {axis}" for axis in "xyz"]
            send_lines(rec, f"sensors/{kind}/{key}", stamp, scene.trial.epoch, thinned / unit, names, AXIS_COLOURS, 1.0)
        _log_intervals(rec, scene, key, name, series)
    log_key(rec, "sensors/key", colours_of(scene.trial))
    _log_delay(rec, scene)


def _log_intervals(rec: rr.RecordingStream, scene: Scene, key: str, name: str, series: ImuSeries) -> None:
    """Sample intervals in usual ones: 1 when regular, 2 for a lost sample."""
    if len(series) < 3:
        return
    ratio = np.diff(series.stamp) / usual_interval(series.stamp)
    stamp, thinned = thin_extremes(series.stamp[1:], ratio[:, None], stride(series.stamp, CLOCK_RATE))
    colour = UNIT_COLOURS[list(units(scene.trial)).index(key)]
    send_lines(rec, f"sensors/interval/{key}", stamp, scene.trial.epoch, thinned, [name], [colour], 1.0)


def _log_delay(rec: rr.RecordingStream, scene: Scene) -> None:
    """The delay as one line with its band over the whole trial."""
    delay = time_delay(scene.deformation)
    stamp = scene.deformation.stamp[[0, -1]]
    value, std = (np.full((2, 1), 1e3 * float(x)) for x in (delay.value, delay.std))
    send_band(rec, "sensors/delay", stamp, scene.trial.epoch, value, std, ["time delay of the sub-IMU"], [BLUE], "ms")


def tab(scene: Scene) -> rrb.Container:
    """A column of gyros, one of accelerometers, clocks below."""
    present = units(scene.trial)
    gyros = [
        layout.time_view(scene, f"Gyro, {name} [deg/s]", [f"sensors/gyro/{key}"], _span(unit.gyro, DEG))
        for key, (name, unit) in present.items()
    ]
    accels = [
        layout.time_view(scene, f"Specific force, {name} [m/s²]", [f"sensors/accel/{key}"], _span(unit.accel))
        for key, (name, unit) in present.items()
    ]
    intervals = [f"sensors/interval/{key}" for key in present]
    clocks = rrb.Horizontal(
        layout.time_view(scene, "Sample interval [usual intervals]", intervals, (0.0, 3.0)),
        layout.time_view(scene, "Time delay of the sub-IMU ±3σ [ms]", ["sensors/delay"]),
        layout.lanes(scene, "Gaps", "lanes"),
    )
    columns = rrb.Horizontal(rrb.Vertical(*gyros), rrb.Vertical(*accels))
    key = key_view("sensors/key", "Colours")
    return rrb.Vertical(key, columns, clocks, row_shares=[0.3, 2.4, 1.35], name="Sensors")


def _span(values: FloatArray, unit: float = 1.0) -> tuple[float, float]:
    """Limits of measurements (n, 3) over their unit, a slab at a time."""
    ends = []
    for part in slabs(len(values)):
        known = np.isfinite(values[part])
        ends += [extreme(values[part], where=known, initial=0.0) / unit for extreme in (np.min, np.max)]
    scratch.release(values)
    return span_of([np.array(ends)])


def colours_of(trial: Trial) -> list[tuple[str, Colour]]:
    """Axes of the measurements, units of the sample intervals."""
    names = [f"sample interval, {name}" for name, _ in units(trial).values()]
    return [*zip("xyz", AXIS_COLOURS), *zip(names, UNIT_COLOURS)]
