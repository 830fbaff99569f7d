"""The Twin: what an engineer believes about ship and sensors, as a TOML file.

The tables and keys are those of the log contract; every key has a default, an unknown one is an error, and so is a
value no ship or sensor could have. Units stand in the names or in the comments; :mod:`twin.simulation` converts to SI.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Arcminutes = Annotated[float, Field(ge=-10800.0, le=10800.0)]
Row = tuple[Annotated[float, Field(ge=-80.0, le=80.0)], Annotated[float, Field(ge=0.5, le=86400.0)], Angle]
Rows = tuple[Row, ...]


class Section(BaseModel):
    """A table of the file: frozen, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Run(Section):
    """duration s; rate Hz; seed; start: time of the first stamp, s since 1970 UTC."""

    duration: Annotated[float, Field(gt=0.0, le=604800.0)] = 1800.0
    rate: Annotated[float, Field(ge=1.0, le=2000.0)] = 100.0
    seed: Annotated[int, Field(ge=0)] = 1
    start: Annotated[int, Field(ge=0, le=9_000_000_000)] = 1_767_225_600

    @model_validator(mode="after")
    def _enough(self) -> Run:
        if not 2 <= self.duration * self.rate <= 2e8:
            raise ValueError("duration times rate must give between 2 and 2e8 samples")
        return self


class Phase(Section):
    """From start (s) on, reached over ramp (s): speed (knots), heading (deg), sea (factor on all wave motion), weave.

    A phase that leaves a key out keeps the value before it. weave (deg): the course's swing at weave_period.
    """

    start: NotNegative
    ramp: Positive = 20.0
    speed: Annotated[float, Field(ge=-60.0, le=60.0)] | None = None
    heading: Annotated[float, Field(ge=-3600.0, le=3600.0)] | None = None
    sea: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    weave: Annotated[float, Field(ge=0.0, le=90.0)] | None = None


class Ship(Section):
    """Where the ship is and goes: deg, m, deg counter-clockwise from north, knots. phase: manoeuvres and rests."""

    latitude: Annotated[float, Field(ge=-85.0, le=85.0)] = 45.0
    longitude: Angle = 126.0
    height: Annotated[float, Field(ge=-500.0, le=10000.0)] = 20.0
    heading: Angle = 45.0
    speed: Annotated[float, Field(ge=-60.0, le=60.0)] = 20.0
    weave_period: Annotated[float, Field(ge=20.0, le=7200.0)] = 60.0
    phase: tuple[Phase, ...] = ()

    @model_validator(mode="after")
    def _ordered(self) -> Ship:
        starts = [phase.start for phase in self.phase]
        if starts != sorted(set(starts)):
            raise ValueError("phases must start one after the other")
        return self


class Sea(Section):
    """Wave motion: rows of amplitude, period s, phase deg; angles in deg, surge, sway and heave in m.

    model = "spectrum" draws the rows instead: a JONSWAP spectrum per motion with significant amplitude (twice the
    standard deviation; deg or m), peak period s, peak_enhancement (1: Pierson-Moskowitz), and components: number of
    lines.
    """

    model: Literal["rows", "spectrum"] = "rows"
    pitch: Rows = ((10.0, 8.0, 0.0),)
    roll: Rows = ((10.0, 8.0, 0.0),)
    heading: Rows = ((10.0, 10.0, 0.0),)
    surge: Rows = ()
    sway: Rows = ()
    heave: Rows = ()
    pitch_significant: Annotated[float, Field(ge=0.0, le=30.0)] = 1.5
    roll_significant: Annotated[float, Field(ge=0.0, le=40.0)] = 5.0
    heading_significant: Annotated[float, Field(ge=0.0, le=30.0)] = 1.5
    surge_significant: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    sway_significant: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    heave_significant: Annotated[float, Field(ge=0.0, le=15.0)] = 0.0
    pitch_period: Annotated[float, Field(ge=2.0, le=60.0)] = 7.0
    roll_period: Annotated[float, Field(ge=2.0, le=60.0)] = 10.0
    heading_period: Annotated[float, Field(ge=2.0, le=60.0)] = 11.0
    surge_period: Annotated[float, Field(ge=2.0, le=60.0)] = 9.0
    sway_period: Annotated[float, Field(ge=2.0, le=60.0)] = 9.0
    heave_period: Annotated[float, Field(ge=2.0, le=60.0)] = 8.0
    peak_enhancement: Annotated[float, Field(ge=1.0, le=20.0)] = 3.3
    components: Annotated[int, Field(ge=1, le=1000)] = 30


