"""The twin's prediction of a log and what is left of it: nuisances re-fitted, innovations whitened.

Nuisances (biases, static angle, how flexure moves the lever arm, PHINS installation) are regressors with the prior
that a twin deserves; flexure, displacement and accelerometer noise and the PHINS' noise are fitted by likelihood. What
is left is white where the twin is right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.kalman import SparseModel, run_filter
from physics.rotations import exp
from physics.units import ARCMIN, DEG_PER_HOUR, MICRO_G
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from stages import identify
from stages.diagnose import whitening
from stages.diagnose.columns import Response, trapezoid_means
from stages.diagnose.evidence import solve
from stages.diagnose.view import Believed
from stages.diagnose.whitening import AccelColour, Levels, PhinsMatch, Whitened
from stages.estimate import tuning
from stages.paired import Linearisation, Observations, Paired, observe, pair
from twin.bending import quasi_static
from twin.effects._prediction import Signals, on_axis

GYRO_BIAS = 0.05 * DEG_PER_HOUR  # how far a twin's figure may be off without being a gap, one sigma
ACCEL_BIAS = 50.0 * MICRO_G
STATIC = 5.0 * ARCMIN
COLOUR = 20.0 * MICRO_G  # where the search for the accelerometers' coloured noise begins
COLOUR_TAU = 3.0  # s
PILOT_S = 400.0  # of record on which noise is found
PER_STEP = (
    "index", "dt", "jump_s", "gap_end", "z", "u", "A_start", "A_end", "A_mid", "omega", "rate_m", "force_i", "force_m",
    "centred",
)  # fmt: skip
JUMP_SIGMA, MOST_JUMPS = 6.0, 8
IMPULSE = 0.01  # rad
SLOW_SHARE = 0.1  # of the quasi-static amplitude
INSTALLATION = 2.0 * ARCMIN
COUPLING_SHARE = 0.1  # of the lever arm
LAGGING_HZ = (0.5, 2.0, 8.0)
IN_PHASE_HZ = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0)
FACTORS = ((0.05, 20.0), (0.2, 5.0), (0.4, 2.5), (0.6, 1.6), (0.8, 1.25))  # tried on each noise level, round by round
JITTER, VELOCITY = 2e-5, 1e-5  # m, m/s, where the search begins; the floors are those of rounding

Factors = tuple[float, ...]
Change = Callable[[Levels, FloatArray], Levels]
STATES = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Nuisance:
    """A regressor (N, 9) with the standard deviation of its prior."""

    name: str
    column: FloatArray
    sigma: float


@dataclass(frozen=True)
class Baseline:
    """One linearisation of a log, whitened; columns: (N, 9, K) of the nuisances, whitened."""

    source: Believed
    at: Linearisation
    paired: Paired
    obs: Observations
    match: PhinsMatch | None
    flexure: FlexureModel
    levels: Levels
    whitened: Whitened
    nuisances: tuple[Nuisance, ...]
    columns: FloatArray
    response: Response
    jumps: tuple[float, ...]

    @property
    def t(self) -> FloatArray:
        """(N,) s, ends of the steps."""
        return self.obs.t[self.obs.index]

    @property
    def precision(self) -> FloatArray:
        """(K,) of the nuisances' priors."""
        return np.array([1.0 / n.sigma**2 for n in self.nuisances])

    def residual(self) -> FloatArray:
        """(N, 9) innovations less the nuisances' fit, NaN where masked."""
        return residual(self.whitened, self.columns, self.precision)


def baseline(source: Believed, coarse: Alignment, start: Levels | None = None) -> Baseline:
    """Whiten a log about what its twin says; coarse: what the log's alignment says, to carry units across gaps.

    start: noise of a baseline of nearly the same log, from which the search goes on. Raises DataError where the units
    hardly overlap.
    """
    believed = _aligned(source, coarse)
    paired = pair(source.trial, believed, despike=False)  # a step of the mounting is a spike of its gyro
    flexure = tuning.separable(identify.get("whittle")().identify(source.trial, believed))
    at = Linearisation.at(believed, source.lever_arm)
    obs = _without_slow_bending(observe(paired, at), source)
    response = Response(obs, at.R_ref, at.coupling)
    nuisances = (*_nuisances(obs, at, response), *_slow_bending(source, response))
    tuner = _Tuner(obs, at, whitening.phins_match(source.trial, obs), nuisances)
    levels = _first_levels(source, believed, flexure)
    jumps = step_times(tuner, tuner.whitened(levels)[0])
    tuner = replace(tuner, nuisances=(*tuner.nuisances, *_impulses(jumps, response)))
    levels = tuner.tuned(levels, FACTORS) if start is None else tuner.tuned(_resumed(levels, start), FACTORS[2:])
    whitened, columns = tuner.whitened(levels)
    return Baseline(
        source, at, paired, obs, tuner.match, flexure, levels, whitened, tuner.nuisances, columns, response, jumps
    )


