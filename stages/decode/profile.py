"""The rig profile: what the owner of a log declares about its channels and the installation (TOML).

Everything has the log contract's default, so an empty profile, or none, reads a log of the contract. Unknown keys and
absurd values are refused in one line that names the key. The reference for users is ``docs/rig.md``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from physics.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from schemas.errors import DataError
from schemas.rig import FloatArray, ImuGrade, Rig
from stages.decode.axes import hull_from_log
from stages.decode.profile_errors import first_error

Sampling = Literal["interval", "instantaneous"]
Sign = Literal[-1, 1]
Signs = tuple[Sign, Sign, Sign]
Columns = str | tuple[str, ...]
Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]

IMU = "sensor_msgs/msg/Imu"
DEFAULTS: dict[str, tuple[str, str]] = {
    "main": ("/imu/main", IMU),
    "sub": ("/imu/sub", IMU),
    "phins_main": ("/phins/main", IMU),
    "phins_sub": ("/phins/sub", IMU),
    "gnss": ("/gnss/fix", "sensor_msgs/msg/NavSatFix"),
    "sliding": ("/sliding/imu", IMU),
    "sled": ("/sliding/odom", "nav_msgs/msg/Odometry"),
    "temperature_main": ("/imu/main/temperature", "sensor_msgs/msg/Temperature"),
    "temperature_sub": ("/imu/sub/temperature", "sensor_msgs/msg/Temperature"),
    "truth_deformation": ("/truth/deformation", "deckflex_msgs/msg/Deformation"),
    "truth_attitude": ("/truth/attitude", "geometry_msgs/msg/QuaternionStamped"),
}
"""Topic and message type of every role of the contract."""
REQUIRED = ("main", "sub")


class _Strict(BaseModel):
    """Unknown keys, infinities and changes after loading are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Channel(_Strict):
    """One channel: where it is and how its messages are laid out.

    fields: standard field -> column(s) of the log's message: either the prefix of a vector ("gyro" for gyro.x, gyro.y,
    gyro.z; also one array column), or the columns one by one. stamp_unit: of a stamp column that is a plain number.
    """

    topic: str = Field(min_length=1)
    type: str = Field(min_length=1)
    use: bool = True
    encoding: Literal["cdr", "json", "protobuf"] | None = None
    stamp: Literal["header", "log_time"] = "header"
    stamp_unit: Literal["ns", "us", "ms", "s"] = "ns"
    fields: dict[str, Columns] = Field(default_factory=dict)
    standard: ClassVar[tuple[str, ...]] = ()

    @field_validator("fields")
    @classmethod
    def _known(cls, value: dict[str, Columns]) -> dict[str, Columns]:
        known = ("stamp", *cls.standard)
        for name in value:
            if name not in known:
                raise ValueError(f"{name!r} is no standard field of this channel; there are {', '.join(known)}")
        return value


class Gnss(Channel):
    """Position fixes. status: fixes with a negative one are left out."""

    standard: ClassVar[tuple[str, ...]] = ("latitude", "longitude", "altitude", "status", "position_covariance")


class Temperature(Channel):
    """Temperature of a unit, deg C."""

    standard: ClassVar[tuple[str, ...]] = ("temperature",)


class TruthChannel(Channel):
    """Truth of a simulated log; always as the log contract has it, but for the topic."""


class BodyChannel(Channel):
    """A channel whose vectors are resolved in body axes. axes: see :func:`stages.decode.axes.hull_from_log`."""

    axes: str | tuple[str, ...] | tuple[tuple[float, ...], ...] = "RFU"

    @field_validator("axes")
    @classmethod
    def _readable(cls, value: Any) -> Any:
        hull_from_log(value)
        return value

    @property
    def hull_rotation(self) -> FloatArray:
        """``R_hull_log`` (3, 3): maps vectors of the log's axes into hull axes."""
        return hull_from_log(self.axes)


class Sled(BodyChannel):
    """The sled's odometry on the deck: position and velocity, deck frame."""

    standard: ClassVar[tuple[str, ...]] = ("position", "velocity")


class Noise(_Strict):
    """Noise grade of a unit, as on its data sheet; what is left out is found in the log."""

    gyro_arw: float | None = Field(default=None, gt=0.0, le=100.0)
    gyro_bias_dph: float | None = Field(default=None, ge=0.0, le=1e5)
    accel_vrw_ug: float | None = Field(default=None, gt=0.0, le=1e6)
    accel_bias_ug: float | None = Field(default=None, ge=0.0, le=1e6)

    def grade(self) -> ImuGrade:
        """In SI: deg/sqrt(h), deg/h, ug/sqrt(Hz) and ug become rad/sqrt(s), rad/s, (m/s)/sqrt(s) and m/s^2."""
        return ImuGrade(
            _scaled(self.gyro_arw, DEG_PER_SQRT_HOUR),
            _scaled(self.gyro_bias_dph, DEG_PER_HOUR),
            _scaled(self.accel_vrw_ug, MICRO_G),
            _scaled(self.accel_bias_ug, MICRO_G),
        )


