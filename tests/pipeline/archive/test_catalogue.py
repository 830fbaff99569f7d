"""Rows of the catalogue and what is said of them, on entries of real runs that were changed by hand."""

import copy
import json
from datetime import datetime, timedelta

import numpy as np
import polars as pl
import pytest

from pipeline.archive.repeated import repeated
from pipeline.archive.reporting import archive_report, effect_rows, size_rows
from pipeline.archive.rows import SCHEMA, frame_of
from pipeline.archive.survey import survey_document, surveyed
from stages.archive.repetition import Standing
from tests.pipeline.archive.processes import entries


@pytest.fixture(scope="module")
def entry(done):
    return json.loads(entries(done / "out")[0].read_bytes())


def effect(name, nats, **parameters):
    stated = {key: {"value": value, "std": std, "unit": "s"} for key, (value, std) in parameters.items()}
    return {"name": name, "parameters": stated, "evidence_nats": nats, "ambiguous_with": []}


def report(*effects, weak=()):
    tested = [{"name": one["name"], "evidence_nats": one["evidence_nats"], "threshold_nats": 8.0, "named": True}
              for one in effects]  # fmt: skip
    tested += [{"name": name, "evidence_nats": nats, "threshold_nats": 8.0, "named": False} for name, nats in weak]
    gap = {"before": 0.4, "after": 0.01, "closed": 0.97}
    return {"twin": "ship.toml", "verdict": "explained", "effects": list(effects), "tested": tested, "gap": gap}


def varied(entry, count, **changes):
    """Entries of so many voyages, two weeks apart."""
    out = []
    for k in range(count):
        one = copy.deepcopy(entry)
        start = datetime.fromisoformat(entry["start_utc"]) + timedelta(days=14 * k)
        one |= {"key": f"{k:032x}", "sha256": f"{k:064x}", "name": f"voyage-{k}.mcap", "start_utc": start.isoformat()}
        one |= {name: change(k) for name, change in changes.items()}
        out.append(one)
    return out


def framed(rows):
    return frame_of(rows).with_columns(current=pl.lit(True))


def test_a_row_holds_what_the_run_found(entry):
    frame = frame_of([entry])
    assert dict(frame.schema) == SCHEMA
    assert frame["axis"].to_list() == ["x", "y", "z"]
    summary = entry["summary"]
    assert frame["static_arcmin"].to_list() == summary["static_arcmin"]
    assert frame["flexure_std_arcmin"].to_list() == summary["flexure"]["std_arcmin"]
    assert frame["rmse_truth_arcmin"].to_list() == summary["rmse_arcmin"]["truth"]
    ratio = np.array(summary["rmse_arcmin"]["truth"]) / np.array(summary["details"]["predicted_std_arcmin"])
    assert (frame["rmse_ratio"].to_numpy() >= ratio - 1e-12).all()
    assert frame["deck_peak_rad_per_m"].null_count() == 3


def test_the_deck_stands_beside_the_axis_it_bends_about(entry):
    one = copy.deepcopy(entry)
    curve = {"peak_std_rad_per_m": 1e-6, "peak_at_m": 3.0}
    one["summary"]["deck_shape"] = {
        "passes": 4,
        "vertical": {**curve, "peak_rad_per_m": 1e-4, "exceeds_limit_at_m": [[1.0, 2.0]]},
        "torsion": {**curve, "peak_rad_per_m": -2e-4, "exceeds_limit_at_m": []},
        "horizontal": {**curve, "peak_rad_per_m": None, "exceeds_limit_at_m": []},
    }
    frame = frame_of([one])
    assert frame["deck_curvature"].to_list() == ["vertical", "torsion", "horizontal"]
    assert frame["deck_peak_rad_per_m"].to_list() == [1e-4, -2e-4, None]
    assert frame["deck_exceeds_limit"].to_list() == [True, False, False]
    made = archive_report(surveyed(framed([one])), "ship", (), {})
    deck = [trend for trend in made.trends if trend.tab == "Deck shape"]
    assert [trend.title for trend in deck] == ["Largest vertical curvature of the deck", "Largest torsion of the deck"]
    assert [trend.values.item() for trend in deck] == pytest.approx([10.0, -20.0])  # 1e-5 rad/m
    assert [trend.std.item() for trend in deck] == pytest.approx([0.1, 0.1])


def test_installations_are_told_apart(entry):
    rows = varied(entry, 8, rig=lambda k: "bow" if k % 2 else "stern")
    survey = surveyed(framed(rows))
    assert [group.name for group in survey.groups] == ["bow", "stern"]
    assert [fit.line.count for fit in survey.groups[0].drifts] == [4, 4, 4]
    assert len(surveyed(framed(rows), "all").groups) == 1
    made = archive_report(survey, "ship", (), {})
    assert any(sentence.startswith("stern: About z") for sentence in made.sentences)


def test_logs_not_to_be_relied_on_bend_no_trend(entry):
    def judged(k):
        return {"grade": "bad" if k == 3 else "good", "found": "", "reasons": ["wild"] if k == 3 else []}

    rows = varied(entry, 8, verdict=judged)
    rows[3]["summary"]["static_arcmin"] = [900.0, 900.0, 900.0]
    survey = surveyed(framed(rows))
    assert survey.groups[0].drifts[0].line.count == 7
    assert survey.groups[0].drifts[0].line.slope == pytest.approx(0.0, abs=1e-9)
    assert survey.worst["name"][0] == "voyage-3.mcap"
    assert survey_document(survey, (), "")["worst"][0]["doubts"] == ["wild"]


