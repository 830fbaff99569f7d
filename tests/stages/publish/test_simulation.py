"""A simulated trial as a log, read back by an independent decoder."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from schemas.wire import read_log, write_log
from stages.publish.simulation import simulation_tables
from twin import make_twin, simulate

TOPICS = {
    "/imu/main": ("sensor_msgs/msg/Imu", "imu_main"),
    "/imu/sub": ("sensor_msgs/msg/Imu", "imu_sub"),
    "/phins/main": ("sensor_msgs/msg/Imu", "phins_main"),
    "/phins/sub": ("sensor_msgs/msg/Imu", "phins_sub"),
    "/gnss/fix": ("sensor_msgs/msg/NavSatFix", "gnss"),
    "/imu/main/temperature": ("sensor_msgs/msg/Temperature", "imu_main"),
    "/imu/sub/temperature": ("sensor_msgs/msg/Temperature", "imu_sub"),
    "/sliding/imu": ("sensor_msgs/msg/Imu", "sliding"),
    "/sliding/odom": ("nav_msgs/msg/Odometry", "deck"),
    "/truth/deformation": ("deckflex_msgs/msg/Deformation", "imu_main"),
    "/truth/attitude": ("geometry_msgs/msg/QuaternionStamped", "enu"),
}


@pytest.fixture(scope="module")
def simulation():
    return simulate(make_twin({"run": {"duration": 14.0, "rate": 50.0}, "deck": {"start": 2.0, "pause": 1.0}}))


@pytest.fixture(scope="module")
def log(simulation, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("log") / "trial.mcap"
    write_log(path, simulation_tables(simulation))
    return path


@pytest.fixture(scope="module")
def messages(log: Path):
    """Topic -> (schema, [(log time, message)]) as mcap-ros2-support reads them."""
    found: dict = {}
    with log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            found.setdefault(channel.topic, (schema.name, []))[1].append((message.log_time, decoded))
    return found


def stamp_of(header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def vectors(rows, *path: str, axes: str = "xyz") -> np.ndarray:
    out = []
    for _, row in rows:
        value = row
        for name in path:
            value = getattr(value, name)
        out.append([getattr(value, axis) for axis in axes])
    return np.array(out)


def test_every_channel_of_the_contract_with_its_type_and_frame(messages) -> None:
    assert {topic: rows[0] for topic, rows in messages.items()} == {t: name for t, (name, _) in TOPICS.items()}
    for topic, (_, frame) in TOPICS.items():
        assert {row.header.frame_id for _, row in messages[topic][1]} == {frame}
    assert messages["/sliding/odom"][1][0][1].child_frame_id == "sliding"


def test_inertial_units_read_back_exactly(simulation, messages) -> None:
    trial = simulation.trial
    units = {"/imu/main": trial.main, "/imu/sub": trial.sub, "/phins/main": trial.phins_main,
             "/phins/sub": trial.phins_sub, "/sliding/imu": trial.sliding}  # fmt: skip
    for topic, series in units.items():
        rows = messages[topic][1]
        assert [stamp_of(row.header) for _, row in rows] == series.stamp.tolist()
        assert [time for time, _ in rows] == series.stamp.tolist()
        np.testing.assert_array_equal(vectors(rows, "angular_velocity"), series.gyro)
        np.testing.assert_array_equal(vectors(rows, "linear_acceleration"), series.accel)


def test_only_a_phins_has_an_attitude(simulation, messages) -> None:
    rows = messages["/phins/sub"][1]
    np.testing.assert_array_equal(vectors(rows, "orientation", axes="xyzw"), simulation.trial.phins_sub.attitude)
    variance = np.array(rows[0][1].orientation_covariance)[[0, 4, 8]]
    expected = (np.radians(np.array([0.3, 0.3, 0.6]) / 60)) ** 2 + np.radians(0.06 / 60) ** 2
    np.testing.assert_allclose(variance, expected, rtol=1e-12)
    for topic in ("/imu/main", "/imu/sub", "/sliding/imu"):
        assert {row.orientation_covariance[0] for _, row in messages[topic][1]} == {-1.0}


def test_fixes_are_in_degrees(simulation, messages) -> None:
    rows, series = messages["/gnss/fix"][1], simulation.trial.gnss
    np.testing.assert_allclose([row.latitude for _, row in rows], np.degrees(series.latitude), rtol=1e-15)
    np.testing.assert_allclose([row.longitude for _, row in rows], np.degrees(series.longitude), rtol=1e-15)
    assert rows[0][1].position_covariance[0] == pytest.approx(1.25**2)
    assert rows[0][1].position_covariance_type == 2


def test_temperatures_odometry_and_truth(simulation, messages) -> None:
    trial, truth = simulation.trial, simulation.truth
    readings = [row.temperature for _, row in messages["/imu/sub/temperature"][1]]
    np.testing.assert_array_equal(readings, trial.temperature_sub.value)
    rows = messages["/sliding/odom"][1]
    np.testing.assert_array_equal(vectors(rows, "pose", "pose", "position"), trial.sled.position)
    np.testing.assert_array_equal(vectors(rows, "twist", "twist", "linear"), trial.sled.velocity)
    rows = messages["/truth/deformation"][1]
    for part, expected in (
        ("total", truth.total),
        ("static_part", truth.static_part),
        ("dynamic_part", truth.dynamic_part),
    ):
        np.testing.assert_array_equal(vectors(rows, part), expected)
    assert rows[0][1].covariance[0] == -1.0
    rows = messages["/truth/attitude"][1]
    np.testing.assert_array_equal(vectors(rows, "quaternion", axes="xyzw"), truth.attitude)


def test_the_projects_own_reader_agrees(simulation, log: Path) -> None:
    tables = read_log(log).tables
    assert set(tables) == set(TOPICS)
    np.testing.assert_array_equal(tables["/imu/sub"].vector("angular_velocity"), simulation.trial.sub.gyro)
    np.testing.assert_array_equal(tables["/truth/deformation"].columns["header.stamp"], simulation.truth.stamp)


def test_channels_that_are_left_out_stay_out() -> None:
    off = {"phins": False, "gnss": False, "temperature": False, "truth": False}
    tables = simulation_tables(simulate(make_twin({"run": {"duration": 1.0}, "channels": off})))
    assert [table.topic for table in tables] == ["/imu/main", "/imu/sub"]


def test_the_same_twin_makes_the_same_file(simulation, log: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    write_log(again, simulation_tables(simulate(simulation.twin)))
    assert again.read_bytes() == log.read_bytes()
