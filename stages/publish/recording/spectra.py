"""Spectra: the flexure found against the model identified, by frequency and by lag."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics.units import ARCMIN
from schemas.rig import FloatArray
from stages.publish.axis import Axis, decades_of
from stages.publish.recording.chart import Chart, Curve, chart_view, log_chart
from stages.publish.recording.scene import AXES, BLUE, GREY, ORANGE, Scene
from stages.publish.spectrum import (
    HIGHEST,
    MAX_LAG,
    drawable,
    measured_autocorrelation,
    measured_spectrum,
    model_autocorrelation,
    model_spectrum,
)

HEIGHT = 125.0  # of the charts: three beside each other are narrow


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Per axis, spectrum and autocorrelation; nothing where the longest run is too short."""
    d, found = scene.deformation, drawable(scene.deformation)
    if found is None:
        return
    theta, rate = found
    f, density = measured_spectrum(theta, rate)
    lags = int(min(MAX_LAG * rate, len(theta) / 2))
    lag = np.arange(lags) / rate
    measured, model = measured_autocorrelation(theta, lags), model_autocorrelation(lag, d.flexure)
    expected = model_spectrum(f, d.flexure)
    for axis, name in enumerate("xyz"):
        log_chart(rec, f"spectra/density_{name}", _density_chart(f, density[:, axis], expected[:, axis]))
        log_chart(rec, f"spectra/correlation_{name}", _correlation_chart(lag, measured[:, axis], model[:, axis]))


def _density_chart(f: FloatArray, measured: FloatArray, model: FloatArray) -> Chart:
    shown = f <= HIGHEST
    f, measured, model = f[shown], measured[shown] / ARCMIN**2, model[shown] / ARCMIN**2
    low, top = decades_of([measured, model])
    curves = [Curve(f, measured, BLUE, "measured", 1.5), Curve(f, model, ORANGE, "model", 2.0)]
    return Chart(
        Axis(float(f[0]), float(f[-1]), "frequency [Hz]", True),
        Axis(low, top, "arcmin²/Hz", True),
        curves,
        height=HEIGHT,
    )


def _correlation_chart(lag: FloatArray, measured: FloatArray, model: FloatArray) -> Chart:
    step = max(1, len(lag) // 600)
    curves = [
        Curve(lag[[0, -1]], np.zeros(2), GREY, "", 0.7),
        Curve(lag[::step], measured[::step], BLUE, "measured", 1.5),
        Curve(lag[::step], model[::step], ORANGE, "model", 2.0),
    ]
    low = min(-0.4, float(np.nanmin(np.concatenate([measured, model]))) - 0.05)
    return Chart(Axis(0.0, float(lag[-1]), "lag [s]"), Axis(low, 1.05, "correlation [1]"), curves, height=HEIGHT)


def tab(scene: Scene) -> rrb.Container:
    """Spectra above, autocorrelations below."""
    above = [
        chart_view(f"spectra/density_{n}", f"Flexure {a} spectrum [arcmin²/Hz]", HEIGHT) for n, a in zip("xyz", AXES)
    ]
    below = [
        chart_view(f"spectra/correlation_{n}", f"Flexure {a} autocorrelation [1]", HEIGHT) for n, a in zip("xyz", AXES)
    ]
    return rrb.Vertical(rrb.Horizontal(*above), rrb.Horizontal(*below), name="Spectra")
