"""The roles of the log contract: which table serves one, and how its series is made and checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from schemas.errors import DataError
from schemas.trial import GnssSeries, ImuSeries, OdometrySeries, ScalarSeries
from schemas.wire import ChannelInfo, Log, Table
from stages.decode import channels, columns, plausible, stamps
from stages.decode.attitude import with_gravity
from stages.decode.profile import DEFAULTS, Channel, RigProfile

Notes = tuple[str, ...]
BESIDE = {
    "gnss": ("position_covariance_type",),
    "truth_deformation": ("total", "static_part", "dynamic_part"),
    "truth_attitude": ("quaternion",),
}
"""Fields that are read beside the standard ones of a channel."""


@dataclass(frozen=True)
class Found:
    """The series decoded so far, by role."""

    main: ImuSeries | None = None
    sub: ImuSeries | None = None
    phins_main: ImuSeries | None = None
    phins_sub: ImuSeries | None = None
    gnss: GnssSeries | None = None
    sliding: ImuSeries | None = None
    sled: OdometrySeries | None = None
    temperature_main: ScalarSeries | None = None
    temperature_sub: ScalarSeries | None = None


def topics(profile: RigProfile) -> frozenset[str]:
    """Topics the profile names and wants used."""
    return frozenset(profile.channel(role).topic for role in DEFAULTS if profile.channel(role).use)


def wanted(profile: RigProfile, roles: Iterable[str] = DEFAULTS) -> dict[str, frozenset[str]]:
    """By topic, the paths of all columns that the roles read."""
    found: dict[str, frozenset[str]] = {}
    for role in roles:
        channel = profile.channel(role)
        if channel.use:
            found[channel.topic] = found.get(channel.topic, frozenset()) | columns.needed(channel, BESIDE.get(role, ()))
    return found


def has_channel(role: str, log: Log, profile: RigProfile) -> bool:
    """Whether the log has the role's channel and the profile wants it."""
    channel = profile.channel(role)
    return channel.use and any(info.topic == channel.topic for info in log.channels)


def table_of(role: str, log: Log, tables: Mapping[str, Table], profile: RigProfile) -> Table:
    """The role's table; DataError where it is missing, empty or of another type or encoding than declared."""
    channel = profile.channel(role)
    info = next((one for one in log.channels if one.topic == channel.topic), None)
    if info is None:
        raise DataError(f"channel {channel.topic} ({role}) is missing; the log has {listed(log.channels)}")
    table = tables.get(channel.topic)
    kind = info.schema if table is None else table.schema
    if not same_type(kind, channel.type):
        wrong = f"it carries {kind or 'no type'}, not {channel.type}; rig keys {role}.type and {role}.fields can map it"
        raise DataError(wrong, channel=channel.topic)
    if channel.encoding is not None and info.message_encoding != channel.encoding:
        wrong = f"it is encoded as {info.message_encoding}, not {channel.encoding} as rig key {role}.encoding says"
        raise DataError(wrong, channel=channel.topic)
    if table is None or not len(table):
        raise DataError("the channel has no messages", channel=channel.topic)
    return table


def listed(infos: tuple[ChannelInfo, ...]) -> str:
    """Topics with their types, for people."""
    named = [f"{info.topic} ({info.schema or 'no type'})" for info in infos]
    return ", ".join(named[:12]) + (", ..." if len(named) > 12 else "") if named else "no channels"


def epoch_of(main: Table, profile: RigProfile) -> int:
    """Stamp of the first sample of the main IMU, ns: what the times of the trial count from."""
    log_time = np.asarray(main.log_time, dtype=np.int64)
    try:
        settled = stamps.settle(columns.stamps(main, profile.main), log_time, lambda i, j: np.ones(len(i), dtype=bool))
    except DataError as error:
        raise error.located(channel=profile.main.topic) from error
    return int(settled.stamp[0])


def clock_lag(table: Table, channel: Channel) -> float | None:
    """Usual time from stamp to writing, s; None without stamps."""
    stamp, log_time = columns.stamps(table, channel), np.asarray(table.log_time, dtype=np.int64)
    valid = (stamp > 0) & (log_time > 0)
    return float(np.median((log_time - stamp)[valid])) * 1e-9 if valid.any() else None


