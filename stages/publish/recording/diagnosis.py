"""A diagnosis as a recording: the answer, where the gap lies, spectra before and after, the residual in time."""

from __future__ import annotations

from pathlib import Path, PurePath

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.diagnosis import Diagnosis, Localisation, Spectrum, Trace, Transfer
from schemas.rig import FloatArray
from stages.publish import diagnosis_words as words
from stages.publish.axis import Axis, decades_of, time_axis
from stages.publish.document import plain_markdown, table
from stages.publish.recording import layout
from stages.publish.recording.chart import Chart, Curve, chart_view, key_view, log_chart, log_key
from stages.publish.recording.overview import KEY_SHARE
from stages.publish.recording.scene import BLUE, GREEN, GREY, ORANGE, RED
from stages.publish.recording.sheet import Row, bars_height, log_bars, log_map, map_view, sheet_view
from stages.publish.recording.stream import record, send_lines
from stages.publish.residual import telling, transfer_gain, whitened_spectra

MOST_BARS = 14
MOST_SPECTRA = 9
MOST_TRACES = 6
MOST_LETTERS = 28  # of a bar's name
MAP_HEIGHT = 56.0
SPECTRA_IN_ROW, SPECTRUM_HEIGHT, ALL_SPECTRA_HEIGHT = 3, 80.0, 260.0
TRANSFER_HEIGHT = 80.0
SCALE = tuple((words.signed_log(v), f"{v:g}") for v in (-100.0, 0.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6))
SHORT = ("log", "twin", "twin + effects", "compensated")
TRACE_NAMES = ("before", "after", "what the effect foretells")
TRACE_COLOURS = (ORANGE, BLUE, RED)


def write_diagnosis_recording(diagnosis: Diagnosis, path: Path) -> None:
    """Write the recording of a diagnosis; it appears at path whole or not at all."""
    name = f"{PurePath(diagnosis.log).name} against {PurePath(diagnosis.twin).name}"
    axis = layout.axis_over(_span(diagnosis))
    record(path, name, layout.blueprint(_tabs(diagnosis, axis), axis), lambda rec: _log(rec, diagnosis))


def _span(d: Diagnosis) -> tuple[float, float]:
    """Start and end (s) of what is drawn over time."""
    ends = [(float(one.t[0]), float(one.t[-1])) for one in d.traces if len(one.t)]
    if d.localisation is not None and len(d.localisation.edges_s):
        ends.append((float(d.localisation.edges_s[0]), float(d.localisation.edges_s[-1])))
    ends = ends or [(0.0, max(d.duration_s, 1.0))]
    return min(a for a, _ in ends), max(b for _, b in ends)


def _log(rec: rr.RecordingStream, d: Diagnosis) -> None:
    document = rr.TextDocument(diagnosis_text(d), media_type=rr.MediaType.MARKDOWN)
    rec.log("answer", document, static=True)
    log_bars(rec, "evidence", _evidence(d), "nats, as if it were the only effect; red: needed", ticks=SCALE)
    if _shrinkage(d):
        log_bars(rec, "shrinkage", _shrinkage(d), "share of the gap closed [%]", (0.0, 100.0))
    if d.rmse is not None:
        log_bars(rec, "rmse", _errors(d), "RMSE [arcmin]")
    if d.localisation is not None and d.localisation.score.size:
        _log_maps(rec, d.localisation)
    found = _spectra(d)
    for index, (_, spectrum) in enumerate(found):
        log_chart(rec, f"spectra/{index}", _spectrum_chart(spectrum, _spectrum_height(len(found))))
    for index, trace in enumerate(telling(d.traces, MOST_TRACES)):
        _log_trace(rec, index, trace)
    if d.transfer is not None:
        for name, chart in _transfer_charts(d.transfer).items():
            log_chart(rec, f"transfer/{name}", chart)
    log_key(rec, "residual_key", list(zip(TRACE_NAMES, TRACE_COLOURS)))


def _spectra(d: Diagnosis) -> list[tuple[str, Spectrum]]:
    """With their titles: of the gyros at full rate, and of the whitened residuals that tell most."""
    named = [("", one) for one in d.spectra]
    named += [("whitened, ", one) for one in whitened_spectra(telling(d.traces, MOST_TRACES))]
    titles = [f"{what}{words.channel_text(one.channel, one.axis)} [{one.unit}]" for what, one in named]
    return list(zip(titles, (one for _, one in named)))[:MOST_SPECTRA]


