"""What a diagnosis prints: whole sentences, every figure, plain where there is no terminal."""

from __future__ import annotations

import contextlib
import io

import pytest

from pipeline.diagnosis_printing import MOST_ROWS, print_diagnosis
from schemas.diagnosis import Tested as Row
from tests.stages.publish import diagnosed


def printed(diagnosis) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        print_diagnosis(diagnosis)
    return out.getvalue()


@pytest.mark.parametrize(
    "part",
    [
        "the cause is found",
        "delay_s     0.015302 ± 2.1e-05 s",
        "time_delay                    5210            14.0   named",
        "49 – 60 %",
        "twin with the effects   0.250   0.250   0.630",
        "look-alike  time_delay looks the same in this log as phins_latency",
        "next        Repeat the trial with a turn of 30 degrees.",
        "untestable  gyro_temperature: the log has no temperature",
        "where       gyro of the sub-IMU, x, 0.1 to 0.2 Hz, the whole record",
    ],
)
def test_everything_a_person_needs_is_printed(part):
    assert part in printed(diagnosed.diagnosis())


def test_output_is_plain_where_there_is_no_terminal():
    assert "\x1b" not in printed(diagnosed.diagnosis())


def test_nothing_found_is_said_in_a_sentence():
    told = printed(diagnosed.no_gap())
    assert "behaves as its twin foretells" in told
    assert "named effect" not in told
    assert "nothing known explains it" in printed(diagnosed.unknown())


def test_a_long_list_is_cut_but_what_is_named_stays():
    rows = [Row(f"effect_{k}", 50.0 - k, 14.0, k == 30) for k in range(40)]
    told = printed(diagnosed.diagnosis(tested=tuple(rows)))
    assert "effect_30" in told
    assert "effect_20" not in told
    assert f"and {40 - MOST_ROWS - 1} more" in told


def test_markup_of_the_terminal_is_shown_not_obeyed():
    assert "[red]x[/red]" in printed(diagnosed.diagnosis(notes=("[red]x[/red]",)))
