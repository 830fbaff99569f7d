"""Log -> Trial: every role of the rig profile decoded, settled and checked; truth kept apart."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from schemas import scratch
from schemas.errors import DataError
from schemas.trial import Trial, Truth
from schemas.wire import Log, Table, read_log
from stages.decode import channels, plausible
from stages.decode.foreign import with_foreign
from stages.decode.profile import RigProfile, default_rig
from stages.decode.roles import Found, Notes, clock_lag, decode_role, epoch_of, has_channel, table_of, topics, wanted
from stages.slabs import beside

MIN_DURATION_S = 5.0
"""Main and sub IMU must record together at least so long."""
EDGE_S = 1.0
"""A channel that starts later or ends earlier than the main IMU by more than this is noted."""
CLOCKS_APART_S = 1.0
"""Stamps of main and sub further apart than this for messages written together: two clocks."""
GROUPS = (
    ("phins_main", "phins_sub"),
    ("main", "sub"),
    ("gnss", "sliding", "sled", "temperature_main", "temperature_sub"),
)
"""Roles that do not need each other; PHINS first: their attitude may have to restore the gravity an IMU removed."""
ORDER = tuple(role for group in GROUPS for role in group)

Progress = Callable[[int, int], None]
Series = TypeVar("Series", bound=Any)


@dataclass(frozen=True)
class Decoded:
    """A decoded log.

    truth: None unless the log is simulated. log: its channels, metadata and problems, without the tables. profile: how
    it was read.
    """

    trial: Trial
    truth: Truth | None
    log: Log
    profile: RigProfile


def decode(path: Path | str, rig_profile: RigProfile | None = None, progress: Progress | None = None) -> Decoded:
    """Decode a log into a trial (hull axes, SI, strictly increasing stamps) and its truth.

    Optional channels that are broken are left out with a note in ``trial.notes``. Raises DataError, with file and
    channel, where a required channel is missing, dead, too short or contradicts the units the profile declares.
    """
    profile = rig_profile or default_rig()
    try:
        log = read_log(path, topics(profile), progress, columns=wanted(profile))
        log = with_foreign(log, topics(profile))
        tables, log = dict(log.tables), replace(log, tables={})
        trial = _trial(log, tables, profile, str(path))
        truth, about_truth = _truth(log, tables, profile)
    except DataError as error:
        raise error.located(file=path) from error
    return Decoded(replace(trial, notes=trial.notes + about_truth), truth, log, profile)


def _trial(log: Log, tables: dict[str, Table], profile: RigProfile, source: str) -> Trial:
    """All channels but truth. Tables are given up group by group, to hold no more memory than needed."""
    for role in ("main", "sub"):
        table_of(role, log, tables, profile)
    epoch = epoch_of(tables[profile.main.topic], profile)
    found, notes = Found(), tuple(log.problems) + _clock_note(tables, profile)
    together = beside(len(tables[profile.main.topic]))
    for group in GROUPS:
        with ThreadPoolExecutor(together) as pool:
            decoded = pool.map(partial(_role, log, tables, profile, epoch, found), group)
            for role, (series, told) in zip(group, decoded):
                found = replace(found, **{role: series})
                notes += tuple(f"{profile.channel(role).topic}: {note}" for note in told)
        for role in group:
            release(role, tables, profile)
        scratch.release(*(column for table in tables.values() for column in table.columns.values()))
    return _assembled(found, notes, profile, source, epoch)


def _clock_note(tables: dict[str, Table], profile: RigProfile) -> Notes:
    """Whether main and sub stamp by different clocks, judged by when their messages were written."""
    lag = [clock_lag(tables[profile.channel(role).topic], profile.channel(role)) for role in ("main", "sub")]
    if lag[0] is None or lag[1] is None or abs(lag[1] - lag[0]) < CLOCKS_APART_S:
        return ()
    apart = abs(lag[1] - lag[0])
    way = "behind" if lag[1] > lag[0] else "ahead of"
    names = f"{profile.sub.topic} is {apart:.3f} s {way} {profile.main.topic}"
    return (f"by the times of writing the clock of {names}: two clocks?",)


def _role(
    log: Log, tables: dict[str, Table], profile: RigProfile, epoch: int, found: Found, role: str
) -> tuple[Any, Notes]:
    """The role decoded, None where the log lacks it; an optional one that is broken is told of instead."""
    channel = profile.channel(role)
    required = role in ("main", "sub")
    if not required and not has_channel(role, log, profile):
        return None, ()
    try:
        series, notes = decode_role(role, table_of(role, log, tables, profile), profile, epoch, found)
    except DataError as error:
        if required:
            raise error.located(channel=channel.topic) from error
        return None, (f"left out: {error.problem}",)
    return _shelved(series), notes


def _shelved(series: Series) -> Series:
    """The series, the large arrays of a long log out of memory."""
    arrays = {one.name: getattr(series, one.name) for one in fields(series)}
    return replace(series, **{k: scratch.shelved(v) for k, v in arrays.items() if isinstance(v, np.ndarray)})


def release(role: str, tables: dict[str, Table], profile: RigProfile) -> None:
    """Drop the role's table unless a later role reads it too."""
    topic = profile.channel(role).topic
    later = ORDER[ORDER.index(role) + 1 :]
    if all(profile.channel(one).topic != topic for one in later):
        tables.pop(topic, None)


