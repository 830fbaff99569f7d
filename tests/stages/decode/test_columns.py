"""Columns that the profile names: which are asked of the log, and stamps that int64 nanoseconds cannot hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schemas.errors import DataError
from schemas.wire import Table, read_log, write_log
from stages.decode import columns, decode
from stages.decode.profile import RigProfile, default_rig
from stages.decode.roles import wanted
from tests.schemas.sample_logs import imu


def table(**given: Any) -> Table:
    n = len(next(iter(given.values())))
    times = np.arange(n, dtype=np.int64)
    named = {path.replace("__", "."): np.asarray(values) for path, values in given.items()}
    return Table("/x", "any/msg/Type", named, times, times, times.astype(np.uint32))


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [
        ({"header__stamp": np.array([7, 2**63 + 5, 2**64 - 1], np.uint64)}, "ns", [7, 0, 0]),
        ({"header__stamp": np.array([7, 2**60, -(2**60)])}, "us", [7_000, 0, 0]),
        ({"header__stamp": np.array([7.5, 1e300, np.nan])}, "s", [7_500_000_000, 0, 0]),
        ({"header__stamp__sec": np.array([1, 2**40]), "header__stamp__nsec": np.arange(2)}, "s", [1_000_000_000, 0]),
    ],
)  # fmt: skip
def test_a_stamp_that_does_not_fit_is_no_stamp(given: dict[str, Any], unit: str, expected: list[int]):
    channel = default_rig().main.model_copy(update={"stamp_unit": unit})
    assert columns.stamps(table(**given), channel).tolist() == expected


def test_the_columns_of_a_role_are_those_of_its_field_map():
    profile = RigProfile.model_validate(
        {"main": {"fields": {"stamp": "t", "angular_velocity": ["gx", "gy", "gz"], "linear_acceleration": "acc"}}}
    )
    asked = wanted(profile)
    assert {"t", "gx", "gy", "gz", "acc", "orientation"} <= asked["/imu/main"]
    assert "header.stamp" in asked["/imu/sub"]
    assert {"status.status", "position_covariance_type"} <= asked["/gnss/fix"]


def test_roles_that_share_a_topic_ask_for_the_columns_of_both():
    profile = RigProfile.model_validate(
        {"phins_main": {"topic": "/imu/main", "fields": {"orientation": ["a", "b", "c", "d"]}}}
    )
    assert {"angular_velocity", "orientation", "a", "b", "c", "d"} <= wanted(profile)["/imu/main"]


def test_every_column_asked_for_by_default_exists_in_its_message(tmp_path: Path):
    write_log(tmp_path / "a.mcap", [imu(n=5)])
    found = read_log(tmp_path / "a.mcap", columns=wanted(default_rig())).tables["/imu/main"]
    assert {"header.stamp", "orientation.w", "orientation_covariance", "angular_velocity.x"} <= found.columns.keys()
    assert not {"angular_velocity_covariance", "header.frame_id"} & found.columns.keys()


def test_an_unknown_field_is_answered_with_all_that_there_are(tmp_path: Path):
    write_log(tmp_path / "a.mcap", [imu(), replace(imu(), topic="/imu/sub")])
    profile = RigProfile.model_validate({"main": {"fields": {"angular_velocity": "gyro"}}})
    with pytest.raises(DataError, match=r"no field gyro.x; they have header\.stamp, header\.frame_id, orientation\.x"):
        decode(tmp_path / "a.mcap", profile)
