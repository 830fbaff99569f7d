"""The page of a diagnosis: where the gap lies, what causes it, how far it shrinks, what could not be told."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath

import numpy as np

from schemas.diagnosis import Diagnosis, Finding, Localisation, Spectrum, Trace, Transfer
from schemas.rig import FloatArray
from stages.publish import diagnosis_words as words
from stages.publish.axis import Axis, decades_of, span_of, time_axis
from stages.publish.page.charts import Bar, Bars, HeatMap, bars, heat_map
from stages.publish.page.figure import BLUE, GREEN, GREY, ORANGE, RED, Line, Plot, plot
from stages.publish.page.html import Html, bullets, join, paragraph, section, table, tag
from stages.publish.page.sheet import Sheet, render, verdict_box
from stages.publish.residual import telling, transfer_gain, whitened_spectra

SPREAD = 4.0  # of a whitened trace: unit variance under the model
MOST_TRACES = 4
MOST_SPECTRA = 6
TRACE_WINDOW = 120.0  # s, of the trace in detail
MOST_BARS = 16
NATS_TICKS = tuple((words.signed_log(v), f"{v:g}") for v in (-1e4, -100.0, 0.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6))


def diagnosis_page(diagnosis: Diagnosis, provenance: Mapping[str, str], made: str = "") -> str:
    """HTML of one diagnosis. provenance: names and values printed at its end. made: when, as text."""
    body = [
        verdict_box(
            words.GRADES[diagnosis.verdict], words.HEADLINES[diagnosis.verdict], [words.sentence(diagnosis)],
            words.look_alikes(diagnosis),
        ),
        section("What to do next", bullets(diagnosis.advice)),
        section("What was found", *(_finding(finding) for finding in diagnosis.effects)),
        section("Section by section", _sections(diagnosis)),
        section("How far the gap shrinks", _shrinkage(diagnosis)),
        section("The estimate on log and twin", _errors(diagnosis)),
        section("Where the gap lies", _places(diagnosis), *_maps(diagnosis.localisation)),
        section("How it follows the ship", _transfer(diagnosis.transfer)),
        section("Residual spectra, before and after", _spectra(diagnosis)),
        section("Whitened residual in time", _traces(diagnosis)),
        section("Everything that was tested", _evidence(diagnosis), _tested(diagnosis)),
        section("What could not be tested", _untestable(diagnosis)),
        section("What to distrust", bullets(diagnosis.notes)),
        section("The twin with the effects", _twin(diagnosis)),
    ]  # fmt: skip
    about = f"{diagnosis.duration_s:.0f} s, held against the twin {PurePath(diagnosis.twin).name or diagnosis.twin}"
    title = PurePath(diagnosis.log).name or "trial"
    return render(Sheet("diagnosis of the gap between log and twin", title, about, body, provenance, made))


def _finding(finding: Finding) -> Html:
    """An effect with its parameters, where it shows, and its advice."""
    rows = list(words.parameters(finding))
    places = bullets(words.place_text(place).removeprefix("the ") for place in finding.places[:5])
    return join(
        [
            tag("h3", f"{finding.name} – evidence {words.nats(finding.evidence_nats)} nats"),
            table(["parameter", "value ± std"], rows, class_="words") if rows else None,
            join([paragraph("It shows, the strongest first, in:", class_="note"), places]) if finding.places else None,
            paragraph(finding.advice) if finding.advice else None,
        ]
    )


def _sections(d: Diagnosis) -> Html:
    rows = words.sections(d)
    return table(list(words.SECTION_HEADER), rows, class_="words") if rows else join([])


def _shrinkage(d: Diagnosis) -> Html:
    rows = words.shrinkage(d)
    if not d.effects and len(rows) == 1:
        return join([])
    colours = {"answer": BLUE, "placebo": GREY}
    drawn = [
        Bar(name, 100 * gap.closed, colours.get(name.split(":")[0], ORANGE),
            50 * (gap.closed_ci95[1] - gap.closed_ci95[0]), note=f"{words.percent(gap.closed)} %")
        for name, gap in rows
    ]  # fmt: skip
    figures = [
        [name, f"{gap.before:.4g}", f"{gap.after:.4g}", f"{words.percent(gap.closed)} %",
         f"{words.percent(gap.closed_ci95[0])} to {words.percent(gap.closed_ci95[1])} %"]
        for name, gap in rows
    ]  # fmt: skip
    title = "Share of the gap that closes; whiskers: 95 % interval"
    return join([
        bars(Bars(title, "share of the gap closed [%]", drawn, limits=(0.0, 100.0))),
        table(["gap with", "before", "after", "closed", "95 % interval"], figures, caption=f"in {d.gap.unit}"),
    ])  # fmt: skip


def _errors(d: Diagnosis) -> Html:
    rows = words.error_rows(d)
    if not rows:
        return join([])
    drawn = [
        Bar(f"{name}, {axis}" if i == 0 else axis, float(values[i]), colour, note=f"{values[i]:.3f}′")
        for (name, values), colour in zip(rows, (ORANGE, GREY, RED, GREEN))
        for i, axis in enumerate("xyz")
    ]
    figures = [[name, *(f"{value:.3f}" for value in values)] for name, values in rows]
    about = "With the right cause the twin with the effects errs as the log does, and the compensated log as the twin."
    return join([
        paragraph(about, class_="note"),
        table(["RMSE on", "x [′]", "y [′]", "z [′]"], figures, f"RMSE of the estimate{words.against(d)}"),
        bars(Bars("RMSE of the estimate", "RMSE [arcmin]", drawn)),
    ])  # fmt: skip


def _places(d: Diagnosis) -> Html:
    rows = [
        [words.channel_text(p.channel, p.axis), words.band_text(*p.band_hz),
         "whole record" if p.window_s is None else f"{p.window_s[0]:.0f} to {p.window_s[1]:.0f} s", f"{p.score:.0f}"]
        for p in d.where[:12]
    ]  # fmt: skip
    return table(["channel", "band", "time", "deficit [nats]"], rows) if rows else join([])


def _maps(found: Localisation | None) -> list[Html]:
    """Deficit by channel and frequency, and by channel and time."""
    if found is None or not found.score.size:
        return []
    rows = [words.channel_text(*name.split(" ", 1)) for name in found.channels]
    bands = [words.band_short(float(a), float(b)) for a, b in found.bands_hz]
    axis = time_axis(float(found.edges_s[0]), float(found.edges_s[-1]))
    middles = 0.5 * (found.edges_s[1:] + found.edges_s[:-1])
    times = [f"{t / axis.scale:.3g}" for t in middles]
    by_band, by_block = found.score.sum(axis=2), found.score.sum(axis=1)
    return [
        heat_map(HeatMap("By channel and frequency", rows, bands, by_band, "nats", "frequency [Hz]")),
        heat_map(HeatMap("By channel and time", rows, times, by_block, "nats", axis.label)),
    ]


def _transfer(found: Transfer | None) -> Html:
    """Gain and phase of what has no name."""
    if found is None:
        return join([])
    x = Axis(float(found.frequency[0]), float(found.frequency[-1]), "frequency [Hz]", log=True)
    gain, low, high = transfer_gain(found)
    phase = [np.degrees(found.phase + sign * found.phase_std) for sign in (0.0, -1.0, 1.0)]
    drawn = [
        ("gain", Axis(*decades_of([gain]), f"[{found.unit}]", log=True), (gain, low, high)),
        ("phase", Axis(-180.0, 180.0, "[deg]"), phase),
    ]
    figures = [
        plot(Plot(title, x, y, _with_errors(found.frequency, *values), height=230.0, width=300.0))
        for title, y, values in drawn
    ]
    return join([paragraph(words.transfer_text(found)), tag("div", *figures, class_="row")])


def _with_errors(f: FloatArray, value: FloatArray, low: FloatArray, high: FloatArray) -> list[Line]:
    return [Line(f, low, GREY, "1 sigma"), Line(f, high, GREY, ""), Line(f, value, BLUE, "found", 2.0)]


def _spectra(d: Diagnosis) -> Html:
    """Of the gyros at full rate, and of the whitened residuals that tell most."""
    figures = [plot(_spectrum(one)) for one in d.spectra]
    whitened = [plot(_spectrum(one, "whitened, ")) for one in whitened_spectra(telling(d.traces, MOST_SPECTRA))]
    return join(tag("div", *row, class_="row") for row in (figures, whitened) if row)


def _spectrum(one: Spectrum, what: str = "") -> Plot:
    f = one.frequency
    keep = f > 0
    x = Axis(float(f[keep].min()), float(f.max()), "frequency [Hz]", log=True)
    y = Axis(*decades_of([one.before[keep], one.after[keep], one.expected[keep]]), f"[{one.unit}]", log=True)
    lines = [
        Line(f, one.expected, GREY, "expected", 2.6, opacity=0.6),
        Line(f, one.before, ORANGE, "before"),
        Line(f, one.after, BLUE, "after"),
    ]
    return Plot(what + words.channel_text(one.channel, one.axis), x, y, lines, height=230.0, width=300.0)


def _traces(d: Diagnosis) -> Html:
    """The whole record, and below it the stretch where the regressor is largest in detail."""
    drawn = telling(d.traces, MOST_TRACES)
    return join(plot(_trace(one, axis, also)) for one in drawn for axis, also in _stretches(one))


def _stretches(one: Trace) -> list[tuple[Axis, str]]:
    """All of it, and where that is much longer than what shows single waves, a stretch."""
    long = float(one.t[-1] - one.t[0]) > 1.5 * TRACE_WINDOW
    return [(_whole(one), ""), *([(_detail(one), " in detail")] if long else [])]


def _whole(one: Trace) -> Axis:
    return time_axis(float(one.t[0]), float(one.t[-1]))


def _detail(one: Trace) -> Axis:
    size = np.abs(one.regressor) if one.regressor.any() else np.abs(one.before)
    middle = float(one.t[int(np.nanargmax(np.where(one.good, size, 0.0)))])
    start = max(float(one.t[0]), min(middle - 0.5 * TRACE_WINDOW, float(one.t[-1]) - TRACE_WINDOW))
    end = min(start + TRACE_WINDOW, float(one.t[-1]))
    return Axis(start, end, "time since the start of the trial [s]")


def _trace(one: Trace, x: Axis, also: str) -> Plot:
    here = slice(int(np.searchsorted(one.t, x.low)), int(np.searchsorted(one.t, x.high, side="right")))
    t, good = one.t[here], one.good[here]
    before, after = (np.where(good, values[here], np.nan) for values in (one.before, one.after))
    lines = [Line(t, before, ORANGE, "before", 0.9), Line(t, after, BLUE, "after", 0.9, opacity=0.7)]
    if one.regressor.any():
        lines.append(Line(t, np.where(good, one.regressor[here], np.nan), RED, "what the effect foretells", 1.4))
    low, high = span_of([before, after, np.array([-SPREAD, SPREAD])])
    y = Axis(low, high, "whitened residual [1]")
    return Plot(words.channel_text(one.channel, one.axis) + also, x, y, lines, height=150.0)


def _evidence(d: Diagnosis) -> Html:
    """Evidence against what it had to reach, on a scale that shows both nothing and very much."""
    rows = [row for row in d.tested if row.evidence_nats is not None][:MOST_BARS]
    if not rows:
        return join([])
    drawn = [
        Bar(row.name, words.signed_log(row.evidence_nats or 0.0), BLUE if row.named else GREY,
            mark=words.signed_log(row.threshold_nats), note=words.nats(row.evidence_nats))
        for row in rows
    ]  # fmt: skip
    keys = [(BLUE, "named"), (GREY, "not named"), (RED, "needed")]
    title = "Evidence of each effect as if it were the only one"
    return bars(Bars(title, "evidence [nats], scale of 1 + |nats|, logarithmic", drawn, keys, ticks=NATS_TICKS))


def _tested(d: Diagnosis) -> Html:
    rows = [[r.name, words.nats(r.evidence_nats), words.nats(r.threshold_nats), tag("span", words.judged(r))]
            for r in d.tested]  # fmt: skip
    return table(["effect", "evidence [nats]", "needed [nats]", ""], rows, class_="words") if rows else join([])


def _untestable(d: Diagnosis) -> Html:
    return bullets(f"{name}: {why}" for name, why in d.untestable.items())


def _twin(d: Diagnosis) -> Html:
    return tag("pre", d.augmented_twin) if d.augmented_twin.strip() else join([])