def _spectrum_height(count: int) -> float:
    """Of each of so many charts, three in a row, that they fill the tab."""
    return max(SPECTRUM_HEIGHT, ALL_SPECTRA_HEIGHT / -(-count // SPECTRA_IN_ROW))


def _tabs(d: Diagnosis, axis: rrb.TimeAxis) -> list[rrb.Container]:
    """The answer first; a tab only for what there is."""
    tabs = [_answer_tab(d)]
    if d.localisation is not None and d.localisation.score.size:
        maps = [map_view("where/bands", "Deficit by channel and frequency [nats]", MAP_HEIGHT),
                map_view("where/blocks", "Deficit by channel and time [nats]", MAP_HEIGHT)]  # fmt: skip
        tabs.append(rrb.Vertical(*maps, name="Where"))
    found = _spectra(d)
    if found:
        height = _spectrum_height(len(found))
        charts = [chart_view(f"spectra/{k}", title, height) for k, (title, _) in enumerate(found)]
        tabs.append(rrb.Grid(*charts, grid_columns=min(SPECTRA_IN_ROW, len(charts)), name="Spectra"))
    if d.transfer is not None:
        source = words.channel_text(d.transfer.source, d.transfer.source_axis)
        into = words.channel_text(d.transfer.channel, d.transfer.axis)
        charts = [chart_view(f"transfer/{name}", f"{name}, {source} → {into}", TRANSFER_HEIGHT)
                  for name in _transfer_charts(d.transfer)]  # fmt: skip
        tabs.append(rrb.Vertical(*charts, name="Follows"))
    drawn = telling(d.traces, MOST_TRACES)
    if drawn:
        views = [layout.lines_view(axis, f"Whitened residual, {words.channel_text(one.channel, one.axis)} [1]",
                                   [f"residual/{k}"])
                 for k, one in enumerate(drawn)]  # fmt: skip
        shares = [KEY_SHARE, *[9.0 / len(views)] * len(views)]
        tabs.append(rrb.Vertical(key_view("residual_key", "Colours"), *views, row_shares=shares, name="In time"))
    return tabs


def _answer_tab(d: Diagnosis) -> rrb.Container:
    name = "Evidence of each effect [nats], logarithmic"
    right: list[object] = [sheet_view("evidence", name, bars_height(len(_evidence(d))))]
    if _shrinkage(d):
        right.append(sheet_view("shrinkage", "How far the gap shrinks [%]", bars_height(len(_shrinkage(d)))))
    if d.rmse is not None:
        right.append(sheet_view("rmse", "RMSE of the estimate [arcmin]", bars_height(12)))
    left = rrb.TextDocumentView(origin="answer", name="Answer")
    shares = [bars_height(len(_evidence(d))), bars_height(4), bars_height(12)][: len(right)]
    column = rrb.Vertical(*right, row_shares=shares)  # type: ignore[arg-type]
    return rrb.Horizontal(left, column, column_shares=[1.0, 1.1], name="Diagnosis")


def diagnosis_text(d: Diagnosis) -> str:
    """Markdown: verdict, what was found, what to do next, what could not be told."""
    parts = [f"# {words.HEADLINES[d.verdict]}", plain_markdown(words.sentence(d))]
    for finding in d.effects:
        rows = [[plain_markdown(cell) for cell in row] for row in words.parameters(finding)]
        evidence = f"evidence {words.nats(finding.evidence_nats)} nats"
        parts += [f"## {plain_markdown(finding.name)}, {evidence}", table(["parameter", "value ± std"], rows)]
    follows = [] if d.transfer is None else [words.transfer_text(d.transfer)]
    sections = {
        "What to do next": d.advice,
        "Where it shows": [words.place_text(place) for place in d.where[:5]],
        "How it follows the ship": follows,
        "Look-alikes": words.look_alikes(d),
        "What to distrust": d.notes,
        "What could not be tested": [f"{name}: {why}" for name, why in d.untestable.items()],
    }
    for title, lines in sections.items():
        if lines:
            parts.append(f"## {title}\n\n" + "\n".join(f"- {plain_markdown(line)}" for line in lines))
    return "\n\n".join(parts) + "\n"


def _evidence(d: Diagnosis) -> list[Row]:
    rows = [row for row in d.tested if row.evidence_nats is not None][:MOST_BARS]
    return [
        Row(row.name, words.signed_log(row.evidence_nats or 0.0), BLUE if row.named else GREY,
            mark=words.signed_log(row.threshold_nats), note=words.nats(row.evidence_nats))
        for row in rows
    ]  # fmt: skip


def _shrinkage(d: Diagnosis) -> list[Row]:
    rows = words.shrinkage(d) if d.effects or d.comparisons else []
    colours = {"answer": BLUE, "placebo": GREY}
    return [
        Row(_short(name), 100 * gap.closed, colours.get(name.split(":")[0], ORANGE),
            50 * (gap.closed_ci95[1] - gap.closed_ci95[0]), note=f"{words.percent(gap.closed)} %")
        for name, gap in rows
    ]  # fmt: skip


def _short(name: str) -> str:
    """Beginning and end of a long name."""
    head = MOST_LETTERS // 3
    return name if len(name) <= MOST_LETTERS else f"{name[:head].rstrip()}…{name[head + 1 - MOST_LETTERS :].lstrip()}"


def _errors(d: Diagnosis) -> list[Row]:
    return [
        Row(f"{name} {axis}", float(values[i]), colour, note=f"{values[i]:.3f}")
        for name, (_, values), colour in zip(SHORT, words.error_rows(d), (ORANGE, GREY, RED, GREEN))
        for i, axis in enumerate("xyz")
    ]


def _log_maps(rec: rr.RecordingStream, found: Localisation) -> None:
    rows = [words.channel_text(*name.split(" ", 1)) for name in found.channels]
    bands = [words.band_short(float(a), float(b)) for a, b in found.bands_hz]
    axis = time_axis(float(found.edges_s[0]), float(found.edges_s[-1]))
    times = [f"{t / axis.scale:.3g}" for t in 0.5 * (found.edges_s[1:] + found.edges_s[:-1])]
    by_band, by_block = found.score.sum(axis=2), found.score.sum(axis=1)
    log_map(rec, "where/bands", by_band, rows, bands, f"frequency [Hz]; {_red(by_band)}", MAP_HEIGHT)
    log_map(rec, "where/blocks", by_block, rows, times, f"{axis.label}; {_red(by_block)}", MAP_HEIGHT)


def _red(values: FloatArray) -> str:
    """What the hottest colour of a map stands for."""
    return f"red: {float(np.nanmax(values, initial=0.0)):.3g} nats"


def _spectrum_chart(one: Spectrum, height: float) -> Chart:
    keep = one.frequency > 0
    f, before, after, expected = (v[keep] for v in (one.frequency, one.before, one.after, one.expected))
    x = Axis(float(f.min()), float(f.max()), "frequency [Hz]", True)
    y = Axis(*decades_of([before, after, expected]), one.unit, True)
    curves = [
        Curve(f, expected, GREY, "expected", 2.5),
        Curve(f, before, ORANGE, "before"),
        Curve(f, after, BLUE, "after"),
    ]
    return Chart(x, y, curves, height=height)


def _transfer_charts(found: Transfer) -> dict[str, Chart]:
    """Gain and phase of what has no name, with their standard errors."""
    f = found.frequency
    x = Axis(float(f[0]), float(f[-1]), "frequency [Hz]", True)
    values = transfer_gain(found)
    phases = [np.clip(np.degrees(found.phase + sign * found.phase_std), -180.0, 180.0) for sign in (0.0, -1.0, 1.0)]
    gain, phase = Axis(*decades_of([values[0]]), f"gain [{found.unit}]", True), Axis(-180.0, 180.0, "phase [deg]")
    return {
        "gain": Chart(x, gain, _with_errors(f, *values), height=TRANSFER_HEIGHT),
        "phase": Chart(x, phase, _with_errors(f, *phases), height=TRANSFER_HEIGHT),
    }


def _with_errors(f: FloatArray, value: FloatArray, low: FloatArray, high: FloatArray) -> list[Curve]:
    return [Curve(f, low, GREY, "1 sigma"), Curve(f, high, GREY, ""), Curve(f, value, BLUE, "found")]


def _log_trace(rec: rr.RecordingStream, index: int, one: Trace) -> None:
    """Residual before and after, and what the effect foretells; nothing where the data were masked."""
    columns = [one.before, one.after, *([one.regressor] if one.regressor.any() else [])]
    values = np.where(one.good[:, None], np.stack(columns, axis=1), np.nan)
    stamp = np.round(one.t * 1e9).astype(np.int64)
    colours = TRACE_COLOURS[: len(columns)]
    send_lines(rec, f"residual/{index}", stamp, None, values, TRACE_NAMES[: len(columns)], colours, 1.2)
