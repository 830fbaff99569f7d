"""The opening of the seal: answers held against the truth, all figures with their intervals."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.blind.folder import ANSWERS, OPENED, Sealed, read_json, read_manifest, write_json
from pipeline.blind.matching import Case, relative_error
from pipeline.blind.statistics import Share, mean, median, share
from pipeline.blind.vault import fingerprint, read_key, unlock
from schemas.errors import DataError

HEADLINE = 3.0  # multiple of the detectable severity from which the targets hold
STRONG = 10.0
EVIDENCE = (0.0, 10.0, 20.0, 50.0, 200.0, np.inf)  # nats, edges of the classes of the calibration
FULL = 0.995  # an interval of the share closed that reaches here holds "all of it"


def score(folder: Path, key: Path, *, again: bool = False, now: datetime | None = None) -> dict[str, Any]:
    """Open the seal, check every commitment, and score all methods that answered.

    The first opening is written down with a fingerprint of the answers; another one needs ``again`` and says so.
    Raises DataError for a wrong key, changed files, logs without an answer, or a seal that was opened before.
    """
    sealed = read_manifest(folder)
    openings = _openings(sealed, again)
    sealed.check()
    methods = list(sealed.methods())
    if not methods:
        raise DataError("there are no answers to score yet", file=folder)
    reports = {method: _reports(sealed, method) for method in methods}
    truth = unlock(folder / ANSWERS, read_key(key), sealed.commitment)
    prints = {method: _fingerprint(sealed, method) for method in methods}
    opened = (now or datetime.now(UTC)).strftime("%Y-%m-%dT%H:%M:%SZ")
    openings.append({"at": opened, "answers": prints})
    write_json(folder / OPENED, {"openings": openings})
    scored = {method: summary(cases(truth["logs"], found)) for method, found in reports.items()}
    return {
        "set": _about(sealed, truth),
        "opening": {
            "number": len(openings),
            "first": openings[0]["at"],
            "answers_changed_since": openings[0]["answers"] != prints,
        },
        "methods": scored,
    }


def cases(truth: Sequence[Mapping[str, Any]], reports: Mapping[str, Mapping[str, Any]]) -> list[Case]:
    """Each log's truth with its report."""
    return [Case(entry, reports[entry["name"]]) for entry in truth]


def summary(found: Sequence[Case]) -> dict[str, Any]:
    """All figures of one method."""
    single = [c for c in found if c.kind == "single"]
    strong = [c for c in single if c.severity >= HEADLINE]
    return {
        "logs": len(found),
        "failures": share(c.failed for c in found).document(),
        "nulls": nulls([c for c in found if c.kind == "null"]),
        "single": singles(strong),
        "by_severity": _grouped(single, lambda c: f"{c.severity:g}", in_full=True),
        "by_effect": _grouped(strong, lambda c: c.true_names[0]),
        "by_grade": _grouped(strong, lambda c: str(c.truth["grade"])),
        "by_sea": _grouped(strong, lambda c: str(c.truth["sea"])),
        "by_duration": _grouped(strong, lambda c: f"{c.truth['duration_s']:g}"),
        "pairs": pairs([c for c in found if c.kind == "pair" and c.severity >= HEADLINE]),
        "outside": outside([c for c in found if c.kind in ("foreign", "removed") and c.severity >= HEADLINE]),
        "foreign": outside([c for c in found if c.kind == "foreign" and c.severity >= HEADLINE]),
        "removed": outside([c for c in found if c.kind == "removed" and c.severity >= HEADLINE]),
        "parameters": parameters(strong),
        "gap": gaps(strong),
        "calibration": calibration([c for c in found if c.kind != "removed"]),
        "confusion": confusion(found),
        "cases": [_case(c) for c in found],
    }


def nulls(found: Sequence[Case]) -> dict[str, Any]:
    """False alarms on logs without an effect."""
    return {
        "false_name": share(bool(c.named) for c in found).document(),
        "any_alarm": share(c.detected for c in found).document(),
        "named": _counted(name for c in found for name in c.named),
    }


def singles(found: Sequence[Case]) -> dict[str, Any]:
    """Logs with one effect of the library."""
    return {
        "detected": share(c.detected for c in found).document(),
        "top1": share(c.right_first for c in found).document(),
        "group": share(c.right_group for c in found).document(),
        "in_set": share(bool(c.candidates & set(c.true_names)) for c in found).document(),
        "set_size": mean([len(c.candidates) for c in found]).document(),
        "spurious_per_log": mean([len(c.spurious) for c in found]).document(),
        "place": share(c.place_right() for c in found).document(),
        "place_of_three": share(c.place_right(3) for c in found).document(),
    }


def pairs(found: Sequence[Case]) -> dict[str, Any]:
    """Logs with two effects."""
    return {
        "both": share(set(c.true_names) <= set(c.named) for c in found).document(),
        "both_in_sets": share(set(c.true_names) <= c.candidates for c in found).document(),
        "one": share(bool(set(c.true_names) & set(c.named)) for c in found).document(),
        "spurious_per_log": mean([len(c.spurious) for c in found]).document(),
    }


def outside(found: Sequence[Case]) -> dict[str, Any]:
    """Logs whose effect the library does not have."""
    return {
        "not_explained": share(c.not_explained for c in found).document(),
        "unknown": share(c.verdict == "unknown_effect" for c in found).document(),
        "confidently_wrong": share(c.confidently_wrong for c in found).document(),
        "unseen": share(not c.detected for c in found).document(),
    }


