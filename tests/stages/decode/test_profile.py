"""The rig profile: defaults of the contract, units to SI, and one clear line for every mistake."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.errors import DataError
from stages.decode import default_rig, load_rig


def profile(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return load_rig(path)


def refusal(tmp_path, text):
    with pytest.raises(DataError) as caught:
        profile(tmp_path, text)
    line = str(caught.value)
    assert "\n" not in line
    assert "rig.toml" in line
    return line


def test_without_keys_it_is_the_contract(tmp_path):
    assert profile(tmp_path, "") == default_rig()
    rig = default_rig().rig()
    assert rig.lever_arm is None
    assert rig.installation_main is None
    assert default_rig().main.topic == "/imu/main"
    assert not default_rig().instantaneous("main")


def test_a_role_keeps_its_defaults_for_keys_left_out(tmp_path):
    changed = profile(tmp_path, '[sub]\ngyro_unit = "deg/s"\n')
    assert changed.sub.topic == "/imu/sub"
    assert changed.sub.gyro_unit == "deg/s"
    assert changed.main == default_rig().main


def test_installation_is_heading_then_pitch_then_roll(tmp_path):
    rig = profile(tmp_path, "[phins_main]\ninstallation_deg = [10.0, 20.0, 30.0]\n").rig()
    pitch, roll, heading = np.deg2rad([10.0, 20.0, 30.0])
    by_hand = Rotation.from_rotvec([0, 0, heading]) * Rotation.from_rotvec([pitch, 0, 0])
    by_hand = by_hand * Rotation.from_rotvec([0, roll, 0])
    np.testing.assert_allclose(rig.installation_main, by_hand.as_matrix(), atol=1e-14)


def test_noise_grades_become_si(tmp_path):
    text = "[sub.noise]\ngyro_arw = 0.3\ngyro_bias_dph = 200\naccel_vrw_ug = 100\naccel_bias_ug = 10000\n"
    grade = profile(tmp_path, text).rig().sub
    assert grade.gyro_arw == pytest.approx(np.deg2rad(0.3) / 60.0)
    assert grade.gyro_bias_std == pytest.approx(np.deg2rad(200.0) / 3600.0)
    assert grade.accel_vrw == pytest.approx(100e-6 * 9.80665)
    assert grade.accel_bias_std == pytest.approx(10e-3 * 9.80665)


def test_sampling_of_a_unit_overrides_that_of_the_profile(tmp_path):
    changed = profile(tmp_path, 'sampling = "instantaneous"\n[sub]\nsampling = "interval"\n')
    assert changed.instantaneous("main")
    assert not changed.instantaneous("sub")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mian]\n", ("unknown key mian", "did you mean main")),
        ('[main]\ngyro_unt = "deg/s"\n', ("unknown key main.gyro_unt", "did you mean gyro_unit")),
        ("[main.noise]\narw = 1.0\n", ("unknown key main.noise.arw", "gyro_arw")),
        ('[main]\ngyro_unit = "deg"\n', ("main.gyro_unit", "'deg/s'", "not 'deg'")),
        ('[sub]\naxes = "RFX"\n', ("sub.axes", "RFU, FLU or FRD")),
        ('[sub]\naxes = "RBU"\n', ("sub.axes", "left-handed", "gyro_signs")),
        ('[sub]\naxes = "RLU"\n', ("sub.axes", "perpendicular")),
        ("[sub]\naxes = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\n", ("sub.axes", "perpendicular")),
        ('[sub]\naxes = ["x", "y", "w"]\n', ("sub.axes", "'w'")),
        ("[mount]\nlever_arm = [1.0, 2.0]\n", ("mount.lever_arm.2", "required")),
        ("[mount]\nlever_arm = [1.0, 2.0, nan]\n", ("mount.lever_arm.2", "finite")),
        ("[mount]\nlever_arm = [1.0, 2.0, 1e9]\n", ("mount.lever_arm.2", "1000")),
        ("[mount]\nlever_arm_std = 0.0\n", ("mount.lever_arm_std", "greater than 0")),
        ("[main.noise]\ngyro_arw = -1.0\n", ("main.noise.gyro_arw", "greater than 0", "-1.0")),
        ("[phins_sub]\ninstallation_deg = [0, 0, 999]\n", ("phins_sub.installation_deg.2", "180")),
        ("[main]\ninstallation_deg = [0, 0, 1]\n", ("main.installation_deg", "phins_main")),
        ('[main.fields]\nomega = "gyro"\n', ("main.fields", "'omega'", "angular_velocity")),
        ('[main]\ntopic = "/a"\n[sub]\ntopic = "/a"\n', ("main.topic and sub.topic", "/a")),
        ("[main]\nuse = false\n", ("main.use", "cannot be left out")),
        ("gravity = 1.62\n", ("gravity", "9.7", "1.62")),
        ('main = "x"\n', ("main", "table")),
        ("[main\n", ("not valid TOML",)),
        ("[main.noise]\ngyro_arw = -1\n[main.attitude]\nform = 3\n", ("and 1 more",)),
    ],
)
def test_a_mistake_is_told_with_its_key(tmp_path, text, words):
    line = refusal(tmp_path, text)
    assert [word for word in words if word not in line] == [], line


def test_files_that_are_not_there_or_not_text(tmp_path):
    with pytest.raises(DataError, match="cannot be read"):
        load_rig(tmp_path / "absent.toml")
    (tmp_path / "rig.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not valid TOML"):
        load_rig(tmp_path / "rig.toml")
