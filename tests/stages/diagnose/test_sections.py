"""A record longer than a diagnosis holds: every section by itself, the one that departs most as the answer."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from pipeline.diagnosing import report_document
from pipeline.diagnosis_printing import section_table
from schemas.diagnosis import Diagnosis, Verdict
from schemas.errors import DataError
from schemas.trial import Trial
from stages.diagnose import diagnose
from stages.diagnose.sections import sections
from tests.stages.diagnose import simulated
from twin import with_run

TWIN = with_run(simulated.TWIN, duration=270.0)
LIBRARY = ("gyro_scale_factor", "time_delay", "misalignment_step")
LONGEST = 95.0


@lru_cache
def trial() -> Trial:
    """Three sections: still, as its twin, and with a step of the mounting."""
    log = simulated.without_aids(simulated.log(("misalignment_step", {"y": 20.0, "time": 230.0}), of=TWIN))
    still = log.seconds(log.main.stamp) < 90.0
    gyro = np.where(still[:, None], 1e-9, log.main.gyro)
    return replace(log, main=replace(log.main, gyro=gyro))


@lru_cache
def told() -> Diagnosis:
    return diagnose(trial(), TWIN, shrink=False, library=LIBRARY, longest=LONGEST)


def test_a_record_is_cut_into_as_few_equal_parts_as_fit_and_none_is_lost() -> None:
    cuts = sections(trial(), LONGEST)
    assert len(cuts) == 3
    assert all(end == begin for (_, end), (begin, _) in pairwise(cuts))
    assert cuts[0][0] == trial().seconds(trial().main.stamp[:1])[0]
    assert cuts[-1][1] > trial().seconds(trial().main.stamp[-1:])[0]
    assert len(sections(trial(), 300.0)) == 1


def test_the_section_that_departs_most_is_the_answer_and_the_others_stand_beside_it() -> None:
    found = told()
    assert [one.verdict for one in found.sections] == [None, Verdict.NO_GAP, found.verdict]
    assert "lies still" in found.sections[0].problem
    assert [finding.name for finding in found.effects] == ["misalignment_step"]
    assert found.effects[0].parameters["time"].value == pytest.approx(230.0, abs=0.05)  # type: ignore[union-attr]
    assert found.sections[2].effects[0] == ("misalignment_step", found.effects[0].evidence_nats)
    assert found.duration_s == trial().duration
    assert all(place.window_s and place.window_s[0] > 170.0 for place in found.where)
    assert any("sections" in note for note in found.notes)


def test_report_and_terminal_tell_the_sections() -> None:
    document, table = report_document(told()), section_table(told())
    assert [one["verdict"] for one in document["sections"]] == [None, "no_gap", "explained"]
    assert document["sections"][2]["effects"][0]["name"] == "misalignment_step"
    assert table is not None
    assert table.row_count == 3


def test_a_record_of_which_no_section_can_be_diagnosed_is_refused_in_a_sentence() -> None:
    still = replace(trial(), main=replace(trial().main, gyro=np.full_like(trial().main.gyro, 1e-9)))
    with pytest.raises(
        DataError, match="no section of the record can be diagnosed; the first one: the ship lies still"
    ):
        diagnose(still, TWIN, shrink=False, library=LIBRARY, longest=LONGEST)
