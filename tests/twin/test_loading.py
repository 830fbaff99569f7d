"""Twins as TOML: everything has a default, and what is wrong is named."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.errors import DataError
from twin import Twin, believed_rig, built_in, dump_twin, load_twin, parse_twin, with_run

CONTRACT = """
name = "example"
[run]
duration = 1800.0
rate = 100.0
seed = 1
[ship]
latitude = 45.0
longitude = 126.0
height = 20.0
heading = 45.0
speed = 20.0
[sea]
pitch = [[10.0, 8.0, 0.0]]
roll = [[10.0, 8.0, 0.0]]
heading = [[10.0, 10.0, 0.0]]
[mount]
static_arcmin = [10.0, 10.0, 30.0]
lever_arm = [10.0, 10.0, 2.0]
lever_bandwidth = 5.0
time_delay = 0.0
[flexure]
damping = [0.2146, 0.2146, 0.0715]
frequency = [0.0, 0.0, 0.0]
std_arcmin = [6.0, 6.0, 10.0]
quasi_static_amplitude_arcmin = [0.0, 0.0, 0.0]
quasi_static_period = 3600.0
[imu.main]
gyro_bias_dph = [0.01, -0.01, -0.01]
gyro_arw = 0.001
gyro_scale_ppm = [5.0, -5.0, 5.0]
gyro_nonorthogonality_arcsec = [5.0, -5.0, -5.0, 5.0, -5.0, 5.0]
accel_bias_ug = [50.0, 50.0, 50.0]
accel_vrw_ug = 10.0
[phins]
attitude_noise_arcmin = 0.06
attitude_drift_arcmin = [0.3, 0.3, 0.6]
attitude_drift_tau = 300.0
installation_main_deg = [-0.041, 0.430, -0.250]
installation_sub_deg = [-0.029, 0.525, 0.330]
[deck]
length = 100.0
speed = 5.0
angle = 7.0
passes = 4
vertical = [2e-5, 1.6e-4, 9.0, 1e-5, 60.0]
horizontal = [1.5e-5, 1e-5, 20.0, 0.0, 50.0]
torsion = [-1e-5, -2.2e-4, 8.0, 8e-6, 45.0]
flexure_scale = 0.3
outlier_rate = 6.0
outlier_size = 0.5
"""


def test_the_example_of_the_contract_is_the_default() -> None:
    twin = parse_twin(CONTRACT)
    plain = parse_twin('name = "example"\n[deck]\n')
    assert twin == plain


def test_an_empty_file_is_a_twin_without_a_deck() -> None:
    assert parse_twin("") == Twin()
    assert parse_twin("").deck is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[imu.main]\ngyro_biass_dph = [0, 0, 0]", "unknown key 'imu.main.gyro_biass_dph'"),
        ("[seas]\n", "unknown key 'seas'"),
        ("colour = 1", "unknown key 'colour'"),
        ("[[ship.phase]]\nstart = 1\nspin = 2", "unknown key 'ship.phase.0.spin'"),
        ("[run]\nduration = -5", "'run.duration'"),
        ("[run]\nrate = 1e9", "'run.rate'"),
        ("[run]\nduration = nan", "'run.duration'"),
        ("[run]\nduration = 600000\nrate = 2000", "samples"),
        ("[ship]\nlatitude = 91", "'ship.latitude'"),
        ("[sea]\npitch = [[200.0, 8.0, 0.0]]", "'sea.pitch.0.0'"),
        ("[sea]\npitch = [[1.0, 0.0, 0.0]]", "'sea.pitch.0.1'"),
        ("[sea]\npitch = [[1.0, 8.0]]", "'sea.pitch.0"),
        ('[sea]\nmodel = "tsunami"', "'sea.model'"),
        ("[mount]\nlever_arm = [1.0, 2.0]", "'mount.lever_arm"),
        ("[mount]\ntime_delay = 1e6", "'mount.time_delay'"),
        ("[flexure]\ndamping = [0.0, 0.1, 0.1]", "'flexure.damping.0'"),
        ("[flexure]\nstd_arcmin = [-1.0, 1, 1]", "'flexure.std_arcmin.0'"),
        ("[flexure]\nstd_arcmin = [1e9, 1, 1]", "no deck's"),
        ("[flexure]\nstd_arcmin = [inf, 1, 1]", "'flexure.std_arcmin.0'"),
        ("[deck]\nlength = 2.0\nspeed = 10.0", "speed on so short a path"),
        ("[deck]\nvertical = [1.0, 0, 1, 0, 1]", "0.1 rad/m"),
        ("[[ship.phase]]\nstart = 9\n[[ship.phase]]\nstart = 3", "one after the other"),
        ("[run]\nseed = 'x'", "'run.seed'"),
        ("[run\n", "not valid TOML"),
        ("a = " + "[" * 50_000, "nested too deeply"),
        ("a = " + "9" * 5_000, "not valid TOML"),
        ('[[effect]]\nname = "kraken"', "no effect named 'kraken'"),
    ],
)
def test_what_is_wrong_is_named(text: str, told: str) -> None:
    with pytest.raises(DataError) as caught:
        parse_twin(text, file="bad.toml")
    assert told in str(caught.value)
    assert str(caught.value).startswith("bad.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", built_in())
def test_built_in_twins_load_and_survive_writing(name: str) -> None:
    twin = load_twin(name)
    assert twin.name == name
    assert parse_twin(dump_twin(twin)) == twin


def test_the_published_simulations_are_built_in() -> None:
    assert {"idam", "td-ma", "model-free", "sliding", "idam-ship", "random-sea", "sample"} <= set(built_in())
    assert load_twin("td-ma").mount.time_delay == 0.075
    assert load_twin("idam-ship").phins.installation_sub_deg == (-0.029, 0.525, 0.330)


def test_odd_names_survive_writing() -> None:
    twin = Twin(name='a "quoted" \\ name\nwith\x01 more é')
    assert parse_twin(dump_twin(twin)) == twin


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no built-in twin named 'atlantis'"):
        load_twin("atlantis")
    with pytest.raises(DataError, match="cannot be read"):
        load_twin(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(DataError, match="UTF-8"):
        load_twin(tmp_path / "latin.toml")


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[2].parent / "shared" / "logs").glob("*.twin.toml")), ids=lambda p: p.stem
)
def test_twins_of_foreign_logs_load(path: Path) -> None:
    assert load_twin(path).run.duration > 0


def test_another_run_is_checked_like_a_file() -> None:
    twin = with_run(load_twin("idam"), duration=12.0, seed=3)
    assert (twin.run.duration, twin.run.seed, twin.run.rate) == (12.0, 3, 100.0)
    assert twin.flexure == load_twin("idam").flexure
    with pytest.raises(DataError, match=r"run\.duration"):
        with_run(twin, duration=-1.0)


def test_what_the_owner_would_state_of_the_installation() -> None:
    rig = believed_rig(load_twin("idam-ship"))
    np.testing.assert_allclose(rig.lever_arm, [-4.0, 34.0, 3.0])
    np.testing.assert_allclose(
        rig.installation_sub, Rotation.from_euler("ZXY", [0.330, -0.029, 0.525], degrees=True).as_matrix(), atol=1e-15
    )
    assert rig.main.gyro_arw == pytest.approx(np.radians(0.001) / 60)
    assert rig.sub.accel_vrw == pytest.approx(10 * 9.80665e-6)
    assert rig.main.gyro_bias_std == pytest.approx(np.radians(0.01) / 3600)
    assert believed_rig(load_twin("idam")).installation_main is None
