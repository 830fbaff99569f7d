"""Logs for the checks at full rate: a broadband sea, two IMUs, reality a little beside what the engineer believes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from schemas.trial import Trial
from stages.align import align
from stages.diagnose import spectra
from stages.diagnose.spectra import FullRateResidual
from twin import load_twin, simulate
from twin.config import EffectSpec, Twin
from twin.effects._change import section, sub_imu


@lru_cache(maxsize=32)
def drawn(seed: int, duration: float = 240.0, effects: tuple[tuple[str, tuple], ...] = ()) -> tuple[Trial, Twin]:
    """A log, and the twin an engineer would believe. effects: (name, ((parameter, value), ...))."""
    rng = np.random.default_rng(seed)
    belief = section(load_twin("random-sea"), "run", duration=duration)
    belief = section(
        belief, "flexure", damping=tuple(rng.uniform(0.06, 0.25, 3)), frequency=tuple(rng.uniform(0.15, 0.9, 3)),
        std_arcmin=tuple(rng.uniform(2.0, 6.0, 3)),
    )  # fmt: skip
    real = section(belief, "flexure", **{key: _near(getattr(belief.flexure, key), 0.05, rng)
                                         for key in ("damping", "frequency", "std_arcmin")})  # fmt: skip
    real = sub_imu(real, gyro_arw=0.001 * float(np.exp(0.03 * rng.standard_normal())),
                   gyro_bias_dph=tuple(rng.normal(0.0, 0.02, 3)))  # fmt: skip
    static = tuple(np.array(belief.mount.static_arcmin) + rng.normal(0.0, 3.0, 3))
    real = section(real, "mount", static_arcmin=static)
    real = section(real, "channels", phins=False, gnss=False, temperature=False)
    real = real.model_copy(update={"effect": tuple(EffectSpec(name=name, **dict(given)) for name, given in effects)})
    return simulate(real, np.random.default_rng(seed + 10**6)).trial, belief


@lru_cache(maxsize=32)
def residual_of(
    seed: int, duration: float = 240.0, effects: tuple[tuple[str, tuple], ...] = ()
) -> tuple[FullRateResidual, Twin]:
    """The rate residual of such a log."""
    trial, belief = drawn(seed, duration, effects)
    return spectra.residual(trial, align(trial), belief), belief


def _near(values: tuple[float, ...], share: float, rng: np.random.Generator) -> tuple[float, ...]:
    return tuple(float(v * np.exp(share * rng.standard_normal())) for v in values)
