"""The sliding-SINS paper: rates before and after wavelet and Kalman filter, curvature, torsion and the danger zone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from physics.units import ARCMIN, DEG_PER_HOUR
from pipeline.experiments.bench import Bench, changed
from pipeline.experiments.claims import shown
from schemas.experiment import Check, Curve, Experiment, Figures, Measured, Panel, Part, Printed, Row, Values
from schemas.products import DeckShape
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages import shape
from stages.shape.rates import aligned, reference
from stages.shape.samples import load
from stages.shape.wavelet_kalman import by_run, filtered, ins_model, moving_db3, sins_model
from twin import simulate
from twin.sled import DeckPath

METHODS = ("wavelet-kalman", "spline")
BETA, SIGMA_ARCMIN = (0.15, 0.12, 0.10), (5.0, 5.0, 20.0)  # as printed, 1/s and arcmin
LIMIT = 5e-5  # rad/m, tolerated departure from the design
PUBLISHED_GAIN = (2.517, 3.583, 2.944)
GAIN, CURVATURE, FLAGGED = "RMS before over after", "RMS error of curvature", "flagged length"
FRAME = 1024  # samples of the spectrum of Fig. 5
PERFECT = {
    "gyro_bias_dph": [0.0] * 3,
    "gyro_arw": 0.0,
    "gyro_scale_ppm": [0.0] * 3,
    "gyro_nonorthogonality_arcsec": [0.0] * 6,
}
LOUD = "no outliers, gyro noise of the sled x 20"
NOISE: Mapping[str, dict[str, Any]] = {
    "no outliers": {"deck": {"outlier_rate": 0.0}},
    LOUD: {"deck": {"outlier_rate": 0.0}, "imu": {"sliding": {"gyro_arw": 0.06}}},
}
OWN_NOISE = (0.43, 12.0, 100.0)  # deg/h; the first is what the originals of Table 1 scatter about their means
OWN_SAMPLES, OWN_STEP = 2000, 0.01  # 20 s
VARIED: Mapping[str, dict[str, Any]] = {
    "as chosen": {},
    "no outliers": {"deck": {"outlier_rate": 0.0}},
    "gyro noise of the sled x 4": {"imu": {"sliding": {"gyro_arw": 0.012}}},
    "1 run": {"run": {"duration": 60.0}, "deck": {"passes": 1}},
}


@dataclass(frozen=True)
class Rates:
    """Mean rates over the sled's samples in hull axes, (n, 3) rad/s; run: (n,) which run; t: (n,) s; step: s."""

    ship: FloatArray
    sled: FloatArray
    run: IntArray
    t: FloatArray
    step: float


@lru_cache(maxsize=1)
def plain(seed: int) -> Bench:
    """The trial; the parts of one seed share it."""
    return Bench.simulated(changed("sliding"), seed)


def rates_of(trial: Trial) -> Rates:
    """What the two units measured during the runs."""
    main = reference(trial.main, trial.seconds(trial.main.stamp))
    _, sled = load(trial)
    sled = sled.where(main.covered(sled.unit.begin, sled.unit.end))
    turned = sled.unit.rate @ aligned(main, sled.unit)[0].T
    step = float(np.median(sled.unit.end - sled.unit.begin))
    return Rates(main.mean(sled.unit.begin, sled.unit.end), turned, sled.run, sled.unit.end, step)


def perfect(seed: int) -> Rates:
    """The same trial measured without any error: the truth of the rates."""
    imu = {"main": PERFECT, "sub": PERFECT, "sliding": PERFECT}
    return rates_of(_trial({"imu": imu, "deck": {"outlier_rate": 0.0}}, seed))


def _trial(sections: Mapping[str, Any], seed: int) -> Trial:
    return simulate(changed("sliding", **sections), np.random.default_rng(seed)).trial