def decode_role(role: str, table: Table, profile: RigProfile, epoch: int | None, found: Found) -> tuple[Any, Notes]:
    """The series of any role but truth. found: what is decoded already (a PHINS may restore an IMU's gravity)."""
    if role in ("main", "sub", "sliding"):
        return _unit(role, table, profile, epoch, found)
    if role in ("phins_main", "phins_sub"):
        return _phins(role, table, profile, epoch)
    if role == "gnss":
        return channels.gnss(table, profile.gnss, epoch)
    if role == "sled":
        return channels.odometry(table, profile.sled, epoch)
    return channels.temperature(table, profile.channel(role), epoch)


def _unit(role: str, table: Table, profile: RigProfile, epoch: int | None, found: Found) -> tuple[ImuSeries, Notes]:
    """An inertial unit, gravity restored where it was removed, checked against the units declared."""
    channel = profile.imu(role)
    series, notes = channels.imu(table, channel, profile.instantaneous(role), epoch)
    if channel.gravity_removed:
        series, told = _gravity_restored(series, role, profile, found)
        notes += told
    doubts = (
        plausible.specific_force(series.accel, role),
        plausible.gyro_against_attitude(series, role),
        plausible.gyro_against_gravity(series, role),
    )
    tilted = plausible.upright(series.accel, role)
    return series, notes + _judged(doubts, profile) + ((tilted,) if tilted else ())


def _phins(role: str, table: Table, profile: RigProfile, epoch: int | None) -> tuple[ImuSeries, Notes]:
    """A PHINS; one whose attitude contradicts gravity or its own rates is refused: it would be a false witness."""
    series, notes = channels.phins(table, profile.imu(role), profile.instantaneous(role), epoch)
    notes += _judged((plausible.attitude_against_gravity(series, role),), profile)
    if np.isfinite(series.gyro).all():
        notes += _judged((plausible.gyro_against_attitude(series, role),), profile)
    return series, notes


def _judged(doubts: tuple[str | None, ...], profile: RigProfile) -> Notes:
    """Refuse on the first doubt, or only tell of all where the profile says so."""
    raised = tuple(doubt for doubt in doubts if doubt)
    if raised and profile.plausibility == "refuse":
        raise DataError(raised[0])
    return raised


def _gravity_restored(series: ImuSeries, role: str, profile: RigProfile, found: Found) -> tuple[ImuSeries, Notes]:
    """Gravity by the unit's own attitude, else by that of the PHINS at the same place."""
    if series.attitude is not None:
        return _with_gravity(series, series, np.eye(3), profile), ("gravity restored with its own attitude",)
    beside = {"main": found.phins_main, "sub": found.phins_sub}.get(role)
    if beside is None:
        raise DataError(
            f"gravity is removed ({role}.gravity_removed) and no attitude is there to restore it: the unit gives none "
            "and no PHINS stands beside it"
        )
    rig = profile.rig()
    mounting = rig.installation_main if role == "main" else rig.installation_sub
    told = "gravity restored with the attitude of the PHINS beside it"
    if mounting is None:
        told += f", taken as mounted parallel to the unit (rig key phins_{role}.installation_deg is not given)"
    R_imu_phins = np.eye(3) if mounting is None else mounting
    restored = _with_gravity(series, beside, R_imu_phins, profile)
    lost = len(series) - len(restored)
    return restored, (told, *((f"{lost} samples without attitude left out",) if lost > 1 else ()))


def _with_gravity(series: ImuSeries, source: ImuSeries, R_imu_source: np.ndarray, profile: RigProfile) -> ImuSeries:
    restored = with_gravity(series, source, R_imu_source, profile.gravity)
    if len(restored) < channels.MIN_SAMPLES:
        raise DataError("gravity is removed and the attitude that should restore it covers too few samples")
    return restored


def same_type(one: str, other: str) -> bool:
    """ROS 1 and 2 write types with and without ``/msg/``."""
    return one.replace("/msg/", "/") == other.replace("/msg/", "/")
