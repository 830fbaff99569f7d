"""Sampling, delay, lever arm, PHINS and seeds of whole simulations."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.twin.worlds import angle_between, enu_to_inertial, perfect
from twin import make_twin, simulate
from twin.sampling import mean_force, substeps
from twin.sea import realise
from twin.simulation import STREAMS, make_world, nodes

STIFF = {"std_arcmin": [0.0] * 3}
LIVELY = {"damping": [0.3] * 3, "frequency": [0.8, 0.6, 0.5], "std_arcmin": [6.0, 6.0, 10.0]}


def world_of(twin):
    return make_world(twin, dict(zip(STREAMS, np.random.default_rng(twin.run.seed).spawn(len(STREAMS)))))


@pytest.mark.parametrize("delay", [0.075, -0.25])
def test_a_sub_sample_stamped_t_was_measured_at_t_minus_the_delay(delay: float) -> None:
    twin = perfect(
        run={"duration": 12.0, "rate": 200.0}, mount={"time_delay": delay}, flexure=LIVELY, gnss={"rate": 50.0}
    )
    simulation = simulate(twin)
    fix = simulation.trial.gnss  # every fourth sample
    t = np.arange(len(fix.latitude)) / 50.0
    R_i_s = enu_to_inertial(fix.latitude, fix.longitude, t) @ (
        Rotation.from_quat(simulation.truth.attitude[::4]).as_matrix()
    )
    steps = Rotation.from_rotvec(simulation.trial.sub.gyro / 200.0).as_matrix()
    lag = round(delay * 200)
    for k in range(100, 500, 7):  # the turn from fix k to k + 1 is in the samples stamped a delay later
        turn = np.eye(3)
        for step in steps[4 * k + 1 + lag : 4 * k + 5 + lag]:
            turn = turn @ step
        assert angle_between(R_i_s[k].T @ R_i_s[k + 1], turn) < 1e-11


def test_a_delay_of_part_of_a_sample_is_exact() -> None:
    twin = perfect(run={"duration": 5.0}, mount={"time_delay": 0.0123, "static_arcmin": [0.0] * 3}, flexure=STIFF)
    simulation = simulate(twin)
    ship, t = world_of(twin).scene.ship, np.arange(500) * 0.01 - 0.0123
    q0, q1 = (Rotation.from_quat(ship.at(x).q_i_m) for x in (t - 0.01, t))
    np.testing.assert_allclose(simulation.trial.sub.gyro, (q0.inv() * q1).as_rotvec() / 0.01, atol=1e-12)
    assert np.abs(simulation.trial.sub.gyro - simulation.trial.main.gyro).max() > 1e-4


def test_truth_is_that_of_the_stamp_whatever_the_delay() -> None:
    twin = perfect(run={"duration": 5.0}, mount={"time_delay": 0.5}, flexure=LIVELY)
    simulation = simulate(twin)
    relative = Rotation.from_quat(simulation.trial.phins_main.attitude).inv() * Rotation.from_quat(
        simulation.trial.phins_sub.attitude
    )
    np.testing.assert_allclose(relative.as_rotvec(), simulation.truth.total, atol=1e-12)


def test_lever_arm_force_is_the_second_difference_of_the_subs_place() -> None:
    twin = perfect(
        run={"duration": 20.0}, mount={"lever_arm": [-4.0, 36.0, 3.0], "lever_bandwidth": 2.0}, flexure=LIVELY
    )
    world = world_of(twin)
    t, h, arm = np.linspace(2.0, 18.0, 161), 0.004, np.array([-4.0, 36.0, 3.0])

    def place(time: np.ndarray) -> np.ndarray:
        bend = world.lever.at(time)[0]
        return Rotation.from_quat(world.scene.motion(time).q_i_m).apply(arm + np.cross(bend, arm))

    weight = np.array([-1, 16, -30, 16, -1]) / 12.0
    nodes = world.flexure.tick * 1e-10
    t_node = nodes[np.searchsorted(nodes, t)]
    acceleration = sum(w * place(t_node + (k - 2) * h) for k, w in enumerate(weight)) / h**2
    motion = world.scene.motion(t_node)
    body = world.sub(motion)
    in_space = Rotation.from_quat(body.q_i_b).apply(body.force)
    main = Rotation.from_quat(motion.q_i_m).apply(motion.specific_force)
    np.testing.assert_allclose(in_space - main, acceleration, atol=1e-5)
    assert np.abs(world.lever.at(t_node)[2]).max() * 36.0 > 1e-3  # bending does move it


@pytest.mark.parametrize(("cutoff", "limit"), [(0.5, 6e-6), (5.0, 2e-4)])
def test_force_means_do_not_change_when_the_quadrature_is_refined(cutoff: float, limit: float) -> None:
    """Here at 5 ms against 10 ms; what is left comes from theta'' being white (0.6 ug) and the lever arm's band."""
    twin = perfect(run={"duration": 10.0, "rate": 50.0}, flexure=LIVELY, mount={"lever_bandwidth": cutoff})
    world = world_of(twin)
    every = world.per_sample
    assert every == substeps(50.0, cutoff) == 4
    force = world.sub(world.scene.motion(nodes(10, 400, every, 50.0))).force
    fine, coarse = mean_force(force, every), mean_force(force[::2], 2)
    assert np.abs(fine - coarse).max() < limit
    np.testing.assert_allclose(fine.mean(axis=0), coarse.mean(axis=0), atol=1e-6)


