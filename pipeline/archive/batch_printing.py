"""What a batch says: a line a log on standard error as it ends, a summary on standard output."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from typing_extensions import override

from pipeline.archive.jobs import Outcome, State
from pipeline.archive.planning import Plan
from pipeline.archive.running import HOUR, Listener, Step, Summary

MOST_LISTED = 200  # logs without a result on the terminal; --json and the manifest have them all


@contextmanager
def listening() -> Iterator[Listener]:
    """Tell each log as it ends; a bar stands below where a person is there to see it."""
    if not sys.stderr.isatty():
        yield Lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, markup=False, highlight=False, emoji=False)
    said = TextColumn("{task.description}", markup=False)
    with Progress(BarColumn(), said, TimeElapsedColumn(), console=console, transient=True) as bar:
        task = bar.add_task("starting the workers", total=None)

        class Bar(Listener):
            @override
            def begun(self, total: int) -> None:
                bar.update(task, total=total, description=f"0 of {total} logs, time left not known yet;", refresh=True)

            @override
            def ended(self, step: Step) -> None:
                console.print(line(step), soft_wrap=True)
                told = ", ".join(part for part in (f"{step.done} of {step.total} logs", _left(step)) if part)
                bar.update(task, completed=step.done, description=f"{told};", refresh=True)

        yield Bar()


class Lines(Listener):
    """A line a log on standard error."""

    @override
    def ended(self, step: Step) -> None:
        _say(line(step))


def line(step: Step) -> str:
    """One log that ended, on one line whatever its name holds."""
    outcome = step.outcome
    width = len(str(step.total))
    told = f"{step.done:{width}}/{step.total} {outcome.state:<9} {outcome.source.name}  {_detail(outcome)}"
    left = _left(step)
    return one_line(f"{told}  [{left}]" if left else told)


def _detail(outcome: Outcome) -> str:
    if outcome.state is not State.DONE:
        return outcome.reason
    doubt = {"good": "", "care": "use with care", "bad": "do not rely on it"}.get(outcome.grade, "")
    parts = [f"{_length(outcome.duration_s)} in {outcome.wall_s:.1f} s", outcome.figures, doubt]
    parts += [f"no diagnosis: {outcome.reason}"] if outcome.reason else []
    return "; ".join(part for part in parts if part)


def _length(seconds: float) -> str:
    return (
        f"{seconds:.0f} s"
        if seconds < 600
        else f"{seconds / 60:.0f} min"
        if seconds < 5400
        else f"{seconds / HOUR:.2f} h"
    )


def _left(step: Step) -> str:
    if step.left_s is None or step.done == step.total:
        return ""
    return f"{_length(step.left_s)} left"


def one_line(text: str) -> str:
    """Nothing in it moves the cursor."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _say(text: str) -> None:
    with suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def summary_report(summary: Summary) -> list[str]:
    """What came of the batch."""
    counts = [
        (summary.done, "done"),
        (summary.done_before, "done before"),
        (summary.same, "of the same content as another"),
        (len(summary.aside), "set aside"),
        (len(summary.failed), "not now"),
        (summary.left, "left for the next run"),
    ]
    told = ", ".join(f"{count} {what}" for count, what in counts if count) or (
        "nothing done" if summary.stopped else "nothing to do"
    )
    lines = [f"{summary.logs} logs: {told}", *(f"note        {note}" for note in summary.notes)]
    if summary.hours_per_minute is not None:
        lines.append(
            f"{summary.hours:.2f} h of log in {_length(summary.wall_s)} on {summary.workers} workers: "
            f"{summary.hours_per_minute:.2f} h a minute; {summary.cpu_s:.0f} s of CPU, "
            f"at most {summary.peak_memory / 1e9:.1f} GB a worker"
        )
    lines += _listed("set aside", summary.aside) + _listed("not now", summary.failed)
    return [*map(one_line, lines), f"results     {summary.output}"]


def _listed(what: str, rows: list[tuple[str, str, str]]) -> list[str]:
    rest = len(rows) - MOST_LISTED
    lines = [f"{what:<11} {name}: {reason}" for _, name, reason in sorted(rows)[:MOST_LISTED]]
    return lines + ([f"{what:<11} and {rest} more"] if rest > 0 else [])


def complaint(summary: Summary) -> str:
    """Why the exit status is not 0, in a sentence."""
    without, left = len(summary.aside) + len(summary.failed), summary.left
    parts = [
        f"stopped early: {summary.stopped}" if summary.stopped else "",
        f"{left} of {summary.logs} logs are left for the next run" if left else "",
        f"{without} of {summary.logs} logs are without a result, each with its reason above" if without else "",
    ]
    return "; ".join(part for part in parts if part)


def plan_report(plan: Plan) -> list[str]:
    """What would be done."""
    counts = [
        (len(plan.jobs), "to do"),
        (len(plan.done), "done before"),
        (len(plan.same), "of the same content as another"),
        (len(plan.aside), "set aside before"),
        (len(plan.unreadable), "cannot be read"),
    ]
    size = sum(job.source.size or 0 for job in plan.jobs)
    lines = [f"{plan.logs} logs: {', '.join(f'{count} {what}' for count, what in counts if count)}"]
    lines += [f"note        {note}" for note in plan.notes]
    lines += [f"to do       {job.source.name}" for job in plan.jobs[:MOST_LISTED]]
    rest = len(plan.jobs) - MOST_LISTED
    lines += [f"to do       and {rest} more"] if rest > 0 else []
    lines += [f"unreadable  {name}: {reason}" for name, reason in plan.unreadable[:MOST_LISTED]]
    return [*map(one_line, lines), f"{size / 1e9:.2f} GB to read; nothing was done"]


def plan_document(plan: Plan) -> dict[str, Any]:
    """The same for programs."""
    return {
        "logs": plan.logs,
        "to_do": [job.source.address for job in plan.jobs],
        "done_before": len(plan.done),
        "same_content": len(plan.same),
        "set_aside_before": len(plan.aside),
        "unreadable": [{"name": name, "reason": reason} for name, reason in plan.unreadable],
        "bytes_to_read": sum(job.source.size or 0 for job in plan.jobs),
        "notes": list(plan.notes),
    }
