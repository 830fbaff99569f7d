"""Faults as mutations of a sound log, each with the outcome it must have.

An outcome is a refusal (one line that holds the words) or a note in the trial (that holds the words) with the rest of
the trial still good.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pytest

from schemas.errors import DataError
from schemas.wire import Table, write_log
from stages.decode import decode
from tests.stages.decode import synthetic
from tests.stages.decode.synthetic import COUNT, RATE, changed, selected

SECOND = 1_000_000_000


@dataclass(frozen=True)
class Refused:
    """DataError whose line holds all these words."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class Noted:
    """A note holds all these words; main keeps this many samples, and these optional parts are gone."""

    words: tuple[str, ...]
    main: int = COUNT
    gone: tuple[str, ...] = ()


Tables = dict[str, Table]


def on(topic: str, change: Callable[[Table], Table]) -> Callable[[Tables], None]:
    """A mutation of one channel."""

    def mutate(tables: Tables) -> None:
        tables[topic] = change(tables[topic])

    return mutate


def without(*topics: str) -> Callable[[Tables], None]:
    def mutate(tables: Tables) -> None:
        for topic in topics:
            del tables[topic]

    return mutate


def rows(index: np.ndarray) -> Callable[[Table], Table]:
    return lambda table: selected(table, index)


def put(at, value):
    def act(column):
        column[at] = value
        return column

    return act


def values(one: Table, prefix: str, act: Callable) -> Table:
    return changed(one, **{f"{prefix.replace('.', '__')}__{axis}": act for axis in "xyz"})


def gyro(act: Callable) -> Callable[[Table], Table]:
    return lambda one: values(one, "angular_velocity", act)


def accel(act: Callable) -> Callable[[Table], Table]:
    return lambda one: values(one, "linear_acceleration", act)


def stamped(act: Callable) -> Callable[[Table], Table]:
    return lambda one: changed(one, header__stamp=act)


def every(change: Callable[[Table], Table]) -> Callable[[Tables], None]:
    def mutate(tables: Tables) -> None:
        for topic in tables:
            tables[topic] = change(tables[topic])

    return mutate


def both(*mutations: Callable[[Tables], None]) -> Callable[[Tables], None]:
    def mutate(tables: Tables) -> None:
        for one in mutations:
            one(tables)

    return mutate


def written_late(one: Table, delay: np.ndarray) -> Table:
    return Table(one.topic, one.schema, one.columns, one.log_time + delay, one.publish_time + delay, one.sequence)


def frozen_from(first: int, last: int) -> Callable[[Table], Table]:
    def change(one: Table) -> Table:
        held = put(slice(first, last), 0.0)
        return values(values(one, "angular_velocity", held), "linear_acceleration", held)

    return change


def retyped(one: Table) -> Table:
    columns = {name: one.columns[name] for name in ("header.stamp", "header.frame_id")}
    columns |= {"temperature": np.zeros(len(one)), "variance": np.zeros(len(one))}
    return Table(one.topic, "sensor_msgs/msg/Temperature", columns, one.log_time, one.publish_time, one.sequence)


def without_gravity(one: Table) -> Table:
    one = changed(one, linear_acceleration__z=lambda a: a - synthetic.G)
    return changed(one, linear_acceleration__x=lambda a: a - a.mean(), linear_acceleration__y=lambda a: a - a.mean())


def clock_reset(one: Table) -> Table:
    """The clock is set back by 100 s after 10 s, while the recorder goes on."""
    return stamped(lambda s: np.where(np.arange(len(s)) >= 10 * RATE, s - 100 * SECOND, s))(one)


ALL = np.arange(COUNT)
GAP = np.r_[0:500, 800:COUNT]
DOUBLED = np.sort(np.r_[ALL, 100:110])
SWAPPED = np.r_[0:200, 205:210, 200:205, 210:COUNT]