def test_samples_at_half_the_rate_are_means_of_two() -> None:
    fast, slow = (simulate(perfect(run={"duration": 10.0, "rate": r}, flexure=STIFF)).trial for r in (200.0, 100.0))
    # the slow sample k ends where the fast sample 2 k does
    np.testing.assert_allclose(slow.sub.accel[1:], (0.5 * (fast.sub.accel[1:-1:2] + fast.sub.accel[2::2])), atol=1e-9)
    first, second = (Rotation.from_rotvec(fast.sub.gyro[k::2][:999] / 200) for k in (1, 2))
    np.testing.assert_allclose((first * second).as_rotvec() * 100, slow.sub.gyro[1:], atol=1e-12)


def test_mean_force_is_exact_for_cubics() -> None:
    t = np.linspace(0.0, 3.0, 13)
    force = np.stack([np.ones_like(t), t, t**3], axis=-1)
    means = mean_force(force, 4)
    edges = np.arange(4.0)
    np.testing.assert_allclose(means[:, 2], np.diff(edges**4) / 4, rtol=1e-14)
    np.testing.assert_allclose(means[:, 1], [0.5, 1.5, 2.5], rtol=1e-14)


def test_phins_axes_are_turned_for_rates_and_force_too() -> None:
    turned = {"installation_main_deg": [-0.041, 0.430, -0.250], "installation_sub_deg": [5.0, -20.0, 90.0]}
    trial = simulate(perfect(run={"duration": 3.0}, phins=turned, flexure=LIVELY)).trial
    for unit, phins, angles in (
        (trial.main, trial.phins_main, turned["installation_main_deg"]),
        (trial.sub, trial.phins_sub, turned["installation_sub_deg"]),
    ):
        pitch, roll, heading = angles
        R_imu_phins = Rotation.from_euler("ZXY", [heading, pitch, roll], degrees=True)
        np.testing.assert_allclose(R_imu_phins.apply(phins.gyro), unit.gyro, atol=1e-13)
        np.testing.assert_allclose(R_imu_phins.apply(phins.accel), unit.accel, atol=1e-12)


def test_the_same_seed_gives_the_same_trial_and_another_seed_another() -> None:
    twin = make_twin({"run": {"duration": 30.0}, "deck": {"passes": 1}, "sea": {"model": "spectrum"}})
    first, again, other = (simulate(twin, np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert_same(first.trial, again.trial)
    assert not np.allclose(first.trial.main.gyro, other.trial.main.gyro)
    assert_same(simulate(twin).trial, simulate(twin, np.random.default_rng(twin.run.seed)).trial)


def assert_same(a, b) -> None:
    for item in fields(a):
        left, right = getattr(a, item.name), getattr(b, item.name)
        if isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right)
        elif hasattr(left, "__dataclass_fields__"):
            assert_same(left, right)


def test_leaving_a_channel_out_changes_no_other() -> None:
    full = simulate(make_twin({"run": {"duration": 20.0}, "deck": {}})).trial
    bare = simulate(make_twin({"run": {"duration": 20.0}, "channels": {"phins": False, "gnss": False}})).trial
    assert bare.phins_main is bare.gnss is bare.sliding is None
    np.testing.assert_array_equal(full.sub.gyro, bare.sub.gyro)
    np.testing.assert_array_equal(full.temperature_sub.value, bare.temperature_sub.value)


@pytest.mark.parametrize("rate", [10.0, 30.0, 100.0, 200.0])
def test_stamps_are_whole_nanoseconds_on_the_rate(rate: float) -> None:
    trial = simulate(perfect(run={"duration": 4.0, "rate": rate, "start": 1_700_000_000})).trial
    assert trial.main.stamp[0] == trial.epoch == 1_700_000_000 * 10**9
    assert len(trial.main) == 4 * rate
    np.testing.assert_allclose(np.diff(trial.main.stamp), 1e9 / rate, atol=1.0)
    assert trial.main.stamp[int(rate)] - trial.epoch == 10**9
    assert len(trial.gnss.stamp) == 4


def test_long_records_are_worked_out_in_slabs_without_a_seam() -> None:
    trial = simulate(perfect(run={"duration": 400.0}, flexure=STIFF)).trial  # more than one slab of 32 768 samples
    for channel in (trial.main.gyro, trial.sub.gyro, trial.sub.accel):
        bend = np.abs(np.diff(channel, 3, axis=0))
        assert bend[32_760:32_775].max() <= bend[:30_000].max()


def test_temperatures_warm_up() -> None:
    quiet = {"noise": 0.0, "rise_main": 8.0, "rise_sub": 10.0, "tau": 10.0, "swing": 0.0}
    trial = simulate(perfect(run={"duration": 60.0}, temperature=quiet)).trial
    np.testing.assert_allclose(trial.temperature_main.value[[0, 10, 59]], [20.0, 28 - 8 / np.e, 28.0], atol=0.03)
    assert trial.temperature_sub.value[-1] == pytest.approx(30.0, abs=0.03)


def test_a_spectral_sea_is_drawn_from_the_generator() -> None:
    twin = perfect(sea={"model": "spectrum"})
    rows = realise(twin.sea, np.random.default_rng(1))
    assert len(rows["roll"].amplitude) == twin.sea.components
