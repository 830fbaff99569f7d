"""What is in a log and what can be done with it: channels, rates, gaps, disorder, and what they allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schemas.errors import DataError
from schemas.wire import ChannelInfo, Log, Table, read_log, scan_log
from stages.decode import columns, stamps
from stages.decode.decoding import ORDER, check_pair, release
from stages.decode.foreign import with_foreign
from stages.decode.profile import DEFAULTS, IMU, REQUIRED, Channel, RigProfile, default_rig
from stages.decode.roles import Found, decode_role, epoch_of, has_channel, same_type, table_of, topics, wanted


@dataclass(frozen=True)
class ChannelHealth:
    """One channel. role: "" where the rig profile names none for it. Times in s; start, end in ns of the stamps.

    facts (rate, jitter, gaps, duplicates, disorder) are None where the stamps could not be read. usable: whether the
    role can be decoded; problems: what decoding repaired or refused.
    """

    topic: str
    role: str
    schema: str
    encoding: str
    count: int
    start: int | None = None
    end: int | None = None
    facts: stamps.StampFacts | None = None
    usable: bool = True
    problems: tuple[str, ...] = ()

    @property
    def rate(self) -> float | None:
        """Samples per second by the usual distance of stamps."""
        return 1.0 / self.facts.period if self.facts and self.facts.period > 0.0 else None


@dataclass(frozen=True)
class Capability:
    """What can be run on the log, or why not."""

    name: str
    possible: bool
    reason: str


@dataclass(frozen=True)
class LogHealth:
    """A log looked over. missing: roles of the contract without a channel; problems: of the file as a whole."""

    path: str
    channels: tuple[ChannelHealth, ...]
    capabilities: tuple[Capability, ...]
    missing: tuple[str, ...]
    problems: tuple[str, ...]
    start: int | None
    end: int | None

    @property
    def duration(self) -> float:
        """Seconds from the first stamp of any channel to the last."""
        return 0.0 if self.start is None or self.end is None else (self.end - self.start) * 1e-9


def health(
    path: Path | str, rig_profile: RigProfile | None = None, progress: Callable[[int, int], None] | None = None
) -> LogHealth:
    """Look over a log: every channel's stamps, which roles decode, what can be run. Raises DataError only where the
    file itself cannot be read.
    """
    profile = rig_profile or default_rig()
    listing = scan_log(path)
    known = {info.topic for info in listing.channels if _known_type(info)} | topics(profile)
    log = _read(path, known, profile, progress)
    tables, log = dict(log.tables), replace(log, tables={})
    looked = tuple(_channel(info, tables.get(info.topic), profile) for info in log.channels)
    found, notes, refusals = _decoded_roles(log, tables, profile)
    looked = tuple(_told(one, notes, refusals) for one in looked)
    begins = [one.start for one in looked if one.start is not None]
    ends = [one.end for one in looked if one.end is not None]
    has_truth = has_channel("truth_deformation", log, profile)
    return LogHealth(
        path=str(path),
        channels=looked,
        capabilities=_capabilities(found, profile, refusals, has_truth),
        missing=tuple(role for role in DEFAULTS if not has_channel(role, log, profile)),
        problems=tuple(log.problems) + _hint(log, profile),
        start=min(begins, default=None),
        end=max(ends, default=None),
    )


def _read(path: Path | str, known: set[str], profile: RigProfile, progress: Callable[[int, int], None] | None) -> Log:
    log = read_log(path, known, progress, columns=_looked_at(known, profile), attachments=True)
    try:
        return with_foreign(log, topics(profile))
    except DataError as error:
        return replace(log, problems=(*log.problems, str(error)))


def _looked_at(known: set[str], profile: RigProfile) -> dict[str, frozenset[str]]:
    """By topic, the columns of the roles that are decoded, not much more than the stamps of all others."""
    stamps_alone = {topic: columns.needed(_stamped(_role_of(topic, profile), profile)) for topic in known}
    return stamps_alone | wanted(profile, ORDER)


def _known_type(info: ChannelInfo) -> bool:
    return any(same_type(info.schema, kind) for _, kind in DEFAULTS.values())


def _role_of(topic: str, profile: RigProfile) -> str:
    return next((r for r in DEFAULTS if profile.channel(r).use and profile.channel(r).topic == topic), "")


def _stamped(role: str, profile: RigProfile) -> Channel:
    """The channel that says where a role's stamps are; of none, any channel of the profile."""
    return profile.channel(role) if role else profile.temperature_main


