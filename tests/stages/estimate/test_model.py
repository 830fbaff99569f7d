"""The linear model against differences of whole trials: one parameter of the world is changed, all else is kept.

Prediction: the state of the change runs through (I + E) and H. Truth: the observations of the changed world minus those
of the unchanged one, both linearised about the same point.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import flexure
from physics.kalman import run_filter
from stages.estimate import model as m
from stages.paired import Observations, observe
from tests.stages.estimate.observed import observed, paired_of
from tests.stages.estimate.synthetic import World

WORLD = World(rate=100.0, duration=24.0)
GIVEN = {
    "damping": np.array([0.2, 0.15, 0.3]), "stiffness": np.array([0.09, 0.0225, 0.05]),
    "std": np.array([1e-3, 2e-3, 1.5e-3]), "gyro": np.full(3, 4e-7), "gyro_walk": 1e-9, "quasi_static": 1e-7,
    "velocity": np.full(3, 1e-4), "jitter": np.array([1e-3, 2e-3, 5e-4]), "accel": 1e-4, "accel_walk": 1e-7,
    "phi_prior": 0.01, "drift_prior": 0.01, "gyro_bias_prior": 1e-7, "delay_prior": 1e-3, "clock_prior": 1e-5,
    "accel_bias_prior": 1e-3, "lever_prior": 1.0, "coupling_prior": 0.5, "scale_prior": np.full((3, 3), 1e-4),
    "use_velocity": True, "angle_open": np.diag([1e-6, 2e-6, 4e-2]),
}  # fmt: skip
NOISE = m.Noise(**{field.name: GIVEN.get(field.name, 1e-3) for field in fields(m.Noise)})


@pytest.fixture(scope="module")
def base():
    return observed(WORLD)


def measured(obs: Observations, coupling: np.ndarray) -> np.ndarray:
    """(N, 6) z and u as the filter sees them."""
    return m.build(obs, NOISE, coupling, np.zeros(m.SIZE)).z


def predicted(obs: Observations, coupling: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(N, 6) H x, the state running through the transition from zeta_map x, dense."""
    model = m.build(obs, NOISE, coupling, np.zeros(m.SIZE))
    x, out = m.zeta_map(obs) @ x, np.empty((len(obs.dt), 6))
    for k in range(len(obs.dt)):
        E = np.zeros((m.SIZE, m.SIZE))
        np.add.at(E, (model.transition_row, model.transition_col), model.transition[k])
        x = x + E @ x
        for i in range(6):
            out[k, i] = model.measurement[k, i] @ x[model.measurement_col[i]]
    return out


def state(**blocks) -> np.ndarray:
    x = np.zeros(m.SIZE)
    for name, value in blocks.items():
        first = getattr(m, name)
        value = np.atleast_1d(value).ravel()
        x[first : first + len(value)] = value
    return x


def compare(base, world: World, x: np.ndarray, *, z_rel: float, u_rel: float, u_floor: float = 2e-7, **changed) -> None:
    obs, at = base
    other = observe(paired_of(world), replace(at, **changed))
    change = measured(other, at.coupling) - measured(obs, at.coupling)
    # A constant of V is what the initial velocity of the changed world is: it is a state of its own.
    expected = predicted(obs, at.coupling, x)
    seen = np.isfinite(change).all(axis=1)
    difference = change[seen] - expected[seen]
    z, u = np.abs(difference[:, :3]).max(), np.abs(difference[:, 3:]).max()
    z_size, u_size = np.abs(expected[seen, :3]).max(), np.abs(expected[seen, 3:]).max()
    assert z <= z_rel * z_size + 1e-11, f"z: {z:.3g} of {z_size:.3g}"
    assert u <= u_rel * u_size + u_floor, f"u: {u:.3g} of {u_size:.3g}"


def start_velocity(base, world: World) -> np.ndarray:
    """V: minus the change of the velocity at the start, which the integrals do not know; axes of A_m(0) = I."""
    obs, _ = base
    turn = WORLD.main(obs.t[:1])[0].inv()
    return -turn.apply(world.velocity(obs.t[:1])[0] - WORLD.velocity(obs.t[:1])[0])


