"""The corpus: one enum value a fault, its mutation and the outcome it must have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from schemas.wire import Table, write_log
from tests.faults import channels as ch
from tests.faults import container as ct
from tests.faults.channels import MAIN, SUB, everywhere, gap, on, without
from tests.faults.outcomes import Answered, Refused

PAIR = (MAIN, SUB)
CHUNK = 100_000  # bytes: some tens of chunks of the file that is damaged


@dataclass(frozen=True)
class Damaged:
    """bytes: of the log as a file, or channels: of its tables before it is written."""

    bytes: ct.Bytes | None = None
    channels: ch.Mutation | None = None

    def write(self, sound: bytes, tables: Mapping[str, Table], path: Path) -> None:
        """The damaged copy of a sound log, given as a file and as tables."""
        if self.bytes is not None:
            path.write_bytes(self.bytes(sound))
            return
        assert self.channels is not None
        mutable = dict(tables)
        self.channels(mutable)
        write_log(path, list(mutable.values()))


def file(mutation: ct.Bytes) -> Damaged:
    return Damaged(bytes=mutation)


def log(mutation: ch.Mutation) -> Damaged:
    return Damaged(channels=mutation)


class Fault(Enum):
    """name = (damage, outcome)."""

    NONE = (file(lambda data: data), Answered())

    # the file
    EMPTY_FILE = (file(lambda data: b""), Refused(("empty",)))
    NOT_MCAP = (file(lambda data: b"time,gyro\n" * 1000), Refused(("not an MCAP file",)))
    MAGIC_ALONE = (file(lambda data: data[:8]), Refused(("/imu/main", "missing")))
    TRUNCATED_IN_HEADER = (file(ct.truncated_in_header), Refused(("/imu/main", "missing")))
    TRUNCATED_IN_CHUNK = (file(ct.truncated_in_chunk), Answered(("truncated",), least=0.7))
    TRUNCATED_IN_SUMMARY = (file(ct.truncated_in_summary), Answered())
    FLIPPED_WITH_CRC = (file(ct.flipped), Answered(("chunk at byte", "messages are lost"), least=0.8))
    FLIPPED_WITHOUT_CRC = (file(ct.flipped_without_crc), Answered((SUB, "gyro stands out", "x 1")))
    UNKNOWN_COMPRESSION = (file(ct.unknown_compression), Answered(("unknown compression 'snap'",), least=0.8))
    UNCOMPRESSED = (file(ct.uncompressed), Answered())
    LZ4 = (file(ct.lz4), Answered())
    UNCHUNKED = (file(ct.unchunked), Answered())
    NO_MESSAGE_INDEX = (file(ct.without_message_index), Answered())
    NO_SUMMARY = (file(ct.without_summary), Answered())
    ZERO_LENGTH_RECORDS = (file(ct.zero_length_records), Answered(("too short",)))
    CONFLICTING_CHANNEL = (
        file(ct.conflicting_channel),
        Answered(("channel id", "defined twice", "/imu/main", "/imu/sub"), least=0.6),
    )
    LYING_STATISTICS = (file(ct.lying_statistics), Answered())
    LYING_MESSAGE_INDEX = (file(ct.lying_message_index), Answered())

    # claims of gigabytes
    CHUNK_CLAIMS_A_PETABYTE = (file(ct.with_chunk(uncompressed_size=1 << 50)), Answered(("more than the",)))
    CHUNK_CLAIMS_ALL_IT_MAY = (
        file(ct.with_chunk(compression="zstd", data=ct.bomb(100), uncompressed_size=(1 << 29) - 1)),
        Answered(("does not hold as many bytes",)),
    )
    BOMB_IN_A_SMALL_CHUNK = (
        file(ct.with_chunk(compression="zstd", data=ct.bomb(1 << 28), uncompressed_size=1000)),
        Answered(("does not hold as many bytes",)),
    )
    RECORD_CLAIMS_AN_EXABYTE = (file(ct.with_claim(4)), Answered(("inside a record",)))
    CHUNK_RECORD_CLAIMS_AN_EXABYTE = (file(ct.with_claim(6)), Answered(("inside a record",)))
    SCHEMA_OF_A_TERABYTE = (file(ct.with_hostile_schema("float64[1000000000000] x")), Answered())
    SCHEMA_WITHOUT_END = (file(ct.with_hostile_schema("evil/Evil x")), Answered())
    SCHEMA_THAT_BRANCHES = (
        file(
            ct.with_hostile_schema(
                "A[1000] a\n" + "\n".join(f"{'=' * 80}\nMSG: evil/{a}\n{b}[1000] x" for a, b in ("AB", "BC", "CA"))
            )
        ),
        Answered(),
    )
    SMALL_FILE_HUGE_MAIN = (file(ct.hostile_main("float64[1000000000000] x")), Refused(("/imu/main",)))
    SMALL_FILE_HUGE_SEQUENCE = (file(ct.hostile_main("string[] x")), Refused(("/imu/main",)))

    # names
    NAMES_THAT_ARE_PATHS = (file(ct.with_hostile_names), Answered())

    # channels
    NO_MAIN = (log(without(MAIN)), Refused((MAIN, "missing", SUB)))
    NO_SUB = (log(without(SUB)), Refused((SUB, "missing", MAIN)))
    NO_OPTIONALS = (
        log(without("/phins/main", "/phins/sub", "/gnss/fix", "/imu/main/temperature", "/imu/sub/temperature")),
        Answered(),
    )
    EMPTY_SUB = (log(on(SUB, ch.kept(lambda t: t < 0.0))), Refused((SUB, "no messages")))
    EMPTY_PHINS = (log(on("/phins/sub", ch.kept(lambda t: t < 0.0))), Answered(("/phins/sub", "no messages")))
    UNKNOWN_TYPE = (log(on(SUB, ch.retyped)), Refused((SUB, "sensor_msgs/msg/Temperature", "sub.type")))
    THIRD_OF_A_SECOND = (log(everywhere(ch.kept(lambda t: t < 0.3))), Refused((MAIN, "usable messages")))
    THREE_SECONDS = (log(everywhere(ch.kept(lambda t: t < 3.0))), Refused((MAIN, SUB, "at least 5 s")))
    GAP_IN_MAIN = (log(on(MAIN, gap(20.0, 25.0))), Answered((MAIN, "a gap of 5.0"), least=0.85))
    GAP_IN_SUB = (log(on(SUB, gap(20.0, 25.0))), Answered((SUB, "a gap of 5.0"), least=0.85))
    GAP_IN_ALL = (log(everywhere(gap(20.0, 25.0))), Answered((SUB, "a gap of 5.0"), least=0.85))
    GAPS_NOW_AND_THEN = (log(on(SUB, ch.kept(lambda t: t % 15.0 > 0.2))), Answered((SUB, "gaps"), least=0.8))
    GAPS_EVERY_SECOND = (log(on(SUB, ch.kept(lambda t: t % 1.0 > 0.1))), Refused(("no piece of 10 s without a gap",)))
    LATE_START = (log(on(SUB, ch.kept(lambda t: t > 15.0))), Answered((SUB, "starts 15.0", "later"), least=0.7))
    EARLY_END = (log(on(MAIN, ch.kept(lambda t: t < 45.0))), Answered((SUB, "ends 15.0", "later"), least=0.7))
    HALF_RATE = (log(on(SUB, ch.halved)), Answered())
    HALF_RATE_MAIN = (log(on(MAIN, ch.halved)), Answered(least=0.45))
    DUPLICATES = (log(on(SUB, ch.duplicated)), Answered((SUB, "duplicate stamp")))
    DISORDER = (log(on(SUB, ch.disordered)), Answered((SUB, "out of order")))
    STAMPS_BACK = (log(on(MAIN, ch.set_back(40.0, 20.0))), Answered((MAIN, "jump back by 19.98"), least=0.6))
    ZERO_STAMPS = (log(on(PAIR, ch.stamped(np.zeros_like))), Answered((MAIN, "stamps are all zero")))
    ZERO_STAMPS_IN_SUB = (log(on(SUB, ch.stamped(np.zeros_like))), Answered((SUB, "stamps are all zero")))
    SOME_ZERO_STAMPS = (
        log(on(SUB, ch.stamped(lambda s: np.where(np.arange(len(s)) % 50 == 7, 0, s)))),
        Answered((SUB, "without a valid stamp")),
    )
    COARSE_STAMPS = (
        log(on(SUB, ch.stamped(lambda s: s // ch.SECOND * ch.SECOND))),
        Refused((SUB, "too coarse", "log_time")),
    )
    TWO_CLOCKS_APART = (log(on(SUB, ch.late(3600.0))), Refused((MAIN, SUB, "do not overlap", "two clocks")))
    STRANGERS = (log(on(SUB, ch.both(ch.reversed_in_time))), Refused((MAIN, SUB, "do not follow each other")))
    STRANGERS_FOR_A_SHORT_TIME = (log(on(SUB, ch.late(-40.0))), Refused((MAIN, SUB, "do not follow each other")))
    TWO_CLOCKS_NEAR = (log(on(SUB, ch.late(3.0))), Refused((SUB, "3 s ahead", "two clocks")))
    DEGREES = (log(on(SUB, ch.gyro(np.rad2deg))), Refused((SUB, "deg/s", "sub.gyro_unit")))
    DEGREES_IN_BOTH = (log(on(PAIR, ch.gyro(np.rad2deg))), Refused((MAIN, "deg/s", "main.gyro_unit")))
    ACCELERATION_IN_G = (log(on(MAIN, ch.accel(lambda a: a / ch.G))), Refused((MAIN, "looks like g")))
    SWAPPED_AXES = (log(on(SUB, ch.both(ch.swapped(0, 1)))), Refused((MAIN, SUB, "mirror")))
    SWAPPED_GYRO_AXES = (log(on(SUB, ch.gyro(ch.swapped(0, 1)))), Refused((MAIN, SUB, "mirror")))
    WRONG_SIGN = (log(on(SUB, ch.gyro(lambda w: w * [1.0, -1.0, 1.0]))), Refused((SUB, "mirror", "gyro_signs")))
    ALL_SIGNS_WRONG = (log(on(SUB, ch.gyro(np.negative))), Refused((SUB, "mirror", "gyro_signs")))
    WRONG_ACCELERATION = (log(on(SUB, ch.accel(np.negative))), Refused((SUB, "gravity", "sub.accel_signs")))
    COMPENSATED = (log(ch.compensated), Refused((SUB, "gravity looks removed", "sub.gravity_removed")))

    # samples
    NAN = (log(on(SUB, ch.gyro(ch.put(slice(1000, 1040), np.nan)))), Answered((SUB, "40 samples not finite")))
    ALL_NAN = (log(on(SUB, ch.gyro(ch.put(slice(None), np.nan)))), Refused((SUB, "100 %", "not finite")))
    INFINITE = (log(on(MAIN, ch.accel(ch.put(slice(500, 503), np.inf)))), Answered((MAIN, "3 samples not finite")))
    FROZEN = (log(on(SUB, ch.both(ch.frozen(slice(1000, 1200))))), Answered((SUB, "frozen"), least=0.85))
    FROZEN_TO_THE_END = (log(on(SUB, ch.both(ch.frozen(slice(1000, 3000))))), Refused((SUB, "frozen")))
    FROZEN_GYRO = (
        log(on(SUB, ch.gyro(ch.frozen(slice(1000, 1500))))),
        Answered((SUB, "499 samples frozen (gyro"), least=0.8),
    )
    DEAD_AXIS = (
        log(on(SUB, ch.gyro(lambda w: w * [1.0, 0.0, 1.0]))),
        Refused((SUB, "constant on y", "the unit is dead")),
    )
    FROZEN_ACCELEROMETER = (log(on(SUB, ch.accel(ch.frozen(slice(1000, 1500))))), Answered((SUB, "frozen"), least=0.8))
    SATURATED = (log(on(SUB, ch.gyro(ch.clipped(0.9)))), Answered((SUB, "saturated")))
    SATURATED_MUCH = (log(on(SUB, ch.gyro(ch.clipped(0.4)))), Refused(("no piece of 10 s without a gap",)))
    SPIKES = (log(on(SUB, ch.gyro(ch.spikes(15, 0.5)))), Answered((SUB, "stands out")))
    MANY_SPIKES = (
        log(on(SUB, ch.gyro(ch.spikes(200, 0.2)))),
        Answered((SUB, "stands out"), least=0.85, worst=(20.0, 20.0, 30.0)),
    )
    SPIKES_IN_ACCELERATION = (log(on(MAIN, ch.accel(ch.spikes(15, 50.0)))), Answered((MAIN, "stands out")))
