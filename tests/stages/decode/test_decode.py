"""A sound log comes out as the trial it was made from, through any rig; truth stays apart."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from schemas.errors import DataError
from schemas.trial import Trial
from schemas.wire import write_log
from stages.decode import decode, load_rig
from tests.stages.decode import synthetic
from tests.stages.decode.synthetic import changed, parts

SHARED = Path(__file__).parents[3].parent / "shared"
HULL_FROM_FRD = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def written(tables, folder):
    path = folder / "log.mcap"
    write_log(path, list(tables.values()))
    return path


def rig(folder, text):
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return load_rig(path)


def test_a_log_of_the_contract_is_decoded_exactly(tmp_path):
    decoded = decode(written(synthetic.tables(), tmp_path))
    trial = decoded.trial
    attitude, gyro, accel = synthetic.imu_data(2, synthetic.STATIC)
    np.testing.assert_array_equal(trial.sub.stamp, synthetic.stamps())
    np.testing.assert_array_equal(trial.sub.gyro, gyro)
    np.testing.assert_array_equal(trial.sub.accel, accel)
    assert trial.sub.attitude is None
    assert (Rotation.from_quat(trial.phins_sub.attitude).inv() * attitude).magnitude().max() < 1e-12
    assert trial.gnss.latitude[0] == pytest.approx(np.deg2rad(45.0))
    np.testing.assert_array_equal(trial.gnss.covariance[3], np.diag([1.0, 1.0, 4.0]))
    np.testing.assert_array_equal(trial.sled.velocity[7], [0.0, 5.0, 0.0])
    assert trial.temperature_sub.value[5] == pytest.approx(20.05)
    assert trial.epoch == trial.main.stamp[0]
    assert trial.notes == ()


def test_truth_is_kept_apart_from_the_trial(tmp_path):
    decoded = decode(written(synthetic.tables(), tmp_path))
    np.testing.assert_allclose(decoded.truth.total[5], synthetic.STATIC.as_rotvec())
    assert len(decoded.truth.attitude) == synthetic.COUNT
    assert not [field.name for field in fields(Trial) if "truth" in field.name]
    tables = synthetic.tables()
    del tables["/truth/deformation"]
    assert decode(written(tables, tmp_path)).truth is None


def test_units_axes_signs_and_frames_of_a_driver_are_undone(tmp_path):
    attitude, gyro, accel = synthetic.imu_data(1)
    R_enu_ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    published = R_enu_ned.inv() * attitude * Rotation.from_matrix(HULL_FROM_FRD)
    signs = np.array([1.0, -1.0, 1.0])
    tables = synthetic.tables()
    tables["/imu/main"] = synthetic.imu_table(
        "/driver/imu",
        synthetic.stamps(),
        np.rad2deg(gyro @ HULL_FROM_FRD) * signs,
        accel @ HULL_FROM_FRD / synthetic.G,
        published.as_quat(),
    )
    profile = rig(
        tmp_path,
        """
        [main]
        topic = "/driver/imu"
        axes = "FRD"
        gyro_unit = "deg/s"
        gyro_signs = [1, -1, 1]
        accel_unit = "g"
        attitude = { frame = "NED" }
        """,
    )
    trial = decode(written(tables, tmp_path), profile).trial
    np.testing.assert_allclose(trial.main.gyro, gyro, atol=1e-15)
    np.testing.assert_allclose(trial.main.accel, accel, atol=1e-13)
    assert (Rotation.from_quat(trial.main.attitude).inv() * attitude).magnitude().max() < 1e-12


def test_removed_gravity_is_restored_by_the_phins_or_refused(tmp_path):
    _, _, accel = synthetic.imu_data(1)
    middle = synthetic.motion((np.arange(1, synthetic.COUNT + 1) - 0.5) / synthetic.RATE)
    compensated = accel - middle.inv().apply([0.0, 0.0, synthetic.G])
    tables = synthetic.tables()
    main = tables["/imu/main"]
    tables["/imu/main"] = type(main)(
        **{**vars(main), "columns": main.columns | parts("linear_acceleration", compensated)}
    )
    text = "[main]\ngravity_removed = true\n[phins_main]\ninstallation_deg = [0, 0, 0]\n"
    profile = rig(tmp_path, text)
    trial = decode(written(tables, tmp_path), profile).trial
    assert np.abs(trial.main.accel - accel[1:]).max() < 1e-4
    assert any("gravity restored" in note for note in trial.notes)
    del tables["/phins/main"]
    with pytest.raises(DataError, match="no attitude is there to restore it"):
        decode(written(tables, tmp_path), profile)


def test_implausible_units_only_warn_where_the_profile_says_so(tmp_path):
    tables = synthetic.tables()
    wrong = {f"angular_velocity__{axis}": np.rad2deg for axis in "xyz"}
    tables["/imu/main"] = changed(tables["/imu/main"], **wrong)
    trial = decode(written(tables, tmp_path), rig(tmp_path, 'plausibility = "warn"\n')).trial
    assert any("deg/s" in note for note in trial.notes)


def test_units_at_different_rates_and_stamps(tmp_path):
    tables = synthetic.tables()
    tables["/imu/main"] = synthetic.unit("/imu/main", 1, rate=10.0)
    shifted = changed(tables["/phins/main"], header__stamp=lambda stamp: stamp + 3_333_333)
    tables["/phins/main"] = shifted
    trial = decode(written(tables, tmp_path)).trial
    assert (len(trial.main), len(trial.sub)) == (400, synthetic.COUNT)
    assert trial.phins_main.stamp[0] == synthetic.stamps()[0] + 3_333_333
    assert trial.notes == ()


def json_log(path, topics):
    """Units as JSON: nested vectors, times as ISO 8601 text."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("rig.Sample", "jsonschema", b"{}")
        for topic, (stamp, gyro, accel) in topics.items():
            channel = writer.register_channel(topic, "json", schema)
            for when, rate, force in zip(stamp.tolist(), gyro, accel):
                text = str(np.datetime64(when, "ns")) + "Z"
                sample = {"t": text, "w": dict(zip("xyz", rate)), "force": {"f": force.tolist()}}
                data = json.dumps(sample).encode()
                writer.add_message(channel, when, data, when)
        writer.finish()