def test_drift_turns_attitudes_and_gravity(base) -> None:
    _, at = base
    d = np.array([2e-6, -1e-6, 3e-6])
    R_0 = Rotation.from_rotvec(d).as_matrix() @ at.R_0
    # Log(Exp(a) Exp(theta)) = a + theta + a x theta / 2, theta up to 3e-3.
    compare(base, WORLD, state(D=d), z_rel=2e-3, u_rel=2e-3, R_0=R_0)


def test_gyro_bias(base) -> None:
    eps = np.array([1e-7, -2e-7, 1.5e-7])  # m-axes, mean; flexure turns it by 0.1 degrees
    bias = Rotation.from_rotvec(WORLD.static).inv().apply(eps)
    # V takes d from the start of each step: half a step of its growth, dt over the record's length, is left out.
    compare(base, replace(WORLD, gyro_bias=bias), state(EPS=eps), z_rel=3e-3, u_rel=0.015)


def test_bias_that_both_gyros_share_is_seen_by_the_lever_arm_alone(base) -> None:
    obs, at = base
    bias = np.array([1e-5, -2e-5, 1.5e-5])
    world = replace(WORLD, main_bias=bias, gyro_bias=Rotation.from_rotvec(WORLD.static).inv().apply(bias))
    other = observe(paired_of(world), at)
    # V begins at minus the velocity that the integrals do not know, and the bias turns the axes it is seen in.
    start = -WORLD.main(obs.t[:1])[0].inv().apply(WORLD.velocity(obs.t[:1])[0])
    shown = [measured(one, at.coupling)[:, 3:] - np.einsum("kji,j->ki", one.A_mid, start) for one in (other, obs)]
    expected = predicted(obs, at.coupling, state(BIAS_MAIN=bias))[2:, 3:]
    # Flexure turns the sub's bias by 0.1 degrees against the main one's: that is drift, and moves V by gravity.
    assert np.abs((shown[0] - shown[1])[2:] - expected).max() < 0.15 * np.abs(expected).max()


@pytest.mark.parametrize("unit", ["main", "sub"])
def test_noise_of_either_gyro_reaches_the_velocity_through_its_own_door(base, unit: str) -> None:
    """One step disturbed. The sub's error passes for flexure, which the step of d undoes; the main one's is in omega
    and in flexure with opposite signs, and nothing has to be undone."""
    obs, at = base
    k, turn = 60, np.array([3e-8, -2e-8, 1e-8])
    trial = WORLD.trial()
    series = getattr(trial, unit)
    gyro = series.gyro.copy()
    in_m = Rotation.from_matrix(at.R_ref) if unit == "sub" else Rotation.identity()
    inside = slice(*np.searchsorted(trial.seconds(series.stamp), obs.t[obs.index[[k - 1, k]]] + 1e-6))
    gyro[inside] += in_m.inv().apply(turn) / obs.dt[k]
    disturbed = replace(trial, **{unit: replace(series, gyro=gyro)})
    obs, other = (observe(paired_of(WORLD, one, despike=False), at) for one in (trial, disturbed))
    model = m.build(obs, NOISE, at.coupling, np.zeros(m.SIZE))
    d = obs.A_mid[k] @ turn * (1.0 if unit == "sub" else -1.0)
    x = state(D=d, STEP_D=d if unit == "sub" else np.zeros(3))
    predicted_u = [model.measurement[k, 3 + i] @ x[model.measurement_col[3 + i]] for i in range(3)]
    change = (measured(other, at.coupling) - measured(obs, at.coupling))[k]
    np.testing.assert_allclose(change[:3], obs.A_end[k].T @ d, atol=1e-2 * np.linalg.norm(turn))
    size = np.linalg.norm(np.cross(WORLD.lever, turn)) / obs.dt[k]
    np.testing.assert_allclose(change[3:], predicted_u, atol=0.1 * size)


def test_gyro_scale_and_nonorthogonality(base) -> None:
    M = 1e-6 * np.array([[1.0, -0.5, 0.3], [0.7, -1.2, 0.4], [-0.6, 0.9, 0.8]])
    R = Rotation.from_rotvec(WORLD.static).as_matrix()
    # omega of the main stands for that of the sub: flexure's own rate, a per cent of it, is left out.
    compare(base, replace(WORLD, scale=R.T @ M @ R), state(M=M), z_rel=0.03, u_rel=0.05)


