"""What ``deckflex info`` tells: channels, rates, gaps, disorder, and what can be run on the log."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.one_log import Progress
    from stages.decode import ChannelHealth, LogHealth


def log_health(log: Path, rig: Path | None = None, progress: Progress | None = None) -> LogHealth:
    """Look a log over. Raises DataError, which names the file, where it cannot be read at all."""
    from schemas.errors import DataError
    from stages.decode import health, load_rig

    profile = load_rig(rig) if rig else None
    try:
        return health(log, profile, _reading(progress))
    except DataError as error:
        raise error.located(file=log) from error


def health_document(health: LogHealth) -> dict[str, Any]:
    """The same for programs; times in seconds, stamps in nanoseconds since 1970 UTC."""
    from stages.publish.summary import plain

    document: dict[str, Any] = {
        "log": health.path,
        "start_ns": health.start,
        "end_ns": health.end,
        "duration_s": health.duration,
        "channels": [_channel_document(channel) for channel in health.channels],
        "missing": list(health.missing),
        "can_run": {one.name: {"possible": one.possible, "reason": one.reason} for one in health.capabilities},
        "problems": list(health.problems),
    }
    return dict(plain(document))


def health_report(health: LogHealth) -> list[object]:
    """Tables and lines for people."""
    from pipeline.tables import plain_table

    columns = ("role", "messages", "rate [Hz]", "jitter [ms]", "gaps", "longest [s]", "repeated", "disordered", "use")
    channels = plain_table("topic", *columns)
    for channel in health.channels:
        channels.add_row(channel.topic, channel.role or "–", str(channel.count), *_stamp_cells(channel))
    runs = plain_table("what can be run", "")
    runs.columns[1].justify = "left"
    for one in health.capabilities:
        runs.add_row(one.name, "yes" if one.possible else f"no: {one.reason}")
    problems = [f"problem     {problem}" for problem in health.problems]
    problems += [f"problem     {c.topic}: {problem}" for c in health.channels for problem in c.problems]
    missing = [f"missing     {', '.join(health.missing)}"] if health.missing else []
    return [_when(health), "", channels, "", runs, *(["", *missing, *problems] if missing or problems else [])]


def _reading(progress: Progress | None) -> Any:
    return None if progress is None else lambda done, total: progress("read", done, total)


def _channel_document(channel: ChannelHealth) -> dict[str, Any]:
    facts = channel.facts
    return {
        "topic": channel.topic,
        "role": channel.role or None,
        "schema": channel.schema,
        "encoding": channel.encoding,
        "messages": channel.count,
        "start_ns": channel.start,
        "end_ns": channel.end,
        "rate_hz": channel.rate,
        "jitter_s": facts.jitter if facts else None,
        "gaps": facts.gaps if facts else None,
        "longest_gap_s": facts.longest_gap if facts else None,
        "longest_gap_at_ns": facts.longest_gap_at if facts and facts.gaps else None,
        "duplicates": facts.duplicates if facts else None,
        "out_of_order": facts.out_of_order if facts else None,
        "usable": channel.usable,
        "problems": list(channel.problems),
    }


def _stamp_cells(channel: ChannelHealth) -> tuple[str, ...]:
    use = "no" if not channel.usable else "yes" if channel.role else "–"
    facts = channel.facts
    if facts is None:
        return "–", "–", "–", "–", "–", "–", use
    return (
        "–" if channel.rate is None else f"{channel.rate:.4g}",
        f"{facts.jitter * 1e3:.3f}",
        str(facts.gaps),
        f"{facts.longest_gap:.3f}" if facts.gaps else "–",
        str(facts.duplicates),
        str(facts.out_of_order),
        use,
    )


def _when(health: LogHealth) -> str:
    if health.start is None:
        return f"{health.path}: no stamps that could be read"
    start = datetime.fromtimestamp(health.start / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return f"{health.path}: {health.duration:.1f} s from {start} UTC"
