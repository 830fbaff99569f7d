import numpy as np
import pytest

from tests.twin.effects.worlds import LIVELY, STIFF, alone, pair, sine, table
from tests.twin.worlds import PERFECT

DPH = np.pi / 180 / 3600


def gyros(*effects, **tables):
    plain, changed = pair(*effects, **tables)
    return plain.trial.sub.gyro, changed.trial.sub.gyro


def test_scale_factor_is_a_ratio() -> None:
    plain, scaled = gyros(table("gyro_scale_factor", x=1000.0, y=-200.0, z=0.0))
    np.testing.assert_allclose(scaled / plain, np.tile([1.001, 0.9998, 1.0], (3000, 1)), rtol=1e-12)


def test_nonorthogonality_xy_is_the_y_rate_seen_on_x() -> None:
    angles = {"xy": 100.0, "xz": -200.0, "yx": 300.0, "yz": 50.0, "zx": -60.0, "zy": 70.0}
    plain, skewed = gyros(table("gyro_nonorthogonality", **angles), sea={"roll": [[5.0, 6.1, 40.0]]})
    matrix = np.linalg.lstsq(plain, skewed - plain, rcond=None)[0].T / (np.pi / 180 / 3600)
    expected = [[0.0, 100.0, -200.0], [300.0, 0.0, 50.0], [-60.0, 70.0, 0.0]]
    np.testing.assert_allclose(matrix, expected, atol=1e-6)


def test_g_sensitivity_is_a_regression_on_the_axis_own_force() -> None:
    plain, leaning = pair(table("gyro_g_sensitivity", x=20.0, y=-7.0, z=3.0), flexure=LIVELY)
    added = leaning.trial.sub.gyro - plain.trial.sub.gyro
    force = plain.trial.sub.accel / 9.80665
    for axis, k in enumerate([20.0, -7.0, 3.0]):
        np.testing.assert_allclose(added[:, axis], k * DPH * force[:, axis], atol=1e-12)


def test_g_sensitivity_feels_the_true_force_not_the_measured_one() -> None:
    imu = {"main": PERFECT, "sub": {**PERFECT, "accel_bias_ug": [1e5] * 3}}
    plain, leaning = gyros(table("gyro_g_sensitivity", x=20.0), imu=imu)
    bare = alone().trial.sub.accel[:, 0]
    np.testing.assert_allclose((leaning - plain)[:, 0], 20.0 * DPH * bare / 9.80665, atol=1e-12)


def test_bias_is_constant() -> None:
    plain, biased = gyros(table("gyro_bias", x=1.0, y=-2.0, z=0.5))
    np.testing.assert_allclose((biased - plain) / DPH, np.tile([1.0, -2.0, 0.5], (3000, 1)), atol=1e-9)


def test_bias_instability_has_its_spread_and_time_constant() -> None:
    run = {"duration": 800.0, "rate": 10.0}
    plain, wandering = gyros(table("gyro_bias_instability", std=2.0, tau=3.0), run=run)
    bias = (wandering - plain) / DPH
    assert np.sqrt((bias**2).mean()) == pytest.approx(2.0, rel=0.12)
    for lag in (2, 3, 6):
        correlation = (bias[10 * lag :] * bias[: -10 * lag]).mean() / (bias**2).mean()
        assert correlation == pytest.approx(np.exp(-lag / 3.0), abs=0.12)
    assert abs(np.corrcoef(bias[:, 0], bias[:, 1])[0, 1]) < 0.3


@pytest.mark.parametrize("total", [0.002, 0.02])
def test_random_walk_is_the_total(total: float) -> None:
    imu = {"main": PERFECT, "sub": {**PERFECT, "gyro_arw": 0.008}}
    noisy = alone(table("gyro_random_walk", arw=total), imu=imu, run={"duration": 100.0}).trial.sub.gyro
    angle = (noisy - alone(run={"duration": 100.0}).trial.sub.gyro).cumsum(axis=0) * 0.01
    for lag in (1, 4, 16):  # the variance of a random walk grows with the time
        growth = (angle[lag:] - angle[:-lag]).std() / np.sqrt(0.01 * lag)
        assert growth == pytest.approx(total * np.pi / 180 / 60, rel=0.06)


