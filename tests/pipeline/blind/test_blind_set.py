"""From sealing to scoring on real logs, with the baselines as diagnosers."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from pipeline.blind import answering, baselines
from pipeline.blind.answering import answer, resolve
from pipeline.blind.folder import read_json, read_manifest
from pipeline.blind.page import figure, markdown
from pipeline.blind.plan import Shares, Wish
from pipeline.blind.scoring import score
from pipeline.blind.sealing import seal
from pipeline.blind.vault import lock, new_key, read_key, unlock
from schemas.errors import DataError
from schemas.wire import read_log, scan_log
from stages.decode import decode
from twin.loading import load_twin

NAMES = ("time_delay", "accel_bias", "wave_forced_bending")
WISH = Wish(
    names=NAMES, foreign=("sinusoidal_clock",), severities=(10.0,), durations=(60.0,),
    shares=Shares(null=0.25, pair=0.125, foreign=0.125, removed=0.125),
)  # fmt: skip
LOGS = 8


def truthful(log: Path, twin: Path, without: tuple[str, ...]) -> dict:
    """A diagnoser that fails on one log and finds nothing in the others."""
    if log.stem == "003":
        raise RuntimeError("no such\nluck")
    return {"verdict": "no_gap", "effects": [], "where": [], "gap": {"before": float("nan")}}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blind") / "set"
    seal(folder, folder.with_name("set.key"), LOGS, WISH, seed=20)
    return folder


@pytest.fixture
def copied(made, tmp_path):
    """A copy whose seal a test may open (the logs themselves are linked)."""
    folder = tmp_path / "set"
    folder.mkdir()
    for path in made.iterdir():
        if path.is_file():
            os.link(path, folder / path.name)
    return folder


def key_of(made: Path) -> Path:
    return made.with_name("set.key")


def test_a_set_holds_logs_twins_and_locked_answers(made):
    sealed = read_manifest(made)
    names = {path.name for path in made.iterdir() if path.is_file()}
    expected = {f"{e.name}{end}" for e in sealed.logs for end in (".mcap", ".twin.toml")}
    assert names == expected | {"seal.json", "answers.sealed"}
    assert len(sealed.logs) == LOGS
    sealed.check()


def test_the_logs_follow_the_contract_and_decode(made):
    scanned = scan_log(made / "001.mcap")
    topics = {channel.topic: channel.schema for channel in scanned.channels}
    assert topics["/imu/main"] == topics["/phins/sub"] == "sensor_msgs/msg/Imu"
    assert topics["/imu/sub/temperature"] == "sensor_msgs/msg/Temperature"
    assert topics["/gnss/fix"] == "sensor_msgs/msg/NavSatFix"
    assert not [topic for topic in topics if topic.startswith("/truth")]
    trial = decode(made / "001.mcap").trial
    assert len(trial.main) == 6000
    assert trial.phins_sub is not None
    assert trial.notes == ()


def test_nothing_outside_the_lock_names_an_effect(made):
    public = "".join(path.read_text() for path in made.glob("*.twin.toml"))
    assert not [name for name in ("wave_forced_bending", "sinusoidal_clock", "[[effect]]") if name in public]
    sealed = read_manifest(made)
    assert "kind" not in (made / "seal.json").read_text()
    for entry in sealed.logs:
        assert load_twin(sealed.twin(entry)).effect == ()
        assert load_twin(sealed.twin(entry)).name == "trial"
        assert not read_log(sealed.log(entry), topics=[]).metadata
    raw = (made / "001.mcap").read_bytes()[:4096] + (made / "answers.sealed").read_bytes()
    assert not [name for name in NAMES if name.encode() in raw]


def test_files_bear_the_same_date(made):
    assert len({int(path.stat().st_mtime) for path in made.iterdir() if path.is_file()}) == 1


def test_the_key_is_for_its_owner_alone(made):
    assert key_of(made).stat().st_mode & 0o077 == 0


def test_the_length_of_the_answers_tells_nothing(tmp_path):
    key = new_key(tmp_path / "key")
    short, _ = lock({"logs": []}, key)
    long, _ = lock({"logs": ["x" * 5000]}, key)
    assert len(short) == len(long)


def test_answers_cannot_be_exchanged(tmp_path):
    key = new_key(tmp_path / "key")
    locked, commitment = lock({"logs": [1]}, key)
    path = tmp_path / "answers"
    path.write_bytes(locked)
    assert unlock(path, key, commitment)["logs"] == [1]
    path.write_bytes(lock({"logs": [2]}, key)[0])
    with pytest.raises(DataError, match="committed"):
        unlock(path, key, commitment)
    path.write_bytes(locked[:-9] + b"AAAAAAAA=")
    with pytest.raises(DataError, match="cannot be opened"):
        unlock(path, key, commitment)


def test_a_set_is_never_sealed_over_another(made, tmp_path):
    with pytest.raises(DataError, match="not an empty directory"):
        seal(made, tmp_path / "key", 1, WISH)
    with pytest.raises(DataError, match="never overwritten"):
        seal(tmp_path / "new", key_of(made), 1, WISH)
    with pytest.raises(DataError, match="another place"):
        seal(tmp_path / "new", tmp_path / "new" / "key", 1, WISH)


def test_a_failing_log_does_not_stop_the_others_and_work_is_resumed(copied):
    how = f"{__name__}:truthful"
    first = answer(copied, diagnoser=how)
    assert (first.answered, first.failed, first.before) == (LOGS - 1, ("003.mcap",), 0)
    assert read_json(copied / "answers" / "003.json")["failure"] == "RuntimeError: no such luck"
    assert read_json(copied / "answers" / "001.json")["gap"]["before"] is None
    (copied / "answers" / "005.json").unlink()
    second = answer(copied, diagnoser=how)
    assert (second.answered, second.before) == (1, LOGS - 1)
    assert answer(copied, diagnoser=how, retry=True).failed == ("003.mcap",)


def test_a_log_that_was_changed_is_not_answered(copied):
    log = copied / "002.mcap"
    data = bytearray(log.read_bytes())
    log.unlink()
    data[len(data) // 2] ^= 1
    log.write_bytes(bytes(data))
    assert answer(copied, diagnoser=f"{__name__}:truthful").failed == ("002.mcap", "003.mcap")


@pytest.mark.slow
def test_several_workers_give_the_same_answers(copied):
    done = answer(copied, method="global_nis", workers=2)
    assert done.failed == ()
    for k in (1, LOGS):
        document = read_json(copied / "baselines" / "global_nis" / f"{k:03d}.json")
        alone = baselines.global_nis(copied / f"{k:03d}.mcap", copied / f"{k:03d}.twin.toml", ())
        assert document["verdict"] == alone["verdict"]


def test_the_seal_is_opened_once(copied, made):
    answer(copied, diagnoser=f"{__name__}:truthful")
    found = score(copied, key_of(made))
    assert found["opening"] == {"number": 1, "first": found["opening"]["first"], "answers_changed_since": False}
    with pytest.raises(DataError, match="opened already"):
        score(copied, key_of(made))
    with pytest.raises(DataError, match="prove nothing"):
        answer(copied, diagnoser=f"{__name__}:truthful")
    document = read_json(copied / "answers" / "001.json")
    (copied / "answers" / "001.json").write_text(json.dumps(document | {"verdict": "unknown_effect"}))
    again = score(copied, key_of(made), again=True)
    assert again["opening"]["number"] == 2
    assert again["opening"]["answers_changed_since"]
    assert "opened before" in markdown(again)


def test_nothing_is_opened_while_an_answer_is_missing_or_the_key_is_wrong(copied, made, tmp_path):
    with pytest.raises(DataError, match="no answers"):
        score(copied, key_of(made))
    answer(copied, diagnoser=f"{__name__}:truthful")
    new_key(tmp_path / "other")
    with pytest.raises(DataError, match="cannot be opened"):
        score(copied, tmp_path / "other")
    (copied / "answers" / "004.json").unlink()
    with pytest.raises(DataError, match="1 of 8 logs have no answer"):
        score(copied, key_of(made))
    assert not (copied / "opened.json").exists()


def test_baselines_are_scored_against_the_truth(copied, made):
    for method in answering.BASELINES:
        assert answer(copied, method=method).failed == ()
    document = score(copied, key_of(made))
    assert set(document["methods"]) == set(answering.BASELINES)
    truth = unlock(copied / "answers.sealed", read_key(key_of(made)), read_manifest(copied).commitment)["logs"]
    right = 0
    for entry in truth:
        given = read_json(copied / "baselines" / "bic" / f"{entry['name']}.json")
        if entry["kind"] == "single" and given["effects"]:
            right += given["effects"][0]["name"] == entry["effects"][0]["name"]
    bic = document["methods"]["bic"]
    assert bic["single"]["top1"]["k"] == right >= 1
    assert bic["nulls"]["false_name"]["n"] == 2
    assert sum(sum(row.values()) for row in bic["confusion"].values()) == LOGS - 1  # the pair has no row
    page = markdown(document, "score.svg")
    assert "| two effects: both named |" in page
    assert "score.svg" in page
    assert figure(document).startswith("<svg")
    json.dumps(document, allow_nan=False)


def test_a_baseline_estimates_a_strong_bias(made):
    from pipeline.blind.reality import draw
    from pipeline.blind.residuals import view, whitened

    trial, twin, _ = draw(77, effects=[("accel_bias", {"z": 5000.0})], duration=120.0)
    seen = view(trial, twin)
    fits = {fit.name: fit for fit in baselines._fits(seen, whitened(seen, seen.residual), ())}
    best = max(fits.values(), key=lambda fit: fit.gain)
    assert best.name in ("accel_bias", "accel_scale_factor")  # the two are one where f_z is nearly g
    assert fits["accel_bias"].value[2] == pytest.approx(5000.0, rel=0.04)
    assert np.isfinite(fits["accel_bias"].std).all()


def test_an_unknown_method_is_told_with_the_names_there_are():
    with pytest.raises(ValueError, match="largest_residual"):
        resolve("guesswork")


@pytest.mark.slow
def test_the_diagnosis_itself_answers(tmp_path):
    wish = Wish(names=("accel_bias",), severities=(10.0,), durations=(120.0,), shares=Shares(0.0, 0.0, 0.0, 1.0))
    seal(tmp_path / "set", tmp_path / "key", 1, wish, seed=6)
    done = answer(tmp_path / "set")
    assert (done.answered, done.failed) == (1, ())
    given = read_json(tmp_path / "set" / "answers" / "001.json")
    assert given["without"] == ["accel_bias"]
    assert "accel_bias" not in [effect["name"] for effect in given["effects"]]
    found = score(tmp_path / "set", tmp_path / "key")["methods"]["deckflex"]
    assert found["removed"]["not_explained"]["n"] == 1
