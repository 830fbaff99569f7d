"""Decoding and appending beside other readers and writers.

    python -m benchmarks.decode [--duration 7200] [--repeats 5]

CPU seconds (user and system) of the process, medians of alternating runs, and the ratio's spread over the runs. The
floor is reading, decompression, CRC and one copy into memory that is used again and again. Where no field is constant,
every value needs memory of its own, which takes the kernel about as long as decompression.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import McapReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from benchmarks.logs import write_trial
from schemas.wire import append_tables, definition, read_log, read_messages
from schemas.wire.checksum import crc32
from schemas.wire.container import File, outline
from schemas.wire.records import chunk_head, decompress_into
from stages.decode.profile import default_rig
from stages.decode.roles import wanted

Run = Callable[[Path], int]


def ours(path: Path) -> int:
    """Every column of every message, as arrays."""
    log = read_log(path)
    assert not log.problems
    return sum(map(len, log.tables.values()))


def trial_columns(path: Path) -> int:
    """What the pipeline itself loads: all messages checked, the columns kept that a trial is made of."""
    log = read_log(path, columns=wanted(default_rig()))
    assert not log.problems
    return sum(map(len, log.tables.values()))


def rust(path: Path) -> int:
    """Every message decoded; its output has no covariances."""
    rows: dict[str, int] = {}
    for chunk in McapReader(path).stream():
        name = str(chunk.entity_path)
        rows[name] = rows.get(name, 0) + chunk.num_rows
    return sum(rows.values())


def rosbags(path: Path) -> int:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        return sum(store.deserialize_cdr(raw, c.msgtype) is not None for c, _, raw in reader.messages())


def mcap_ros2(path: Path) -> int:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return sum(1 for _ in reader.iter_decoded_messages())


def floor(path: Path) -> int:
    """Reading, decompression, CRC and one copy: what no decoder can do without."""
    total = 0
    with File(path) as file:
        for block in outline(file).blocks:
            body = memoryview(file.read(block.start, block.stop))
            head = chunk_head(body)
            out = np.empty(head.size, np.uint8)
            decompress_into(body[head.data_start :], head.compression, out.data)
            assert crc32(out.data) == head.crc
            total += len(out.copy())
    return total


def append_ours(path: Path) -> int:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        log = read_log(path, ["/imu/main"])
        table = replace(log.tables["/imu/main"], topic="/new")
        start = time.process_time()
        append_tables(path, Path(folder) / "out.mcap", [table])
        append_ours.seconds = time.process_time() - start  # type: ignore[attr-defined]
        return len(table)


def append_library(path: Path) -> int:
    """The same through the library's writer: every message read and written again."""
    raw = read_messages(path, "/imu/main")
    start = time.process_time()
    with path.open("rb") as source, tempfile.TemporaryFile(dir=path.parent) as target:
        writer = Writer(target)
        writer.start("ros2")
        ids: dict[str, int] = {}

        def channel(topic: str, name: str) -> int:
            if topic not in ids:
                schema = writer.register_schema(name, "ros2msg", definition(name).encode())
                ids[topic] = writer.register_channel(topic, "cdr", schema)
            return ids[topic]

        for schema, old, message in make_reader(source).iter_messages(log_time_order=False):
            assert schema is not None
            writer.add_message(channel(old.topic, schema.name), message.log_time, message.data, message.publish_time)
        new = channel("/new", "sensor_msgs/msg/Imu")
        for k in range(len(raw)):
            writer.add_message(new, int(raw.log_time[k]), raw.payload(k), int(raw.publish_time[k]))
        writer.finish()
    append_library.seconds = time.process_time() - start  # type: ignore[attr-defined]
    return len(raw)


def measure(runs: dict[str, Run], path: Path, repeats: int) -> dict[str, list[float]]:
    """CPU seconds of each, in turns so that a busy machine touches all alike."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run(path)  # what is loaded, compiled and cached once
    for _ in range(repeats):
        for name, run in runs.items():
            start = time.process_time()
            run(path)
            seconds[name].append(getattr(run, "seconds", time.process_time() - start))
    return seconds


def report(title: str, seconds: dict[str, list[float]], reference: str) -> str:
    lines = [f"{title} (ratio: how many times the CPU time of {reference})"]
    for name, values in seconds.items():
        ratios = [value / own for value, own in zip(values, seconds[reference], strict=True)]
        spread = f"{statistics.median(ratios):6.2f}  [{min(ratios):.2f}, {max(ratios):.2f}]"
        lines.append(f"  {name:<24}{statistics.median(values):8.2f} s   {spread}")
    if "floor" in seconds:
        over = [own / least for own, least in zip(seconds[reference], seconds["floor"], strict=True)]
        lines.append(f"  {reference} over the floor: {statistics.median(over):.2f}  [{min(over):.2f}, {max(over):.2f}]")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=7200.0, help="seconds of log for the large comparison")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        large, small = Path(folder) / "large.mcap", Path(folder) / "small.mcap"
        start = time.process_time()
        count = write_trial(large, options.duration)
        print(
            f"written: {count} messages, {large.stat().st_size / 1e6:.0f} MB, {time.process_time() - start:.1f} CPU s"
        )
        runs: dict[str, Run] = {
            "deckflex": ours, "deckflex, trial columns": trial_columns, "rerun McapReader (Rust)": rust, "floor": floor
        }  # fmt: skip
        print(report(f"decode {options.duration:.0f} s", measure(runs, large, options.repeats), "deckflex"))
        write_trial(large, options.duration, vary=True)
        print(report("the same, no field constant", measure(runs, large, options.repeats), "deckflex"))
        write_trial(small, min(options.duration, 120.0))
        runs |= {"rosbags": rosbags, "mcap + mcap-ros2-support": mcap_ros2}
        print(report("decode 120 s", measure(runs, small, 3), "deckflex"))
        runs = {"deckflex": append_ours, "mcap Writer": append_library}
        print(report("append one IMU channel to 120 s", measure(runs, small, 3), "deckflex"))


if __name__ == "__main__":
    main()