def test_temperature_counts_from_twenty_degrees() -> None:
    warm = {"start": 35.0, "rise_sub": 10.0, "tau": 20.0, "swing": 0.0, "noise": 0.0, "rate": 10.0}
    plain, changed = pair(table("gyro_temperature", slope=[0.5, 0.0, -1.0]), temperature=warm)
    degrees = plain.trial.temperature_sub.value
    added = (changed.trial.sub.gyro - plain.trial.sub.gyro)[::10] / DPH
    np.testing.assert_allclose(added, np.outer(degrees - 20.0, [0.5, 0.0, -1.0]), atol=1e-8)
    assert degrees[-1] - degrees[0] > 5.0


def test_a_slope_may_be_one_number_or_a_table() -> None:
    one, table_of, three = (
        alone(table("gyro_temperature", slope=slope)).trial.sub.gyro
        for slope in (0.5, {"x": 0.5, "y": 0.5, "z": 0.5}, [0.5, 0.5, 0.5])
    )
    np.testing.assert_array_equal(one, three)
    np.testing.assert_array_equal(table_of, three)


def test_quantised_increments_lie_on_the_lattice_and_lose_nothing() -> None:
    plain, counted = gyros(table("gyro_quantization", step=2.0))
    step = 2.0 / 3600 * np.pi / 180
    counts = counted * 0.01 / step
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    assert len(np.unique(np.rint(counts))) > 50
    assert np.abs(np.cumsum(counted - plain, axis=0) * 0.01).max() <= step * (0.5 + 1e-6)


def test_saturation_clips() -> None:
    plain, clipped = gyros(table("gyro_saturation", limit=4.0))
    limit = np.radians(4.0)
    np.testing.assert_array_equal(clipped, np.where(np.abs(plain) > limit, np.sign(plain) * limit, plain))
    assert (np.abs(plain) > limit).any(axis=0).sum() >= 2


@pytest.mark.parametrize(("frequency", "cutoff"), [(0.8, 2.0), (4.0, 10.0), (10.0, 10.0), (20.0, 10.0), (30.0, 80.0)])
def test_bandwidth_is_a_first_order_low_pass(frequency: float, cutoff: float) -> None:
    shake, slow = table("narrowband_vibration", frequency=frequency), table("gyro_bandwidth", cutoff=cutoff)
    tables = {"flexure": STIFF, "run": {"duration": 20.0}}
    fast = np.subtract(*(alone(*e, **tables).trial.sub.gyro[:, 2] for e in ([shake], [])))
    late = np.subtract(*(alone(*e, **tables).trial.sub.gyro[:, 2] for e in ([shake, slow], [slow])))
    t, k = np.arange(2000) * 0.01, slice(300, 1700)
    response = sine(t[k], late[k], frequency) / sine(t[k], fast[k], frequency)
    assert response == pytest.approx(1.0 / (1.0 + 1j * frequency / cutoff), abs=0.005)


def test_bandwidth_delays_the_motion_of_the_ship_and_keeps_its_ends() -> None:
    plain, slow = gyros(table("gyro_bandwidth", cutoff=10.0), flexure=STIFF)
    t, k = np.arange(3000) * 0.01, slice(20, 2980)
    expected = np.stack([np.interp(t - 1 / (2 * np.pi * 10.0), t, plain[:, i]) for i in range(3)], axis=-1)
    np.testing.assert_allclose(slow[k], expected[k], atol=3e-5)
    assert np.abs(slow - plain).max() < 6e-3


@pytest.mark.parametrize("frequency", [3.0, 30.0, 70.0])
def test_vibration_is_a_sine_averaged_over_the_samples(frequency: float) -> None:
    plain, shaken = gyros(table("narrowband_vibration", frequency=frequency, amplitude=0.05, axis="y"))
    added, t = (shaken - plain), np.arange(3000) * 0.01
    seen = sine(t, added[:, 1], frequency)
    weight = abs(np.sin(np.pi * frequency * 0.01) / (np.pi * frequency * 0.01))
    assert abs(seen) == pytest.approx(np.radians(0.05) * weight, rel=1e-6)
    assert not added[:, [0, 2]].any()


def test_outliers_come_at_their_rate_and_size() -> None:
    plain, wild = gyros(table("outliers", rate=60.0, size=0.2), run={"duration": 300.0})
    added = np.degrees(wild - plain)
    hit = np.abs(added[np.abs(added) > 1e-9])
    assert len(hit) == pytest.approx(300, abs=70)
    assert 0.1 - 1e-9 <= hit.min() < hit.max() <= 0.3 + 1e-9
    assert hit.mean() == pytest.approx(0.2, rel=0.06)
    assert 0.3 < (added[np.abs(added) > 1e-9] > 0).mean() < 0.7