def denoising(seed: int) -> Measured:
    """Table 1 and Figures 3 to 5: errors of the angular velocities before and after filtering."""
    found, true = rates_of(plain(seed).trial), perfect(seed)
    varied = {case: rates_of(_trial(sections, seed)) for case, sections in NOISE.items()}
    ship = {name: values - true.ship for name, values in _ship(found).items()}
    apart, truth = _apart(found), true.sled - true.ship
    rows = [Row("INS (Fig. 3)", name, "RMS error of the rate", "deg/h", _dph(error)) for name, error in ship.items()]
    sled = {name: values - truth for name, values in apart.items()}
    rows += [Row("SINS (Table 1)", name, "RMS error of the rate", "deg/h", _dph(error)) for name, error in sled.items()]
    rows += [
        Row("SINS (Table 1)", name, "mean error of the rate", "deg/h", _means(error)) for name, error in sled.items()
    ]
    rows += [_gain(case, rates, truth) for case, rates in {"SINS (Table 1)": found, **varied}.items()]
    rows += own_conditions(seed)
    rows += [Row("SINS (Fig. 5)", name, "main frequency", "Hz", _main_frequency(apart[name], found)) for name in _SHOWN]
    return Measured(tuple(rows), _rate_panels(apart, truth, found))


def own_conditions(seed: int) -> list[Row]:
    """The paper's simulation as far as it is printed: ship at rest, the sled's rate that of (20) without noise from the
    initial angles, nothing but white noise on it. How much the RMS falls hangs on that noise, which is not printed."""
    t: FloatArray = OWN_STEP * np.arange(OWN_SAMPLES, dtype=np.float64)[:, None]
    beta = np.array(BETA)
    truth = -np.array(SIGMA_ARCMIN) * ARCMIN * beta**2 * t * np.exp(-beta * t)
    white = np.random.default_rng(seed).standard_normal(truth.shape) * DEG_PER_HOUR
    rows = []
    for noise in OWN_NOISE:
        rates = Rates(np.zeros_like(truth), truth + noise * white, np.zeros(OWN_SAMPLES, np.int64), t[:, 0], OWN_STEP)
        rows.append(_gain(_own(noise), rates, truth))
        rows.append(_gain(f"{_own(noise)}, (20) as printed", rates, truth, driven=False))
    return rows


def _own(noise: float) -> str:
    return f"the paper's own rates, {noise:g} deg/h of noise"


_SHOWN = ("as measured", "db3 and Kalman filter")


def _ship(rates: Rates) -> dict[str, FloatArray]:
    smooth = by_run(moving_db3, rates.ship, rates.run)
    kalman = {
        name: filtered(ins_model(x, rates.step, None), x, rates.run)[0]
        for name, x in (("", rates.ship), ("db3", smooth))
    }
    return {"as measured": rates.ship, "Kalman filter": kalman[""], "db3 and Kalman filter": kalman["db3"]}


def _apart(rates: Rates, driven: bool = True) -> dict[str, FloatArray]:
    """The sled's rate against the ship, by each stage of the recipe; driven: by the noise that (20) lacks."""
    raw = rates.sled - rates.ship
    smooth = by_run(moving_db3, raw, rates.run)
    kalman = [filtered(sins_model(x, rates.step, BETA, SIGMA_ARCMIN, driven), x, rates.run)[0] for x in (raw, smooth)]
    return {"as measured": raw, "db3": smooth, "Kalman filter": kalman[0], "db3 and Kalman filter": kalman[1]}


def _gain(case: str, rates: Rates, truth: FloatArray, driven: bool = True) -> Row:
    apart = _apart(rates, driven)
    gain = np.array(_dph(apart["as measured"] - truth)) / _dph(apart["db3 and Kalman filter"] - truth)
    return Row(case, "db3 and Kalman filter", GAIN, "ratio", tuple(float(v) for v in gain))


def _dph(error: FloatArray) -> Values:
    return tuple(float(v) for v in np.sqrt(np.mean(error**2, axis=0)) / DEG_PER_HOUR)


def _means(error: FloatArray) -> Values:
    return tuple(float(v) for v in np.abs(np.mean(error, axis=0)) / DEG_PER_HOUR)


def _main_frequency(rate: FloatArray, rates: Rates) -> Values:
    """Frequency of the largest line of a 1024-point spectrum, the constant left out."""
    first = rate[rates.run == rates.run[0]][:FRAME]
    power = np.abs(np.fft.rfft(first - first.mean(axis=0), FRAME, axis=0))[1:]
    return tuple(float(v) for v in np.fft.rfftfreq(FRAME, rates.step)[1:][np.argmax(power, axis=0)])


