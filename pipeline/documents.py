"""What ``--json`` prints: plain data in the units people see (arcminutes, seconds, 1/s, rad/s, rad/m)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.one_log import Comparison, LogRun
from stages.publish.summary import summary

Document = dict[str, Any]


def run_document(run: LogRun, written: Mapping[str, str]) -> Document:
    """One run: the summary of its result, what was taken out of the log before, and the files it wrote, by kind."""
    taken_out = {"compensated": list(run.compensated)} if run.compensated else {}
    return {**summary(run.result, str(run.path), run.wall), **taken_out, "written": dict(written)}


def compare_document(found: Comparison, written: Mapping[str, str]) -> Document:
    """Several estimators on one log; wall_s of each is its own time, what is shared not counted. failed: those that
    had no answer, with the reason."""
    documents = [summary(run.result, str(run.path), run.seconds["estimate"]) for run in found.runs]
    shared = ("log", "duration_s")
    return {
        **{key: documents[0][key] for key in shared},
        "estimators": [{key: value for key, value in one.items() if key not in shared} for one in documents],
        "failed": dict(found.failed),
        "written": dict(written),
    }
