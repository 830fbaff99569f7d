import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.twin.effects.worlds import LIVELY, STIFF, alone, pair, table


@pytest.mark.parametrize("samples", [1, 4, -2])
def test_delay_shifts_the_sub_imu_and_nothing_else(samples: int) -> None:
    plain, late = pair(table("time_delay", delay=0.01 * samples), run={"duration": 12.0}, flexure=LIVELY)
    k = np.arange(10, 1190)
    for key in ("gyro", "accel"):
        a, b = getattr(plain.trial.sub, key), getattr(late.trial.sub, key)
        np.testing.assert_allclose(b[k], a[k - samples], atol=1e-9)
        assert np.abs(b[k] - a[k]).max() > 1e-4


def test_delay_adds_to_that_of_the_twin() -> None:
    mount = {"time_delay": 0.02}
    _, late = pair(table("time_delay", delay=0.03), run={"duration": 12.0}, mount=mount, flexure=LIVELY)
    plain = alone(run={"duration": 12.0}, flexure=LIVELY)
    np.testing.assert_allclose(late.trial.sub.gyro[100:], plain.trial.sub.gyro[95:-5], atol=1e-12)


def test_a_delay_between_samples_leaves_the_flexure_as_drawn() -> None:
    plain, late = pair(table("time_delay", delay=0.0123), run={"duration": 20.0}, flexure=LIVELY)
    np.testing.assert_array_equal(late.truth.dynamic_part, plain.truth.dynamic_part)
    before, after = (CubicSpline(np.arange(2000) * 0.01, x.trial.sub.gyro) for x in (plain, late))
    t = np.arange(2.0, 18.0, 0.01)
    np.testing.assert_allclose(after(t), before(t - 0.0123), atol=1e-4)  # the forcing is white: no closer
    assert np.abs(after(t) - before(t)).max() > 1e-3


@pytest.mark.parametrize("drift", [2000.0, -2000.0])
def test_a_fast_clock_makes_the_delay_grow_from_nothing(drift: float) -> None:
    plain, late = pair(table("clock_drift", drift=drift), run={"duration": 40.0}, flexure=STIFF)
    t = np.arange(4000) * 0.01
    exact = CubicSpline(t - 0.005, plain.trial.sub.gyro)
    k = np.arange(20, 3980)
    middle = (t[k] - 0.005) / (1.0 + drift * 1e-6)  # true time when the clock says t
    np.testing.assert_allclose(late.trial.sub.gyro[k], exact(middle), atol=1e-7)
    assert np.abs(late.trial.sub.gyro - plain.trial.sub.gyro)[:20].max() < 1e-4
    assert np.abs(late.trial.sub.gyro - plain.trial.sub.gyro)[3500:].max() > 5e-3


def test_jitter_scatters_stamps_alone() -> None:
    plain, shaken = pair(table("timestamp_jitter", std=2e-4), run={"duration": 60.0})
    error = (shaken.trial.sub.stamp - plain.trial.sub.stamp) * 1e-9
    assert error.std() == pytest.approx(2e-4, rel=0.04)
    assert abs(error.mean()) < 4 * 2e-4 / np.sqrt(6000)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.06
    np.testing.assert_array_equal(shaken.trial.sub.gyro, plain.trial.sub.gyro)
    np.testing.assert_array_equal(shaken.trial.main.stamp, plain.trial.main.stamp)


def test_stamps_stay_in_order_however_large_the_jitter() -> None:
    shaken = alone(table("timestamp_jitter", std=0.05), run={"duration": 20.0})
    assert (np.diff(shaken.trial.sub.stamp) > 0).all()


def test_dropouts_come_at_their_rate_and_length() -> None:
    plain, broken = pair(table("sample_dropout", rate=0.5, length=4), run={"duration": 300.0})
    lost = 30_000 - len(broken.trial.sub)
    gaps = np.diff(broken.trial.sub.stamp) // 10_000_000 - 1
    runs, expected = gaps[gaps > 0], 150
    assert (runs == 4).mean() > 0.85  # the others are two that overlap
    assert runs.max() < 12
    assert len(runs) == pytest.approx(expected, abs=4 * np.sqrt(expected))
    assert lost == pytest.approx(expected * 4, rel=0.35)
    kept = np.isin(plain.trial.sub.stamp, broken.trial.sub.stamp)
    np.testing.assert_array_equal(broken.trial.sub.gyro, plain.trial.sub.gyro[kept])