class Attitude(_Strict):
    """How a unit states its attitude. The signs concern ``form = "euler"``; frame and inverse the quaternion."""

    form: Literal["quaternion", "euler", "none"] = "quaternion"
    frame: Literal["ENU", "NED", "NWU"] = "ENU"
    inverse: bool = False
    unit: Literal["rad", "deg"] = "rad"
    pitch_positive: Literal["bow up", "bow down"] = "bow up"
    roll_positive: Literal["starboard down", "port down"] = "starboard down"
    heading_positive: Literal["clockwise", "counter-clockwise"] = "clockwise"


class ImuChannel(BodyChannel):
    """An inertial unit. Signs act in the log's axes, before ``axes``; sampling None: the profile's own."""

    standard: ClassVar[tuple[str, ...]] = (
        *("angular_velocity", "linear_acceleration", "orientation", "orientation_covariance"),
        *("heading", "pitch", "roll"),
    )
    gyro_unit: Literal["rad/s", "deg/s", "deg/h"] = "rad/s"
    accel_unit: Literal["m/s^2", "g", "mg"] = "m/s^2"
    gyro_signs: Signs = (1, 1, 1)
    accel_signs: Signs = (1, 1, 1)
    gravity_removed: bool = False
    sampling: Sampling | None = None
    attitude: Attitude = Attitude()
    noise: Noise = Noise()
    installation_deg: tuple[Degrees, Degrees, Degrees] | None = None


class Mount(_Strict):
    """lever_arm: main to sub, hull axes of the main IMU, m; lever_arm_std: one sigma per axis, m."""

    lever_arm: tuple[Metres, Metres, Metres] | None = None
    lever_arm_std: float = Field(default=0.05, gt=0.0, le=100.0)


class RigProfile(_Strict):
    """The whole profile. gravity: m/s^2, for units that publish specific force with gravity removed.

    plausibility: what to do when the values contradict the declared units: refuse the log (with the key that would
    mend it), or only warn.
    """

    name: str = "default"
    sampling: Sampling = "interval"
    plausibility: Literal["refuse", "warn"] = "refuse"
    gravity: float = Field(default=9.80665, gt=9.7, lt=9.9)
    mount: Mount = Mount()
    main: ImuChannel
    sub: ImuChannel
    phins_main: ImuChannel
    phins_sub: ImuChannel
    gnss: Gnss
    sliding: ImuChannel
    sled: Sled
    temperature_main: Temperature
    temperature_sub: Temperature
    truth_deformation: TruthChannel
    truth_attitude: TruthChannel

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        return {**data, **{role: _channel(data.get(role), *default) for role, default in DEFAULTS.items()}}

    @model_validator(mode="after")
    def _sensible(self) -> RigProfile:
        if self.main.topic == self.sub.topic:
            raise ValueError(f"main.topic and sub.topic are both {self.main.topic}; two units are needed")
        for role in ("main", "sub", "sliding"):
            if self.imu(role).installation_deg is not None:
                raise ValueError(f"{role}.installation_deg: belongs to phins_main and phins_sub only")
        for role in REQUIRED:
            if not self.channel(role).use:
                raise ValueError(f"{role}.use: the {role} IMU cannot be left out")
        return self

    def channel(self, role: str) -> Channel:
        """The channel of a role of the contract."""
        channel = getattr(self, role)
        assert isinstance(channel, Channel)
        return channel

    def imu(self, role: str) -> ImuChannel:
        """The channel of a role that is an inertial unit."""
        channel = getattr(self, role)
        assert isinstance(channel, ImuChannel)
        return channel

    def instantaneous(self, role: str) -> bool:
        """Whether gyro and accelerometer of the role are sampled at the stamp instead of averaged up to it."""
        return (self.imu(role).sampling or self.sampling) == "instantaneous"

    def rig(self) -> Rig:
        """The physical half, for the stages after decoding."""
        arm = self.mount.lever_arm
        return Rig(
            name=self.name,
            lever_arm=None if arm is None else np.array(arm, dtype=float),
            lever_arm_std=self.mount.lever_arm_std,
            installation_main=_installation(self.phins_main),
            installation_sub=_installation(self.phins_sub),
            main=self.main.noise.grade(),
            sub=self.sub.noise.grade(),
            sliding=self.sliding.noise.grade(),
        )


def default_rig() -> RigProfile:
    """The log contract's own conventions."""
    return RigProfile.model_validate({})


def load_rig(path: Path | str) -> RigProfile:
    """Read a rig profile. Raises DataError, one line with the file and the key, for anything it cannot accept."""
    try:
        text = Path(path).read_bytes().decode("utf-8")
        return RigProfile.model_validate(tomllib.loads(text))
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", file=path) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(f"is not valid TOML: {error}", file=path) from error
    except ValidationError as error:
        raise DataError(first_error(error, RigProfile), file=path) from error


def _channel(given: Any, topic: str, kind: str) -> Any:
    if given is None:
        return {"topic": topic, "type": kind}
    return {"topic": topic, "type": kind, **given} if isinstance(given, Mapping) else given


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _installation(unit: ImuChannel) -> FloatArray | None:
    """``R_imu_phins = Rz(heading) Rx(pitch) Ry(roll)``."""
    if unit.installation_deg is None:
        return None
    from physics.rotations import from_euler  # scipy is slow to import

    pitch, roll, heading = (np.asarray(angle * DEG) for angle in unit.installation_deg)
    return from_euler(heading, pitch, roll)
