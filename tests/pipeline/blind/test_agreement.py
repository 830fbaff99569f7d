"""Twin and independent reality, given the same ship and no noise, write the same log for every certain effect."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.blind.reality.assembly import assemble
from pipeline.blind.reality.drawing import CAUSES
from pipeline.blind.reality.nature import Deck, Nature, PhinsUnit, Unit, Voyage, Warmth
from pipeline.blind.reality.waves import Lines, none
from twin import make_twin, simulate

DEG = np.pi / 180.0
ROWS = {
    "pitch": [[1.2, 6.1, 20.0], [0.5, 8.3, 200.0]],
    "roll": [[4.0, 9.2, 75.0], [1.5, 11.0, 300.0]],
    "heading": [[0.9, 10.3, 130.0]],
    "surge": [[0.2, 8.0, 10.0]],
    "sway": [[0.3, 9.0, 40.0]],
    "heave": [[0.5, 7.0, 90.0]],
}
LEVER = [1.5, -33.0, 2.5]
STATIC = [12.0, -30.0, 45.0]
INSTALLATION = [-0.03, 0.5, 0.33]
QUIET = {
    "gyro_bias_dph": [0.0] * 3, "gyro_arw": 0.0, "gyro_scale_ppm": [0.0] * 3,
    "gyro_nonorthogonality_arcsec": [0.0] * 6, "accel_bias_ug": [0.0] * 3, "accel_vrw_ug": 0.0,
}  # fmt: skip
DURATION = 80.0
COMPARED = {  # samples, where the two differ for a reason
    "misalignment_step": np.delete(np.arange(8000), 4001),  # the mean of the force across a jump
    "heel_bending": np.arange(7000, 8000),  # how the lag begins is nobody's to say
    "gyro_bandwidth": np.arange(100, 7900),  # the twin's filter sees the ends mirrored
}


def twin_of(*effects):
    return make_twin(
        {
            "run": {"duration": DURATION, "rate": 100.0},
            "ship": {"latitude": -33.0, "longitude": 151.0, "height": 15.0, "heading": 60.0, "speed": 14.0},
            "sea": ROWS,
            "mount": {"static_arcmin": STATIC, "lever_arm": LEVER},
            "flexure": {"std_arcmin": [0.0] * 3},
            "imu": {"main": QUIET, "sub": QUIET},
            "phins": {
                "attitude_noise_arcmin": 0.0, "attitude_drift_arcmin": [0.0] * 3, "gyro_arw": 0.0,
                "accel_vrw_ug": 0.0, "installation_sub_deg": INSTALLATION,
            },
            "temperature": {"start": 20.0, "rise_sub": 10.0, "tau": 600.0, "swing": 0.0},
            "effect": [{"name": name, **parameters} for name, parameters in effects],
        }
    )  # fmt: skip


def lines(key, unit):
    table = np.array(ROWS[key])
    return Lines(table[:, 0] * unit, 2.0 * np.pi / table[:, 1], table[:, 2] * DEG)


@pytest.fixture(scope="module")
def nature():
    quiet = Unit(np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros(3), 0.0)
    seats = [np.array(twin_of().phins.installation_main_deg) * DEG, np.array(INSTALLATION) * DEG]
    voyage = Voyage(
        -33.0 * DEG, 151.0 * DEG, 15.0, 60.0 * DEG, 14.0 * 1852.0 / 3600.0, lines("pitch", DEG), lines("roll", DEG),
        lines("heading", DEG), none(), *(lines(key, 1.0).rate() for key in ("surge", "sway", "heave")),
    )  # fmt: skip
    deck = Deck(
        np.full(3, 0.2), np.zeros(3), np.zeros(3), np.eye(3), np.array(STATIC) * DEG / 60.0, np.array(LEVER), 5.0, 2
    )
    phins = PhinsUnit(np.zeros(3), 300.0, 0.0, *seats, 0.0, 0.0)
    return Nature(
        DURATION, 100.0, 0, voyage, deck, quiet, quiet, phins, Warmth(20.0, (8.0, 10.0), (600.0, 600.0), 0.0, 1800.0)
    )


def both(nature, *effects):
    ours = assemble(nature, [CAUSES[name](parameters) for name, parameters in effects], np.random.default_rng(1))[0]
    return ours, simulate(twin_of(*effects), np.random.default_rng(1)).trial


@pytest.fixture(scope="module")
def plain(nature):
    return both(nature)


def apart(a, b):
    return (Rotation.from_quat(a.attitude) * Rotation.from_quat(b.attitude).inv()).as_rotvec()


def test_the_same_ship_gives_the_same_log(plain):
    ours, twins = plain
    for unit in ("main", "sub", "phins_main", "phins_sub"):
        a, b = getattr(ours, unit), getattr(twins, unit)
        np.testing.assert_allclose(a.gyro, b.gyro, atol=1e-11, err_msg=unit)
        np.testing.assert_allclose(a.accel, b.accel, atol=2e-6, err_msg=unit)
    assert np.abs(apart(ours.phins_main, twins.phins_main)).max() < 1e-10
    assert np.abs(apart(ours.phins_sub, twins.phins_sub)).max() < 1e-10


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("time_delay", {"delay": 0.004}),
        ("clock_drift", {"drift": 50.0}),
        ("gyro_scale_factor", {"x": 300.0, "y": -200.0, "z": 100.0}),
        ("gyro_nonorthogonality", {"xy": 60.0, "xz": -50.0, "yx": 40.0, "yz": 30.0, "zx": -20.0, "zy": 10.0}),
        ("gyro_g_sensitivity", {"x": 20.0, "y": -30.0, "z": 5.0}),
        ("gyro_bias", {"x": 1.0, "y": -2.0, "z": 0.5}),
        ("gyro_temperature", {"slope": [0.5, 1.0, -1.0]}),
        ("gyro_saturation", {"limit": 2.0}),
        ("accel_bias", {"x": 300.0, "y": -500.0, "z": 100.0}),
        ("accel_scale_factor", {"x": 300.0, "y": -200.0, "z": 100.0}),
        ("lever_arm", {"x": 0.1, "y": -0.2, "z": 0.05}),
        ("static_misalignment", {"x": 5.0, "y": -8.0, "z": 10.0}),
        ("misalignment_step", {"x": 5.0, "y": -8.0, "z": 10.0, "time": 40.0025}),
        ("thermal_bending", {"amplitude": [5.0, -8.0, 10.0], "period": 100.0}),
        ("wave_forced_bending", {"x": 1.0, "y": 0.5, "z": -0.7}),
        ("heel_bending", {"x": 8.0, "y": -5.0, "z": 6.0}),
        ("phins_latency", {"delay": 0.02}),
        ("phins_attitude_error", {"x": 1.0, "y": -2.0, "z": 3.0, "period": 60.0}),
        ("gyro_bandwidth", {"cutoff": 6.0}),
    ],
)
def test_every_certain_effect_is_the_same_in_both(nature, plain, name, parameters):
    """Differences that the effect makes agree to a few per cent of their size, and mostly far better."""
    found = both(nature, (name, parameters))
    differences = [
        [getattr(after.sub, kind) - getattr(before.sub, kind) for kind in ("gyro", "accel")]
        + [apart(getattr(after, unit), getattr(before, unit)) for unit in ("phins_main", "phins_sub")]
        for after, before in zip(found, plain)
    ]
    some, samples = False, COMPARED.get(name, np.arange(8000))
    share = 0.05 if name == "heel_bending" else 0.02
    for ours, twins, least in zip(*differences, (1e-11, 4e-6, 1e-10, 1e-10)):
        size = np.abs(twins).max()
        some |= size > least
        np.testing.assert_allclose(ours[samples], twins[samples], atol=share * size + least)
    assert some