def _without_slow_bending(obs: Observations, source: Believed) -> Observations:
    """The observations less the quasi-static bending that the twin says, which moves the lever arm as any bending."""
    belief = source.twin.flexure
    if not any(belief.quasi_static_amplitude_arcmin):
        return obs
    return replace(obs, z=obs.z - quasi_static(belief, obs.t)[obs.index])


def _slow_bending(source: Believed, response: Response) -> list[Nuisance]:
    """Its amplitude and phase are never exactly the twin's."""
    belief, out = source.twin.flexure, []
    phase = 2.0 * np.pi * response.obs.t / belief.quasi_static_period
    for axis, amplitude in enumerate(belief.quasi_static_amplitude_arcmin):
        if amplitude:
            for name, wave in (("sine", np.sin(phase)), ("cosine", np.cos(phase))):
                bending = response(Signals(bending=on_axis(axis, wave)))
                sigma = SLOW_SHARE * abs(amplitude) * ARCMIN
                out.append(Nuisance(f"slow bending {name} {'xyz'[axis]}", bending, sigma))
    return out


def extended(base: Baseline, more: Sequence[Nuisance]) -> Baseline:
    """The baseline with further regressors that have priors."""
    if not more:
        return base
    raw = np.stack([nuisance.column for nuisance in more], axis=2)
    columns = np.concatenate([base.columns, whitening.whiten_columns(base.whitened, raw)], axis=2)
    return replace(base, nuisances=(*base.nuisances, *more), columns=columns)


def _first_levels(source: Believed, believed: Alignment, flexure: FlexureModel) -> Levels:
    noise = tuning.with_flexure(tuning.initial(believed, flexure, source.trial.rig), flexure)
    noise = replace(noise, jitter=np.full(3, JITTER), velocity=np.full(3, VELOCITY))
    return Levels(noise, AccelColour(np.full(3, COLOUR), COLOUR_TAU), whitening.phins_noise(source.twin.phins))


def _resumed(fresh: Levels, start: Levels) -> Levels:
    """The earlier levels with the flexure found now."""
    old = start.noise
    noise = replace(fresh.noise, jitter=old.jitter, velocity=old.velocity, accel=old.accel)
    return Levels(noise, start.colour, start.phins)


def step_times(tuner: _Tuner, whitened: Whitened) -> tuple[float, ...]:
    """Instants (s since the epoch), to the sample, at which the attitude jumps by far more than flexure can."""
    found = whitened.filtered
    size = np.abs(found.innovation[:, :3] / np.sqrt(found.innovation_variance[:, :3])) / whitened.scale[:3]
    size = np.where(np.isfinite(size), size, 0.0).max(axis=1)
    size[whitening.masked(tuner.obs, 1)[:, 0]] = 0.0
    theta = full_rate(tuner.obs, tuner.at.R_ref)
    high = [int(k) for k in np.argsort(size)[::-1][:MOST_JUMPS] if size[k] > JUMP_SIGMA]
    return tuple(float(tuner.obs.t[_largest_jump(theta, tuner.obs.index[k - 1], tuner.obs.index[k])]) for k in high)


def _largest_jump(theta: FloatArray, first: int, last: int) -> int:
    """The sample up to which theta changes most."""
    return first + 1 + int(np.argmax(np.abs(np.diff(theta[first : last + 1], axis=0)).max(axis=1)))


def _impulses(times: Sequence[float], response: Response) -> list[Nuisance]:
    """A single false gyro sample at each time, rad about each axis."""
    t, out = response.obs.t, []
    for time in times:
        k = int(np.argmin(np.abs(t - time)))
        for axis in range(3):
            one = np.zeros((len(t), 3))
            one[k, axis] = 1.0 / response.dt[k]
            out.append(Nuisance(f"impulse {time:.2f} s {'xyz'[axis]}", response(Signals(gyro=one)), IMPULSE))
    return out


def _aligned(source: Believed, coarse: Alignment) -> Alignment:
    """Static angle and delay as the twin says: what the log adds to them is for the regression to find."""
    mount = source.twin.mount
    delay = replace(coarse.time_delay, value=np.array(mount.time_delay))
    return replace(
        coarse, rotation=exp(source.static), static=replace(coarse.static, value=source.static), time_delay=delay
    )