def _channel(info: ChannelInfo, table: Table | None, profile: RigProfile) -> ChannelHealth:
    """The channel's stamps as they were written, before anything is settled."""
    role = _role_of(info.topic, profile)
    count = len(table) if table is not None else info.count or 0
    bare = ChannelHealth(info.topic, role, info.schema, info.message_encoding, count)
    if table is None or not len(table):
        return bare
    try:
        stamp = columns.stamps(table, _stamped(role, profile))
    except DataError as error:
        return replace(bare, usable=not role, problems=(error.problem,))
    stamp = stamp if (stamp > 0).any() else np.asarray(table.log_time, dtype=np.int64)
    valid = stamp[(stamp > 0) & (stamp < stamps.LATEST_NS)]
    if not len(valid):
        return bare
    return replace(bare, start=int(valid.min()), end=int(valid.max()), facts=stamps.facts(valid))


def _decoded_roles(
    log: Log, tables: dict[str, Table], profile: RigProfile
) -> tuple[Found, dict[str, tuple[str, ...]], dict[str, str]]:
    """Every role that decodes, and by role what decoding told or why it refused. Tables are given up on the way."""
    found, notes, refusals = Found(), {}, {}
    epoch = _epoch(tables, profile)
    for role in ORDER:
        if not has_channel(role, log, profile):
            continue
        try:
            series, notes[role] = decode_role(role, table_of(role, log, tables, profile), profile, epoch, found)
            found = replace(found, **{role: series})
        except DataError as error:
            refusals[role] = error.problem
        release(role, tables, profile)
    return found, notes, refusals


def _epoch(tables: dict[str, Table], profile: RigProfile) -> int | None:
    main = tables.get(profile.main.topic)
    try:
        return epoch_of(main, profile) if main is not None and len(main) else None
    except DataError:
        return None


def _told(one: ChannelHealth, notes: dict[str, tuple[str, ...]], refusals: dict[str, str]) -> ChannelHealth:
    if one.role in refusals:
        return replace(one, usable=False, problems=(*one.problems, refusals[one.role]))
    return replace(one, problems=one.problems + notes.get(one.role, ()))


def _capabilities(
    found: Found, profile: RigProfile, refusals: dict[str, str], has_truth: bool
) -> tuple[Capability, ...]:
    def lacking(*roles: str) -> str:
        """Why a role cannot serve: refused or missing; empty where all can."""
        unfit = [role for role in roles if getattr(found, role) is None]
        return "; ".join(
            f"{profile.channel(role).topic} ({role}) " + refusals.get(role, "is missing") for role in unfit
        )

    no_estimate = lacking("main", "sub") or _no_pair(found, profile)
    reasons = {
        "estimators": no_estimate,
        "score against truth": no_estimate or ("" if has_truth else "the log has no truth"),
        "score against PHINS": no_estimate or lacking("phins_main", "phins_sub"),
        "attitude of the deck": no_estimate or ("" if _has_attitude(found) else lacking("phins_main")),
        "deck shape": lacking("sliding", "sled"),
        "diagnosis": no_estimate,
    }
    return tuple(Capability(name, not reason, reason) for name, reason in reasons.items())


def _has_attitude(found: Found) -> bool:
    return found.phins_main is not None or (found.main is not None and found.main.attitude is not None)


def _no_pair(found: Found, profile: RigProfile) -> str:
    try:
        check_pair(found, profile)
    except DataError as error:
        return error.problem
    return ""


def _hint(log: Log, profile: RigProfile) -> tuple[str, ...]:
    """Inertial channels that no role names, where a required one is missing."""
    missing = [role for role in REQUIRED if not has_channel(role, log, profile)]
    spare = [i.topic for i in log.channels if same_type(i.schema, IMU) and not _role_of(i.topic, profile)]
    if not missing or not spare:
        return ()
    return (
        f"{' and '.join(missing)} missing; a rig profile can name {', '.join(spare)} as one (key {missing[0]}.topic)",
    )
