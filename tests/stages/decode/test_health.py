"""What ``info`` says of a log: rates, gaps, damage, and what can be run on it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from schemas.wire import write_log
from stages.decode import health, load_rig
from tests.stages.decode import synthetic
from tests.stages.decode.synthetic import COUNT, changed, selected

SHARED = Path(__file__).parents[3].parent / "shared"


def looked_over(tables, folder, profile=None):
    path = folder / "log.mcap"
    write_log(path, list(tables.values()))
    return health(path, profile)


def channel(found, topic):
    return next(one for one in found.channels if one.topic == topic)


def possible(found):
    return {one.name for one in found.capabilities if one.possible}


def test_a_sound_log_can_do_everything(tmp_path):
    found = looked_over(synthetic.tables(), tmp_path)
    assert all(one.possible and not one.reason for one in found.capabilities)
    assert found.missing == ()
    assert found.problems == ()
    main = channel(found, "/imu/main")
    assert (main.role, main.count, main.encoding, main.usable) == ("main", COUNT, "cdr", True)
    assert main.rate == pytest.approx(synthetic.RATE)
    assert main.start == synthetic.stamps()[0]
    assert found.duration == pytest.approx(synthetic.DURATION - 1.0 / synthetic.RATE)


def test_damage_to_the_stamps_is_counted_as_it_was_written(tmp_path):
    tables = synthetic.tables()
    index = np.r_[0:100, 99, 100:500, 505, 504, 900:COUNT]
    tables["/imu/main"] = selected(tables["/imu/main"], index)
    facts = channel(looked_over(tables, tmp_path), "/imu/main").facts
    assert (facts.duplicates, facts.out_of_order, facts.gaps) == (1, 1, 2)
    assert facts.longest_gap == pytest.approx((900 - 505) / synthetic.RATE)
    assert facts.longest_gap_at == synthetic.stamps()[505]


def test_what_is_missing_takes_its_capability_along(tmp_path):
    tables = synthetic.tables()
    del tables["/phins/sub"]
    del tables["/sliding/odom"]
    del tables["/truth/deformation"]
    found = looked_over(tables, tmp_path)
    assert possible(found) == {"estimators", "attitude of the deck", "diagnosis"}
    reasons = {one.name: one.reason for one in found.capabilities}
    assert "/phins/sub (phins_sub) is missing" in reasons["score against PHINS"]
    assert "/sliding/odom (sled) is missing" in reasons["deck shape"]
    assert set(found.missing) == {"phins_sub", "sled", "truth_deformation"}


def test_a_wrong_unit_is_told_without_an_error(tmp_path):
    tables = synthetic.tables()
    wrong = {f"angular_velocity__{axis}": np.rad2deg for axis in "xyz"}
    tables["/imu/sub"] = changed(tables["/imu/sub"], **wrong)
    found = looked_over(tables, tmp_path)
    assert not channel(found, "/imu/sub").usable
    assert 'sub.gyro_unit = "deg/s"' in channel(found, "/imu/sub").problems[-1]
    assert "estimators" not in possible(found)
    assert "deck shape" in possible(found)


def test_a_log_without_the_roles_names_the_channels_that_could_serve(tmp_path):
    tables = {"/a": synthetic.unit("/a", 1), "/b": synthetic.unit("/b", 2)}
    found = looked_over(tables, tmp_path)
    assert "main and sub missing" in found.problems[0]
    assert "/a, /b" in found.problems[0]
    assert channel(found, "/a").rate == pytest.approx(synthetic.RATE)
    (tmp_path / "rig.toml").write_text('[main]\ntopic = "/a"\n[sub]\ntopic = "/b"\n')
    named = looked_over(tables, tmp_path, load_rig(tmp_path / "rig.toml"))
    assert "estimators" in possible(named)


def test_clocks_that_never_meet_leave_no_estimate(tmp_path):
    tables = synthetic.tables()
    tables["/imu/sub"] = changed(tables["/imu/sub"], header__stamp=lambda stamp: stamp - 10**12)
    found = looked_over(tables, tmp_path)
    assert "estimators" not in possible(found)
    assert "do not overlap" in found.capabilities[0].reason


def test_a_real_recording():
    path = SHARED / "data" / "husky" / "real-imu-gnss.mcap"
    if not path.exists():
        pytest.skip("the shared recording is not there")
    found = health(path)
    assert channel(found, "/imu/data").rate == pytest.approx(30.0, abs=0.1)
    assert channel(found, "/husky_velocity_controller/odom").facts.gaps == 2
    assert "/imu/data" in found.problems[0]
    assert possible(found) == set()


def test_looking_over_a_log_needs_no_compiler():
    code = "import sys, stages.decode; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[3], check=False).returncode == 0
