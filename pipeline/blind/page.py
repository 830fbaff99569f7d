"""A score as a page for people, and the confusion of names as a picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from pipeline.blind.matching import FOREIGN_ALIKES

CELL = 15  # px
LEFT, TOP = 190, 190  # px, for the names
RIGHT = {
    True: ("no_gap",),
    False: ("unknown_effect", "partly_explained"),
}  # first answers to a null, to what is outside


def markdown(document: Mapping[str, Any], picture: str | None = None) -> str:
    """The whole score; picture: file of the confusion matrix to refer to."""
    methods: Mapping[str, Any] = document["methods"]
    parts = [_heading(document), _headline(methods)]
    for name, found in methods.items():
        parts += [f"## {name}", _nulls(found), _outside(found), _table("By severity", found["by_severity"])]
        parts += [_table("By effect, at 3 times the detectable severity and more", found["by_effect"])]
        for key in ("grade", "sea", "duration"):
            parts.append(_table(f"By {key}", found[f"by_{key}"]))
        parts.append(_calibration(found["calibration"]))
    if picture:
        parts.append(f"![First answer against truth, the first method]({picture})")
    return "\n\n".join(part for part in parts if part) + "\n"


def figure(document: Mapping[str, Any]) -> str:
    """The confusion matrix of the first method as SVG: rows are the truth, columns the first answer."""
    table: Mapping[str, Mapping[str, int]] = next(iter(document["methods"].values()))["confusion"]
    rows = sorted(table, key=lambda row: (row != "null", _is_outside(row), row))
    seen = {answer for row in table.values() for answer in row}
    columns = [name for name in rows if name in seen] + sorted(seen - set(rows))
    width, height = LEFT + CELL * len(columns) + 20, TOP + CELL * len(rows) + 20
    body = [
        f'<text x="{LEFT - 6}" y="{TOP + CELL * (i + 0.75):.1f}" text-anchor="end">{escape(_words(row))}</text>'
        for i, row in enumerate(rows)
    ]
    body += [
        f'<text transform="translate({LEFT + CELL * (j + 0.75):.1f},{TOP - 6}) rotate(-90)">{escape(_words(c))}</text>'
        for j, c in enumerate(columns)
    ]
    for i, row in enumerate(rows):
        body += _cells(i, row, columns, table[row])
    style = "text{font:11px sans-serif;fill:#222} .n{font-size:9px;text-anchor:middle} rect{stroke:#ddd}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f"<title>First answer (columns) against what was in the log (rows)</title><style>{style}</style>"
        f'<rect width="{width}" height="{height}" fill="#fff" style="stroke:none"/>{"".join(body)}</svg>\n'
    )


def _cells(i: int, row: str, columns: Sequence[str], counts: Mapping[str, int]) -> Iterable[str]:
    """Squares of one row, darker with the share of the row; green where the answer is right, red where not."""
    total = sum(counts.values())
    for j, column in enumerate(columns):
        count = counts.get(column, 0)
        right = column in RIGHT[row == "null"] if row == "null" or _is_outside(row) else column == row
        shade = f"rgba({'22,120,80' if right else '190,60,40'},{0.15 + 0.85 * count / total:.2f})" if count else "#fff"
        x, y = LEFT + CELL * j, TOP + CELL * i
        yield f'<rect x="{x}" y="{y}" width="{CELL}" height="{CELL}" fill="{shade}"/>'
        if count:
            dark = "#fff" if count > 0.4 * total else "#222"
            yield f'<text class="n" x="{x + CELL / 2}" y="{y + 11}" style="fill:{dark}">{count}</text>'


def _is_outside(row: str) -> bool:
    """The library does not have it."""
    return row in FOREIGN_ALIKES or row.endswith("(removed)")


def _words(name: str) -> str:
    return name.replace("_", " ")


def _heading(document: Mapping[str, Any]) -> str:
    about, opening = document["set"], document["opening"]
    kinds = ", ".join(f"{number} {kind}" for kind, number in about["kinds"].items())
    lines = [
        f"# Blind check: {about['logs']} sealed logs",
        f"{kinds}; {about['seconds'][0]:g} to {about['seconds'][1]:g} s each; seed {about['seed']}. "
        f"Commitment to the answers: `{about['commitment']}`.",
        f"Seal opened on {opening['first']}; this is scoring number {opening['number']}.",
    ]
    if opening["number"] > 1:
        changed = "have changed" if opening["answers_changed_since"] else "have not changed"
        lines.append(f"**The seal had been opened before this scoring**; the answers {changed} since then.")
    lines.append("Intervals are of 95 % (Wilson for shares, bootstrap for medians and means).")
    return "\n\n".join(lines)


def _headline(methods: Mapping[str, Any]) -> str:
    """One row a figure, one column a method."""
    rows: list[tuple[str, tuple[str, ...]]] = [
        ("one effect, 3 times the detectable and more: first name right", ("single", "top1")),
        ("the same, stated look-alikes counted", ("single", "group")),
        ("the same, truth among names and look-alikes", ("single", "in_set")),
        ("size of that set, mean", ("single", "set_size")),
        ("spurious names a log, mean", ("single", "spurious_per_log")),
        ("detected", ("single", "detected")),
        ("channel and axis right", ("single", "place")),
        ("channel and axis among the first three", ("single", "place_of_three")),
        ("nulls: a false name", ("nulls", "false_name")),
        ("nulls: any alarm", ("nulls", "any_alarm")),
        ("two effects: both named", ("pairs", "both")),
        ("two effects: spurious names a log, mean", ("pairs", "spurious_per_log")),
        ("outside the library: not explained", ("outside", "not_explained")),
        ("outside the library: confident and outside the group", ("outside", "confidently_wrong")),
        ("parameters within 3 sigma", ("parameters", "within_3_sigma")),
        ("parameters within their interval of 95 %", ("parameters", "within_interval")),
        ("relative error at 10 times, median", ("parameters", "relative_error_at_10x")),
        ("relative error at 10 times, at most 10 %", ("parameters", "within_10_percent_at_10x")),
        ("share of the gap closed, median", ("gap", "closed")),
        ("its interval reaches all of it", ("gap", "interval_reaches_all")),
        ("logs that failed", ("failures",)),
    ]
    lines = ["| | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for title, path in rows:
        cells = [_shown(_at(found, path)) for found in methods.values()]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _at(found: Mapping[str, Any], path: Sequence[str]) -> Any:
    value: Any = found
    for key in path:
        value = value[key]
    return value


def _shown(value: Any) -> str:
    """A share, or a median or mean, as text."""
    if isinstance(value, Mapping) and "share" in value:
        if value["share"] is None:
            return "none"
        low, high = value["ci95"]
        return f"{100 * value['share']:.1f} % [{100 * low:.1f}, {100 * high:.1f}] ({value['k']}/{value['n']})"
    if isinstance(value, Mapping):
        if value["value"] is None:
            return "none"
        return f"{value['value']:.3g} [{value['ci95'][0]:.3g}, {value['ci95'][1]:.3g}] (n = {value['n']})"
    return "none"


def _nulls(found: Mapping[str, Any]) -> str:
    named = found["nulls"]["named"]
    return "Named on nulls: " + (", ".join(f"{k} {v}" for k, v in named.items()) if named else "nothing") + "."


def _outside(found: Mapping[str, Any]) -> str:
    """The two kinds of logs that the library cannot explain."""
    lines = ["| outside the library | not explained | unknown | confident and outside the group | unseen |",
             "|---|---|---|---|---|"]  # fmt: skip
    for key, title in (("foreign", "forms of another shape"), ("removed", "effect taken out of the library")):
        cells = (_shown(found[key][name]) for name in ("not_explained", "unknown", "confidently_wrong", "unseen"))
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _table(title: str, groups: Mapping[str, Any]) -> str:
    if not groups:
        return ""
    lines = [f"| {title} | detected | first name right | look-alikes counted |", "|---|---|---|---|"]
    lines += [
        f"| {n} | {_shown(g['detected'])} | {_shown(g['top1'])} | {_shown(g['group'])} |" for n, g in groups.items()
    ]
    return "\n".join(lines)


def _calibration(classes: Sequence[Mapping[str, Any]]) -> str:
    lines = ["| evidence of a name, nats | name right |", "|---|---|"]
    for entry in classes:
        top = "more" if entry["to_nats"] is None else f"{entry['to_nats']:g}"
        lines.append(f"| {entry['from_nats']:g} to {top} | {_shown(entry['right'])} |")
    return "\n".join(lines)
