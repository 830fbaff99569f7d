"""The report of a made-up archive: two years of voyages of one ship."""

import numpy as np

from stages.publish.archive import ArchiveReport, Fit, Listing, Relation, Trend

DAY = 86_400_000_000_000
START = int(np.datetime64("2026-01-01", "ns").astype(np.int64))
STAMP = START + np.arange(24) * 30 * DAY
AXES = ("x (pitch)", "y (roll)", "z (heading)")


def static_trend() -> Trend:
    t = STAMP.astype(float)
    line = 10.0 + 0.5 * np.arange(24)
    values = line + 0.3 * np.sin(np.arange(24))
    fit = Fit(t[[0, -1]], line[[0, -1]], np.array([0.2, 0.2]))
    return Trend("Static angle about z (heading)", "arcmin", STAMP, values[:, None], np.full((24, 1), 0.4),
                 (AXES[2],), [fit], "Static angle")  # fmt: skip


def archive_report() -> ArchiveReport:
    errors = np.abs(np.sin(np.arange(72.0))).reshape(24, 3)
    errors[5, 1] = np.nan
    sea = np.linspace(0.5, 3.0, 24)
    fit = Fit(sea, 2.0 * sea, 0.1 * sea)
    return ArchiveReport(
        title="ship <A>",
        about="24 logs",
        grade="care",
        headline="The static angle drifts about z (heading).",
        sentences=("By +0.5 ± 0.01′ a month.",),
        trends=(
            static_trend(),
            Trend("RMSE against truth", "arcmin", STAMP, errors, None, AXES, tab="Accuracy"),
            Trend("Nothing", "1", STAMP, np.full((24, 1), np.nan), None, ("x",), tab="Nowhere"),
        ),
        listings=(Listing("Least trustworthy logs", ("log", "why"), [(f"voyage_{k}", "*odd*") for k in range(70)]),),
        warnings=("voyage_3 is far off",),
        provenance={"deckflex": "1"},
        relations=(Relation("Flexure against the sea", "rate [deg/s]", "σ [arcmin]", sea, 2.1 * sea, 0.2 * sea, fit),),
    )