def test_the_truth_of_a_simulated_log_has_no_say_in_trends(done):
    judged = [json.loads(path.read_bytes())["verdict"] for path in entries(done / "out")]
    against = [one for one in judged if one["grade"] == "bad" and "truth contradicts" in one["reasons"][0]]
    alone = [one for one in against if not any(" contradicts" in reason for reason in one["reasons"][1:])]
    assert alone
    assert any(one["usable"] for one in alone)
    rows = [json.loads(path.read_bytes()) for path in entries(done / "out")]
    survey = surveyed(framed(rows))
    assert survey.groups[0].drifts[0].line.count == sum(one["usable"] for one in judged)


def test_a_step_in_one_voyage_is_pointed_out(entry):
    rows = varied(entry, 12)
    rows[7]["summary"]["static_arcmin"] = [v + 40 * s for v, s in zip(rows[7]["summary"]["static_arcmin"],
                                           rows[7]["summary"]["details"]["static_std_arcmin"])]  # fmt: skip
    rows[7]["verdict"] |= {"grade": "good", "usable": True}
    document = survey_document(surveyed(framed(rows)), (), "")
    assert document["installations"][0]["static_angle"]["z"]["off_the_line"] == ["voyage-7.mcap"]
    json.dumps(document, allow_nan=False)


def test_effects_of_many_logs_are_put_together(entry):
    reports = {
        0: report(effect("time_delay", 50.0, delay=(0.0040, 1e-5)), weak=[("gyro_bias", 7.0)]),
        1: report(effect("time_delay", 60.0, delay=(0.0041, 1e-5))),
        2: report(weak=[("time_delay", -1.0), ("gyro_bias", 3.0)]),
        3: None,
    }
    rows = varied(entry, 4, diagnosis=lambda k: reports[k])
    frame = framed(rows)
    assert frame.filter(pl.col("axis") == "z")["effects"].to_list() == [["time_delay"], ["time_delay"], [], None]
    group = surveyed(frame).groups[0]
    (found,) = group.effects
    assert (found.effect, found.nats, found.named) == ("time_delay", 109.0, 2)
    assert found.standing is Standing.VARIES
    assert found.against == ("voyage-2.mcap",)
    assert effect_rows(group)[0][1:] == ("time_delay", str(Standing.VARIES), "109.0", "1", "2")
    (size,) = size_rows(group)
    assert size[1:] == ("time_delay", "delay", "0.00405 ± 5e-05 s", "50.0 of 1", "disagree")


def test_verdicts_are_counted_and_logs_without_one_named(entry):
    reports = {0: report(effect("time_delay", 50.0, delay=(0.004, 1e-5))), 1: report(), 2: None}
    rows = varied(entry, 3, diagnosis=lambda k: reports[k])
    rows[2]["diagnosis_problem"] = "the log holds 40.0 s; a diagnosis needs 60 s"
    listings = {one.title: one.rows for one in archive_report(surveyed(framed(rows)), "ship", (), {}).listings}
    assert listings["Verdicts of the diagnoses"] == [("explained", "2", "97.0")]
    assert listings["Without a diagnosis"] == [("voyage-2.mcap", rows[2]["diagnosis_problem"])]
    assert listings["Effects over the voyages"][0][-1] == "voyage-0.mcap"
    assert "Size of the effects that repeat" not in listings


def test_sizes_of_a_repeating_effect_are_drawn_over_the_voyages_with_the_common_one(entry):
    def sized(value):
        one = effect("lever_arm", 90.0)
        one["parameters"] = {axis: {"value": value * k, "std": 0.01, "unit": "m"} for k, axis in enumerate("xyz", 1)}
        return report(one)

    rows = varied(entry, 3, diagnosis=lambda k: {0: sized(0.05), 1: report(), 2: sized(0.06)}[k])
    (trend,) = (one for one in archive_report(surveyed(framed(rows)), "ship", (), {}).trends if one.tab == "Effects")
    assert (trend.title, trend.label, trend.names) == ("lever_arm", "m", ["x", "y", "z"])
    np.testing.assert_allclose(trend.values, np.outer([0.05, 0.06], [1, 2, 3]))
    assert np.ptp(trend.stamp) == 28 * 86_400_000_000_000
    assert [fit.value[0] for fit in trend.fits] == pytest.approx([0.055, 0.11, 0.165])
    assert {fit.name for fit in trend.fits} == {"common value"}
    sizes = [row[2:4] for row in size_rows(surveyed(framed(rows)).groups[0])]
    assert sizes == [("x", "+0.0550 ± 0.0071 m"), ("y", "+0.110 ± 0.010 m"), ("z", "+0.165 ± 0.015 m")]


def test_the_same_effect_about_another_axis_is_another_effect():
    def vibration(axis):
        one = effect("narrowband_vibration", 30.0, frequency=(12.0, 0.1))
        one["parameters"]["axis"] = {"value": axis, "std": None, "unit": ""}
        return report(one)

    found = repeated([("a", vibration("x")), ("b", vibration("z")), ("c", vibration("z"))])
    assert {one.effect: str(one.standing) for one in found} == {
        "narrowband_vibration z": "repeats", "narrowband_vibration x": "named in one log only",
    }  # fmt: skip


def test_moments_of_a_voyage_are_no_common_parameters():
    step = effect("misalignment_step", 30.0, time=(12.0, 0.1))
    step["parameters"]["amplitude"] = {"x": {"value": 3.0, "std": 0.1, "unit": "arcmin"}}
    (found,) = repeated([("a", report(step)), ("b", report(step))])
    assert list(found.parameters) == ["amplitude.x"]
