"""The picture of the confusion: what is right is green, what is not is red."""

import xml.etree.ElementTree as ElementTree

from pipeline.blind.page import figure

GREEN, RED = "rgba(22,120,80", "rgba(190,60,40"


def cells(confusion):
    root = ElementTree.fromstring(figure({"methods": {"own": {"confusion": confusion}, "other": {"confusion": {}}}}))
    fills = [e.get("fill") for e in root.iter("{http://www.w3.org/2000/svg}rect")]
    words = [e.text for e in root.iter("{http://www.w3.org/2000/svg}text")]
    return [f for f in fills if f.startswith("rgba")], words


def test_right_answers_are_green():
    fills, words = cells(
        {
            "null": {"no_gap": 3},
            "time_delay": {"time_delay": 2},
            "bouc_wen": {"unknown_effect": 1},
            "lever_arm (removed)": {"partly_explained": 1},
        }
    )
    assert len(fills) == 4
    assert all(fill.startswith(GREEN) for fill in fills)
    assert words[:4] == ["null", "time delay", "bouc wen", "lever arm (removed)"]


def test_wrong_answers_are_red():
    fills, _ = cells(
        {
            "null": {"time_delay": 1, "unknown_effect": 1},
            "time_delay": {"no_gap": 1, "lever_arm": 1, "unknown_effect": 1},
            "bouc_wen": {"no_gap": 1, "flexure_parameters": 1},
        }
    )
    assert len(fills) == 7
    assert all(fill.startswith(RED) for fill in fills)


def test_names_that_would_break_the_picture_are_escaped():
    _, words = cells({"<&>": {"<&>": 1}})
    assert words[0] == "<&>"
