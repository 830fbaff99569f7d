"""The page of a run: what the deformation was, how sure that is, what to distrust, and everything behind it."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from physics.interpolation import gap_starts, usual_interval
from physics.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, PPM
from schemas.products import DeckShape, Estimate, Result
from schemas.trial import IntArray, Trial
from stages.publish.best import static_angle, time_delay
from stages.publish.document import duration
from stages.publish.page import parts
from stages.publish.page.html import Html, bullets, join, paragraph, section, table, tag
from stages.publish.page.parts import angle, figure, reason_of
from stages.publish.page.sheet import Sheet, render, verdict_box
from stages.publish.summary import intervals
from stages.publish.verdict import AXES, REFERENCE_NAMES, flexure_std, sigma_of, verdict

UNITS = {
    "gyro_bias": ("[°/h]", 1.0 / DEG_PER_HOUR),
    "gyro_noise": ("[°/√h]", 1.0 / DEG_PER_SQRT_HOUR),
    "accel_bias": ("[µg]", 1.0 / MICRO_G),
    "clock_drift": ("[ppm]", 1.0 / PPM),
    "lever_arm": ("[m]", 1.0),
    "lever_jitter": ("[mm]", 1e3),
}  # of estimators' own parameters, by what their names hold


def run_page(result: Result, trial: Trial, made: str = "") -> str:
    """HTML of one run. made: when the page was made, as text."""
    judged, d, x = verdict(result, trial), result.deformation, parts.whole(trial)
    name = PurePath(trial.source).name or "trial"
    length = duration(float(d.stamp[-1] - d.stamp[0]) * 1e-9)
    about = f"{length} from {parts.utc(int(trial.main.stamp[0]))}, estimator {d.estimator}"
    body = [
        verdict_box(judged.grade, judged.headline, (judged.found, judged.sure), judged.reasons),
        section("Deformation", deformation_table(result), parts.deformation_plots(trial, d, result.scores, x, "")),
        section(
            "The minute in which it bends most",
            parts.deformation_plots(trial, d, result.scores, parts.close_up(trial, d), "in detail"),
        ),
        section("How sure it is", *_accuracy(result, trial)),
        section("What to distrust", bullets(result.warnings) or paragraph("Nothing was odd.")),
        section("Alignment and clocks", alignment_table(result)),
        section("Flexure model", flexure_table(result), parts.spectrum_plots(d)),
        _deck(result.deck_shape),
        section("Sensors", sensor_table(trial, result), _motion(trial)),
        section("What was used", bullets([*d.used, *d.alignment.notes, *d.notes])),
    ]
    origin = {**result.provenance, "trial time": f"{parts.utc(int(trial.main.stamp[0]))} to "
                                                  f"{parts.utc(int(trial.main.stamp[-1]))}"}  # fmt: skip
    return render(Sheet("deck deformation of one trial", name, about, body, origin, made))


def deformation_table(result: Result) -> Html:
    """One row per axis: what was found and how well it is known."""
    static, moving, sigma = static_angle(result.deformation), flexure_std(result), sigma_of(result)
    scores = parts.ordered(result.scores)
    header = ["axis", "static angle [′]", "± [′]", "flexure, std [′]", "total known to (1σ) [′]"]
    header += [f"RMSE against {REFERENCE_NAMES[s.reference]} [′]" for s in scores]
    rows = [
        [AXES[i], angle(static.value[i]), angle(static.std[i]), angle(moving[i]), angle(sigma[i])]
        + [angle(s.rmse[i]) for s in scores]
        for i in range(3)
    ]
    return table(header, rows)


def _accuracy(result: Result, trial: Trial) -> list[object]:
    if not result.scores:
        return [paragraph("The log holds no reference: what the covariance says cannot be checked against anything.")]
    return [
        score_table(result),
        coverage_table(result),
        parts.error_plots(trial, result.deformation, result.scores, parts.whole(trial)),
    ]


def score_table(result: Result) -> Html:
    """RMSE beside what the covariance predicts and what the reference's own noise explains."""
    rows = []
    for score in parts.ordered(result.scores):
        name = REFERENCE_NAMES[score.reference]
        rows.append([f"RMSE against {name} [′]", *(angle(v) for v in score.rmse)])
        rows.append(["predicted by the covariance [′]", *(angle(v) for v in score.predicted)])
        if (score.reference_noise > 0).any():
            rows.append([f"noise of {name} itself [′]", *(angle(v) for v in score.reference_noise)])
    return table(["", *AXES], rows)


def coverage_table(result: Result) -> Html:
    """Share of the errors within one, two and three sigma."""
    rows = [[f"errors against {REFERENCE_NAMES[score.reference]}", *(f"{100 * v:.1f} %" for v in score.coverage)]
            for score in parts.ordered(result.scores)]  # fmt: skip
    return table(["share within", "1σ", "2σ", "3σ"], [*rows, ["expected", "68.3 %", "95.4 %", "99.7 %"]])