class Mount(Section):
    """The sub-IMU: static angle, lever arm main to sub (m, m-axes), band of its bending (Hz), time delay (s)."""

    static_arcmin: tuple[Arcminutes, Arcminutes, Arcminutes] = (10.0, 10.0, 30.0)
    lever_arm: tuple[Annotated[float, Field(ge=-500.0, le=500.0)], ...] = Field(
        default=(10.0, 10.0, 2.0), min_length=3, max_length=3
    )
    lever_bandwidth: Annotated[float, Field(ge=0.05, le=50.0)] = 5.0
    time_delay: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0


class Flexure(Section):
    """Second-order Gauss-Markov flexure and a slow sine per axis: mu 1/s, lambda rad/s, standard deviation arcmin.

    correlation: of the white forcing of two axes, xy xz yz.
    """

    damping: tuple[Positive, Positive, Positive] = (0.2146, 0.2146, 0.0715)
    frequency: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    std_arcmin: tuple[NotNegative, NotNegative, NotNegative] = (6.0, 6.0, 10.0)
    quasi_static_amplitude_arcmin: Vector = (0.0, 0.0, 0.0)
    quasi_static_period: Positive = 3600.0
    correlation: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _plausible(self) -> Flexure:
        xy, xz, yz = self.correlation
        if 1.0 - xy**2 - xz**2 - yz**2 + 2.0 * xy * xz * yz < 0.0 or max(abs(xy), abs(xz), abs(yz)) > 1.0:
            raise ValueError("no three axes have such correlations")
        if max(*self.damping, *self.frequency) > 100.0 or max(self.std_arcmin) > 600.0:
            raise ValueError("a rate above 100 1/s or a standard deviation above 600 arcmin is no deck's")
        return self


class Imu(Section):
    """Errors of one inertial unit; non-orthogonality in the order xy xz yx yz zx zy, xy being the y-rate seen on x."""

    gyro_bias_dph: Vector = (0.01, -0.01, -0.01)
    gyro_arw: NotNegative = 0.001
    gyro_scale_ppm: Vector = (5.0, -5.0, 5.0)
    gyro_nonorthogonality_arcsec: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = (
        5.0,
        -5.0,
        -5.0,
        5.0,
        -5.0,
        5.0,
    )
    accel_bias_ug: Vector = (50.0, 50.0, 50.0)
    accel_vrw_ug: NotNegative = 10.0


class Imus(Section):
    """The three units of a trial."""

    main: Imu = Imu()
    sub: Imu = Imu()
    sliding: Imu = Imu()


class Phins(Section):
    """A PHINS beside each IMU: attitude errors (arcmin, s), installation as pitch, roll, heading (deg), own noise."""

    attitude_noise_arcmin: NotNegative = 0.06
    attitude_drift_arcmin: tuple[NotNegative, NotNegative, NotNegative] = (0.3, 0.3, 0.6)
    attitude_drift_tau: Positive = 300.0
    installation_main_deg: tuple[Angle, Angle, Angle] = (-0.041, 0.430, -0.250)
    installation_sub_deg: tuple[Angle, Angle, Angle] = (-0.029, 0.525, 0.330)
    gyro_arw: NotNegative = 0.0015
    accel_vrw_ug: NotNegative = 15.0


class Gnss(Section):
    """GNSS receiver at the main IMU: rate Hz, white noise m per fix."""

    rate: Annotated[float, Field(gt=0.0, le=50.0)] = 1.0
    horizontal_std: NotNegative = 1.25
    vertical_std: NotNegative = 2.5


