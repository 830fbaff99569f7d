"""How strong a hidden effect is drawn: multiples of the smallest severity that a good diagnosis can detect.

The unit of severity is a figure measured for 30 min and navigation-grade units; it grows as a power of 30 min over the
duration and, for effects that compete with the sensors' noise, with the grade. Where the log's own sea, axis or flexure
make the bound of :mod:`pipeline.blind.reality.limits` larger, that is the unit. Vector effects act mostly on one axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG, DEG_PER_SQRT_HOUR
from pipeline.blind.reality import limits
from pipeline.blind.reality.nature import Nature
from pipeline.blind.reality.scenes import GRADES, Scene
from twin.config import Flexure, Twin

FloatArray = NDArray[np.float64]

Parameters = dict[str, Any]
AXES = ("x", "y", "z")
PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")


@dataclass(frozen=True)
class Draw:
    """What parameters are drawn from.

    severity: the multiple. factor: severity times what duration and grade make of it. rates: rad/s rms about x, y, z.
    bound: from what shapes the effect to the smallest detectable values, None where there is no bound.
    plainness: from other flexure to the multiple of the detectable that it is.
    """

    twin: Twin
    severity: float
    factor: float
    rates: tuple[float, float, float]
    rng: np.random.Generator
    bound: Callable[[Parameters], FloatArray | None]
    plainness: Callable[[Parameters], float]

    def sign(self) -> float:
        """Either."""
        return float(self.rng.choice([-1.0, 1.0]))

    def about(self, value: float) -> float:
        """Within 15 % of a value."""
        return value * float(self.rng.uniform(0.85, 1.15))

    def axis(self) -> str:
        """One of three."""
        return str(self.rng.choice(AXES))

    def sizes(self, units: Sequence[float], shape: Parameters) -> list[float]:
        """Each the larger of factor x unit and severity x bound, within 15 %."""
        bound = self.bound(shape)
        floors = np.zeros(len(units)) if bound is None else bound
        return [self.about(max(self.factor * u, self.severity * float(b))) for u, b in zip(units, floors)]

    def vector(self, *unit: float, keys: tuple[str, ...] = AXES, shape: Parameters | None = None) -> Parameters:
        """Sizes of either sign (unit: one for all, or one each): on one axis two times of three, else on all."""
        units = unit * len(keys) if len(unit) == 1 else unit
        chosen = set(keys) if self.rng.uniform() < 1.0 / 3.0 else {str(self.rng.choice(keys))}
        sizes = self.sizes(units, shape or {})
        return {k: self.sign() * size if k in chosen else 0.0 for k, size in zip(keys, sizes)} | (shape or {})

    def listed(self, key: str, *unit: float, shape: Parameters | None = None) -> Parameters:
        """The same as a list under a key."""
        values = self.vector(*unit, shape=shape)
        return {key: [values[axis] for axis in AXES]} | (shape or {})

    def rate(self, low: float, high: float, per: float) -> float:
        """Events per ``per`` s between low and high, such that a whole number, at least one, falls in the record."""
        count = max(1.0, np.round(self.rng.uniform(low, high) * self.twin.run.duration / per))
        return float(count * per / self.twin.run.duration)

    def period(self, low: float, high: float) -> float:
        """Drawn evenly in its logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))


def _time_delay(d: Draw) -> Parameters:
    return {"delay": d.sign() * d.sizes([4e-5], {})[0]}


def _clock_drift(d: Draw) -> Parameters:
    return {"drift": d.sign() * d.sizes([0.04], {})[0]}


def _jitter(d: Draw) -> Parameters:
    return {"std": d.about(2e-5 * d.severity)}


def _dropout(d: Draw) -> Parameters:
    return {"rate": d.rate(0.0085 * d.severity, 0.0115 * d.severity, 1.0), "length": int(d.rng.integers(1, 11))}


def _instability(d: Draw) -> Parameters:
    return {"std": d.about(0.35 * d.factor), "tau": d.period(60.0, 600.0)}


def _random_walk(d: Draw) -> Parameters:
    own = d.twin.imu.sub.gyro_arw
    return {"arw": own + d.sizes([0.15 * own], {})[0]}


def _quantization(d: Draw) -> Parameters:
    return {"step": d.about(0.01 * d.severity * d.twin.imu.sub.gyro_arw / 0.001)}


def _saturation(d: Draw) -> Parameters:
    return {"limit": float(np.degrees(d.rates[1])) * d.about(2.6 * d.severity**-0.25)}


def _bandwidth(d: Draw) -> Parameters:
    return {"cutoff": d.about(80.0 * d.factor**-0.75)}


def _step(d: Draw) -> Parameters:
    return d.vector(0.5, shape={"time": float(d.rng.uniform(0.2, 0.8)) * d.twin.run.duration})


def _thermal(d: Draw) -> Parameters:
    return d.listed("amplitude", 4.5, 4.5, 13.0, shape={"period": d.period(0.8, 4.0) * d.twin.run.duration})


