"""Runs found in odometry, and arc length against time."""

import numpy as np
import pytest

from schemas.errors import DataError
from schemas.trial import OdometrySeries
from stages.shape.robust import hampel
from stages.shape.track import Track, track
from tests.stages.shape.generator import EPOCH, Case, trial


def found(odometry: OdometrySeries) -> Track:
    return track(odometry, (odometry.stamp - EPOCH) * 1e-9)


def odometry(**case: object) -> OdometrySeries:
    sled = trial(Case(**{"passes": 3, "flexure": (0.0, 0.0, 0.0), **case}))[0].sled  # type: ignore[arg-type]
    assert sled is not None
    return sled


def test_runs_there_and_back_count_from_the_same_end() -> None:
    path = found(odometry())
    assert [p.forward for p in path.passes] == [True, False, True]
    ends = path.arc_length(np.array([[p.begin, p.end] for p in path.passes]).ravel()).reshape(-1, 2)
    np.testing.assert_allclose(np.sort(ends, axis=1), [[0.0, 60.0]] * 3, atol=0.15)
    assert all(p.cruise == pytest.approx(4.0, rel=0.02) for p in path.passes)


def test_arc_length_is_centimetre_true_and_position_on_the_path() -> None:
    sled = odometry()
    path = found(sled)
    t = (sled.stamp - EPOCH) * 1e-9
    s = path.arc_length(t)
    raw = (sled.position - sled.position[:100].mean(axis=0)) @ path.direction
    assert np.std(s - raw) == pytest.approx(0.01, rel=0.1)  # nothing left but the odometry's own noise
    np.testing.assert_allclose(path.position(s), sled.position, atol=0.06)


def test_slow_odometry_and_missing_velocity_serve() -> None:
    sled = odometry()
    thin = OdometrySeries(sled.stamp[::5], sled.position[::5], np.zeros_like(sled.velocity[::5]))
    t = (sled.stamp - EPOCH) * 1e-9
    apart = found(thin).arc_length(t[10:-10]) - found(sled).arc_length(t[10:-10])
    assert np.std(apart) < 0.02


def test_jumps_and_missing_rows_are_left_out() -> None:
    sled = odometry()
    position, velocity = sled.position.copy(), sled.velocity.copy()
    position[::97] += 3.0
    position[::89] = np.nan
    velocity[::83] = 50.0
    bad = found(OdometrySeries(sled.stamp, position, velocity))
    good, t = found(sled), (sled.stamp - EPOCH) * 1e-9
    assert len(bad.passes) == 3
    assert np.max(np.abs(bad.arc_length(t[5:-5]) - good.arc_length(t[5:-5]))) < 0.05


def test_a_sled_carried_back_between_runs_makes_runs_in_one_direction() -> None:
    sled = odometry(there_and_back=False)
    path = found(sled)
    assert [p.forward for p in path.passes] == [True, True, True]
    t = (sled.stamp - EPOCH) * 1e-9
    raw = (sled.position - path.origin) @ path.direction
    assert np.max(np.abs(path.arc_length(t) - raw)) < 0.08


def test_a_gap_is_not_covered() -> None:
    sled = odometry()
    t = (sled.stamp - EPOCH) * 1e-9
    keep = (t < 9.0) | (t > 11.0)
    path = found(OdometrySeries(sled.stamp[keep], sled.position[keep], sled.velocity[keep]))
    assert not path.covered(np.array([9.9]), np.array([10.1]))[0]
    assert path.covered(np.array([8.0]), np.array([8.1]))[0]


def test_a_sled_at_rest_has_no_run() -> None:
    sled = odometry()
    with pytest.raises(DataError, match="no run of the sled"):
        found(OdometrySeries(sled.stamp[:150], sled.position[:150], sled.velocity[:150]))


def test_hampel_takes_its_threshold_from_the_data_and_spares_slopes() -> None:
    rng = np.random.default_rng(1)
    x = 1e-6 * rng.standard_normal((4000, 2)) + np.linspace(0.0, 2e-3, 4000)[:, None]
    x[1000, 0] += 2e-5
    flagged = hampel(x)
    assert flagged[1000, 0]
    assert flagged.sum() <= 3
