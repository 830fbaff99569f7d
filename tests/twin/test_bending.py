import numpy as np
import pytest

from physics.units import ARCMIN
from twin.bending import FlexurePath, draw_path, lever_path, ticks
from twin.config import Flexure, Twin
from twin.effects import Effect
from twin.motion import ShipMotion
from twin.scene import Scene
from twin.sea import realise


def scene(**flexure) -> Scene:
    twin = Twin(flexure=Flexure(**flexure))
    return Scene(twin, ShipMotion(twin.ship, realise(twin.sea, np.random.default_rng(0)), (-1.0, 2.0)))


def test_quasi_static_part_is_a_sine_of_its_amplitude_and_period() -> None:
    t = np.array([0.0, 25.0, 50.0, 75.0])
    slow = {"quasi_static_amplitude_arcmin": (1.0, 2.0, -3.0), "quasi_static_period": 100.0}
    path = draw_path([t], scene(std_arcmin=(0.0, 0.0, 0.0), **slow), (), np.random.default_rng(1))
    expected = np.outer([0.0, 1.0, 0.0, -1.0], [1.0, 2.0, -3.0]) * ARCMIN
    np.testing.assert_allclose(path.at(t), expected, atol=1e-18)


def test_each_axis_has_its_own_standard_deviation() -> None:
    t = np.arange(400_000) * 0.5
    path = draw_path([t], scene(std_arcmin=(1.0, 0.0, 5.0)), (), np.random.default_rng(2))
    np.testing.assert_allclose(path.at(t).std(axis=0) / ARCMIN, [1.0, 0.0, 5.0], rtol=0.03)


def test_instants_of_several_sensors_lie_on_one_path() -> None:
    main, sub = np.arange(1000) * 0.01, np.arange(1000) * 0.01 - 0.0123
    path = draw_path([main, sub], scene(), (), np.random.default_rng(3))
    assert len(path.tick) == 2000
    gap = path.at(main[2:]) - path.at(sub[2:])  # 12.3 ms apart: hardly any flexure
    assert np.abs(gap).max() < 2e-4
    assert np.abs(path.at(main)).max() > 5e-4


def test_an_instant_that_was_not_drawn_is_an_error() -> None:
    path = FlexurePath(ticks(np.arange(10) * 0.1), np.zeros((10, 3)))
    with pytest.raises(ValueError, match="instant"):
        path.at(np.array([0.25]))


@pytest.mark.parametrize(("frequency", "gain"), [(0.2, 1 / (1 + 0.1**4)), (2.0, 0.5), (6.0, 1 / 82)])
def test_lever_arm_follows_flexure_below_its_bandwidth_without_lag(frequency: float, gain: float) -> None:
    grid = np.arange(-4000, 8000) * 0.005
    theta = np.stack([np.sin(2 * np.pi * frequency * grid)] * 3, axis=-1)
    lever = lever_path(FlexurePath(ticks(grid), theta), grid, cutoff=2.0)
    t = np.linspace(5.0, 20.0, 1001)
    w = 2 * np.pi * frequency
    for order, found in enumerate(lever.at(t)):
        expected = gain * w**order * np.sin(w * t + order * np.pi / 2)
        np.testing.assert_allclose(found[:, 1], expected, atol=2e-4 * gain * w**order)


def test_lever_arm_derivatives_are_those_of_its_path() -> None:
    grid = np.arange(-1000, 3000) * 0.005
    path = draw_path([grid], scene(), (), np.random.default_rng(5))
    lever = lever_path(path, grid, cutoff=5.0)
    t, h = np.linspace(0.0, 9.0, 777), 1e-3
    _, rate, acceleration = lever.at(t)
    after, before = lever.at(t + h), lever.at(t - h)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), rate, atol=1e-3 * np.abs(rate).max())
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), acceleration, atol=3e-3 * np.abs(acceleration).max())


def test_slow_drift_passes_to_the_lever_arm_without_ringing_at_the_ends() -> None:
    grid = np.arange(-400, 2400) * 0.005
    theta = np.outer(1.0 + 0.3 * grid, [1.0, -2.0, 0.5])
    value, rate, acceleration = lever_path(FlexurePath(ticks(grid), theta), grid, cutoff=5.0).at(np.array([0.0, 5.0]))
    np.testing.assert_allclose(value, np.outer([1.0, 2.5], [1.0, -2.0, 0.5]), atol=1e-9)
    np.testing.assert_allclose(rate, np.tile([0.3, -0.6, 0.15], (2, 1)), atol=1e-9)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8)


def test_an_effect_may_bend_the_deck() -> None:
    class Hump(Effect):
        def flexure(self, t, theta, scene, rng):
            return theta + np.array([1e-3, 0.0, 0.0])

    t = np.arange(100) * 0.01
    plain = draw_path([t], scene(), (), np.random.default_rng(6)).at(t)
    bent = draw_path([t], scene(), (Hump(),), np.random.default_rng(6)).at(t)
    np.testing.assert_allclose(bent - plain, np.tile([1e-3, 0.0, 0.0], (100, 1)), atol=1e-15)