def protobuf_log(path, topics):
    """The same as Protobuf with a google.protobuf.Timestamp-like time; zeros are left out on the wire."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name="rig.proto", package="rig", syntax="proto3")
    kinds = {"Time": [("seconds", 3), ("nanos", 5)], "Vector": [("x", 1), ("y", 1), ("z", 1)]}
    for name, members in kinds.items():
        kind = file.message_type.add(name=name)
        for number, (member, code) in enumerate(members, 1):
            kind.field.add(name=member, number=number, type=code, label=1)
    sample = file.message_type.add(name="Sample")
    sample.field.add(name="t", number=1, type=11, type_name=".rig.Time", label=1)
    sample.field.add(name="w", number=2, type=11, type_name=".rig.Vector", label=1)
    force = file.message_type.add(name="Force")
    force.field.add(name="f", number=1, type=1, label=3)
    sample.field.add(name="force", number=3, type=11, type_name=".rig.Force", label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("rig.Sample"))
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start()
        described = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        schema = writer.register_schema("rig.Sample", "protobuf", described)
        for topic, (stamp, gyro, accel) in topics.items():
            channel = writer.register_channel(topic, "protobuf", schema)
            for when, rate, force_now in zip(stamp.tolist(), gyro, accel):
                seconds, nanos = divmod(when, 1_000_000_000)
                message = kind(t={"seconds": seconds, "nanos": nanos}, w=dict(zip("xyz", rate)))
                message.force.f.extend(force_now)
                writer.add_message(channel, when, message.SerializeToString(), when)
        writer.finish()


FOREIGN = """
[main]
topic = "/a"
type = "rig.Sample"
encoding = "{encoding}"
fields = {{ stamp = "t", angular_velocity = "w", linear_acceleration = "force.f" }}
[sub]
topic = "/b"
type = "rig.Sample"
fields = {{ stamp = "t", angular_velocity = ["w.x", "w.y", "w.z"], linear_acceleration = "force.f" }}
"""


@pytest.mark.parametrize(("encoding", "write"), [("json", json_log), ("protobuf", protobuf_log)])
def test_other_encodings_are_read_through_a_field_map(tmp_path, encoding, write):
    stamp = synthetic.stamps()
    data = {"/a": (stamp, *synthetic.imu_data(1)[1:]), "/b": (stamp, *synthetic.imu_data(2)[1:])}
    write(tmp_path / "log.mcap", data)
    trial = decode(tmp_path / "log.mcap", rig(tmp_path, FOREIGN.format(encoding=encoding))).trial
    np.testing.assert_array_equal(trial.main.stamp, stamp)
    np.testing.assert_array_equal(trial.main.gyro, data["/a"][1])
    np.testing.assert_array_equal(trial.sub.accel, data["/b"][2])
    assert trial.notes == ()


def test_a_field_that_is_not_there_is_named(tmp_path):
    profile = rig(tmp_path, '[main.fields]\nangular_velocity = "gyro"\n')
    with pytest.raises(DataError, match=r"/imu/main: .*no field gyro\.x; they have header\.stamp"):
        decode(written(synthetic.tables(), tmp_path), profile)


@pytest.mark.parametrize(
    ("name", "seconds", "rate"),
    [
        ("idam-ship", 399.99, 100),
        ("stalign-sim", 199.995, 200),
        ("modelfree-sim", 3599.9, 10),
        ("random-sea-a", 399.99, 100),
    ],
)
def test_logs_of_an_independent_generator(name, seconds, rate):
    path = SHARED / "logs" / f"{name}.mcap"
    if not path.exists():
        pytest.skip("the shared logs are not there")
    trial = decode(path).trial
    assert trial.duration == pytest.approx(seconds, abs=1e-3)
    assert len(trial.main) == len(trial.sub) == round(seconds * rate) + 1
    assert trial.notes == ()


def test_a_real_recording_of_one_unit_is_refused_for_want_of_the_other(tmp_path):
    path = SHARED / "data" / "husky" / "real-imu-gnss.mcap"
    if not path.exists():
        pytest.skip("the shared recording is not there")
    with pytest.raises(DataError, match=r"/imu/main \(main\) is missing; the log has /imu/data"):
        decode(path)
    with pytest.raises(DataError, match=r"/imu/sub \(sub\) is missing"):
        decode(path, rig(tmp_path, '[main]\ntopic = "/imu/data"\n'))
