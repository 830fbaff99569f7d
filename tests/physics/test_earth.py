import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import earth


@pytest.mark.parametrize(
    ("latitude", "height", "expected"),
    [
        (0.0, 0.0, 9.7803253359),  # WGS 84 normal gravity at the equator, TR8350.2
        (90.0, 0.0, 9.8321849379),  # and at the pole
        (45.0, 0.0, 9.806197769),  # and half way
    ],
)
def test_normal_gravity_has_the_published_values(latitude: float, height: float, expected: float) -> None:
    assert earth.gravity(np.radians(latitude), np.float64(height)) == pytest.approx(expected, abs=2e-9)


def test_gravity_falls_by_the_free_air_gradient() -> None:
    near, far = earth.gravity(np.full(2, 0.7), np.array([0.0, 100.0]))
    assert (near - far) / 100.0 == pytest.approx(3.086e-6, rel=2e-3)


def test_radii_are_those_of_the_ellipsoid() -> None:
    lat, step = 0.6, 1e-6
    a, e2 = 6378137.0, (1 / 298.257223563) * (2 - 1 / 298.257223563)

    def meridian_point(phi: float) -> np.ndarray:
        n = a / np.sqrt(1 - e2 * np.sin(phi) ** 2)
        return np.array([n * np.cos(phi), n * (1 - e2) * np.sin(phi)])

    meridian, transverse = earth.radii(np.float64(lat))
    arc = np.linalg.norm(meridian_point(lat + step) - meridian_point(lat - step)) / (2 * step)
    assert meridian == pytest.approx(arc, rel=1e-8)
    assert transverse * np.cos(lat) == pytest.approx(meridian_point(lat)[0], rel=1e-14)


def test_local_level_axes_point_east_north_and_up() -> None:
    lat, lon = 0.5, -2.1
    matrix = Rotation.from_quat(earth.local_level(np.float64(lat), np.float64(lon))).as_matrix()
    east = [-np.sin(lon), np.cos(lon), 0.0]
    up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    np.testing.assert_allclose(matrix[:, 0], east, atol=1e-15)
    np.testing.assert_allclose(matrix[:, 2], up, atol=1e-15)
    np.testing.assert_allclose(matrix[:, 1], np.cross(up, east), atol=1e-15)


def test_transport_rate_turns_the_local_level_frame() -> None:
    lat, lon, height, dt = 0.8, 0.3, 50.0, 1.0
    velocity = np.array([7.0, -4.0, 0.0])
    meridian, transverse = earth.radii(np.float64(lat))
    moved = (
        lat + velocity[1] * dt / (meridian + height),
        lon + velocity[0] * dt / ((transverse + height) * np.cos(lat)),
    )
    before = Rotation.from_quat(earth.local_level(np.float64(lat), np.float64(lon)))
    after = Rotation.from_quat(earth.local_level(*(np.float64(v) for v in moved)))
    rate = earth.transport_rate(np.float64(lat), np.float64(height), velocity)
    np.testing.assert_allclose((before.inv() * after).as_rotvec() / dt, rate, atol=1e-12)
