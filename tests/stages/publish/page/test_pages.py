"""Pages taken apart: what they say, that they load nothing, that nothing in a log becomes markup."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schemas.diagnosis import Localisation, Verdict
from stages.publish.page.comparison import comparison_page
from stages.publish.page.diagnosis import diagnosis_page
from stages.publish.page.run import run_page
from tests.stages import synthetic_result as synthetic
from tests.stages.publish import diagnosed
from tests.stages.publish.page.reading import loads_from_elsewhere, read

NASTY = (
    '</style></title><script src="http://a.example/x.js">alert(1)</script><img src=x onerror=alert(1)>&amp;\x00\ud800'
)
MADE = "2026-01-02 03:04 UTC"


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=120.0, rate=20.0, gap=(50.0, 62.0))


@pytest.fixture(scope="module")
def pages(case):
    other = replace(case.result, deformation=replace(case.result.deformation, estimator="filter"))
    return {
        "run": run_page(case.result, case.trial, MADE),
        "compare": comparison_page([case.result, other], case.trial, MADE),
        "diagnose": diagnosis_page(diagnosed.diagnosis(), {"log.sha256": "5e1f"}, MADE),
    }


@pytest.mark.parametrize("kind", ["run", "compare", "diagnose"])
def test_a_page_is_whole_and_loads_nothing(pages, kind):
    page = read(pages[kind])
    assert not page.unbalanced
    assert loads_from_elsewhere(page) == []
    assert "http" not in pages[kind].replace("http-equiv", "")
    assert pages[kind].startswith("<!DOCTYPE html>")
    assert page.texts["title"]
    assert page.count("figure") > 5
    assert "nan" not in "".join(str(attrs) for tag, attrs in page.elements if tag in {"path", "rect", "text"}).lower()
    assert MADE in page.texts["footer"]


@pytest.mark.parametrize("kind", ["run", "compare", "diagnose"])
def test_a_page_is_the_same_for_the_same_result(pages, case, kind):
    again = {"run": lambda: run_page(case.result, case.trial, MADE),
             "diagnose": lambda: diagnosis_page(diagnosed.diagnosis(), {"log.sha256": "5e1f"}, MADE)}  # fmt: skip
    if kind in again:
        assert again[kind]() == pages[kind]


def test_run_page_tells_what_it_must(pages, case):
    page = read(pages["run"])
    body = page.texts["body"]
    for word in ("10.000", "30.000", "truth", "PHINS", "68.3 %", "a warning to be read", "[arcmin²/Hz]", "1e-5 rad/m",
                 "main IMU", "gyros only", "synthetic", "autocorrelation", "damping", "beyond the limit",
                 "no estimate", "2023-11-14 22:13:20 UTC"):  # fmt: skip
        assert word in body, word
    for axis in ("x (pitch)", "y (roll)", "z (heading)"):
        assert axis in page.texts["table"]
    rmse = next(s for s in case.result.scores if s.reference == "truth").rmse / synthetic.ARCMIN
    assert f"{rmse[2]:.3f}" in page.texts["table"]


def test_bare_result_makes_a_page_too():
    bare = synthetic.case(duration=20.0, gap=None, with_phins=False, with_deck=False)
    unknown = np.full_like(bare.result.deformation.covariance, np.nan)
    d = replace(bare.result.deformation, innovations=None, covariance=unknown)
    html = run_page(replace(bare.result, deformation=d, scores=(), warnings=()), replace(bare.trial, gnss=None))
    page = read(html)
    assert "Deck shape" not in page.texts["h2"]
    assert "no reference" in page.texts["main"]
    assert "Do not rely on this result." in page.texts["p"]
    assert "nan" not in "".join(str(attrs) for tag, attrs in page.elements if tag in {"path", "rect"}).lower()


def test_what_a_log_names_never_becomes_markup(case):
    alignment = replace(case.result.deformation.alignment, notes=(NASTY,))
    d = replace(case.result.deformation, estimator=NASTY, alignment=alignment, used=(NASTY,), notes=(NASTY,))
    result = replace(case.result, deformation=d, warnings=(NASTY,), provenance={NASTY: NASTY})
    trial = replace(case.trial, source=NASTY, notes=(NASTY,))
    diagnosis = diagnosed.diagnosis(log=NASTY, twin=NASTY, advice=(NASTY,), notes=(NASTY,), augmented_twin=NASTY,
                                    untestable={NASTY: NASTY})  # fmt: skip
    for html in (run_page(result, trial), comparison_page([result], trial), diagnosis_page(diagnosis, {NASTY: NASTY})):
        page = read(html)
        assert loads_from_elsewhere(page) == []
        assert page.count("style") == 1
        assert not page.unbalanced
        assert "alert(1)" in page.texts["body"]
        html.encode("utf-8")


def test_comparison_names_the_closest_and_shows_all(pages, case):
    worse = replace(case.result.deformation, estimator="worse")
    scores = tuple(replace(s, estimator="worse", rmse=3 * s.rmse) for s in case.result.scores)
    html = comparison_page([replace(case.result, deformation=worse, scores=scores), case.result], case.trial)
    page = read(html)
    assert "synthetic comes closest to truth" in page.texts["p"]
    assert "worse" in page.texts["table"]
    assert page.texts["figcaption"].count("worse") >= 6


def test_diagnosis_page_tells_what_it_must(pages):
    body = read(pages["diagnose"]).texts["body"]
    for word in ("The log departs from its twin, and the cause is found.", "0.015302 ± 2.1e-05 s", "5210", "98 %",
                 "runner-up: phins_latency", "placebo: heel_bending", "0.670", "gyro of the sub-IMU, x", "bias x",
                 "a turn of the ship by 30 degrees", "the log has no temperature", "[[effect]]", "95 to 99 %",
                 "not causation", "what the effect foretells", "5e1f", "one pulse per second"):  # fmt: skip
        assert word in body, word


def test_diagnosis_without_anything_to_draw_is_a_page_too():
    page = read(diagnosis_page(diagnosed.no_gap(), {}))
    assert "The log behaves as its twin foretells." in page.texts["p"]
    assert "Residual spectra, before and after" not in page.texts["h2"]
    assert read(diagnosis_page(diagnosed.unknown(), {})).texts["body"].count("nothing known explains it") == 1
    empty = Localisation((), np.zeros((0, 2)), np.zeros(1), np.zeros((0, 0, 0)))
    partly = diagnosed.diagnosis(verdict=Verdict.PARTLY_EXPLAINED, tested=(), localisation=empty)
    assert "part of the cause is found" in read(diagnosis_page(partly, {})).texts["body"]
