"""A small trial as tables of a log: a ship that rolls, two IMUs, two PHINS, GNSS, temperatures, a sled, truth.

Made from closed formulas with scipy alone, so that the decode stage is checked against something it does not share.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.wire import Table

START = 1_700_000_000_000_000_000
RATE = 50.0
DURATION = 40.0
G = 9.80665
COUNT = int(RATE * DURATION)
IMU = "sensor_msgs/msg/Imu"


def motion(t):
    """``R_n_m`` of a ship in a seaway: heading, pitch and roll of different periods."""
    angles = np.column_stack(
        [0.7 + 0.05 * np.sin(0.5 * t), 0.04 * np.sin(0.8 * t + 1.0), 0.08 * np.sin(0.65 * t + 2.0)]
    )
    return Rotation.from_euler("ZXY", angles)


STATIC = Rotation.from_rotvec([0.01, -0.02, 0.03])


def imu_data(seed, mounting=None, rate=RATE):
    """(attitude, gyro, accel) as interval means of a noisy unit mounted at ``R_m_unit``."""
    mounting = mounting or Rotation.identity()
    t = np.arange(1, int(rate * DURATION) + 1) / rate
    attitude = motion(t) * mounting
    before = motion(t - 1.0 / rate) * mounting
    middle = motion(t - 0.5 / rate) * mounting
    rng = np.random.default_rng(seed)
    gyro = (before.inv() * attitude).as_rotvec() * rate + 1e-5 * rng.standard_normal((len(t), 3))
    accel = middle.inv().apply([0.0, 0.0, G]) + 1e-3 * rng.standard_normal((len(t), 3))
    return attitude, gyro, accel


def stamps(rate=RATE):
    return START + np.rint(np.arange(1, int(rate * DURATION) + 1) / rate * 1e9).astype(np.int64)


def table(topic, schema, stamp, columns):
    n = len(stamp)
    header = {"header.stamp": stamp.copy(), "header.frame_id": np.array([topic.strip("/")] * n, dtype=object)}
    return Table(
        topic=topic,
        schema=schema,
        columns=header | columns,
        log_time=stamp + 2_000_000,
        publish_time=stamp + 2_000_000,
        sequence=np.arange(n, dtype=np.uint32),
    )


def parts(prefix, values, names="xyzw"):
    return {f"{prefix}.{name}": np.ascontiguousarray(column) for name, column in zip(names, values.T)}


def imu_table(topic, stamp, gyro, accel, quaternion=None):
    n = len(stamp)
    covariance = np.zeros((n, 9))
    if quaternion is None:
        covariance[:, 0] = -1.0
        quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    columns = parts("orientation", quaternion) | {"orientation_covariance": covariance}
    columns |= parts("angular_velocity", gyro) | {"angular_velocity_covariance": np.zeros((n, 9))}
    columns |= parts("linear_acceleration", accel) | {"linear_acceleration_covariance": np.zeros((n, 9))}
    return table(topic, IMU, stamp, columns)


def unit(topic, seed, mounting=None, with_attitude=False, rate=RATE):
    attitude, gyro, accel = imu_data(seed, mounting, rate)
    return imu_table(topic, stamps(rate), gyro, accel, attitude.as_quat() if with_attitude else None)


def gnss_table():
    stamp = stamps(1.0)
    n = len(stamp)
    covariance = np.tile(np.diag([1.0, 1.0, 4.0]).ravel(), (n, 1))
    return table(
        "/gnss/fix",
        "sensor_msgs/msg/NavSatFix",
        stamp,
        {
            "status.status": np.zeros(n, dtype=np.int8),
            "status.service": np.ones(n, dtype=np.uint16),
            "latitude": np.full(n, 45.0) + 1e-6 * np.arange(n),
            "longitude": np.full(n, -60.0),
            "altitude": np.full(n, 20.0),
            "position_covariance": covariance,
            "position_covariance_type": np.full(n, 2, dtype=np.uint8),
        },
    )


def temperature_table(topic):
    stamp = stamps(1.0)
    n = len(stamp)
    return table(
        topic,
        "sensor_msgs/msg/Temperature",
        stamp,
        {"temperature": 20.0 + 0.01 * np.arange(n), "variance": np.zeros(n)},
    )


def sled_table():
    stamp = stamps()
    t = (stamp - START) * 1e-9
    position = np.column_stack([0.0 * t, 5.0 * t, 0.0 * t])
    velocity = np.tile([0.0, 5.0, 0.0], (len(t), 1))
    columns = {"child_frame_id": np.array(["sled"] * len(t), dtype=object)}
    columns |= parts("pose.pose.position", position) | parts(
        "pose.pose.orientation", np.tile([0.0, 0, 0, 1], (len(t), 1))
    )
    columns |= {"pose.covariance": np.zeros((len(t), 36)), "twist.covariance": np.zeros((len(t), 36))}
    columns |= parts("twist.twist.linear", velocity) | parts("twist.twist.angular", 0.0 * velocity)
    return table("/sliding/odom", "nav_msgs/msg/Odometry", stamp, columns)


def truth_tables():
    stamp = stamps()
    n = len(stamp)
    phi = np.tile(STATIC.as_rotvec(), (n, 1))
    columns = parts("total", phi) | parts("static_part", phi) | parts("dynamic_part", 0.0 * phi)
    covariance = np.zeros((n, 9))
    covariance[:, 0] = -1.0
    deformation = table(
        "/truth/deformation", "deckflex_msgs/msg/Deformation", stamp, columns | {"covariance": covariance}
    )
    attitude = (motion((stamp - START) * 1e-9) * STATIC).as_quat()
    return [
        deformation,
        table("/truth/attitude", "geometry_msgs/msg/QuaternionStamped", stamp, parts("quaternion", attitude)),
    ]


def tables():
    """Every channel of the contract, by topic."""
    made = [
        unit("/imu/main", 1),
        unit("/imu/sub", 2, STATIC),
        unit("/phins/main", 3, with_attitude=True),
        unit("/phins/sub", 4, STATIC, with_attitude=True),
        unit("/sliding/imu", 5),
        gnss_table(),
        temperature_table("/imu/main/temperature"),
        temperature_table("/imu/sub/temperature"),
        sled_table(),
        *truth_tables(),
    ]
    return {one.topic: one for one in made}


def selected(one, index):
    """The table's rows at index, in that order."""
    return Table(
        topic=one.topic,
        schema=one.schema,
        columns={name: column[index] for name, column in one.columns.items()},
        log_time=one.log_time[index],
        publish_time=one.publish_time[index],
        sequence=one.sequence[index],
    )


def changed(one, **columns):
    """The table with some columns (dots as double underscores) replaced by function(column)."""
    new = dict(one.columns)
    for name, act in columns.items():
        path = name.replace("__", ".")
        new[path] = act(new[path].copy())
    return Table(one.topic, one.schema, new, one.log_time, one.publish_time, one.sequence)