def _rate_panels(apart: Mapping[str, FloatArray], truth: FloatArray, rates: Rates) -> tuple[Panel, ...]:
    first = rates.run == rates.run[0]
    panels = []
    for axis, name in enumerate("xyz"):
        shown = {
            "as measured": apart["as measured"],
            "db3 and Kalman filter": apart["db3 and Kalman filter"],
            "truth": truth,
        }
        curves = tuple(Curve(k, rates.t[first], v[first, axis] / DEG_PER_HOUR) for k, v in shown.items())
        panels.append(Panel(f"Rate of the sled {name} [deg/h]", "time [s]", "rate [deg/h]", curves))
    return tuple(panels)


def curvature(seed: int) -> Measured:
    """Figures 6 and 7: curvature and torsion, and where they leave the design."""
    bench = plain(seed)
    shapes = {name: _shape(bench, name) for name in METHODS}
    rows = [_curvature_row("", name, found) for name, found in shapes.items()]
    rows += [_one_run_row(name, found) for name, found in shapes.items()]
    rows += [Row("", name, FLAGGED, "m", _flagged(found)) for name, found in shapes.items()]
    s = shapes["spline"].arc_length
    true_zone = np.abs(_true(s) - _design(s)) > LIMIT
    rows.append(Row("", "truth", FLAGGED, "m", _length(true_zone, s)))
    return Measured(tuple(rows), _curvature_panels(shapes))


def _shape(bench: Bench, name: str, **options: Any) -> DeckShape:
    """By a method; the deformation is that of the smoother, which only `spline` uses."""
    needed = bench.answer("smoother") if name == "spline" else None
    found: DeckShape = shape.get(name)(limit=(LIMIT,) * 3, design=_design, **options).shape(bench.trial, needed)
    return found


def _true(s: FloatArray) -> FloatArray:
    deck = changed("sliding").deck
    assert deck is not None
    return DeckPath(deck).curvature(s)


def _design(s: FloatArray) -> FloatArray:
    """The twin's deck without the bend at its edge."""
    deck = changed("sliding").deck
    assert deck is not None
    columns = [a + c * np.sin(2.0 * np.pi * s / period) for a, _, _, c, period in deck.profiles]
    return np.stack(columns, axis=-1)


def _curvature_row(case: str, method: str, found: DeckShape) -> Row:
    error = found.curvature - _true(found.arc_length)
    return Row(case, method, CURVATURE, "urad/m", _micro(error))


def _one_run_row(method: str, found: DeckShape) -> Row:
    first = found.passes[0]
    return Row("", method, f"{CURVATURE}, one run", "urad/m", _micro(first.curvature - _true(first.arc_length)))


def _micro(error: FloatArray) -> Values:
    return tuple(float(v) for v in 1e6 * np.sqrt(np.mean(error**2, axis=0)))


def _flagged(found: DeckShape) -> Values:
    return _length(found.exceeds, found.arc_length)


def _length(flags: np.ndarray, s: FloatArray) -> Values:
    return tuple(float(v) for v in np.sum(flags, axis=0) * (s[1] - s[0]))


def _curvature_panels(shapes: Mapping[str, DeckShape]) -> tuple[Panel, ...]:
    panels = []
    for axis, name in enumerate(("Vertical curvature", "Torsion", "Horizontal curvature")):
        curves = [Curve(k, found.arc_length, 1e6 * found.curvature[:, axis]) for k, found in shapes.items()]
        s = shapes["spline"].arc_length
        curves += [Curve("truth", s, 1e6 * _true(s)[:, axis]), Curve("design", s, 1e6 * _design(s)[:, axis])]
        panels.append(Panel(f"{name} [1e-6 rad/m]", "arc length [m]", "[1e-6 rad/m]", tuple(curves), over_time=False))
    return tuple(panels)


def sensitivity(seed: int) -> Measured:
    """Outliers, noise, flexure and the number of runs."""
    rows = []
    for case, sections in VARIED.items():
        bench = Bench.simulated(changed("sliding", **sections), seed)
        rows += [_curvature_row(case, name, _shape(bench, name)) for name in METHODS]
    return Measured(tuple(rows))


def as_printed(seed: int) -> Measured:
    """The recipe with the printed forms of (10), (20), (31) and (33)."""
    bench = plain(seed)
    forms: Mapping[str, dict[str, Any]] = {"(10), (20), (31), (33)": {"as_printed": True}, "corrected": {}}
    return Measured(
        tuple(
            _curvature_row(
                case,
                "wavelet-kalman" + (", as_printed = true" if options else ""),
                _shape(bench, METHODS[0], **options),
            )
            for case, options in forms.items()
        )
    )


