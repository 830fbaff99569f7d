"""The page of a comparison: several estimators on one trial, all in the same figures, RMSE side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from physics.units import ARCMIN
from schemas.products import Result, Score
from schemas.trial import Trial
from stages.publish.axis import Axis, span_of
from stages.publish.document import duration
from stages.publish.page import parts
from stages.publish.page.charts import Bar, Bars, bars
from stages.publish.page.figure import PALETTE, Line, Plot, plot
from stages.publish.page.html import Html, bullets, join, paragraph, section, table
from stages.publish.page.parts import angle
from stages.publish.page.sheet import Sheet, render, verdict_box
from stages.publish.verdict import AXES, REFERENCE_NAMES, closest, sigma_of, verdict


def comparison_page(results: Sequence[Result], trial: Trial, made: str = "") -> str:
    """HTML of several estimators on one trial; the first result's provenance stands for all."""
    names = [result.deformation.estimator for result in results]
    d = results[0].deformation
    length = duration(float(d.stamp[-1] - d.stamp[0]) * 1e-9)
    about = f"{', '.join(names)} on {length} from {parts.utc(int(trial.main.stamp[0]))}"
    body = [
        _verdict(results, trial),
        section("RMSE", rmse_table(results), *_rmse_bars(results)),
        section("Deformation in detail", _estimates(results, trial)),
        section("Error", _errors(results, trial)),
        section("What to distrust", _warnings(results)),
    ]
    origin = {**results[0].provenance, "estimator": ", ".join(names)}
    title = PurePath(trial.source).name or "trial"
    return render(Sheet("estimators compared on one trial", title, about, body, origin, made))


def _verdict(results: Sequence[Result], trial: Trial) -> Html:
    """Which came closest to the best reference, or that there is none to tell by."""
    grades = [f"{r.deformation.estimator}: {verdict(r, trial).headline}" for r in results]
    found = closest(results)
    if found is None:
        return verdict_box("care", "Nothing in the log tells which estimator is right.", grades)
    best, headline = found
    return verdict_box(verdict(best, trial).grade, headline, grades)


def rmse_table(results: Sequence[Result]) -> Html:
    """A row per estimator and reference: RMSE per axis beside what the estimator's own covariance says."""
    header = ["estimator", "against", *(f"{axis} [′]" for axis in AXES), "its own 1σ, x y z [′]"]
    rows = []
    for result in results:
        own = "  ".join(angle(value, 2) for value in sigma_of(result))
        found = [[REFERENCE_NAMES[s.reference], *(angle(v) for v in s.rmse)] for s in parts.ordered(result.scores)]
        rows += [[result.deformation.estimator, *row, own] for row in found or [["–", "–", "–", "–"]]]
    return table(header, rows)


def _rmse_bars(results: Sequence[Result]) -> list[Html]:
    """Per axis a bar for each estimator against the best reference; its own sigma as a mark."""
    scores = [parts.ordered(result.scores)[:1] for result in results]
    if not any(scores):
        return []
    figures = []
    for i, axis in enumerate(AXES):
        rows = [
            Bar(s.estimator, s.rmse[i] / ARCMIN, PALETTE[k % len(PALETTE)], mark=_mark(s, i), note=angle(s.rmse[i]))
            for k, found in enumerate(scores)
            for s in found
        ]
        name = REFERENCE_NAMES[next(found[0].reference for found in scores if found)]
        title = f"RMSE about {axis} against {name}; red: what the estimator itself expects"
        figures.append(bars(Bars(title, "RMSE [arcmin]", rows)))
    return figures


def _mark(score: Score, axis: int) -> float | None:
    expected = float(np.hypot(score.predicted[axis], score.reference_noise[axis])) / ARCMIN
    return expected if np.isfinite(expected) else None


def _estimates(results: Sequence[Result], trial: Trial) -> Html:
    """The minute in which the first estimate bends most, all estimates over the first reference."""
    x = parts.close_up(trial, results[0].deformation)
    return join(plot(_estimate_plot(results, trial, i, x)) for i in range(3))


def _estimate_plot(results: Sequence[Result], trial: Trial, i: int, x: Axis) -> Plot:
    lines = [_reference_line(result, trial, i, x) for result in results[:1] if result.scores]
    for k, result in enumerate(results):
        d = result.deformation
        t = trial.seconds(d.stamp)
        here = parts.within(t, x)
        lines.append(Line(t[here], d.total[here, i] / ARCMIN, PALETTE[k % len(PALETTE)], d.estimator, 1.3,
                          breaks=parts.breaks_of(d.stamp)))  # fmt: skip
    y = Axis(*span_of([line.y for line in lines], zero=False), "angle [arcmin]")
    return Plot(AXES[i], x, y, lines, height=170.0)


def _reference_line(result: Result, trial: Trial, i: int, x: Axis) -> Line:
    score = parts.ordered(result.scores)[0]
    stamp, total = parts.reference_angles(result.deformation, score)
    t = trial.seconds(stamp)
    here = parts.within(t, x)
    return Line(t[here], total[here, i] / ARCMIN, "#30363d", REFERENCE_NAMES[score.reference], 3.0, opacity=0.35)


def _errors(results: Sequence[Result], trial: Trial) -> Html:
    if not any(result.scores for result in results):
        return paragraph("The log holds no reference.")
    return join(plot(_error_plot(results, trial, i)) for i in range(3))


def _error_plot(results: Sequence[Result], trial: Trial, i: int) -> Plot:
    lines = []
    for k, result in enumerate(results):
        for score in parts.ordered(result.scores)[:1]:
            lines.append(Line(trial.seconds(score.stamp), score.error[:, i] / ARCMIN, PALETTE[k % len(PALETTE)],
                              score.estimator, 1.0, breaks=parts.breaks_of(score.stamp)))  # fmt: skip
    y = Axis(*span_of([line.y for line in lines]), "error [arcmin]")
    return Plot(f"{AXES[i]} error", parts.whole(trial), y, lines, height=150.0)


def _warnings(results: Sequence[Result]) -> Html:
    """What all of them share once, what one alone has under its name."""
    shared = [note for note in results[0].warnings if all(note in result.warnings for result in results)]
    own = [f"{r.deformation.estimator}: {note}" for r in results for note in r.warnings if note not in shared]
    return bullets([*shared, *own]) or paragraph("Nothing was odd.")