class Fault(Enum):
    """name = (mutation, outcome)."""

    NONE = (lambda tables: None, Noted(()))
    MAIN_MISSING = (without("/imu/main"), Refused(("/imu/main", "missing", "the log has", "/imu/sub")))
    SUB_MISSING = (without("/imu/sub"), Refused(("/imu/sub", "missing", "the log has", "/imu/main")))
    OPTIONALS_MISSING = (
        without("/phins/main", "/phins/sub", "/gnss/fix", "/sliding/imu", "/sliding/odom", "/truth/deformation"),
        Noted((), gone=("phins_main", "phins_sub", "gnss", "sliding", "sled")),
    )
    WRONG_TYPE = (on("/imu/sub", retyped), Refused(("/imu/sub", "sensor_msgs/msg/Temperature", "sub.type")))
    WRONG_TYPE_OPTIONAL = (
        on("/phins/sub", retyped),
        Noted(("/phins/sub", "left out", "sensor_msgs/msg/Temperature"), gone=("phins_sub",)),
    )
    GAP_MAIN = (on("/imu/main", rows(GAP)), Noted(("/imu/main", "gap of 6.020 s", "t = 9.980 s"), main=COUNT - 300))
    GAP_ALL = (
        both(*(on(topic, rows(GAP)) for topic in ("/imu/main", "/imu/sub"))),
        Noted(("/imu/sub", "gap of 6.020 s"), main=COUNT - 300),
    )
    TWO_GAPS = (
        on("/imu/main", rows(np.r_[0:500, 600:1000, 1300:COUNT])),
        Noted(("2 gaps", "8.000 s in all", "longest 6.020 s", "t = 19.980 s"), main=COUNT - 400),
    )
    DUPLICATES = (on("/imu/main", rows(DOUBLED)), Noted(("/imu/main", "10 samples with a duplicate stamp left out")))
    DUPLICATES_DIFFERENT = (
        on("/imu/main", lambda one: gyro(put(105, 0.01))(selected(one, DOUBLED))),
        Noted(("10 samples with a duplicate stamp", "1 of them with different data")),
    )
    DISORDER = (on("/imu/main", rows(SWAPPED)), Noted(("/imu/main", "5 samples out of order", "put in order")))
    STAMPS_BACK = (on("/imu/main", clock_reset), Refused(("/imu/main", "/imu/sub", "do not overlap", "two clocks")))
    STAMPS_BACK_LATE = (
        on("/imu/main", stamped(lambda s: np.where(np.arange(len(s)) >= 1500, s - 100 * SECOND, s))),
        Noted(("/imu/main", "jump back by 99.980 s", "clock set", "1500 of 2000"), main=1500),
    )
    STAMPS_AHEAD = (
        on("/imu/main", stamped(lambda s: np.where(np.arange(len(s)) >= 1500, s + 60 * SECOND, s))),
        Noted(("/imu/main", "jump ahead by 60.020 s", "1500 of 2000"), main=1500),
    )
    ONE_STAMP_BACK = (
        on("/imu/main", stamped(lambda s: put(700, s[700] - 50 * SECOND)(s))),
        Noted(("1 sample with stamps far off",), main=COUNT - 1),
    )
    ONE_STAMP_AHEAD = (
        on("/imu/main", stamped(lambda s: put(700, s[700] + 50 * SECOND)(s))),
        Noted(("1 sample with stamps far off",), main=COUNT - 1),
    )
    ZERO_STAMPS = (every(stamped(np.zeros_like)), Noted(("/imu/main", "stamps are all zero", "log_time")))
    SOME_ZERO_STAMPS = (
        on("/imu/main", stamped(put(slice(50, 60), 0))),
        Noted(("10 samples without a valid stamp",), main=COUNT - 10),
    )
    COARSE_STAMPS = (
        on("/imu/main", stamped(lambda s: s // SECOND * SECOND)),
        Refused(("/imu/main", "too coarse", "log_time")),
    )
    TWO_CLOCKS = (
        on("/imu/sub", stamped(lambda s: s - 3600 * SECOND)),
        Refused(("/imu/main", "/imu/sub", "do not overlap", "3560", "two clocks")),
    )
    JITTER = (
        on("/imu/main", stamped(lambda s: s + np.random.default_rng(0).integers(-2_000_000, 2_000_000, len(s)))),
        Noted(("/imu/main", "jitter")),
    )
    HALF_RATE = (on("/imu/main", rows(ALL[::2])), Noted((), main=COUNT // 2))
    LATE_START = (on("/imu/sub", rows(ALL[400:])), Noted(("/imu/sub starts 8.000 s later than /imu/main",)))
    EARLY_END = (on("/imu/sub", rows(ALL[:1500])), Noted(("/imu/sub ends 10.000 s earlier than /imu/main",)))
    NAN = (
        on("/imu/main", gyro(put(slice(100, 103), np.nan))),
        Noted(("3 samples not finite", "2.000 s"), main=COUNT - 3),
    )
    INFINITE = (on("/imu/main", accel(put(200, np.inf))), Noted(("1 sample not finite", "4.000 s"), main=COUNT - 1))
    HUGE = (on("/imu/main", accel(put(200, 1e30))), Noted(("1 sample not finite or out of",), main=COUNT - 1))
    ALL_NAN = (on("/imu/sub", gyro(put(slice(None), np.nan))), Refused(("/imu/sub", "100 %", "not finite")))
    CONSTANT = (on("/imu/sub", gyro(put(slice(None), 0.0))), Refused(("/imu/sub", "gyro is constant", "dead")))
    CONSTANT_AXIS = (
        on("/imu/main", lambda one: changed(one, linear_acceleration__y=put(slice(None), 0.1))),
        Refused(("/imu/main", "accelerometer is constant on y", "0.1")),
    )
    FROZEN_PART = (
        on("/imu/main", frozen_from(500, 700)),
        Noted(("/imu/main", "200 samples frozen", "t = 10.000 s"), main=COUNT - 200),
    )
    FROZEN_MOST = (on("/imu/main", frozen_from(500, COUNT)), Refused(("/imu/main", "75 %", "frozen")))
    SATURATED = (
        on("/imu/main", lambda one: changed(one, angular_velocity__y=lambda w: np.clip(w, -0.03, 0.03))),
        Noted(("gyro y", "0.03", "saturated")),
    )
    SPIKES = (
        on("/imu/main", lambda one: changed(one, angular_velocity__z=put(slice(50, 1900, 100), 1.0))),
        Noted(("gyro stands out", "times: z 19")),
    )
    DEAD_PHINS = (
        on("/phins/main", lambda one: changed(one, **{f"orientation__{k}": put(slice(None), 0.5) for k in "xyzw"})),
        Noted(("/phins/main: left out", "frozen"), gone=("phins_main",)),
    )
    PHINS_UNAVAILABLE = (
        on("/phins/main", lambda one: changed(one, orientation_covariance=put((slice(None), 0), -1.0))),
        Noted(("/phins/main: left out", "no attitude"), gone=("phins_main",)),
    )
    PHINS_ZERO_QUATERNION = (
        on("/phins/sub", lambda one: changed(one, **{f"orientation__{k}": put(slice(9, 12), 0.0) for k in "xyzw"})),
        Noted(("/phins/sub", "3 samples without a living attitude")),
    )
    PHINS_NED = (
        on(
            "/phins/sub",
            lambda one: changed(
                one,
                orientation__x=lambda q: one.columns["orientation.w"].copy(),
                orientation__w=lambda q: -one.columns["orientation.x"].copy(),
                orientation__y=lambda q: -one.columns["orientation.z"].copy(),
                orientation__z=lambda q: one.columns["orientation.y"].copy(),
            ),
        ),
        Noted(("/phins/sub: left out", "180 degrees off gravity", "phins_sub.attitude"), gone=("phins_sub",)),
    )
    MAIN_DEG = (on("/imu/main", gyro(np.rad2deg)), Refused(("/imu/main", "deg/s", "main.gyro_unit")))
    SUB_DEG = (on("/imu/sub", gyro(np.rad2deg)), Refused(("/imu/sub", "deg/s", "sub.gyro_unit")))
    PHINS_DEG = (
        on("/phins/sub", gyro(np.rad2deg)),
        Noted(("/phins/sub: left out", "57 times", "phins_sub.gyro_unit"), gone=("phins_sub",)),
    )
    MAIN_G = (on("/imu/main", accel(lambda a: a / synthetic.G)), Refused(("looks like g", 'main.accel_unit = "g"')))
    SUB_MG = (on("/imu/sub", accel(lambda a: a / synthetic.G * 1e3)), Refused(("looks like mg", "sub.accel_unit")))
    NO_GRAVITY = (
        on("/imu/sub", without_gravity),
        Refused(("/imu/sub", "gravity looks removed", "sub.gravity_removed")),
    )
    WRONG_SIGN = (
        on("/imu/sub", lambda one: changed(one, angular_velocity__y=np.negative)),
        Refused(("/imu/main and /imu/sub", "mirror", "sub.gyro_signs")),
    )
    ACCEL_NEGATIVE = (
        on("/imu/sub", accel(np.negative)),
        Refused(("/imu/main and /imu/sub", "gravity", "180 degrees", "sub.accel_signs")),
    )
    CLOCKS_APART = (
        on("/imu/sub", stamped(lambda s: s - 3 * SECOND)),
        Noted(("the clock of /imu/sub is 3.000 s behind /imu/main",)),
    )
    UPSIDE_DOWN = (
        on(
            "/imu/sub",
            lambda one: changed(
                one,
                linear_acceleration__z=np.negative,
                angular_velocity__z=np.negative,
                linear_acceleration__x=np.negative,
                angular_velocity__x=np.negative,
            ),
        ),
        Noted(("/imu/sub", "tilted by 1", "sub.axes")),
    )
    TOO_SHORT = (
        every(lambda one: selected(one, np.arange(min(len(one), 15)))),
        Refused(("/imu/main", "only 15 usable")),
    )
    BRIEF = (on("/imu/sub", rows(ALL[:150])), Refused(("/imu/main and /imu/sub", "together for only 2.980 s", "5 s")))
    GNSS_WITHOUT_FIX = (
        on("/gnss/fix", lambda one: changed(one, status__status=put(slice(None), -1))),
        Noted(("/gnss/fix: left out", "no usable message"), gone=("gnss",)),
    )
    GNSS_FIX_LOST = (
        on("/gnss/fix", lambda one: changed(one, latitude=put(slice(3, 5), np.nan))),
        Noted(("/gnss/fix", "2 samples without a fix left out, the first at t = 3.980 s")),
    )
    SLED_STILL = (
        on("/sliding/odom", lambda one: values(one, "twist.twist.linear", put(slice(None), 0.0))),
        Noted(("/sliding/odom", "velocity contradicts its positions")),
    )


def written(fault: Fault, folder) -> object:
    mutate, _ = fault.value
    tables = synthetic.tables()
    mutate(tables)
    path = folder / f"{fault.name.lower()}.mcap"
    write_log(path, list(tables.values()))
    return path


@pytest.mark.parametrize("fault", Fault, ids=lambda fault: fault.name)
def test_fault_has_its_outcome(fault, tmp_path):
    path = written(fault, tmp_path)
    outcome = fault.value[1]
    if isinstance(outcome, Refused):
        with pytest.raises(DataError) as caught:
            decode(path)
        line = str(caught.value)
        assert "\n" not in line
        assert path.name in line
        assert [word for word in outcome.words if word not in line] == [], line
        return
    trial = decode(path).trial
    assert len(trial.main) == outcome.main
    assert [name for name in outcome.gone if getattr(trial, name) is not None] == []
    if outcome.words:
        assert any(all(word in note for word in outcome.words) for note in trial.notes), trial.notes
    assert_sound(trial)


def assert_sound(trial):
    """What every trial promises, however damaged the log was."""
    for role in ("main", "sub", "phins_main", "phins_sub", "sliding"):
        unit = getattr(trial, role)
        if unit is None:
            continue
        assert (np.diff(unit.stamp) > 0).all()
        # a PHINS is there for its attitude; its rates may be missing
        if not role.startswith("phins"):
            assert np.isfinite(unit.gyro).all()
            assert np.isfinite(unit.accel).all()
        if unit.attitude is not None:
            np.testing.assert_allclose(np.linalg.norm(unit.attitude, axis=1), 1.0, atol=1e-12)


def test_sound_log_has_no_notes(tmp_path):
    assert decode(written(Fault.NONE, tmp_path)).trial.notes == ()


@pytest.mark.parametrize("seed", range(6))
def test_random_damage_ends_in_a_trial_or_one_line(seed, tmp_path):
    rng = np.random.default_rng(seed)
    tables = synthetic.tables()
    for topic in rng.choice(list(tables), size=4, replace=False):
        tables[topic] = damaged(tables[topic], rng)
    path = tmp_path / "log.mcap"
    write_log(path, list(tables.values()))
    try:
        trial = decode(path).trial
    except DataError as error:
        line = str(error)
    else:
        line = "log.mcap"
        assert_sound(trial)
    assert "\n" not in line
    assert "log.mcap" in line


def damaged(one: Table, rng: np.random.Generator) -> Table:
    """Rows lost, repeated and shuffled, and a column with values no sensor gives."""
    one = selected(one, np.sort(rng.integers(0, len(one), rng.integers(1, len(one)))))
    name = rng.choice([key for key, column in one.columns.items() if column.dtype.kind == "f"])
    column = one.columns[name].copy()
    column[rng.integers(0, len(column), 50)] = rng.choice([np.nan, np.inf, -1e308, 1e200, 0.0])
    return Table(one.topic, one.schema, one.columns | {name: column}, one.log_time, one.publish_time, one.sequence)
