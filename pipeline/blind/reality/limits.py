"""The smallest size of a mean effect that any method could detect in a log: five and a half standard deviations.

Cramer-Rao's bound of the parameter from gyros, accelerometers and PHINS together, in the frequency domain:
r = G theta + n with gyros i w, accelerometers F x + w^2 H(f) r x, attitude 1, theta and n of known spectra. Biases,
static angle and the seat of the PHINS are free within what a twin leaves open. Flexure times rate is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize

from physics.units import ARCMIN, ARCSEC, DEG, DEG_PER_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from pipeline.blind.reality.motion import ShipPath
from pipeline.blind.reality.nature import SKEW, Deck, Nature
from twin.config import Flexure

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

STEP = 0.1  # s
HYSTERESIS_STEP, HYSTERESIS_STEPS = 0.01, 200_000  # s
HIGHEST = 4.0  # Hz
DETECTABLE = 5.5  # standard deviations: one false alarm of a hundred among thirty effects, found in 95 of 100 logs
LEFT_OPEN = np.log([1.4, 1.55, 1.2])  # factors either way of mu, b^2 and sigma, none of which a twin knows exactly
FREE = {"gyro": 0.005 * DEG_PER_HOUR, "accel": 25.0 * MICRO_G, "static": 1.0 * ARCMIN, "phins": 0.5 * ARCMIN}


@dataclass(frozen=True)
class Drive:
    """What the ship does at the sub-IMU's place without bending, every STEP, m-axes, (n, 3); t from the start."""

    t: FloatArray
    omega: FloatArray
    omega_dot: FloatArray
    force: FloatArray
    jerk: FloatArray
    lateral: FloatArray  # (n,) m/s^2 at the main IMU
    roll: FloatArray  # (n,) rad
    warmth: FloatArray  # (n,) K


