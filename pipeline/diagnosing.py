"""One log against its twin: decode, diagnose, write the report, the recording and the page."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files import staged, writing
from pipeline.one_log import Progress, Steps
from pipeline.provenance import deckflex_version, sha256_of
from pipeline.publishing import now, recording, save_page
from schemas.diagnosis import Diagnosis, Errors, Finding, ParameterEstimate, Place, Section, Transfer
from schemas.errors import DataError

SEED = 0  # of the replays behind thresholds, intervals and RMSE rows: the same log gives the same report


def diagnose_log(
    log: Path,
    twin: str,
    *,
    rig: Path | None = None,
    shrink: bool = True,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a log file; twin: a TOML file or the name of a built-in one. Raises DataError, naming the file.

    without: effects that must not be named, to see what the rest of the library makes of the log.
    """
    from stages.decode import decode, load_rig
    from stages.diagnose import diagnose
    from twin import effects, load_twin

    steps = Steps(progress)
    believed = load_twin(twin)
    library = [name for name in effects.names() if name not in without]
    try:
        with steps.step("decode") as report:
            trial = decode(log, load_rig(rig) if rig else None, report).trial
        say: Callable[[str], None] = (lambda step: progress(step, 0, 0)) if progress else (lambda step: None)
        rng = np.random.default_rng(SEED)
        found = diagnose(trial, believed, rng=rng, shrink=shrink, library=library, progress=say)
    except DataError as error:
        raise error.located(file=log) from error
    except np.linalg.LinAlgError as error:
        raise DataError(f"the data do not determine a diagnosis ({error})", file=log) from error
    return replace(found, log=str(log), twin=twin)


def report_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """The report as JSON, in the form of the log contract; what it adds stands behind."""
    gap = diagnosis.gap
    return {
        "log": diagnosis.log,
        "twin": diagnosis.twin,
        "verdict": str(diagnosis.verdict),
        "where": [_place(place) for place in diagnosis.where],
        "effects": [_finding(finding) for finding in diagnosis.effects],
        "gap": {
            "before": gap.before, "after": gap.after, "closed": gap.closed, "closed_ci95": list(gap.closed_ci95),
            "unit": gap.unit,
        },
        "rmse_arcmin": None if diagnosis.rmse is None else _errors(diagnosis.rmse),
        "augmented_twin": diagnosis.augmented_twin,
        "advice": list(diagnosis.advice),
        "tested": [
            {"name": row.name, "evidence_nats": row.evidence_nats, "threshold_nats": row.threshold_nats,
             "named": row.named, "reason": row.reason}
            for row in diagnosis.tested
        ],
        "not_testable": dict(diagnosis.untestable),
        "comparisons": [
            {"role": other.role, "name": other.name, "closed": other.gap.closed,
             "closed_ci95": list(other.gap.closed_ci95)}
            for other in diagnosis.comparisons
        ],
        "transfer": None if diagnosis.transfer is None else _transfer(diagnosis.transfer),
        "notes": list(diagnosis.notes),
        "duration_s": diagnosis.duration_s,
        "sections": [_section(one) for one in diagnosis.sections],
    }  # fmt: skip


def _section(one: Section) -> dict[str, Any]:
    return {
        "begin_s": one.begin_s, "end_s": one.end_s, "verdict": None if one.verdict is None else str(one.verdict),
        "effects": [{"name": name, "evidence_nats": nats} for name, nats in one.effects], "problem": one.problem,
    }  # fmt: skip


def _place(place: Place) -> dict[str, Any]:
    window = None if place.window_s is None else list(place.window_s)
    return {
        "channel": place.channel, "axis": place.axis, "band_hz": list(place.band_hz), "window_s": window,
        "score": place.score,
    }  # fmt: skip


def _transfer(found: Transfer) -> dict[str, Any]:
    return {
        "channel": found.channel, "axis": found.axis, "from": found.source, "from_axis": found.source_axis,
        "unit": found.unit, "frequency_hz": found.frequency.tolist(), "gain": found.gain.tolist(),
        "gain_std": found.gain_std.tolist(), "phase_deg": np.degrees(found.phase).tolist(),
        "phase_std_deg": np.degrees(found.phase_std).tolist(), "evidence_nats": found.evidence_nats,
    }  # fmt: skip


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "name": finding.name,
        "parameters": {name: _parameter(value) for name, value in finding.parameters.items()},
        "evidence_nats": finding.evidence_nats,
        "ambiguous_with": list(finding.ambiguous_with),
    }


def _parameter(value: ParameterEstimate | Mapping[str, ParameterEstimate]) -> dict[str, Any]:
    if isinstance(value, ParameterEstimate):
        return {"value": value.value, "std": value.std, "unit": value.unit}
    return {axis: _parameter(item) for axis, item in value.items()}


def _errors(errors: Errors) -> dict[str, Any]:
    rows = {"log": errors.log, "twin": errors.twin, "twin_with_effects": errors.twin_with_effects,
            "log_compensated": errors.log_compensated}  # fmt: skip
    return {
        **{name: [float(x) if np.isfinite(x) else None for x in row] for name, row in rows.items()},
        "reference": errors.reference,
    }


def write_diagnosis(
    diagnosis: Diagnosis, outputs: Mapping[str, Path], progress: Progress | None = None
) -> dict[str, str]:
    """Write what is wanted of ``json``, ``recording`` and ``report``; all of them whole, or none. Raises DataError."""
    if not outputs:
        return {}
    with Steps(progress).step("write"), staged(list(outputs.values())) as temporary:
        for (kind, target), path in zip(outputs.items(), temporary):
            with writing(target, path):
                _WRITERS[kind](diagnosis, path)
    return {kind: str(path) for kind, path in outputs.items()}


def _write_json(diagnosis: Diagnosis, path: Path) -> None:
    path.write_text(json.dumps(report_document(diagnosis), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _write_recording(diagnosis: Diagnosis, path: Path) -> None:
    with recording(path):
        from stages.publish.recording.diagnosis import write_diagnosis_recording

        write_diagnosis_recording(diagnosis, path)


def _write_page(diagnosis: Diagnosis, path: Path) -> None:
    from stages.publish.page.diagnosis import diagnosis_page

    origin = {"deckflex": deckflex_version(), "log": Path(diagnosis.log).name, "twin": Path(diagnosis.twin).name}
    if Path(diagnosis.log).is_file():
        origin["log.sha256"] = sha256_of(Path(diagnosis.log))
    save_page(diagnosis_page(diagnosis, origin, now()), path)


_WRITERS = {"json": _write_json, "recording": _write_recording, "report": _write_page}
