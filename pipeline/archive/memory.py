"""How much memory a log takes, and how much a worker has: a log too large is refused in a line, not killed midway.

Peaks measured on simulated logs of a ship with PHINS and truth, all channels at 100 Hz, a recording and a page written
too: 0.7 GB for 30 min (1.1 million messages), 1.4 GB for 2 h (4.3 million), 3.4 GB for 8 h. With a diagnosis that names
an effect 0.8 GB for 10 min and 2.2 GB for 30 min; with one that finds nothing 3.2 GB for 2 h. A straight line above
them is what a log is taken to need.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from schemas.errors import DataError

if TYPE_CHECKING:
    from schemas.wire import Log

BASE = 500e6  # bytes that a run takes whatever the log
PER_MESSAGE = 240.0  # bytes
PER_MESSAGE_DIAGNOSED = 1600.0  # bytes
SMALLEST_MESSAGE = 8  # bytes in the file: a log that claims more messages than would fit in it is not believed
GB = 1e9
WITHOUT = ", a run without --diagnose takes less"


def needed(path: Path, diagnosed: bool = False) -> float:
    """Bytes that a run on a log, and its diagnosis, take at their peak; the least for a file that is no log."""
    from schemas.wire import scan_log

    try:
        log = scan_log(path)
    except DataError:
        return BASE
    messages = min(sum(channel.count or 0 for channel in log.channels), path.stat().st_size // SMALLEST_MESSAGE)
    more = (PER_MESSAGE_DIAGNOSED - PER_MESSAGE) * messages * _section(log) if diagnosed else 0.0
    return BASE + PER_MESSAGE * messages + more


def _section(log: Log) -> float:
    """The share of a log that is diagnosed at a time."""
    from stages.diagnose.sections import LONGEST_S

    if log.start is None or log.end is None:
        return 1.0
    return min(1.0, LONGEST_S * 1e9 / max(log.end - log.start, 1))


def check_memory(path: Path, limit: float | None, diagnosed: bool = False) -> None:
    """Raise DataError where a log would take more than a worker has."""
    if limit is None:
        return
    want = needed(path, diagnosed)
    if want > limit:
        raise DataError(
            f"needs about {want / GB:.1f} GB, a worker has {limit / GB:.1f} GB; fewer workers (--workers) leave more "
            f"for each{WITHOUT if diagnosed else ''}, --memory states how much"
        )


def machine_memory() -> float:
    """Bytes of memory that this process may use: of the machine, or of the container it is in."""
    limits = [float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")]
    for place in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(float(Path(place).read_text()))
        except (OSError, ValueError):
            continue
    return min(limits)


def per_worker(workers: int) -> float:
    """Bytes for each of so many workers of this machine; a tenth is left to everything else."""
    return 0.9 * machine_memory() / max(workers, 1)


def forget_peak() -> None:
    """Begin a new measurement of :func:`peak`, where the system can."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def peak() -> float:
    """Bytes this process had in memory at most since :func:`forget_peak`; 0 where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return 0.0
    found = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")]
    return 1024.0 * float(found[0]) if found else 0.0