class Temperature(Section):
    """Warm-up from start (deg C) by rise (K) with time constant tau (s), a swing (K, s), white noise (K)."""

    rate: Annotated[float, Field(gt=0.0, le=50.0)] = 1.0
    start: Annotated[float, Field(ge=-60.0, le=90.0)] = 20.0
    rise_main: Annotated[float, Field(ge=-80.0, le=80.0)] = 8.0
    rise_sub: Annotated[float, Field(ge=-80.0, le=80.0)] = 10.0
    tau: Positive = 600.0
    swing: Annotated[float, Field(ge=0.0, le=50.0)] = 0.5
    swing_period: Positive = 1800.0
    noise: NotNegative = 0.01


class Channels(Section):
    """Which of the optional channels there are; the sliding runs are there when the twin has a [deck]."""

    phins: bool = True
    gnss: bool = True
    temperature: bool = True
    truth: bool = True


Profile = tuple[Finite, Finite, Positive, Finite, Positive]


class Deck(Section):
    """A SINS slid along a path on the deck: k(s) = a + b exp(-s/l) + c sin(2 pi s/L) rad/m about each hull axis.

    length m; speed m/s; angle deg to the centreline, to port. Runs go from the deck's edge (s = 0) to its centre, the
    origin of the deck frame, and back in turn when they alternate. Each is recorded from pause s before it moves until
    pause s after; ramp s to reach the speed; turnaround s between records; start s of the first record. origin: the
    deck frame's origin from the main IMU (m, m-axes); height of the sled (m). Own mounting (arcmin), outliers (1/min,
    deg/s), odometry noise (m, m/s).
    """

    length: Annotated[float, Field(gt=1.0, le=1000.0)] = 100.0
    speed: Annotated[float, Field(ge=0.05, le=50.0)] = 5.0
    angle: Angle = 7.0
    passes: Annotated[int, Field(ge=1, le=1000)] = 4
    vertical: Profile = (2e-5, 1.6e-4, 9.0, 1e-5, 60.0)
    horizontal: Profile = (1.5e-5, 1e-5, 20.0, 0.0, 50.0)
    torsion: Profile = (-1e-5, -2.2e-4, 8.0, 8e-6, 45.0)
    flexure_scale: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.3
    outlier_rate: Annotated[float, Field(ge=0.0, le=6000.0)] = 6.0
    outlier_size: NotNegative = 0.5
    alternate: bool = True
    start: NotNegative = 10.0
    pause: NotNegative = 5.0
    turnaround: NotNegative = 10.0
    ramp: Positive = 1.0
    origin: Vector = (0.0, 0.0, 0.0)
    height: Finite = 0.5
    mounting_arcmin: tuple[Arcminutes, Arcminutes, Arcminutes] = (-1.0, 2.0, 1.5)
    odometry_rate: Positive = 100.0
    position_std: NotNegative = 0.01
    velocity_std: NotNegative = 0.01

    @model_validator(mode="after")
    def _shallow(self) -> Deck:
        if self.ramp * self.speed > self.length:
            raise ValueError("the sled cannot reach its speed on so short a path")
        if max(abs(p[0]) + abs(p[1]) + abs(p[3]) for p in self.profiles) > 0.1:
            raise ValueError("a curvature above 0.1 rad/m is no deck's")
        return self

    @property
    def profiles(self) -> tuple[Profile, Profile, Profile]:
        """Profiles about x, y, z: vertical curvature, torsion, horizontal curvature."""
        return (self.vertical, self.torsion, self.horizontal)


class EffectSpec(BaseModel):
    """One [[effect]] table: its name and whatever parameters the effect has."""

    model_config = ConfigDict(frozen=True, extra="allow")
    name: str

    @property
    def parameters(self) -> dict[str, Any]:
        """Everything but the name."""
        return dict(self.model_extra or {})


class Twin(Section):
    """The whole file."""

    name: str = "unnamed"
    run: Run = Run()
    ship: Ship = Ship()
    sea: Sea = Sea()
    mount: Mount = Mount()
    flexure: Flexure = Flexure()
    imu: Imus = Imus()
    phins: Phins = Phins()
    gnss: Gnss = Gnss()
    temperature: Temperature = Temperature()
    channels: Channels = Channels()
    deck: Deck | None = None
    effect: tuple[EffectSpec, ...] = ()