def _flexure(d: Draw) -> Parameters:
    """mu, lambda or sigma off on one axis or on all: the first of them that can be off so plainly.

    A damping seldom can: a deck tells it to 1 / sqrt(mu T), in 10 min a tenth or more.
    """
    swings = min(d.twin.flexure.frequency) > 0.0
    kinds = [("damping",), ("std_arcmin",), ("damping", "std_arcmin"), ("frequency",)][: 4 if swings else 3]
    axes = range(3) if d.rng.uniform() < 1.0 / 3.0 else [int(d.rng.integers(3))]
    sign, least = d.sign(), np.log(1.0 + d.about(0.4 * d.severity**0.6))
    off: Parameters = {}
    for k in d.rng.permutation(len(kinds)):
        for size in np.linspace(least, np.log(MOST_OFF), 8):
            off = _flexure_off(d.twin.flexure, kinds[k], axes, float(np.exp(sign * size)))
            if d.plainness(off) >= d.severity:
                return off
    return off


def _flexure_off(believed: Flexure, kinds: Sequence[str], axes: Sequence[int], factor: float) -> Parameters:
    return {
        kind: [value * factor if axis in axes else None for axis, value in enumerate(getattr(believed, kind))]
        for kind in kinds
    }


def _second_mode(d: Draw) -> Parameters:
    frequency = d.period(1.8, 6.0)
    size = 0.2 * (2.0 / frequency) ** 1.8 * d.factor
    return {
        "damping": float(d.rng.uniform(0.05, 0.25)), "frequency": frequency, "std_arcmin": d.about(size),
        "axis": d.axis(),
    }  # fmt: skip


def _coupling(d: Draw) -> Parameters:
    pair = str(d.rng.choice(["xy", "xz", "yz"]))
    return {key: d.sign() * min(d.about(0.05 * d.factor), 0.9) if key == pair else 0.0 for key in ("xy", "xz", "yz")}


def _stiffening(d: Draw) -> Parameters:
    return {"gain": d.about(0.006 * d.factor)}


def _slamming(d: Draw) -> Parameters:
    return {
        "rate": d.rate(0.1, 0.5, 60.0), "amplitude": d.sign() * d.about(2.0 * d.severity),
        "frequency": float(d.rng.uniform(5.0, 12.0)), "damping": float(d.rng.uniform(0.3, 1.2)),
    }  # fmt: skip


def _nonstationary(d: Draw) -> Parameters:
    return {"growth": (1.0 + d.about(0.08 * d.factor)) ** d.sign()}


def _vibration(d: Draw) -> Parameters:
    frequency = d.period(1.0, 40.0)
    shape = {"frequency": frequency, "axis": d.axis()}
    return {"amplitude": d.sizes([7e-4 * frequency**-0.95], shape)[0]} | shape


def _phins_error(d: Draw) -> Parameters:
    period = d.period(45.0, 0.6 * d.twin.run.duration)
    return d.vector(0.1 * (period / 45.0) ** 0.84, shape={"period": period})


def _outliers(d: Draw) -> Parameters:
    return {"rate": d.rate(0.3, 4.0, 60.0), "size": d.about(0.01 * d.severity)}


def _nonlinearity(d: Draw) -> Parameters:
    order = int(d.rng.choice([2, 3]))
    return d.vector(*(1e-4 / rate ** (order - 1) for rate in d.rates), shape={"order": order})


def _swinging_clock(d: Draw) -> Parameters:
    shape = {"period": d.period(60.0, 240.0)}
    return {"amplitude": d.sizes([1e-4], shape)[0]} | shape


def _bouc_wen(d: Draw) -> Parameters:
    shape = {"yield_sigmas": float(d.rng.uniform(0.6, 1.4))}
    return {"hysteretic_share": min(d.sizes([0.0], shape)[0], MOST_HYSTERETIC)} | shape


def _fractional(d: Draw) -> Parameters:
    return {"order": float(d.rng.choice([-1.0, 1.0])) * min(0.06 * d.factor, 0.5), "knee": d.period(0.2, 1.0)}


@dataclass(frozen=True)
class Severity:
    """How to draw an effect's parameters; its unit grows as (30 min / duration)^power, and with the grade."""

    parameters: Callable[[Draw], Parameters]
    power: float = 0.5
    graded: bool = True


def _vector(*unit: float, keys: tuple[str, ...] = AXES) -> Callable[[Draw], Parameters]:
    return lambda d: d.vector(*unit, keys=keys)


