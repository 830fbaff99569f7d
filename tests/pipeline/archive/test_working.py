"""One log by one worker, called here: whatever the log, the disk or the neighbour does, an outcome comes back."""

import json
import os
import resource
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.archive import memory
from pipeline.archive.config import Config, Text
from pipeline.archive.jobs import Job, State
from pipeline.archive.manifest import load_manifest, marks_of
from pipeline.archive.sources import found_in
from pipeline.archive.stores import LocalStore, open_store
from pipeline.archive.workers import Wish
from pipeline.archive.working import process, slug_of
from pipeline.provenance import deckflex_version
from tests.pipeline.archive.processes import check_whole, entries
from tests.pipeline.archive.voyages import digest

CONFIG = Config(deckflex_version(), estimator="td-ma", identifier="acf")


@pytest.fixture
def log(fleet, tmp_path) -> Path:
    folder = tmp_path / "in"
    folder.mkdir()
    return Path(shutil.copy2(fleet / "month-00" / "voyage 00-0.mcap", folder / "voyage.mcap"))


def job_on(log: Path, out: Path, config: Config = CONFIG, **more) -> Job:
    source = found_in([str(log)], str(out)).sources[0]
    marks = tuple(marks_of(load_manifest(LocalStore(str(out))), source))
    return Job(source, config.document(), str(out), marks=marks, **more)


def test_result_recording_page_and_tables_are_kept_as_wished(log, tmp_path):
    config = replace(CONFIG, outputs=("log", "page", "recording", "tables"), rrd_rate=1.0)
    outcome = process(job_on(log, tmp_path / "out", config))
    assert outcome.state is State.DONE, outcome.reason
    entry = json.loads(entries(tmp_path / "out")[0].read_bytes())
    kinds = {kind: Path(name).name for kind, name in entry["files"].items()}
    assert kinds == {"log": "voyage.mcap", "recording": "voyage.rrd", "report": "voyage.html",
                     "table deformation": "voyage.deformation.parquet"}  # fmt: skip
    for name in entry["files"].values():
        assert (tmp_path / "out" / name).stat().st_size > 1000
    assert entry["summary"]["log"] == str(log)
    assert entry["summary"]["details"]["provenance"]["log.sha256"] == entry["sha256"]


def test_the_same_content_is_worked_on_once(log, tmp_path):
    out = tmp_path / "out"
    assert process(job_on(log, out)).state is State.DONE
    twin = Path(shutil.copy(log, log.with_name("copy.mcap")))
    second = process(job_on(twin, out))
    assert (second.state, second.reason) == (State.KNOWN, "same content as voyage.mcap")
    assert process(job_on(log, out)).state is State.BEFORE
    assert len(entries(out)) == 1


def test_a_replaced_log_is_worked_on_anew_and_its_old_result_no_longer_counts(log, fleet, tmp_path, deckflex):
    out = tmp_path / "out"
    words = ("batch", log.parent, "-o", out, "--estimator", "td-ma", "--identifier", "acf")
    (out).mkdir()
    (out / "deckflex-archive.json").write_text('{"format": 1}')
    assert process(job_on(log, out)).state is State.DONE
    assert json.loads(deckflex(*words, "--dry-run", "--json").out)["to_do"] == []
    shutil.copy2(fleet / "month-01" / "voyage 01-1.mcap", log)
    assert len(json.loads(deckflex(*words, "--dry-run", "--json").out)["to_do"]) == 1
    assert process(job_on(log, out)).state is State.DONE
    assert json.loads(deckflex(*words, "--dry-run", "--json").out)["to_do"] == []
    document = json.loads(deckflex("catalogue", out, "--json").out)
    assert (document["logs"], document["left_out"]) == (1, 1)
    assert len(list((out / "inputs").iterdir())) == 1


def test_a_result_whose_files_are_gone_is_made_anew_when_it_is_looked_at(log, tmp_path):
    out = tmp_path / "out"
    assert process(job_on(log, out)).state is State.DONE
    shutil.rmtree(out / "results")
    assert process(job_on(log, out)).state is State.DONE
    check_whole(out)
    entries(out)[0].write_text("{")
    assert process(job_on(log, out)).state is State.DONE
    check_whole(out)


def test_a_log_that_grows_while_it_is_read_is_left_for_the_next_run(log, tmp_path, monkeypatch):
    import pipeline.archive.working as working

    def grown(path):
        found = run_sha(path)
        with Path(path).open("ab") as stream:
            stream.write(b"more")
        return found

    run_sha = working.sha256_of
    monkeypatch.setattr(working, "sha256_of", grown)
    outcome = process(job_on(log, tmp_path / "out"))
    assert outcome.state is State.FAILED
    assert "changed while it was read" in outcome.reason
    assert digest(tmp_path / "out") == {}


