import numpy as np
from scipy.spatial.transform import Rotation

from tests.twin.effects.worlds import ARCMIN, LIVELY, pair, table
from tests.twin.worlds import PERFECT_PHINS


def test_latency_is_common_to_both_and_touches_attitude_alone() -> None:
    plain, late = pair(table("phins_latency", delay=0.03), flexure=LIVELY)
    for unit in ("phins_main", "phins_sub"):
        a, b = getattr(plain.trial, unit), getattr(late.trial, unit)
        same = np.abs((b.attitude[20:] * a.attitude[17:-3]).sum(axis=1))
        np.testing.assert_allclose(same, 1.0, atol=1e-13)
        assert np.abs(np.abs((b.attitude * a.attitude).sum(axis=1)) - 1.0).max() > 1e-7
        np.testing.assert_array_equal(a.gyro, b.gyro)


def test_attitude_error_is_a_sine_of_the_sub_units_in_main_axes() -> None:
    phins = {**PERFECT_PHINS, "installation_sub_deg": [5.0, -3.0, 40.0]}
    plain, wrong = pair(table("phins_attitude_error", x=1.0, y=-2.0, z=5.0, period=40.0), flexure=LIVELY, phins=phins)
    R_m_n = Rotation.from_quat(plain.trial.phins_main.attitude).inv()
    right, seen = (R_m_n * Rotation.from_quat(s.trial.phins_sub.attitude) for s in (plain, wrong))
    expected = np.outer(np.sin(2 * np.pi * np.arange(3000) * 0.01 / 40.0), [1.0, -2.0, 5.0]) * ARCMIN
    np.testing.assert_allclose((seen * right.inv()).as_rotvec(), expected, atol=1e-12)
    np.testing.assert_array_equal(wrong.trial.phins_main.attitude, plain.trial.phins_main.attitude)


def test_latencies_add_up() -> None:
    twice, once = (
        pair(*[table("phins_latency", delay=d)] * n, flexure=LIVELY)[1] for d, n in ((0.0123, 2), (0.0246, 1))
    )
    same = np.abs((twice.trial.phins_sub.attitude * once.trial.phins_sub.attitude).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