SEVERITIES: dict[str, Severity] = {
    "time_delay": Severity(_time_delay),
    "clock_drift": Severity(_clock_drift, power=1.5),
    "timestamp_jitter": Severity(_jitter, 0.0, False),
    "sample_dropout": Severity(_dropout, 0.0, False),
    "gyro_scale_factor": Severity(_vector(50.0)),
    "gyro_nonorthogonality": Severity(_vector(16.0, keys=PAIRS)),
    "gyro_g_sensitivity": Severity(_vector(5.0, 5.0, 0.12)),
    "gyro_bias": Severity(_vector(0.26, 0.26, 0.09)),
    "gyro_bias_instability": Severity(_instability),
    "gyro_random_walk": Severity(_random_walk, 0.0, False),
    "gyro_temperature": Severity(lambda d: d.listed("slope", 0.03)),
    "gyro_quantization": Severity(_quantization, 0.0, False),
    "gyro_saturation": Severity(_saturation, 0.0, False),
    "gyro_bandwidth": Severity(_bandwidth, 0.0),
    "accel_bias": Severity(_vector(250.0), 0.0),
    "accel_scale_factor": Severity(_vector(60.0)),
    "lever_arm": Severity(_vector(0.004), 0.5),
    "static_misalignment": Severity(_vector(3.2, 3.2, 9.1), graded=False),
    "misalignment_step": Severity(_step, 0.0),
    "thermal_bending": Severity(_thermal, graded=False),
    "flexure_parameters": Severity(_flexure, 0.0, False),
    "second_mode": Severity(_second_mode),
    "axis_coupling": Severity(_coupling, graded=False),
    "amplitude_stiffening": Severity(_stiffening, graded=False),
    "wave_forced_bending": Severity(_vector(0.1), graded=False),
    "heel_bending": Severity(_vector(4.0), graded=False),
    "slamming": Severity(_slamming, 0.0, False),
    "nonstationary_sea": Severity(_nonstationary, graded=False),
    "narrowband_vibration": Severity(_vibration),
    "phins_latency": Severity(lambda d: {"delay": d.about(6e-5 * d.factor)}),
    "phins_attitude_error": Severity(_phins_error),
    "outliers": Severity(_outliers, 0.0, False),
    "bouc_wen": Severity(_bouc_wen, 0.0, False),
    "rate_nonlinearity": Severity(_nonlinearity),
    "fractional_flexure": Severity(_fractional, graded=False),
    "sinusoidal_clock": Severity(_swinging_clock),
}
FOREIGN = ("bouc_wen", "rate_nonlinearity", "fractional_flexure", "sinusoidal_clock")
LISTED = tuple(name for name in SEVERITIES if name not in FOREIGN)
REFERENCE = 1800.0  # s
MOST_OFF = 4.0  # factor of a flexure's parameter, beyond which she would be another ship
MOST_HYSTERETIC = 0.9  # of the stiffness: with more the deck would not come back


def _least_walk(nature: Nature, shape: Parameters) -> FloatArray:
    """Beyond what the gyros have."""
    return np.array([(limits.random_walk(nature) - nature.sub.arw) / DEG_PER_SQRT_HOUR])


def _least_vibration(nature: Nature, shape: Parameters) -> FloatArray:
    return np.array([limits.vibration(nature, shape["frequency"], AXES.index(shape["axis"])) / DEG])


STOCHASTIC: dict[str, Callable[[Nature, Parameters], FloatArray]] = {
    "bouc_wen": lambda nature, shape: limits.hysteresis(nature, shape["yield_sigmas"]),
    "gyro_random_walk": _least_walk,
    "narrowband_vibration": _least_vibration,
}


def plain(values: Any) -> Any:
    """Numbers and lists of Python's own, as a document has them."""
    if isinstance(values, dict):
        return {key: plain(value) for key, value in values.items()}
    if isinstance(values, list | tuple | np.ndarray):
        return [plain(value) for value in values]
    return values.item() if isinstance(values, np.generic) else values


def reached(name: str, severity: float, drawn: Parameters, scene: Scene) -> float:
    """The severity asked for, or the lesser one of what cannot be plainer: a hysteresis, a flexure."""
    if name == "bouc_wen":
        least = float(limits.hysteresis(scene.nature, drawn["yield_sigmas"])[0])
        return min(severity, drawn["hysteretic_share"] / least)
    return min(severity, _plainness(scene, drawn)) if name == "flexure_parameters" else severity


def _plainness(scene: Scene, off: Parameters) -> float:
    """Of flexure with other parameters than the twin's."""
    believed = scene.twin.flexure
    stated = {
        key: tuple(old if new is None else new for new, old in zip(values, getattr(believed, key)))
        for key, values in off.items()
    }
    return limits.flexure(scene.nature, believed, believed.model_copy(update=stated))


def parameters(name: str, severity: float, scene: Scene, rng: np.random.Generator) -> Parameters:
    """The effect's parameters in the units of the log contract, for a scene without it."""
    how, twin, grade = SEVERITIES[name], scene.twin, GRADES[scene.grade]
    factor = severity * (REFERENCE / twin.run.duration) ** how.power * (grade if how.graded else 1.0)

    def bound(shape: Parameters) -> FloatArray | None:
        if name in STOCHASTIC:
            return STOCHASTIC[name](scene.nature, shape)
        seen = limits.drive(scene.nature)
        columns = limits.unit_signals(name, seen, shape)
        return None if columns is None else limits.limit(scene.nature, columns, seen)

    draw = Draw(twin, severity, factor, scene.rates, rng, bound, partial(_plainness, scene))
    return plain(how.parameters(draw))