def test_delay(base) -> None:
    delay = 2e-5
    world = replace(WORLD, delay=delay)
    obs, _ = base
    start = obs.t[:1]
    turn = WORLD.main(start) * WORLD.total(start)
    late = WORLD.main(start - delay) * WORLD.total(start - delay)
    d = (WORLD.main(start).inv() * turn * late.inv() * WORLD.main(start)).as_rotvec()[0]
    # The path starts late: d, and the velocity gained in the delay. Flexure's own rate, a per cent, is left out.
    gained = WORLD.main(start)[0].inv().apply((turn.apply(WORLD.force("sub", start)) * delay)[0])
    compare(base, world, state(DELAY=delay, D=d, V=gained), z_rel=0.015, u_rel=0.01)


def test_drift_of_the_delay(base) -> None:
    drift = 2e-6
    obs, _ = base
    start, delay = obs.t[:1], drift * obs.centred[0]
    turn = WORLD.main(start) * WORLD.total(start)
    late = WORLD.main(start - delay) * WORLD.total(start - delay)
    d = (WORLD.main(start).inv() * turn * late.inv() * WORLD.main(start)).as_rotvec()[0]
    gained = WORLD.main(start)[0].inv().apply((turn.apply(WORLD.force("sub", start)) * delay)[0])
    # B omega_s drift, a per cent of the rest, is left out.
    compare(base, replace(WORLD, drift=drift), state(DRIFT=drift, D=d, V=gained), z_rel=0.015, u_rel=0.02)


def test_accelerometer_bias(base) -> None:
    nabla = np.array([1e-4, -2e-4, 1.5e-4])
    bias = Rotation.from_rotvec(WORLD.static).inv().apply(nabla)
    compare(base, replace(WORLD, accel_bias=bias), state(NABLA=nabla), z_rel=0.0, u_rel=5e-3)


def test_lever_arm_with_its_rigid_coupling(base) -> None:
    """A longer arm moves as a whole; what flexure adds at the new arm is B's business, kept at the old one here."""
    change = np.array([0.02, -0.01, 0.03])
    world = replace(WORLD, lever=WORLD.lever + change, coupling=WORLD.coupled)
    compare(base, world, state(R=change, V=start_velocity(base, world)), z_rel=0.0, u_rel=1e-3)


def test_coupling_of_flexure_into_the_lever_arm(base) -> None:
    """Fast bending (B) and slow bending (kappa) changed alike: what a world with one coupling does."""
    kappa = np.array([0.02, -0.03, 0.01])
    change = WORLD.coupled @ np.diag(kappa)
    world = replace(WORLD, coupling=WORLD.coupled + change)
    compare(base, world, state(B=change, KAPPA=kappa, V=start_velocity(base, world)), z_rel=0.0, u_rel=2e-3)


def test_displacement_that_the_lever_arm_lacks_is_seen_as_its_difference_over_the_step(base) -> None:
    """n white: the velocity (n_k - n_k-1)/dt has variance 2 n^2/dt^2 and half of it, negative, from step to step."""
    obs, at = base
    model = m.build(obs, NOISE, at.coupling, np.zeros(m.SIZE))
    E, Q = np.zeros((2, m.SIZE, m.SIZE)), np.zeros((m.SIZE, m.SIZE))
    for j, k in enumerate((40, 41)):
        np.add.at(E[j], (model.transition_row, model.transition_col), model.transition[k])
    np.add.at(Q, (model.noise_row, model.noise_col), model.noise[40])
    jitter = np.arange(m.JITTER, m.JITTER + 6)
    F, Q = np.eye(6) + E[:, jitter][:, :, jitter], Q[np.ix_(jitter, jitter)]
    P = F[0] @ np.diag(np.tile(NOISE.jitter**2, 2)) @ F[0].T + Q
    for i in range(3):
        H = np.zeros((2, m.SIZE))
        np.add.at(H, (0, model.measurement_col[3 + i]), model.measurement[40, 3 + i])
        np.add.at(H, (1, model.measurement_col[3 + i]), model.measurement[41, 3 + i])
        now, then = H[1, jitter], H[0, jitter]
        size = (NOISE.jitter[i] / obs.dt[40]) ** 2
        assert then @ P @ then == pytest.approx(2 * size, rel=1e-6)
        assert now @ F[1] @ P @ then == pytest.approx(-size, rel=1e-6)


def test_initial_velocity_alone(base) -> None:
    """V is constant in i and seen in m."""
    obs, at = base
    v = np.array([0.3, -0.2, 0.1])
    expected = np.einsum("kji,j->ki", obs.A_mid, v)
    np.testing.assert_allclose(predicted(obs, at.coupling, state(V=v))[2:, 3:], expected[2:], atol=1e-12)