def drive(nature: Nature) -> Drive:
    """The ship's motion over a record."""
    t = np.arange(0.0, nature.duration, STEP)
    state = ShipPath.over(nature.voyage, -1.0, nature.duration + 1.0).at(t)
    arm = nature.deck.lever
    force = state.force + _at_lever(state.omega, state.omega_dot, arm)
    return Drive(
        t=t, omega=state.omega, omega_dot=state.omega_dot, force=force, jerk=np.gradient(force, STEP, axis=0),
        lateral=state.force[:, 0], roll=state.angles[:, 1], warmth=nature.warmth.at(1, t) - 20.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Bending:
    """theta (n, 3) rad, which shows as flexure itself does.

    Products with the ship's rate stay out, as they do of the flexure that hides it: else they would have no noise.
    """

    theta: FloatArray


def limit(nature: Nature, columns: Sequence[FloatArray | Bending], seen: Drive) -> FloatArray:
    """The smallest detectable value (k,) of each of k parameters, given what a unit of each does: (n, 9) or bending.

    Channels: rates, forces, relative attitude of the PHINS, three axes each.
    """
    nuisances, free = _nuisances(nature, seen)
    window = np.hanning(len(seen.t))
    every = np.asarray(np.fft.rfftfreq(len(seen.t), STEP), dtype=np.float64)
    f = every[every <= HIGHEST]
    gain = _gain(nature.deck, f)

    def transformed(column: FloatArray | Bending) -> ComplexArray:
        if isinstance(column, Bending):
            return np.einsum("fca,fa->fc", gain, transformed(column.theta))
        return np.fft.rfft(column * window[:, None], axis=0)[: len(f)]

    spectrum = np.stack([transformed(column) for column in (*columns, *nuisances)], axis=-1)
    variance = spectra(nature, f) * float((window**2).sum()) / STEP
    weights = np.where(f == 0.0, 1.0, 2.0)
    solved = np.linalg.solve(variance, spectrum)
    information = np.einsum("f,fci,fcj->ij", weights, spectrum.conj(), solved).real
    information += np.diag(np.concatenate([np.zeros(len(columns)), np.square(free) ** -1.0]))
    scale = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return DETECTABLE * np.sqrt(np.diag(covariance)[: len(columns)])


def hysteresis(nature: Nature, yield_sigmas: float) -> FloatArray:
    """(1,) the least share of the stiffness that, yielding at so many sigmas, could be told from any linear deck.

    As if the deflection were seen without noise: what is left of the hysteretic moment beside stiffness and damping,
    against the white forcing w of x'' + 2 mu x' + b^2 x = w, whose density is 4 mu b^2 sigma^2. To first order in the
    share, on a long path of the linear deck.
    """
    rng, nats = np.random.default_rng(0), 0.0
    for mu, frequency in zip(nature.deck.damping, nature.deck.frequency):
        stiffness = float(mu**2 + frequency**2)
        density = 4.0 * mu * stiffness
        forcing = rng.standard_normal(HYSTERESIS_STEPS) * np.sqrt(density * HYSTERESIS_STEP)
        x, v, z = _yielding(float(mu), stiffness, forcing, HYSTERESIS_STEP, yield_sigmas)
        linear = np.stack([np.ones_like(x), x, v], axis=1)
        left = stiffness * (z - linear @ np.linalg.lstsq(linear, z, rcond=None)[0])
        nats += 0.5 * nature.duration * float(left.var()) / density
    return np.array([DETECTABLE / np.sqrt(2.0 * nats)])


def random_walk(nature: Nature) -> float:
    """The least angle random walk of the sub-IMU's gyros, rad/sqrt(s), that spectra tell from the one it has.

    By Whittle's likelihood of rates in which flexure stands beside the noise of both units.
    """
    f = np.linspace(0.0, 0.5 * nature.rate, 4001)[1:]
    density, own = rate_density(nature, f), nature.sub.arw**2

    def short_of(arw: float) -> float:
        x = (arw**2 - own) / density
        return nature.duration * float((x - np.log1p(x)).mean(axis=0).sum()) * f[-1] - 0.5 * DETECTABLE**2

    return float(brentq(short_of, nature.sub.arw, 1e3 * np.sqrt(density.max())))


def vibration(nature: Nature, frequency: float, axis: int) -> float:
    """The least amplitude, rad/s, of a sine of the rate at a frequency (Hz)."""
    density = rate_density(nature, np.array([frequency]))[0, axis]
    return DETECTABLE * float(np.sqrt(2.0 * density / nature.duration))


def flexure(nature: Nature, believed: Flexure, real: Flexure) -> float:
    """The multiple of DETECTABLE at which a deck's rates tell its flexure from all that its twin leaves open.

    sqrt(2 KL) / DETECTABLE: KL, nats, is that of Whittle's likelihood against the nearest of those decks, axis by axis.
    """
    f = np.geomspace(1.0 / nature.duration, 0.5 * nature.rate, 2000)
    noise, w = nature.main.arw**2 + nature.sub.arw**2, 2.0 * np.pi * f

    def density(x: FloatArray) -> FloatArray:
        mu, b2, sigma = np.exp(x)
        bent = 4.0 * mu * b2 * sigma**2 / ((b2 - w**2) ** 2 + (2.0 * mu * w) ** 2)
        return np.asarray(w**2 * bent + noise)

    def nats(x: FloatArray, there: FloatArray) -> float:
        ratio = there / density(x)
        return nature.duration * float(np.trapezoid(ratio - 1.0 - np.log(ratio), f))

    total = 0.0
    for here, there in zip(_logarithms(believed), _logarithms(real)):
        box = np.stack([here - LEFT_OPEN, here + LEFT_OPEN], axis=1)
        nearest = minimize(nats, np.clip(there, *box.T), args=(density(there),), method="L-BFGS-B", bounds=box)
        total += float(nearest.fun)
    return float(np.sqrt(2.0 * total)) / DETECTABLE


def _logarithms(deck: Flexure) -> FloatArray:
    """(3, 3) of mu, b^2, sigma (rad), one axis a row."""
    mu = np.array(deck.damping)
    return np.log([mu, mu**2 + np.array(deck.frequency) ** 2, np.array(deck.std_arcmin) * ARCMIN]).T


def rate_density(nature: Nature, f: FloatArray) -> FloatArray:
    """(bins, 3) rad^2/s, two-sided, of the difference of both gyros: flexure and noise."""
    bent = np.diagonal(_bending(nature.deck, f).real, axis1=1, axis2=2)
    return np.asarray((2.0 * np.pi * f[:, None]) ** 2 * bent + nature.main.arw**2 + nature.sub.arw**2)


@njit(cache=True)
def _yielding(mu, stiffness, kick, step, yields):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Deflection, rate and hysteretic part (n,) of Bouc and Wen on the path of a linear deck."""
    x, v, z = 0.0, 0.0, 0.0
    out = np.empty((3, len(kick)))
    for k in range(len(kick)):
        v += kick[k] - step * (2.0 * mu * v + stiffness * x)
        x += step * v
        z += step * (v - 0.5 * (abs(v) * z + abs(z) * v) / yields)
        out[0, k], out[1, k], out[2, k] = x, v, z
    return out


def spectra(nature: Nature, f: FloatArray) -> ComplexArray:
    """Spectral densities (bins, 9, 9) of the residuals; a Hann window's share of the neighbours included."""
    phins, w = nature.phins, 2.0 * np.pi * f
    gain = _gain(nature.deck, f)
    density = gain @ _bending(nature.deck, f) @ gain.conj().transpose(0, 2, 1)
    slow = 2.0 * phins.tau * phins.drift**2 / (1.0 + (w[:, None] * phins.tau) ** 2)
    noise = np.concatenate(
        [
            np.full((len(f), 3), nature.main.arw**2 + nature.sub.arw**2),
            np.full((len(f), 3), nature.main.vrw**2 + nature.sub.vrw**2),
            2.0 * slow + 2.0 * phins.noise**2 / nature.rate,
        ],
        axis=1,
    )
    density += noise[:, :, None] * np.eye(9)
    before, after = np.roll(density, 1, axis=0), np.roll(density, -1, axis=0)
    before[0], after[-1] = density[1], density[-1]
    return (before + 4.0 * density + after) / 6.0


def _bending(deck: Deck, f: FloatArray) -> ComplexArray:
    """(bins, 3, 3) rad^2 s, two-sided, of theta."""
    w = 2.0 * np.pi * f[:, None]
    stiffness = deck.damping**2 + deck.frequency**2
    forcing = np.sqrt(np.outer(*(2 * [4.0 * deck.damping * stiffness * deck.std**2]))) * deck.correlation
    answer = 1.0 / (stiffness - w**2 + 2j * deck.damping * w)
    return np.asarray(answer[:, :, None] * forcing * answer.conj()[:, None, :])


def _gain(deck: Deck, f: FloatArray) -> ComplexArray:
    """G (bins, 9, 3)."""
    w = 2.0 * np.pi * f[:, None, None]
    band = 1.0 / (1.0 + (f[:, None, None] / deck.corner) ** (2 * deck.order))
    level = _cross(np.array([0.0, 0.0, STANDARD_GRAVITY]))
    eye = np.broadcast_to(np.eye(3), (len(f), 3, 3))
    return np.concatenate([1j * w * eye, level + w**2 * band * _cross(deck.lever) + 0j, eye + 0j], axis=1)


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _nuisances(nature: Nature, seen: Drive) -> tuple[list[FloatArray | Bending], FloatArray]:
    """Biases, static angle and seat of the PHINS, with the standard deviation a twin leaves each, and the place to
    which mean bending takes the sub-IMU."""
    columns: list[FloatArray | Bending] = []
    free = []
    hidden = _mean_bending(nature)
    for axis in range(3):
        e = np.eye(3)[axis]
        moved = signal(seen, accel=_at_lever(seen.omega, seen.omega_dot, np.cross(e, nature.deck.lever)))
        for std, column in (
            (FREE["gyro"], signal(seen, gyro=e)), (FREE["accel"], signal(seen, accel=e)),
            (FREE["static"], bent(np.ones(len(seen.t)), axis)), (FREE["phins"], signal(seen, attitude=e)),
            (hidden[axis], moved),
        ):  # fmt: skip
            columns.append(column)
            free.append(std)
    return columns, np.array(free)


def _mean_bending(nature: Nature) -> FloatArray:
    """(3,) rad, one sigma: mean bending that passes for static angle. Of both only the sum is seen; bending alone moves
    the sub-IMU."""
    mean = np.diagonal(_bending(nature.deck, np.zeros(1))[0]).real / nature.duration
    return np.asarray(1.0 / np.sqrt(1.0 / mean + 1.0 / FREE["static"] ** 2))


def _at_lever(omega: FloatArray, omega_dot: FloatArray, arm: FloatArray) -> FloatArray:
    """(n, 3) m/s^2 at the end of a lever arm (3,), beyond those at its foot."""
    return np.asarray(np.cross(omega_dot, arm) + np.cross(omega, np.cross(omega, arm)))


def signal(
    seen: Drive, gyro: FloatArray | None = None, accel: FloatArray | None = None, attitude: FloatArray | None = None
) -> FloatArray:
    """Channels (n, 9) from parts that go with (n, 3)."""
    out = np.zeros((len(seen.t), 9))
    for k, part in enumerate((gyro, accel, attitude)):
        if part is not None:
            out[:, 3 * k : 3 * k + 3] = part
    return out


def bent(angle: FloatArray, axis: int) -> Bending:
    """An angle (n,) rad about an axis."""
    return Bending(np.outer(angle, np.eye(3)[axis]))


def unit_signals(name: str, seen: Drive, drawn: dict) -> Sequence[FloatArray | Bending] | None:
    """What a unit of each parameter of an effect adds, in the order of its axes; None for what is no mean effect.

    drawn: the parameters that shape the effect (a period, a time).
    """
    eye, n = np.eye(3), np.ones(len(seen.t))
    if name in ("time_delay", "clock_drift", "sinusoidal_clock"):
        late = {"time_delay": n, "clock_drift": seen.t * PPM}.get(name)
        if late is None:
            late = np.sin(2.0 * np.pi * seen.t / drawn["period"])
        return [signal(seen, -seen.omega_dot * late[:, None], -seen.jerk * late[:, None])]
    if name == "gyro_nonorthogonality":
        return [signal(seen, np.outer(seen.omega[:, j], eye[i]) * ARCSEC) for i, j in SKEW]
    on_gyro = {
        "gyro_scale_factor": seen.omega * PPM,
        "gyro_g_sensitivity": seen.force * (DEG_PER_HOUR / STANDARD_GRAVITY),
        "gyro_bias": np.outer(n, [DEG_PER_HOUR] * 3),
        "gyro_temperature": np.outer(seen.warmth, [DEG_PER_HOUR] * 3),
        "rate_nonlinearity": seen.omega * np.abs(seen.omega) ** (drawn.get("order", 2) - 1),
    }
    if name in on_gyro:
        return [signal(seen, np.outer(on_gyro[name][:, i], eye[i])) for i in range(3)]
    if name == "accel_scale_factor":
        return [signal(seen, accel=np.outer(seen.force[:, i], eye[i]) * PPM) for i in range(3)]
    if name == "lever_arm":
        return [signal(seen, accel=_at_lever(seen.omega, seen.omega_dot, e)) for e in eye]
    if name == "phins_attitude_error":
        wave = np.sin(2.0 * np.pi * seen.t / drawn["period"]) * ARCMIN
        return [signal(seen, attitude=np.outer(wave, e)) for e in eye]
    angle = _angle(name, seen, drawn)
    return None if angle is None else [bent(angle * ARCMIN, i) for i in range(3)]


def _angle(name: str, seen: Drive, drawn: dict) -> FloatArray | None:
    """Bending (n,) of a unit of a parameter, in arcmin."""
    if name == "misalignment_step":
        return 0.5 + 0.5 * np.tanh((seen.t - drawn["time"]) / STEP)
    if name == "thermal_bending":
        return np.sin(2.0 * np.pi * seen.t / drawn["period"])
    if name == "wave_forced_bending":
        return seen.roll / DEG
    if name == "heel_bending":
        out, share = np.empty_like(seen.lateral), STEP / 20.0
        out[0] = seen.lateral[:600].mean()
        for k in range(1, len(out)):
            out[k] = out[k - 1] + share * (seen.lateral[k] - out[k - 1])
        return out
    return None