def alignment_table(result: Result) -> Html:
    """Every constant that was estimated, with its standard deviation and how far it can be trusted."""
    d, delay = result.deformation, time_delay(result.deformation)
    rows = [_constant("static angle, x y z [′]", static_angle(d), 1 / parts.ARCMIN)]
    rows += [_constant("time delay of the sub-IMU [ms]", delay, 1e3)]
    mounts = (("main", d.alignment.installation_main), ("sub", d.alignment.installation_sub))
    rows += [_constant(f"PHINS on the {name} IMU, x y z [′]", e, 1 / parts.ARCMIN) for name, e in mounts if e]
    known = {"static_angle", "time_delay"}
    rows += [_constant(f"{name.replace('_', ' ')} {unit}".strip(), e, scale)
             for name, e in d.parameters.items() if name not in known for unit, scale in [_unit(name)]]  # fmt: skip
    return table(["", "value", "± (1σ)", "status"], rows, class_="words")


def _unit(name: str) -> tuple[str, float]:
    """Unit as printed and factor of an estimator's own parameter."""
    return next((unit for key, unit in UNITS.items() if key in name), ("[SI]", 1.0))


def _constant(name: str, estimate: Estimate, scale: float) -> list[object]:
    values = [",  ".join(figure(float(v) * scale) for v in np.ravel(estimate.value))]
    spread = np.ravel(estimate.std) * scale
    cells = [*values, ",  ".join(figure(float(v), ".2g") for v in spread) if spread.any() else "–"]
    return [name, *cells, reason_of(estimate)]


def flexure_table(result: Result) -> Html:
    """Parameters of the second-order process per axis with relative standard deviations."""
    model = result.deformation.flexure
    spread = np.sqrt(np.maximum(np.diagonal(model.log_covariance, axis1=1, axis2=2), 0.0))
    header = ["axis", "damping μ [1/s]", "natural frequency b [rad/s]", "λ [rad/s]", "standard deviation [′]", "status"]
    rows = [
        [
            AXES[i],
            f"{model.damping[i]:.4f} ± {spread[i, 0]:.0%}",
            f"{np.sqrt(model.stiffness[i]):.4f} ± {0.5 * spread[i, 1]:.0%}",
            f"{model.frequency[i]:.4f}",
            f"{angle(model.std[i])} ± {spread[i, 2]:.0%}",
            model.status[i] if not model.reason[i] else f"{model.status[i]}: {model.reason[i]}",
        ]
        for i in range(3)
    ]
    about = paragraph("θ″ + 2 μ θ′ + b² θ = w, b² = μ² + λ²; λ = 0 where it does not swing.", class_="note")
    return join([about, table(header, rows, class_="words")])


def _deck(shape: DeckShape | None) -> Html:
    return (
        section("Deck shape", deck_table(shape), parts.deck_plots(shape), bullets(shape.notes)) if shape else join([])
    )


def deck_table(shape: DeckShape) -> Html:
    """Largest curvature of each kind, where it is, and where a limit is passed."""
    rows = []
    for i, name in enumerate(parts.CURVES):
        at = int(np.nanargmax(np.abs(shape.curvature[:, i])))
        beyond = ", ".join(f"{a:.0f} to {b:.0f} m" for a, b in intervals(shape.arc_length, shape.exceeds[:, i]))
        limit = figure(1e5 * float(shape.limit[i])) if np.isfinite(shape.limit[i]) else "none stated"
        rows.append([name, figure(1e5 * shape.curvature[at, i]), figure(3e5 * shape.std[at, i], ".2g"),
                     f"{shape.arc_length[at]:.1f}", limit, beyond or "nowhere"])  # fmt: skip
    about = f"{len(shape.passes)} runs over {np.ptp(shape.arc_length):.1f} m, by {shape.method}; unit 1e-5 rad/m."
    return join([paragraph(about), table(["", "largest", "±3σ", "at [m]", "limit", "beyond its limit at"], rows)])


def sensor_table(trial: Trial, result: Result) -> Html:
    """Every unit's record: samples, rate, what is missing."""
    units = {"main IMU": trial.main, "sub-IMU": trial.sub, "PHINS at main": trial.phins_main,
             "PHINS at sub": trial.phins_sub, "GNSS": trial.gnss, "sliding SINS": trial.sliding,
             "sled": trial.sled}  # fmt: skip
    rows = [[name, *_record(trial, series.stamp)] if series is not None and len(series.stamp) else
            [name, "not in the log", "", "", "", ""] for name, series in units.items()]  # fmt: skip
    rows.append(["estimate", *_record(trial, result.deformation.stamp)])
    return table(["unit", "samples", "rate [Hz]", "from – to [s]", "gaps", "missing [s]"], rows)


def _record(trial: Trial, stamp: IntArray) -> list[str]:
    usual, gaps = usual_interval(stamp) * 1e-9, gap_starts(stamp)
    t = trial.seconds(stamp)
    missing = float((t[gaps + 1] - t[gaps] - usual).sum()) if len(gaps) else 0.0
    rate = figure(1.0 / usual if np.isfinite(usual) else None)
    return [f"{len(stamp)}", rate, f"{t[0]:.1f} – {t[-1]:.1f}".replace("-", "−"), f"{len(gaps)}", f"{missing:.1f}"]


def _motion(trial: Trial) -> Html:
    x = parts.whole(trial)
    units = ((trial.main, "main IMU"), (trial.sub, "sub-IMU"))
    return tag("div", *(parts.plot(parts.motion_plot(trial, series, name, x)) for series, name in units))