@dataclass(frozen=True)
class _Tuner:
    obs: Observations
    at: Linearisation
    match: PhinsMatch | None
    nuisances: tuple[Nuisance, ...]

    @property
    def raw(self) -> FloatArray:
        return np.stack([n.column for n in self.nuisances], axis=2)

    @property
    def precision(self) -> FloatArray:
        return np.array([1.0 / n.sigma**2 for n in self.nuisances])

    def whitened(self, levels: Levels) -> tuple[Whitened, FloatArray]:
        """Innovations and nuisances, both scaled so that what the nuisances leave has unit variance per channel."""
        found = whitening.whiten(self._model(levels), self.obs)
        left = residual(found, whitening.whiten_columns(found, self.raw), self.precision)
        found = whitening.rescaled(found, left)
        return found, whitening.whiten_columns(found, self.raw)

    def _model(self, levels: Levels) -> SparseModel:
        return whitening.build(self.obs, levels, self.at.coupling, self.match)

    def tuned(self, levels: Levels, rounds: Sequence[Factors]) -> Levels:
        """All noise by likelihood of the middle of the log less its nuisances."""
        pilot = self._pilot()
        for factors in rounds:
            found, columns = pilot.whitened(levels)
            levels = pilot._less(_fit(found, columns, self.precision)).climbed(levels, factors)
        return levels

    def _pilot(self) -> _Tuner:
        """The middle of a long record."""
        t = self.obs.t[self.obs.index]
        if t[-1] - t[0] <= 1.5 * PILOT_S:
            return self
        middle = 0.5 * (t[0] + t[-1])
        part = slice(*np.searchsorted(t, [middle - 0.5 * PILOT_S, middle + 0.5 * PILOT_S]))
        cut = {name: getattr(self.obs, name)[part] for name in PER_STEP}
        match = self.match and PhinsMatch(self.match.q[part], self.match.C[part], self.match.count[part])
        nuisances = tuple(replace(n, column=n.column[part]) for n in self.nuisances)
        return replace(self, obs=replace(self.obs, **cut), match=match, nuisances=nuisances)

    def _less(self, value: FloatArray) -> _Tuner:
        """The same with the nuisances' fit taken off the observations."""
        off = self.raw @ value
        obs = replace(self.obs, z=self.obs.z - off[:, :3], u=self.obs.u - off[:, 3:6])
        match = None if self.match is None else replace(self.match, q=self.match.q - off[:, 6:9])
        return replace(self, obs=obs, match=match)

    def climbed(self, levels: Levels, factors: Factors) -> Levels:
        """One round over all levels, a factor at a time; axes apart where they have levels of their own."""
        changes: list[Change] = [_jitter, _velocity, _colour, _accel, _colour_tau]
        if self.match is not None:
            changes += [_white, _drift, _tau]
        tried = np.array([1.0, *factors])
        now = self.channels(levels)
        for change in changes:
            told = np.stack([now, *(self.channels(change(levels, np.full(3, f))) for f in factors)])
            if change in PER_AXIS:
                chosen = tried[np.argmax(told[:, 3:6], axis=0)]
            else:
                chosen = np.full(3, tried[int(np.argmax(told.sum(axis=1)))])
            if np.any(chosen != 1.0):
                levels = change(levels, chosen)
                now = self.channels(levels)
        return levels

    def channels(self, levels: Levels) -> FloatArray:
        """(9,) log-likelihood of the innovations of each channel."""
        found = run_filter(self._model(levels), STATES, keep=False)
        S = found.innovation_variance
        return np.asarray(-0.5 * np.nansum(np.log(S) + found.innovation**2 / S, axis=0))


def _jitter(levels: Levels, factor: FloatArray) -> Levels:
    jitter = np.maximum(factor * levels.noise.jitter, 1e-8)
    return replace(levels, noise=replace(levels.noise, jitter=jitter))


def _velocity(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, noise=replace(levels.noise, velocity=np.maximum(factor * levels.noise.velocity, 1e-8)))


def _accel(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, noise=replace(levels.noise, accel=float(factor[0]) * levels.noise.accel))


def _colour(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, colour=replace(levels.colour, std=np.maximum(factor * levels.colour.std, 1e-7)))


def _colour_tau(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, colour=replace(levels.colour, tau=float(np.clip(factor[0] * levels.colour.tau, 0.3, 100.0))))


def _white(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, phins=replace(levels.phins, white=float(factor[0]) * levels.phins.white))


def _drift(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, phins=replace(levels.phins, drift=factor[0] * levels.phins.drift))