def test_static_angle_is_shown_whole_and_moves_no_lever_arm(base) -> None:
    """A mount that settles does not move the place: u takes -omega x B Phi, as of an arm shorter by B Phi."""
    change = np.array([2e-5, -1e-5, 3e-5])
    obs, _ = base
    static = (Rotation.from_rotvec(change) * Rotation.from_rotvec(WORLD.static)).as_rotvec()
    world = replace(WORLD, static=static, coupling=WORLD.coupled)
    start = WORLD.total(obs.t[:1])[0] * world.total(obs.t[:1])[0].inv()
    x = state(PHI=change, D=start.as_rotvec(), R=-WORLD.coupled @ change)
    # Log(Exp(theta) Exp(Phi)) = theta + Phi + theta x Phi / 2, while Phi and d nearly cancel.
    compare(base, world, x, z_rel=0.02, u_rel=0.01)


def test_flexure_leaves_the_second_measurement_alone(base) -> None:
    """With z in hand, u needs neither theta nor its rate: another flexure changes V's start and nothing else."""
    obs, at = base
    world = replace(WORLD, bend=1.1 * WORLD.bend)
    turn = WORLD.total(obs.t[:1])[0] * world.total(obs.t[:1])[0].inv()
    x = state(V=start_velocity(base, world), D=turn.as_rotvec())
    other = observe(paired_of(world), at)
    change = (measured(other, at.coupling) - measured(obs, at.coupling))[2:, 3:]
    raw = (other.u - obs.u)[2:]
    left = change - predicted(obs, at.coupling, x)[2:, 3:]
    assert np.abs(left).max() < 0.02 * np.abs(raw - raw.mean(axis=0)).max()


def test_flexure_steps_are_the_exact_discretisation_and_zeta_carries_the_rest(base) -> None:
    """theta stepped by F while Phi, d, delay stay: zeta(k) = F theta + Phi + A_m(k)^T d - omega_s(k) delay."""
    obs, at = base
    x = state(ZETA=[1e-3, -2e-3, 1e-3], THETA_DOT=[1e-4, 2e-4, -3e-4], PHI=[3e-3, 1e-3, -1e-3], DELAY=1e-3,
              PHI_DOT=[1e-6, -2e-6, 0.0], D=[1e-3, 2e-3, -1e-3], DRIFT=1e-6)  # fmt: skip
    found = predicted(obs, at.coupling, x)[:, :3]
    for axis in range(3):
        F = flexure.transition(NOISE.damping[axis], NOISE.stiffness[axis], obs.t[obs.index] - obs.t[0])
        theta = F[:, 0] @ np.array([x[m.ZETA + axis], x[m.THETA_DOT + axis]])
        static = x[m.PHI + axis] + x[m.PHI_DOT + axis] * (obs.t[obs.index] - obs.t[0])
        delay = x[m.DELAY] + x[m.DRIFT] * obs.centred
        drift = np.einsum("kj,j->k", obs.A_end[:, :, axis], x[m.D : m.D + 3])
        expected = theta + static + drift - obs.rate_m[:, axis] * delay
        np.testing.assert_allclose(found[:, axis], expected, atol=1e-12)


