"""What a run found, as tables for people: arcminutes, seconds, plain words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from rich.table import Table

from physics.units import ARCMIN
from pipeline.one_log import AXES, Comparison, LogRun
from pipeline.tables import plain_table
from schemas.products import DeckShape, Estimate, FlexureModel, Score, Status
from stages.publish.best import static_angle, time_delay
from stages.publish.verdict import verdict

CURVES = ("vertical (x)", "torsion (y)", "horizontal (z)")


def run_report(run: LogRun, written: Mapping[str, str]) -> list[object]:
    """Everything ``deckflex run`` prints, from top to bottom."""
    deformation = run.result.deformation
    parts: list[object] = [
        heading(run),
        angle_table(run),
        "",
        f"time delay  {delay_line(time_delay(deformation))}",
        f"verdict     {verdict_line(run)}",
    ]
    parts += [f"used        {', '.join(deformation.used) or 'not stated'}"]
    parts += [f"compensated {note}" for note in run.compensated]
    if run.result.deck_shape is not None:
        notes = [f"note        {note}" for note in run.result.deck_shape.notes]
        parts += ["", deck_table(run.result.deck_shape), *(["", *notes] if notes else [])]
    parts += [*warning_lines(run.result.warnings), ""]
    parts += [f"wrote       {kind}: {path}" for kind, path in written.items()]
    return [*parts, f"took        {speed_line(run)}"]


def verdict_line(run: LogRun) -> str:
    """Whether to rely on the answer, and what speaks against it."""
    judged = verdict(run.result, run.decoded.trial)
    return " ".join([judged.headline, "; ".join(judged.reasons)]).strip()


def heading(run: LogRun) -> str:
    """Which log, how long, by which methods."""
    trial, deformation = run.decoded.trial, run.result.deformation
    return (
        f"{run.path}: {trial.duration:.1f} s, {len(deformation.stamp)} of {len(trial.main)} samples, "
        f"estimator {deformation.estimator}, identifier {run.identifier}"
    )


def angle_table(run: LogRun) -> Table:
    """One row per axis: static angle, flexure, what the covariance predicts, RMSE against each reference."""
    deformation = run.result.deformation
    scores = run.result.scores
    columns = ["static angle [′]", "flexure σ [′]", "μ [1/s]", "λ [rad/s]", "predicted σ [′]"]
    table = plain_table("axis", *columns, *(_rmse_heading(score) for score in scores))
    sigma = np.sqrt(np.nanmean(np.diagonal(deformation.covariance, axis1=1, axis2=2), axis=0))
    for axis, name in enumerate(AXES):
        table.add_row(
            name,
            _static(static_angle(deformation), axis),
            *_flexure_cells(deformation.flexure, axis),
            angle(sigma[axis]),
            *(_rmse(score, axis) for score in scores),
        )
    return table


def deck_table(shape: DeckShape) -> Table:
    """The largest curvature of each kind, all runs together, and where it is."""
    title = f"deck shape by {shape.method}: {len(shape.passes)} runs over {np.ptp(shape.arc_length):.1f} m"
    table = plain_table("curvature", "largest [rad/m]", "± [rad/m]", "at [m]", "beyond limit", title=title)
    for axis, name in enumerate(CURVES):
        at = int(np.nanargmax(np.abs(shape.curvature[:, axis])))
        beyond = f"{np.mean(shape.exceeds[:, axis]):.0%} of the path" if shape.exceeds[:, axis].any() else "no"
        worst, std = shape.curvature[at, axis], shape.std[at, axis]
        table.add_row(name, f"{worst:+.2e}", f"{std:.1e}", f"{shape.arc_length[at]:.1f}", beyond)
    return table


def compare_report(found: Comparison, written: Mapping[str, str]) -> list[object]:
    """Everything ``deckflex compare`` prints."""
    runs = found.runs
    trial = runs[0].decoded.trial
    table = plain_table(
        "estimator", "identifier", "reference", *(f"{axis} [′]" for axis in AXES), "predicted x y z [′]", "wall [s]"
    )
    for run in runs:
        for row in _compared(run):
            table.add_row(*row)
    shared = [note for note in runs[0].result.warnings if all(note in run.result.warnings for run in runs)]
    own = [(run.result.deformation.estimator, note) for run in runs for note in run.result.warnings]
    notes = [*shared, *(f"{name}: {note}" for name, note in own if note not in shared)]
    lines = [f"no answer   {name}: {reason}" for name, reason in found.failed.items()]
    lines += [f"wrote       {kind}: {path}" for kind, path in written.items()]
    return [f"{runs[0].path}: {trial.duration:.1f} s, RMSE per axis", table, *warning_lines(notes), *lines]


def warning_lines(warnings: Iterable[str]) -> list[str]:
    """One line a warning, after a blank one; nothing where there is nothing to say."""
    lines = [f"warning     {warning}" for warning in warnings]
    return ["", *lines] if lines else []


def angle(radians: float) -> str:
    """An angle in arcminutes, with as many digits as a person reads."""
    return f"{radians / ARCMIN:.3f}" if np.isfinite(radians) else "–"


def delay_line(delay: Estimate) -> str:
    """Time delay in milliseconds with its standard deviation and, where it matters, its status."""
    if delay.status is Status.NOT_OBSERVABLE:
        return f"{delay.status}: {delay.reason}"
    text = f"{float(delay.value) * 1e3:+.3f} ± {float(delay.std) * 1e3:.3f} ms"
    return text if delay.status is Status.ESTIMATED else f"{text} ({delay.status})"


def speed_line(run: LogRun) -> str:
    """Wall time, how many times faster than the trial, and where it went."""
    steps = ", ".join(f"{name} {seconds:.1f}" for name, seconds in run.seconds.items() if seconds >= 0.05)
    return f"{run.wall:.1f} s, {run.decoded.trial.duration / run.wall:.0f} times real time ({steps})"


def _static(static: Estimate, axis: int) -> str:
    return f"{static.value[axis] / ARCMIN:+.3f} ± {static.std[axis] / ARCMIN:.3f}"


def _flexure_cells(model: FlexureModel, axis: int) -> tuple[str, str, str]:
    mark = "" if model.status[axis] is Status.ESTIMATED else "?"
    return f"{angle(model.std[axis])}{mark}", f"{model.damping[axis]:.4f}{mark}", f"{model.frequency[axis]:.4f}{mark}"


def _rmse_heading(score: Score) -> str:
    noisy = " (its noise)" if (score.reference_noise > 0).any() else ""
    return f"RMSE vs {score.reference}{noisy} [′]"


def _rmse(score: Score, axis: int) -> str:
    """RMSE and, in brackets, the part of it that the reference's own noise explains."""
    noise = score.reference_noise[axis]
    return f"{angle(score.rmse[axis])} ({angle(noise)})" if noise > 0 else angle(score.rmse[axis])


def _compared(run: LogRun) -> Iterable[tuple[str, ...]]:
    name, wall = run.result.deformation.estimator, f"{run.seconds['estimate']:.2f}"
    if not run.result.scores:
        yield name, run.identifier, "none in the log", "–", "–", "–", "–", wall
    for score in run.result.scores:
        predicted = " ".join(angle(value) for value in score.predicted)
        yield name, run.identifier, score.reference, *(angle(value) for value in score.rmse), predicted, wall
