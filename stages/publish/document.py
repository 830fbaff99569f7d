"""The summary in words: Markdown for the recording's documents. No character outside the basic plane: viewers choke."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import numpy as np

from schemas.products import DeckShape, Result
from stages.publish.deck_line import measured_line
from stages.publish.summary import AXES, intervals, summary
from stages.publish.verdict import Verdict

MARKUP = frozenset("\\`*_{}[]<>|#!~$&")
CURVES = ("vertical curvature (about x)", "torsion (about y)", "horizontal curvature (about z)")
NAMES = {"truth": "truth", "phins": "PHINS"}


def summary_text(result: Result, log: str = "", judged: Verdict | None = None) -> str:
    """One page: what the deformation was, how sure it is, what to distrust. judged: the verdict, to open with."""
    s = summary(result, log)
    if judged is not None:
        s["warnings"] = [line for line in s["warnings"] if line not in judged.reasons]
    parts = [_headline(s, judged), _warnings(s), _angles(s), _scores(s), _flexure(s), _deck(s), _provenance(s)]
    return "\n\n".join(part for part in parts if part) + "\n"


def accuracy_text(result: Result) -> str:
    """RMSE against its budget, coverage, and what the estimator used."""
    s = summary(result)
    used = [f"- {plain_markdown(line)}" for line in (*s["details"]["used"], *s["details"]["notes"])]
    parts = [_budget(s), _coverage(s), "### What was used\n\n" + "\n".join(used) if used else ""]
    return "\n\n".join(part for part in parts if part) + "\n"


def deck_text(shape: DeckShape) -> str:
    """Largest curvature of each kind, where it is, its limit, how far the line bends, and what was left out."""
    across = np.abs(measured_line(shape)).max(axis=0) * 1e3
    bend = f"Over its chord the line bends by at most {across[1]:.1f} mm up or down, {across[0]:.1f} mm sideways."
    rows = []
    for i, name in enumerate(CURVES):
        at = int(np.nanargmax(np.abs(shape.curvature[:, i])))
        limit = number(1e5 * float(shape.limit[i])) if np.isfinite(shape.limit[i]) else "none stated"
        beyond = ", ".join(f"{a:.0f} to {b:.0f} m" for a, b in intervals(shape.arc_length, shape.exceeds[:, i]))
        value = f"{number(1e5 * shape.curvature[at, i])} ± {number(3e5 * shape.std[at, i], 2)}"
        rows.append([name, value, f"{shape.arc_length[at]:.1f}", limit, beyond or "nowhere"])
    columns = table(["1e-5 rad/m", "largest ±3σ", "at [m]", "limit", "beyond it at"], rows)
    notes = "\n".join(f"- {plain_markdown(line)}" for line in shape.notes)
    danger = "### A limit is passed" if shape.exceeds.any() else "### Deck shape"
    counted = "straight" if shape.design is None else "the design"
    about = f"{len(shape.passes)} runs over {np.ptp(shape.arc_length):.1f} m ({shape.method}). {bend}"
    return "\n\n".join([danger, f"{about} Limits count from {counted}.", columns, notes])


def plain_markdown(text: str) -> str:
    """Text from a log as it stands: no character of it is markup, and none is one that viewers cannot draw."""
    shown = "".join(c if (c.isprintable() and ord(c) < 0x2600) else "?" for c in text)
    return "".join("\\" + c if c in MARKUP else c for c in shown)


def number(value: float | None, digits: int = 3) -> str:
    """A figure of so many significant digits; a dash where it is not known."""
    if value is None:
        return "–"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e" in text and 1 <= abs(value) < 1e7 else text


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _triple(values: list[float | None] | None) -> list[str]:
    return [number(value) for value in values] if values is not None else ["–"] * 3


def _headline(s: dict[str, Any], judged: Verdict | None) -> str:
    log = plain_markdown(PurePath(s["log"]).name or "trial")
    about = f"{log}: {s['estimator']} on {duration(s['duration_s'])}, {s['samples']} samples."
    if judged is not None:
        reasons = "\n".join(f"- {plain_markdown(reason)}" for reason in judged.reasons)
        return "\n\n".join(
            part for part in (f"## {judged.headline}", reasons, judged.found, judged.sure, about) if part
        )
    lines = [f"## {log}", about]
    for score in s["details"]["scores"]:
        worst = max(score["rmse_arcmin"])
        lines.append(f"**RMSE against {NAMES[score['reference']]}: at most {number(worst)}′ on any axis.**")
    return "\n\n".join(lines)


def duration(seconds: float) -> str:
    """400 s, 12.5 min, 2.00 h."""
    if seconds < 600:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.2f} h"


def _warnings(s: dict[str, Any]) -> str:
    if not s["warnings"]:
        return "Nothing else was odd."
    return "### What to distrust\n\n" + "\n".join(f"- {plain_markdown(line)}" for line in s["warnings"])


def _angles(s: dict[str, Any]) -> str:
    d = s["details"]
    rows = [
        ["static angle [′]", *_triple(s["static_arcmin"])],
        ["its standard deviation [′]", *_triple(d["static_std_arcmin"])],
        ["deformation, std over time [′]", *_triple(d["deformation_std_arcmin"])],
        ["predicted 1σ of the total [′]", *_triple(d["predicted_std_arcmin"])],
    ]
    delay = [None if v is None else 1e3 * v for v in (s["time_delay_s"], d["time_delay_std_s"])]
    sentence = (
        f"Time delay of the sub-IMU: {number(delay[0], 4)} ms ± {number(delay[1], 2)} ms ({d['time_delay_status']})."
    )
    return "### Deformation\n\n" + table(["", "x", "y", "z"], rows) + "\n\n" + sentence


def _scores(s: dict[str, Any]) -> str:
    if not s["details"]["scores"]:
        return "### Score\n\nNo reference in the log that could be used."
    rows = []
    for score in s["details"]["scores"]:
        name = NAMES[score["reference"]]
        rows.append([f"RMSE against {name} [′]", *_triple(score["rmse_arcmin"])])
        if any(score["reference_noise_arcmin"]):
            rows.append([f"of it {name}'s own [′]", *_triple(score["reference_noise_arcmin"])])
    return "### Score\n\n" + table(["", "x", "y", "z"], rows)


def _flexure(s: dict[str, Any]) -> str:
    f = s["flexure"]
    rows = [
        ["damping μ [1/s]", *_triple(f["damping"])],
        ["frequency λ [rad/s]", *_triple(f["frequency"])],
        ["standard deviation [′]", *_triple(f["std_arcmin"])],
    ]
    return f"### Flexure model ({s['identifier']})\n\n" + table(["", "x", "y", "z"], rows)


def _deck(s: dict[str, Any]) -> str:
    deck = s["deck_shape"]
    if deck is None:
        return ""
    rows = [
        [
            name,
            number(1e5 * deck[name]["peak_rad_per_m"]) if deck[name]["peak_rad_per_m"] is not None else "–",
            number(deck[name]["peak_at_m"]),
            ", ".join(f"{a:.0f} to {b:.0f}" for a, b in deck[name]["exceeds_limit_at_m"]) or "nowhere",
        ]
        for name in AXES
    ]
    head = f"### Deck shape\n\n{deck['passes']} runs over {number(deck['length_m'])} m ({deck['method']}).\n\n"
    return head + table(["curvature", "largest [1e-5 rad/m]", "at [m]", "beyond its limit at [m]"], rows)


def _provenance(s: dict[str, Any]) -> str:
    stated = s["details"]["provenance"].items()
    rows = [[key, plain_markdown(str(value))] for key, value in stated if value not in ("", None)]
    return "### Provenance\n\n" + table(["", ""], rows) if rows else ""


def _budget(s: dict[str, Any]) -> str:
    rows = []
    for score in s["details"]["scores"]:
        name = NAMES[score["reference"]]
        rows += [
            [f"RMSE against {name} [′]", *_triple(score["rmse_arcmin"])],
            ["predicted by the estimator [′]", *_triple(score["predicted_std_arcmin"])],
            ["reference's own noise [′]", *_triple(score["reference_noise_arcmin"])],
        ]
    return "### RMSE against its budget\n\n" + table(["", "x", "y", "z"], rows) if rows else "No reference in the log."


def _coverage(s: dict[str, Any]) -> str:
    rows = [
        [NAMES[score["reference"]], *(percent(share) for share in score["coverage_1_2_3_sigma"])]
        for score in s["details"]["scores"]
    ]
    if not rows:
        return ""
    rows.append(["expected", "68.3 %", "95.4 %", "99.7 %"])
    return "### Share of errors within\n\n" + table(["", "1σ", "2σ", "3σ"], rows)


def percent(share: float | None) -> str:
    """68.3 %."""
    return "–" if share is None else f"{100 * share:.1f} %"
