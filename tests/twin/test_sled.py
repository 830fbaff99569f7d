import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import quaternions
from tests.twin.worlds import PERFECT, perfect
from twin import simulate
from twin.config import Deck
from twin.sled import DeckPath

QUIET = {"mounting_arcmin": [0.0] * 3, "outlier_rate": 0.0, "position_std": 0.0, "velocity_std": 0.0}
CALM = {"pitch": [], "roll": [], "heading": []}
STIFF = {"std_arcmin": [0.0] * 3}


def test_a_run_goes_from_the_edge_to_the_centre_at_its_angle_to_port() -> None:
    path = DeckPath(Deck(angle=7.0, length=100.0, height=0.0, vertical=(0, 0, 1, 0, 1), horizontal=(0, 0, 1, 0, 1),
                         torsion=(0, 0, 1, 0, 1)))  # fmt: skip
    sled = path.at(np.array([-1.0, 10.5, 40.0]), 0.0, forward=True)
    np.testing.assert_allclose(
        sled.position[0], [100 * np.sin(np.radians(7)), -100 * np.cos(np.radians(7)), 0], atol=1e-9
    )
    np.testing.assert_allclose(sled.position[2], 0.0, atol=1e-9)
    np.testing.assert_allclose(sled.velocity[1], [-5 * np.sin(np.radians(7)), 5 * np.cos(np.radians(7)), 0], atol=1e-9)
    np.testing.assert_allclose(sled.arc_length, [0.0, 50.0, 100.0], atol=1e-9)


@pytest.mark.parametrize("forward", [True, False])
def test_velocity_acceleration_and_turning_are_derivatives_of_the_path(forward: bool) -> None:
    deck = Deck(ramp=2.0, mounting_arcmin=(30.0, -20.0, 10.0))
    path = DeckPath(deck)
    t, h = np.linspace(0.3, 21.5, 107), 1e-3
    now, after, before = (path.at(t + shift, 0.0, forward) for shift in (0.0, h, -h))
    np.testing.assert_allclose((after.position - before.position) / (2 * h), now.velocity, atol=2e-5)
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * h), now.acceleration, atol=2e-4)
    # rates of the sled in hull axes over the speed along the path are the curvature
    turn = quaternions.log(quaternions.multiply(after.q_m_sled, quaternions.conjugate(before.q_m_sled))) / (2 * h)
    speed = np.gradient(now.arc_length, t)
    along = (t > 3.0) & (t < 19.0)
    np.testing.assert_allclose(turn[along] / speed[along, None], path.curvature(now.arc_length[along]), atol=2e-8)
    assert np.sign(speed[along].mean()) == (1 if forward else -1)


def test_vertical_is_about_x_torsion_about_y_horizontal_about_z() -> None:
    deck = Deck(vertical=(1e-4, 0, 1, 0, 1), torsion=(2e-4, 0, 1, 0, 1), horizontal=(3e-4, 0, 1, 0, 1))
    np.testing.assert_allclose(DeckPath(deck).curvature(np.array([20.0])), [[1e-4, 2e-4, 3e-4]])


def test_the_sleds_gyro_shows_hull_curvature_and_its_share_of_the_flexure() -> None:
    flexure = {"damping": [0.2] * 3, "frequency": [0.5] * 3, "std_arcmin": [3.0] * 3}
    twin = perfect(run={"duration": 60.0}, flexure=flexure, deck={"passes": 1, **QUIET})
    simulation = simulate(twin)
    trial = simulation.trial
    index = np.searchsorted(trial.main.stamp, trial.sliding.stamp)
    np.testing.assert_array_equal(trial.main.stamp[index], trial.sliding.stamp)
    share = Rotation.from_rotvec(0.3 * simulation.truth.dynamic_part[index]).as_matrix()
    back = np.swapaxes(Rotation.from_rotvec(trial.main.gyro[index] * 0.01).as_matrix(), -1, -2)
    steps = Rotation.from_rotvec(trial.sliding.gyro * 0.01).as_matrix()
    R_m_sled = [share[0]]
    for undo, step in zip(back[1:], steps[1:]):
        R_m_sled.append(undo @ R_m_sled[-1] @ step)
    s = np.hypot(*(trial.sled.position - trial.sled.position[0])[:, :2].T)
    fine = np.linspace(0.0, 100.0, 20_001)
    bend = np.cumsum(DeckPath(twin.deck).curvature(0.5 * (fine[1:] + fine[:-1])), axis=0) * (fine[1] - fine[0])
    for k in (400, 700, 1500, len(s) - 1):
        shape = np.array([np.interp(s[k], fine[1:], column) for column in bend.T])
        expected = share[k] @ Rotation.from_rotvec(shape).as_matrix()
        error = Rotation.from_matrix(expected.T @ R_m_sled[k]).as_rotvec()
        assert np.abs(error).max() < 6e-6  # the order of turns along the path, (3e-3)^2/2, is left out here
    assert np.abs(shape).max() > 2e-3


def test_runs_alternate_and_pause() -> None:
    records = DeckPath(Deck(passes=3, start=10.0, pause=5.0, turnaround=10.0)).records(400.0)
    assert [forward for *_, forward in records] == [True, False, True]
    assert records[0] == (10.0, 41.0, 15.0, True)
    assert records[1][0] == pytest.approx(51.0)
    one_way = DeckPath(Deck(passes=3, alternate=False)).records(400.0)
    assert all(forward for *_, forward in one_way)


def test_runs_that_do_not_fit_are_cut_short_or_left_out() -> None:
    trial = simulate(perfect(run={"duration": 60.0}, deck={"passes": 9})).trial
    seconds = trial.seconds(trial.sliding.stamp)
    assert seconds.min() == pytest.approx(10.0)
    assert seconds.max() == pytest.approx(59.99)
    assert simulate(perfect(run={"duration": 5.0}, deck={"passes": 2})).trial.sliding is None


def test_sled_accelerometer_feels_start_and_stop_along_the_path() -> None:
    twin = perfect(run={"duration": 45.0}, sea=CALM, ship={"speed": 0.0, "heading": 0.0}, flexure=STIFF,
                   deck={"passes": 1, "angle": 0.0, **QUIET})  # fmt: skip
    trial = simulate(twin).trial
    t = trial.seconds(trial.sliding.stamp)
    starting, rest = (t > 15.0) & (t < 16.0), t < 14.9
    gained = trial.sliding.accel[starting, 1].sum() * 0.01
    assert gained == pytest.approx(5.0, abs=0.01)
    np.testing.assert_allclose(trial.sliding.accel[rest], trial.main.accel[1000 : 1000 + rest.sum()], atol=2e-5)
    np.testing.assert_allclose(trial.sled.velocity[1500], [0.0, 5.0, 0.0], atol=0.02)


def test_outliers_only_touch_the_sled() -> None:
    deck = {"passes": 2, **QUIET}
    clean = simulate(perfect(run={"duration": 100.0}, deck=deck)).trial
    dirty = simulate(
        perfect(run={"duration": 100.0}, deck={**deck, "outlier_rate": 30.0}, imu={"sliding": PERFECT})
    ).trial
    assert (np.abs(dirty.sliding.gyro - clean.sliding.gyro).max(axis=1) > 1e-3).sum() > 10
    np.testing.assert_array_equal(clean.sub.gyro, dirty.sub.gyro)
