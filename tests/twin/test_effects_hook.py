"""What an effect can reach: a probe registered for the test acts through every hook."""

from typing import ClassVar

import numpy as np
import pytest

from schemas.errors import DataError
from tests.twin.worlds import perfect
from twin import effects, parse_twin, simulate
from twin.effects import Effect


class Probe(Effect):
    """Does one thing through one hook."""

    name: ClassVar[str] = "probe"
    hook: str
    size: float = 1.0

    def twin(self, twin):
        if self.hook != "twin":
            return twin
        return twin.model_copy(update={"mount": twin.mount.model_copy(update={"time_delay": self.size})})

    def sub_clock(self, t):
        return t * (1.0 + self.size) if self.hook == "sub_clock" else t

    def phins_clock(self, unit, t):
        return t - self.size if self.hook == "phins_clock" else t

    def flexure(self, t, theta, scene, rng):
        return theta + self.size * np.sin(t)[:, None] if self.hook == "flexure" else theta

    def mount(self, t, phi, scene):
        return phi + np.outer(t > 5.0, [self.size, 0, 0]) if self.hook == "mount" else phi

    def gyro(self, unit, t, gyro, accel, scene, rng):
        return gyro + self.size * scene.angles(t) if self.hook == "gyro" and unit == "sub" else gyro

    def accel(self, unit, t, accel, scene, rng):
        return accel + scene.specific_force(t) * self.size if self.hook == "accel" and unit == "sub" else accel

    def attitude(self, unit, t, attitude, scene, rng):
        return -attitude if self.hook == "attitude" and unit == "phins_sub" else attitude

    def imu(self, unit, series, scene, rng):
        if self.hook != "imu" or unit != "sub":
            return series
        return type(series)(series.stamp[::2], series.gyro[::2], series.accel[::2])


@pytest.fixture(autouse=True)
def probe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(effects.REGISTRY, "probe", f"{__name__}:Probe")


def trials(hook: str, size: float):
    run = {"duration": 10.0}
    plain = simulate(perfect(run=run))
    return plain, simulate(perfect(run=run, effect=[{"name": "probe", "hook": hook, "size": size}]))


def test_parameters_of_the_twin() -> None:
    plain, changed = trials("twin", 0.02)
    np.testing.assert_allclose(changed.trial.main.gyro, plain.trial.main.gyro, atol=1e-13)
    assert np.abs(changed.trial.sub.gyro - plain.trial.sub.gyro).max() > 1e-4


def test_clock_of_the_sub_imu() -> None:
    plain, changed = trials("sub_clock", 1e-3)
    assert np.abs(changed.trial.sub.gyro - plain.trial.sub.gyro)[:50].max() < 1e-3
    assert np.abs(changed.trial.sub.gyro - plain.trial.sub.gyro)[900:].max() > 5e-4


def test_clock_of_a_phins() -> None:
    _, changed = trials("phins_clock", 0.05)
    late, main = changed.trial.phins_main.attitude, simulate(perfect(run={"duration": 10.0})).trial.phins_main.attitude
    np.testing.assert_allclose(np.abs((late[5:] * main[:-5]).sum(axis=1)), 1.0, atol=1e-13)


def test_flexure_reaches_truth_gyro_and_lever_arm() -> None:
    plain, changed = trials("flexure", 1e-3)
    t = np.arange(1000) * 0.01
    bent = changed.truth.dynamic_part - plain.truth.dynamic_part
    np.testing.assert_allclose(bent, np.tile(1e-3 * np.sin(t)[:, None], 3), atol=1e-12)
    assert np.abs(changed.trial.sub.gyro - plain.trial.sub.gyro).max() == pytest.approx(1e-3, rel=0.3)
    assert np.abs(changed.trial.sub.accel - plain.trial.sub.accel).max() > 5e-3


def test_a_step_of_the_mounting_moves_truth_but_not_the_lever_arm() -> None:
    plain, changed = trials("mount", 1e-3)
    step = changed.truth.static_part - plain.truth.static_part
    np.testing.assert_allclose(step[[0, 499, 502, 999], 0], [0.0, 0.0, 1e-3, 1e-3], atol=1e-15)
    turned = np.linalg.norm(changed.trial.sub.accel, axis=1) - np.linalg.norm(plain.trial.sub.accel, axis=1)
    assert np.abs(turned).max() < 1e-4
    assert np.abs(changed.trial.sub.accel - plain.trial.sub.accel)[510:].max() > 5e-3


def test_ideal_samples_know_the_scene() -> None:
    plain, changed = trials("gyro", 1e-4)
    added = changed.trial.sub.gyro - plain.trial.sub.gyro
    assert np.abs(added[:, 1]).max() == pytest.approx(1e-4 * np.radians(10), rel=0.01)
    plain, changed = trials("accel", 1e-3)
    assert (changed.trial.sub.accel - plain.trial.sub.accel)[:, 2].mean() == pytest.approx(9.7e-3, rel=0.02)


def test_finished_series_and_attitudes() -> None:
    plain, changed = trials("imu", 1.0)
    assert len(changed.trial.sub) == len(plain.trial.sub) // 2
    plain, changed = trials("attitude", 1.0)
    np.testing.assert_array_equal(changed.trial.phins_sub.attitude, -plain.trial.phins_sub.attitude)
    np.testing.assert_array_equal(changed.trial.phins_main.attitude, plain.trial.phins_main.attitude)


def test_an_effect_that_does_nothing_changes_nothing() -> None:
    plain, changed = trials("none", 1.0)
    np.testing.assert_array_equal(changed.trial.sub.gyro, plain.trial.sub.gyro)
    np.testing.assert_array_equal(changed.truth.total, plain.truth.total)


def test_unknown_names_and_wrong_parameters_are_told() -> None:
    with pytest.raises(DataError, match=r"no effect named 'kraken' \(known effects: .*probe"):
        parse_twin('[[effect]]\nname = "kraken"')
    with pytest.raises(DataError, match=r"effect 'probe'.*arms"):
        parse_twin('[[effect]]\nname = "probe"\nhook = "imu"\narms = 8')
    with pytest.raises(DataError, match=r"effect\.0\.name"):
        parse_twin("[[effect]]\ndelay = 1")