def _tau(levels: Levels, factor: FloatArray) -> Levels:
    phins, f = levels.phins, float(factor[0])
    return replace(levels, phins=replace(phins, tau=f * phins.tau, drift=np.sqrt(f) * phins.drift))


PER_AXIS = (_jitter, _velocity, _colour)


def _nuisances(obs: Observations, at: Linearisation, response: Response) -> tuple[Nuisance, ...]:
    one = np.ones(len(obs.t))
    kinds: tuple[tuple[str, Callable[[FloatArray], Signals], float], ...] = (
        ("gyro bias", lambda x: Signals(gyro=x), GYRO_BIAS),
        ("accel bias", lambda x: Signals(accel=x), ACCEL_BIAS),
        ("static", lambda x: Signals(mount=x), STATIC),
        ("installation", lambda x: Signals(phins=x), INSTALLATION),
    )
    constants = [
        Nuisance(f"{kind} {'xyz'[axis]}", response(signals(on_axis(axis, one))), sigma)
        for kind, signals, sigma in kinds
        for axis in range(3)
    ]
    return (*constants, *_couplings(obs, at))


def _couplings(obs: Observations, at: Linearisation) -> list[Nuisance]:
    """How flexure moves the lever arm: each element of B, and each column's share above a corner frequency.

    The lever follows flexure only below some frequency, with a lag or without: what it lacks is a mixture of
    ``theta - LP(theta)`` over corners, with first-order filters of either kind.
    """
    theta = full_rate(obs, at.R_ref)
    size = COUPLING_SHARE * max(float(np.linalg.norm(at.lever_arm)), 1.0)
    moved = _moved(obs, theta)
    out = [
        Nuisance(f"coupling {'xyz'[i]}{'xyz'[j]}", _on_u(moved(theta, np.eye(3)[i][:, None] * np.eye(3)[j])), size)
        for i in range(3)
        for j in range(3)
    ]
    step = float(np.median(np.diff(obs.t)))
    for kind, corners in (("lagging", LAGGING_HZ), ("in phase", IN_PHASE_HZ)):
        for corner in corners:
            lost = _low_pass(theta, min(corner * step, 0.45), kind == "in phase") - theta
            for j in range(3):
                column = _on_u(moved(lost, at.coupling[:, [j]] * np.eye(3)[j]))
                out.append(Nuisance(f"lever {kind} {corner:g} Hz {'xyz'[j]}", column, 1.0))
    return out


def full_rate(obs: Observations, R_ref: FloatArray) -> FloatArray:
    """(n, 3) rad, Log(Y R_ref^T) at the samples."""
    back = quaternions.exp(-Rotation.from_matrix(R_ref).as_rotvec())
    Y = quaternions.multiply(quaternions.conjugate(obs.main.attitude), obs.sub.attitude)
    return quaternions.log(quaternions.multiply(Y, back[None, :]))


def _moved(obs: Observations, theta: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Velocity (N, 3) that a displacement B angle (n, 3) of the lever arm shows in u."""

    def velocity(angle: FloatArray, B: FloatArray) -> FloatArray:
        moved = angle @ B.T
        out = np.cross(obs.omega, trapezoid_means(moved, obs.index))
        at_steps = moved[obs.index]
        out[1:] += np.diff(at_steps, axis=0) / obs.dt[1:, None]
        return out

    return velocity


def _low_pass(x: FloatArray, corner: float, in_phase: bool) -> FloatArray:
    """Corner as a share of the rate: first order and lagging, or second-order Butterworth from either side."""
    start = x[0]
    if in_phase:
        sos = butter(2, 2.0 * corner, output="sos")
        return np.asarray(sosfiltfilt(sos, x - start, axis=0) + start)
    a = np.exp(-2.0 * np.pi * corner)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x - start, axis=0) + start)


def _on_u(u: FloatArray) -> FloatArray:
    return np.hstack([np.zeros_like(u), u, np.zeros_like(u)])


def _fit(whitened: Whitened, columns: FloatArray, precision: FloatArray) -> FloatArray:
    ok = np.isfinite(whitened.values)
    Z = np.column_stack([columns[ok], whitened.values[ok]])
    return solve(Z.T @ Z, precision, range(columns.shape[2])).value


def residual(whitened: Whitened, columns: FloatArray, precision: FloatArray) -> FloatArray:
    """(N, m) innovations less the nuisances' fit, NaN where masked."""
    return np.asarray(whitened.values - columns @ _fit(whitened, columns, precision))


def names(items: Sequence[Nuisance]) -> tuple[str, ...]:
    """Of the regressors, in order."""
    return tuple(item.name for item in items)
