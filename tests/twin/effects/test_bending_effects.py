"""Bending: its path in the truth, and gyros, attitudes and specific force that belong to it."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import welch
from scipy.spatial.transform import Rotation

from tests.twin.effects.worlds import ARCMIN, LIVELY, PLUMB, STIFF, alone, pair, table
from tests.twin.worlds import integrate

SMOOTH = [
    table("thermal_bending", amplitude=[60.0, 30.0, 90.0], period=12.0),
    table("wave_forced_bending", x=0.5, y=-0.3, z=0.8),
    table("heel_bending", x=60.0, y=30.0, z=-60.0),
]


def bent(*effects, **tables):
    """The bending (n, 3) in arcmin that effects add to the truth."""
    plain, changed = pair(*effects, **tables)
    return (changed.truth.dynamic_part - plain.truth.dynamic_part) / ARCMIN


@pytest.mark.parametrize("effect", [*SMOOTH, table("slamming"), table("second_mode")], ids=lambda e: e["name"])
def test_attitudes_and_gyros_belong_to_the_bent_deck(effect) -> None:
    bent_deck = alone(effect, flexure=STIFF, run={"duration": 12.0})
    trial, truth = bent_deck.trial, bent_deck.truth
    R_n_m, R_n_s = (Rotation.from_quat(x.attitude) for x in (trial.phins_main, trial.phins_sub))
    np.testing.assert_allclose((R_n_m.inv() * R_n_s).as_rotvec(), truth.total, atol=1e-12)
    turned_m, turned_s = (integrate(unit.gyro[1:], 0.01) for unit in (trial.main, trial.sub))
    start = Rotation.from_rotvec(truth.total[0]).as_matrix()
    R_m_s = np.swapaxes(turned_m, -1, -2) @ start @ turned_s
    np.testing.assert_allclose(Rotation.from_matrix(R_m_s).as_rotvec(), truth.total, atol=1e-10)


@pytest.mark.parametrize("effect", SMOOTH, ids=lambda e: e["name"])
def test_bending_moves_the_lever_arm(effect) -> None:
    """f_s = R_s_m (f_m + the acceleration of r + theta x r), worked out from the truth and the main IMU."""
    arm = np.array([3.0, 30.0, 4.0])
    mount = {**PLUMB, "lever_arm": arm.tolist(), "lever_bandwidth": 10.0}
    plain, changed = pair(effect, flexure=STIFF, mount=mount, run={"rate": 200.0, "duration": 20.0})
    t = np.arange(4000) / 200.0
    theta = CubicSpline(t, changed.truth.dynamic_part)
    mid, k = t - 0.0025, slice(400, 3600)
    omega, omega_dot = (CubicSpline(mid, plain.trial.main.gyro)(mid, order) for order in (0, 1))
    shift, rate, acceleration = (np.cross(theta(mid, order), arm) for order in range(3))
    moved = np.cross(omega_dot, shift) + np.cross(omega, np.cross(omega, shift) + 2 * rate) + acceleration
    seen = Rotation.from_rotvec(theta(mid)).apply(changed.trial.sub.accel) - plain.trial.sub.accel
    size = np.abs(moved[k]).max()
    np.testing.assert_allclose(seen[k], moved[k], atol=2e-3 * size + 2e-6)
    assert size > 1e-3


def test_thermal_bending_is_a_sine() -> None:
    t = np.arange(3000) * 0.01
    expected = np.outer(np.sin(2 * np.pi * t / 100.0), [2.0, 0.0, -5.0])
    found = bent(table("thermal_bending", amplitude=[2.0, 0.0, -5.0], period=100.0))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_wave_bending_follows_roll_at_once() -> None:
    sea = {"pitch": [], "roll": [[8.0, 9.0, 30.0]]}
    found = bent(table("wave_forced_bending", x=0.5, y=0.0, z=-1.0), sea=sea)
    roll = 8.0 * np.sin(2 * np.pi * np.arange(3000) * 0.01 / 9.0 + np.radians(30.0))
    np.testing.assert_allclose(found, np.outer(roll, [0.5, 0.0, -1.0]), atol=1e-9)


def test_heel_bending_lags_lateral_force_by_twenty_seconds() -> None:
    ship = {"speed": 20.0, "phase": [{"start": 80.0, "ramp": 60.0, "heading": 225.0}]}
    sea = {"roll": [[5.0, 10.0, 0.0]]}
    tables = {"ship": ship, "sea": sea, "run": {"duration": 200.0, "rate": 20.0}}
    plain, changed = pair(table("heel_bending", x=2.0, z=-3.0), **tables)
    force = plain.trial.main.accel[:, 0]
    u, lagged = force[:1200].mean(), []
    for value in force:  # 20 u' + u = f, step by step
        u += (value - u) * 0.05 / 20.0
        lagged.append(u)
    found = (changed.truth.dynamic_part - plain.truth.dynamic_part) / ARCMIN
    expected = np.outer(lagged, [2.0, 0.0, -3.0])
    np.testing.assert_allclose(found, expected, atol=0.3)
    np.testing.assert_allclose(found[2000:], expected[2000:], atol=0.01)  # where it began is forgotten
    assert np.abs(found[:, 0]).max() > 0.5  # the turn is felt
    assert np.abs(found[:, 0]).max() < np.abs(force).max()  # the waves hardly


def test_second_mode_has_its_spectrum_and_size_on_its_axis() -> None:
    run = {"duration": 1000.0, "rate": 20.0}
    found = bent(table("second_mode", damping=0.2, frequency=3.0, std_arcmin=2.0, axis="z"), run=run)
    assert not found[:, :2].any()
    assert found[:, 2].std() == pytest.approx(2.0, rel=0.15)
    f, density = welch(found[:, 2], 20.0, nperseg=2048)
    w, b2 = 2 * np.pi * f, 0.2**2 + 3.0**2
    exact = 2 * 4 * 0.2 * b2 * 2.0**2 / ((b2 - w**2) ** 2 + (2 * 0.2 * w) ** 2)
    for low, high in ((0.2, 0.42), (0.42, 0.53), (0.53, 0.8), (1.0, 3.0)):
        band = (f > low) & (f < high)
        assert density[band].sum() == pytest.approx(exact[band].sum(), rel=0.25)


def test_axis_coupling_correlates_the_forcing() -> None:
    coupled = alone(table("axis_coupling", xy=0.6, xz=0.1, yz=-0.3), flexure=LIVELY, run={"duration": 120.0})
    kick = np.diff(coupled.truth.dynamic_part, 2, axis=0)[::2]  # differences of the rate: the white forcing, nearly
    found = np.corrcoef(kick.T)
    np.testing.assert_allclose(found[[0, 0, 1], [1, 2, 2]], [0.6, 0.1, -0.3], atol=0.06)
    plain = alone(flexure=LIVELY, run={"duration": 120.0})
    np.testing.assert_allclose(coupled.truth.dynamic_part[:, 0], plain.truth.dynamic_part[:, 0], atol=1e-11)
    assert np.abs(np.corrcoef(np.diff(plain.truth.dynamic_part, 2, axis=0).T) - np.eye(3)).max() < 0.06


def test_flexure_parameters_replace_those_of_the_twin_and_keep_the_rest() -> None:
    given = {"damping": {"y": 0.5}, "frequency": {"x": 1.5}, "std_arcmin": {"x": 3.0, "y": 6.0, "z": 20.0}}
    other = alone(table("flexure_parameters", **given), flexure=LIVELY)
    stated = {"damping": [0.3, 0.5, 0.25], "frequency": [1.5, 0.6, 0.5], "std_arcmin": [3.0, 6.0, 20.0]}
    expected = alone(flexure=stated)
    np.testing.assert_array_equal(other.truth.dynamic_part, expected.truth.dynamic_part)
    plain = alone(flexure=LIVELY)
    np.testing.assert_allclose(other.truth.dynamic_part[:, 2], 2.0 * plain.truth.dynamic_part[:, 2], rtol=1e-12)


def test_stiffening_solves_its_equation() -> None:
    plain, stiff = pair(table("amplitude_stiffening", gain=0.05), flexure=LIVELY, run={"duration": 20.0, "rate": 200.0})
    t, mu, b2 = np.arange(4000) / 200.0, 0.3, 0.3**2 + 0.8**2
    linear = CubicSpline(t, plain.truth.dynamic_part[:, 0] / ARCMIN)
    found = (stiff.truth.dynamic_part - plain.truth.dynamic_part)[:, 0] / ARCMIN
    slope = CubicSpline(t, found)(0.0, 1)

    def pull(time, x):
        return [x[1], -2 * mu * x[1] - b2 * x[0] - b2 * 0.05 * (linear(time) + x[0]) ** 3]

    exact = solve_ivp(pull, (0.0, t[-1]), [found[0], float(slope)], t_eval=t, rtol=1e-8, atol=1e-8, max_step=0.02)
    np.testing.assert_allclose(found, exact.y[0], atol=2e-3)
    assert np.abs(found).max() > 2.0


def test_stiffened_flexure_is_stationary_from_the_start() -> None:
    sigma, gain = 6.0, 0.05
    weight = [quad(lambda x, p=p: x**p * np.exp(-(x**2 / 2 + gain * x**4 / 4) / sigma**2), -60, 60)[0] for p in (0, 2)]
    std = np.sqrt(weight[1] / weight[0])
    flexure = {"damping": [0.3] * 3, "frequency": [0.8] * 3, "std_arcmin": [sigma] * 3}
    theta = alone(table("amplitude_stiffening", gain=gain), flexure=flexure, run={"duration": 600.0, "rate": 20.0})
    assert theta.truth.dynamic_part.std() / ARCMIN == pytest.approx(std, rel=0.08)
    assert std < 0.75 * sigma
    from twin.effects.amplitude_stiffening import stationary

    draws = np.random.default_rng(4).standard_normal(4000) * sigma
    assert np.std([stationary(x, sigma, gain) for x in draws]) == pytest.approx(std, rel=0.05)


def test_slams_come_at_their_rate_ring_and_die_away() -> None:
    effect = table("slamming", rate=6.0, amplitude=5.0, frequency=9.0, damping=1.5)
    found = bent(effect, run={"duration": 600.0}, mount={"lever_bandwidth": 1.0})
    assert not found[:, 1:].any()
    t, theta = np.arange(60_000) * 0.01, found[:, 0]
    gone = theta[2:] - 2 * np.exp(-0.015) * np.cos(0.09) * theta[1:-1] + np.exp(-0.03) * theta[:-2]
    struck = np.flatnonzero(np.abs(gone) > 1e-9)  # the ringing's own recursion fails only where a slam begins
    starts = struck[np.concatenate([[True], np.diff(struck) > 2])]
    assert len(starts) == pytest.approx(60, abs=4 * np.sqrt(60))
    lonely = next(k for k, following in pairwise(starts) if following - k > 500)
    part = slice(lonely + 3, lonely + 400)
    basis = np.exp(-1.5 * t[:397])[:, None] * np.stack([np.sin(9 * t[:397]), np.cos(9 * t[:397])], axis=-1)
    weight = np.linalg.lstsq(basis, theta[part], rcond=None)[0]
    np.testing.assert_allclose(basis @ weight, theta[part], atol=1e-6)
    late = (np.arctan2(weight[1], weight[0]) % (2 * np.pi)) / 9.0  # since the slam
    assert np.hypot(*weight) * np.exp(1.5 * late) == pytest.approx(5.0 / 9.0, rel=0.01)


def test_slams_about_another_axis() -> None:
    found = bent(table("slamming", axis="z"))
    assert not found[:, :2].any()
    assert np.abs(found[:, 2]).max() > 0.3


def test_a_growing_sea_is_a_linear_ramp_from_the_twins() -> None:
    tables = {"flexure": {**LIVELY, "quasi_static_amplitude_arcmin": [0.0, 0.0, 4.0], "quasi_static_period": 100.0}}
    plain, grown = pair(table("nonstationary_sea", growth=3.0), table("thermal_bending"), **tables)
    calm = alone(flexure={**tables["flexure"], **STIFF}).truth.dynamic_part  # what is not the sea's
    sun = alone(table("thermal_bending"), flexure=STIFF).truth.dynamic_part
    ramp = 1.0 + 2.0 * np.arange(3000) * 0.01 / 30.0
    expected = (plain.truth.dynamic_part - calm) * ramp[:, None] + calm + sun
    np.testing.assert_allclose(grown.truth.dynamic_part, expected, atol=1e-12)