def parameters(found: Sequence[Case]) -> dict[str, Any]:
    """Errors of the parameters of effects named rightly and first."""
    right = [c for c in found if c.right_first]
    numbers = [p for c in right for p in c.parameters()]
    with_std = [p for p in numbers if p.z is not None]
    errors = [e for c in right if c.severity >= STRONG and (e := relative_error(c)) is not None]
    return {
        "within_3_sigma": share(abs(p.z or 0.0) < 3.0 for p in with_std).document(),
        "within_interval": share(abs(p.z or 0.0) < 1.96 for p in with_std).document(),
        "without_std": share(p.z is None for p in numbers).document(),
        "relative_error_at_10x": median(errors).document(),
        "within_10_percent_at_10x": share(e <= 0.1 for e in errors).document(),
    }


def gaps(found: Sequence[Case]) -> dict[str, Any]:
    """The share of the gap closed where the right effect was named: the truth is all of it."""
    gap = [c.report["gap"] for c in found if c.right_first and isinstance(c.report.get("gap"), dict)]
    closed = [float(g["closed"]) for g in gap if g.get("closed") is not None]
    intervals = [g["closed_ci95"] for g in gap if g.get("closed_ci95") and None not in g["closed_ci95"]]
    return {
        "closed": median(closed).document(),
        "interval_reaches_all": share(high >= FULL for _, high in intervals).document(),
    }


def calibration(found: Sequence[Case]) -> list[dict[str, Any]]:
    """How often a name is right, by its evidence in nats."""
    named = [
        (float(e.get("evidence_nats") or 0.0), e["name"] in c.true_names)
        for c in found
        if not c.failed
        for e in c.report.get("effects", ())
    ]
    return [
        {"from_nats": low, "to_nats": None if np.isinf(high) else high, "right": _right(named, low, high).document()}
        for low, high in pairwise(EVIDENCE)
    ]


def confusion(found: Sequence[Case]) -> dict[str, dict[str, int]]:
    """First answer by what was there: null, and each effect of the logs with one."""
    table: dict[str, dict[str, int]] = {}
    for case in found:
        if case.kind == "pair":
            continue
        row = "null" if case.kind == "null" else case.true_names[0] + (" (removed)" if case.kind == "removed" else "")
        table.setdefault(row, {})
        table[row][case.first] = table[row].get(case.first, 0) + 1
    return {row: dict(sorted(table[row].items())) for row in sorted(table)}


def _case(case: Case) -> dict[str, Any]:
    """One log in a line: what was there and what was said."""
    return {
        "log": case.truth["name"],
        "kind": case.kind,
        "severity": case.severity,
        "truth": [{"name": e["name"], "parameters": e["parameters"]} for e in case.truth["effects"]],
        "verdict": case.verdict,
        "named": case.named,
        "failure": case.report.get("failure"),
    }


def _right(named: Sequence[tuple[float, bool]], low: float, high: float) -> Share:
    return share(right for nats, right in named if low <= nats < high)


def _grouped(found: Sequence[Case], by: Callable[[Case], str], *, in_full: bool = False) -> dict[str, Any]:
    """The figures of :func:`singles` for each group; in_full: those of parameters and gap too."""
    groups: dict[str, list[Case]] = {}
    for case in found:
        groups.setdefault(by(case), []).append(case)
    return {
        name: singles(group) | ({"parameters": parameters(group), "gap": gaps(group)} if in_full else {})
        for name, group in sorted(groups.items(), key=lambda item: (len(item[0]), item[0]) if in_full else item)
    }


def _counted(names: Iterable[str]) -> dict[str, int]:
    out: dict[str, int] = {}
    for name in names:
        out[name] = out.get(name, 0) + 1
    return dict(sorted(out.items()))


def _openings(sealed: Sealed, again: bool) -> list[dict[str, Any]]:
    path = sealed.folder / OPENED
    if not path.exists():
        return []
    openings: list[dict[str, Any]] = read_json(path)["openings"]
    if not again:
        raise DataError(f"the seal was opened already, on {openings[0]['at']}; --again scores it once more", file=path)
    return openings


def _reports(sealed: Sealed, method: str) -> dict[str, dict[str, Any]]:
    """Every report of a method; DataError before the seal is touched when one is missing."""
    folder = sealed.answers(method)
    missing = [entry.name for entry in sealed.logs if not (folder / f"{entry.name}.json").exists()]
    if missing:
        raise DataError(f"{len(missing)} of {len(sealed.logs)} logs have no answer by '{method}' yet", file=folder)
    return {entry.name: read_json(folder / f"{entry.name}.json") for entry in sealed.logs}


def _fingerprint(sealed: Sealed, method: str) -> str:
    """One hash over all answers of a method."""
    parts = [fingerprint(sealed.answers(method) / f"{entry.name}.json") for entry in sealed.logs]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def _about(sealed: Sealed, truth: Mapping[str, Any]) -> dict[str, Any]:
    durations = [float(entry["duration_s"]) for entry in truth["logs"]]
    return {
        "folder": sealed.folder.name,
        "seed": "secret until opened" if sealed.secret else "given",
        "commitment": sealed.commitment,
        "logs": len(truth["logs"]),
        "kinds": _counted(entry["kind"] for entry in truth["logs"]),
        "seconds": [min(durations), max(durations)],
    }