def test_process_noise_of_the_gyros_is_the_same_in_d_and_in_what_the_attitudes_show(base) -> None:
    """zeta' = A_m^T d' + ...: one noise in two places, of variance N^2 dt per axis."""
    obs, _ = base
    model = m.build(obs, replace(NOISE, gyro=np.full(3, 1e-3)), -np.eye(3), np.zeros(m.SIZE))
    k = 37
    Q = np.zeros((m.SIZE, m.SIZE))
    np.add.at(Q, (model.noise_row, model.noise_col), model.noise[k])
    Q = np.triu(Q) + np.triu(Q, 1).T
    d, zeta = slice(m.D, m.D + 3), slice(m.ZETA, m.ZETA + 3)
    np.testing.assert_allclose(Q[d, d], 1e-6 * obs.dt[k] * np.eye(3), rtol=0.02, atol=1e-9)
    flex = np.diag([flexure.noise_covariance(NOISE.damping[i], NOISE.stiffness[i], NOISE.std[i], obs.dt[k])[0, 0]
                    for i in range(3)])  # fmt: skip
    A = obs.A_end[k]
    np.testing.assert_allclose(Q[zeta, zeta] - flex, A.T @ Q[d, d] @ A, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(Q[zeta, d], A.T @ Q[d, d], rtol=1e-9, atol=1e-15)
    assert np.linalg.eigvalsh(Q).min() > -1e-16


def test_the_step_of_d_holds_the_sub_gyros_noise_alone(base) -> None:
    obs, _ = base
    noise = replace(NOISE, gyro=np.full(3, 1e-3))
    model = m.build(replace(obs, main_noise=(0.8e-6, 1e-12)), noise, -np.eye(3), np.zeros(m.SIZE))
    k = 37
    Q = np.zeros((m.SIZE, m.SIZE))
    np.add.at(Q, (model.noise_row, model.noise_col), model.noise[k])
    Q = np.triu(Q) + np.triu(Q, 1).T
    step, d, zeta = (slice(first, first + 3) for first in (m.STEP_D, m.D, m.ZETA))
    np.testing.assert_allclose(Q[step, step], 0.2 * Q[d, d], rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(Q[step, d], 0.2 * Q[d, d], rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(Q[step, zeta], 0.2 * Q[d, zeta], rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize(
    ("main_noise", "share"),
    [((0.0, np.inf), 0.5), ((0.0, 1e3), 0.5), ((0.3, 1e-9), 0.3), ((2.0, 1e-9), 1.0), ((-0.1, 1e-9), 0.0)],
)
def test_share_of_the_main_gyro_is_what_the_record_tells_of_it(base, main_noise, share) -> None:
    noise = replace(NOISE, gyro=np.ones(3))
    assert m.main_share(replace(base[0], main_noise=main_noise), noise) == pytest.approx(share, abs=1e-6)


def test_prior_of_what_the_attitudes_show_is_that_of_its_parts(base) -> None:
    obs, _ = base
    P = m.build(obs, NOISE, -np.eye(3), np.zeros(m.SIZE)).P0
    zeta = slice(m.ZETA, m.ZETA + 3)
    rate = obs.rate_m[0]
    clock = NOISE.delay_prior**2 + (NOISE.clock_prior * obs.centred[0]) ** 2
    expected = np.diag(NOISE.std**2) + (NOISE.phi_prior**2 + NOISE.drift_prior**2) * np.eye(3) + 2.0 * NOISE.angle_open
    np.testing.assert_allclose(P[zeta, zeta], expected + clock * np.outer(rate, rate), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(
        P[zeta, m.PHI : m.PHI + 3], NOISE.phi_prior**2 * np.eye(3) + NOISE.angle_open, rtol=1e-12
    )


def test_without_velocity_nothing_of_it_is_measured_or_stepped(base) -> None:
    obs, at = base
    model = m.build(obs, replace(NOISE, use_velocity=False), at.coupling, np.zeros(m.SIZE))
    assert np.isnan(model.z[:, 3:]).all()
    assert not np.isin(model.transition_row, np.arange(m.V, m.V + 3)).any()


def test_model_in_pieces_is_the_model_as_a_whole(base, monkeypatch) -> None:
    obs, at = base
    whole = m.build(obs, NOISE, at.coupling, np.zeros(m.SIZE))
    monkeypatch.setattr(m, "PIECE", 47)
    made = [piece() for piece in m.pieces(obs, NOISE, at.coupling, np.zeros(m.SIZE))]
    assert len(made) > 2
    for name in ("transition", "noise", "measurement", "z", "variance"):
        np.testing.assert_array_equal(np.concatenate([getattr(one, name) for one in made]), getattr(whole, name))
    np.testing.assert_array_equal(made[0].P0, whole.P0)


def test_gyros_alone_see_only_their_states(base) -> None:
    obs, at = base
    noise = replace(NOISE, use_velocity=False)
    whole = run_filter(m.build(obs, noise, at.coupling, np.zeros(m.SIZE)), np.arange(m.SIZE))
    (piece,) = m.pieces(obs, noise, at.coupling, np.zeros(m.SIZE))
    kept = m.states(noise)
    small = run_filter(piece(), np.arange(len(kept)))
    assert small.log_likelihood == pytest.approx(whole.log_likelihood, rel=1e-9)
    np.testing.assert_allclose(small.x[-1], whole.x[-1][kept], rtol=1e-6, atol=1e-12)