def _better(figures: Figures) -> tuple[bool, str]:
    ratios = []
    for quantity in (CURVATURE, f"{CURVATURE}, one run"):
        own, published = (figures.get(("", name, quantity)) for name in ("spline", "wavelet-kalman"))
        if own is None or published is None:
            return False, "not measured"
        ratios.append(np.array(published.mean) / own.mean)
    said = "; ".join(shown(tuple(ratio)) for ratio in ratios)
    return bool(np.min(ratios) > 1.0), f"all runs, then one run: {said} times"


def _denoises(case: str) -> Callable[[Figures], tuple[bool, str]]:
    """Whether the RMS falls by the published factors, as printed to two digits."""

    def verdict(figures: Figures) -> tuple[bool, str]:
        found = figures.get((case, "db3 and Kalman filter", GAIN))
        if found is None:
            return False, "not measured"
        return bool(np.all(np.round(found.mean, 1) >= (2.5, 3.6, 2.9))), shown(found.mean)

    return verdict


def _anything(figures: Figures) -> tuple[bool, str]:
    """Whether the published factors lie between those of the least and the most noise under the paper's conditions."""
    found = [figures.get((_own(noise), "db3 and Kalman filter", GAIN)) for noise in OWN_NOISE]
    if any(one is None for one in found):
        return False, "not measured"
    means = np.array([one.mean for one in found if one is not None])
    inside = (means.min(axis=0) <= PUBLISHED_GAIN) & (means.max(axis=0) >= PUBLISHED_GAIN)
    return bool(inside.all()), "; ".join(f"{noise:g} °/h: {shown(tuple(m))}" for noise, m in zip(OWN_NOISE, means))


EXPERIMENT = Experiment(
    name="sliding",
    about="The sliding SINS: rates before and after wavelet and Kalman filter, curvature and torsion of the deck",
    source="B. Ren, T. Li, X. Li, Sensors 2019, 19, 4167, section 5, Table 1, Figs. 3-7",
    twins=("sliding",),
    methods=METHODS,
    chosen=(
        "400 s at 100 Hz, nine runs of 100 m at 5 m/s; deck shape, noise, flexure, sea and outliers are a twin's.",
        "Table 1 prints no units, noise or truth: what can be compared is the ratio of RMS before and after. That ratio"
        " is not a property of the method: under the paper's own conditions it is what the noise, which is not printed,"
        " and the driving of (20) make it.",
        "Nor can the table come from filtering alone: its means fall by 2.4 2.2 2.0, and a filter that lets a constant"
        " rate through leaves the mean of an error as it was; about the means the errors fall by 3.3 15 26, from the"
        " same 0.43 on every axis.",
        f"Danger zone: departure from the design by more than {1e6 * LIMIT:.0f} µrad/m, the design being the"
        " twin's deck without the bend at its edge.",
        "The published zone, the first 3 s, is 15 m at the stated 5 m/s; the text says 6 m.",
    ),
    parts=(
        Part(
            "Angular velocities (Table 1, Figs. 3-5)",
            "Errors against the same trial measured without error.",
            denoising,
        ),
        Part(
            "Curvature and torsion (Figs. 6, 7)",
            "x: vertical curvature, y: torsion, z: horizontal curvature.",
            curvature,
        ),
        Part("Sensitivity", "", sensitivity, seeds=1),
        Part("As printed", "", as_printed),
    ),
    printed=(
        Printed("SINS (Table 1)", "db3 and Kalman filter", GAIN, PUBLISHED_GAIN, "Table 1"),
        Printed(
            "SINS (Fig. 5)", "as measured", "main frequency", (0.09766,) * 3, "Fig. 5, the first line of 1024 points"
        ),
        Printed("SINS (Fig. 5)", "db3 and Kalman filter", "main frequency", (0.09766,) * 3, "Fig. 5"),
        Printed("", "wavelet-kalman", FLAGGED, (15.0, 15.0, float("nan")), "Figs. 6, 7: another deck"),
    ),
    checks=(
        Check("`spline` better than `wavelet-kalman` on every curve", _better),
        Check("db3 with a Kalman filter lowers the RMS by the published 2.5 3.6 2.9", _denoises("SINS (Table 1)")),
        Check("the same, twenty times the noise and no outliers", _denoises(LOUD)),
        Check("under the paper's own conditions the factor hangs on the noise: published ones among them", _anything),
    ),
)