def check_pair(found: Found, profile: RigProfile) -> Notes:
    """Whether main and sub record together and agree; DataError, or notes where the profile says only to warn."""
    assert found.main is not None
    assert found.sub is not None
    main, sub = found.main, found.sub
    begin, end = max(main.stamp[0], sub.stamp[0]), min(main.stamp[-1], sub.stamp[-1])
    together = float(end - begin) * 1e-9
    names = f"{profile.main.topic} and {profile.sub.topic}"
    if together <= 0.0:
        raise DataError(
            f"the stamps of {names} do not overlap, they are {-together:.3f} s apart: two clocks? "
            'rig key stamp = "log_time" would use the times of writing'
        )
    if together < MIN_DURATION_S:
        raise DataError(f"{names} record together for only {together:.3f} s; at least {MIN_DURATION_S:g} s are needed")
    doubt = plausible.pair(main, sub)
    if doubt and profile.plausibility == "refuse":
        raise DataError(f"{names}: {doubt}")
    return (f"{names}: {doubt}",) if doubt else ()


def _assembled(found: Found, notes: Notes, profile: RigProfile, source: str, epoch: int) -> Trial:
    notes += check_pair(found, profile)
    assert found.main is not None
    assert found.sub is not None
    return Trial(
        main=found.main,
        sub=found.sub,
        epoch=epoch,
        phins_main=found.phins_main,
        phins_sub=found.phins_sub,
        gnss=found.gnss,
        sliding=found.sliding,
        sled=found.sled,
        temperature_main=found.temperature_main,
        temperature_sub=found.temperature_sub,
        rig=profile.rig(),
        source=source,
        notes=notes + _edges(found, profile),
    )


def _edges(found: Found, profile: RigProfile) -> Notes:
    """Channels that start late or end early against the main IMU."""
    assert found.main is not None
    notes: Notes = ()
    for role in ("sub", "phins_main", "phins_sub"):
        series = getattr(found, role)
        if series is None:
            continue
        late = (series.stamp[0] - found.main.stamp[0]) * 1e-9
        early = (found.main.stamp[-1] - series.stamp[-1]) * 1e-9
        for what, by in (("starts", late), ("ends", early)):
            if abs(by) > EDGE_S:
                when = "later" if (by > 0) == (what == "starts") else "earlier"
                notes += (f"{profile.channel(role).topic} {what} {abs(by):.3f} s {when} than {profile.main.topic}",)
    return notes


def _truth(log: Log, tables: dict[str, Table], profile: RigProfile) -> tuple[Truth | None, Notes]:
    if not has_channel("truth_deformation", log, profile):
        return None, ()
    topic = profile.truth_deformation.topic
    try:
        deformation = table_of("truth_deformation", log, tables, profile)
        attitude = tables.get(profile.truth_attitude.topic)
        truth = channels.truth(deformation, profile.truth_deformation, attitude, profile.truth_attitude)
        return _shelved(truth), ()
    except DataError as error:
        return None, (f"{topic}: left out: {error.problem}",)