def test_a_bad_log_is_set_aside_once_and_tried_again_when_asked(fleet, tmp_path):
    bad, out = fleet / "bad" / "no_sub.mcap", tmp_path / "out"
    first = process(job_on(bad, out))
    assert first.state is State.ASIDE
    assert "/imu/sub (sub) is missing" in first.reason
    assert process(job_on(bad, out)).reason == first.reason
    before = digest(out)
    process(job_on(bad, out))
    assert digest(out) == before
    process(job_on(bad, out, retry=True))
    assert digest(out) != before
    assert len(entries(out, "aside")) == 1


def test_a_log_that_needs_more_memory_than_there_is_is_refused(log, tmp_path):
    outcome = process(job_on(log, tmp_path / "out", memory=0.3e9))
    assert outcome.state is State.FAILED
    assert "needs about 0.5 GB, a worker has 0.3 GB" in outcome.reason
    assert "--diagnose" not in outcome.reason
    assert digest(tmp_path / "out") == {}


def test_a_worker_that_is_never_started_takes_no_memory_from_the_others():
    assert Wish(workers=8).limit(2) == Wish(workers=2).limit(9) == memory.per_worker(2)
    assert Wish(workers=8, memory_gb=3.0).limit(2) == 3e9
    assert Wish(scheduler="tcp://host:8786").limit(2) is None


def test_memory_grows_with_messages_and_lies_about_them_are_not_believed(log, fleet, tmp_path):
    from tests.faults import container

    assert memory.needed(log) > memory.BASE + 1000 * memory.PER_MESSAGE
    assert memory.needed(log, diagnosed=True) > memory.needed(log) + 1e6
    liar = tmp_path / "liar.mcap"
    liar.write_bytes(container.lying_statistics(log.read_bytes()))
    assert memory.needed(liar) < 1.1e9
    assert memory.needed(fleet / "bad" / "not_mcap.mcap") == memory.BASE


def test_a_full_disk_stops_the_batch_and_leaves_no_half_file(log, tmp_path):
    out = tmp_path / "out"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        outcome = process(job_on(log, out))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert outcome.state is State.STORE
    assert "cannot be written" in outcome.reason
    assert digest(out) == {}
    assert process(job_on(log, out)).state is State.DONE
    check_whole(out)


def test_what_cannot_be_read_is_for_the_next_run(tmp_path, log):
    job = job_on(log, tmp_path / "out")
    log.unlink()
    outcome = process(job)
    assert outcome.state is State.FAILED
    assert outcome.reason == "cannot be read: is not there"
    other = process(replace(job, config={**job.config, "version": "0.0.0"}))
    assert "the batch was started by 0.0.0" in other.reason


@pytest.mark.parametrize(
    ("name", "slug"),
    [("../../etc/passwd.mcap", "passwd"), ("..", "log"), ("a b\n\x1b[31m.mcap", "a-b-31m"), ("ü" * 9, "log"),
     ("x" * 300 + ".mcap", "x" * 60), (".mcap", "log"), ("-o.mcap", "o")],
)  # fmt: skip
def test_names_of_logs_cannot_name_a_place(name, slug):
    assert slug_of(name) == slug


def test_odd_names_and_bytes_stay_inside_the_archive(log, tmp_path, deckflex):
    odd = os.fsencode(log.parent) + b"/..\xff\n[red].mcap"
    log.rename(Path(os.fsdecode(odd)))
    outcome = process(job_on(Path(os.fsdecode(odd)), tmp_path / "out"))
    assert outcome.state is State.DONE, outcome.reason
    entry = json.loads(entries(tmp_path / "out")[0].read_bytes())
    assert next(iter(entry["files"].values())).startswith("results/red-")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "out"]


def test_what_a_killed_worker_left_is_swept_away(tmp_path):
    store = LocalStore(str(tmp_path))
    with store.scratch() as mine:
        left = mine.with_name(f"{mine.name.rpartition('.')[0].rpartition('.')[0]}.999999999.abcdef")
        left.mkdir()
        foreign = mine.with_name("elsewhere.1.abcdef")
        foreign.mkdir()
        assert store.sweep() == 1
        assert mine.is_dir()
        assert foreign.is_dir()
        assert not left.exists()
        os.utime(foreign, (0, 0))
        assert store.sweep() == 1


def test_options_that_matter_change_the_digest_and_nothing_else_does():
    digests = {
        replace(CONFIG, **change).digest
        for change in ({}, {"estimator": "smoother"}, {"settings": ("a=1",)}, {"version": "9"}, {"outputs": ()},
                       {"rig": Text("rig.toml", "a")}, {"rig": Text("rig.toml", "b")}, {"twin": Text("idam", "")})
    }  # fmt: skip
    assert len(digests) == 8
    assert Config(**CONFIG.__dict__).digest == CONFIG.digest


def test_results_do_not_go_to_the_web(tmp_path):
    from schemas.errors import DataError

    with pytest.raises(DataError, match="can only be read"):
        open_store("http://host/out")
    (tmp_path / "file").write_text("x")
    with pytest.raises(DataError, match="is a file"):
        open_store(str(tmp_path / "file"))
