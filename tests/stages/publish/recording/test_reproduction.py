"""The recording of an experiment read back."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from stages.publish.recording.reproduction import write_reproduction
from tests.pipeline.experiments.fake import measured


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "fake.rrd"
    write_reproduction("fake", "# figures", measured(1).panels, path)
    return path


def batches(path):
    found: dict[str, list] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    return found


def test_verify_finds_no_fault(path):
    rerun = Path(sys.executable).with_name("rerun")
    assert subprocess.run([rerun, "rrd", "verify", path], capture_output=True).returncode == 0


def test_curves_over_time_stand_at_their_times(path):
    batch = next(b for b in batches(path)["/panel_00_error_x_arcmin/published"] if "trial_time" in b.schema.names)
    times = batch.column("trial_time").cast("int64").to_numpy() * 1e-9
    values = batch.column("Scalars:scalars").flatten().to_numpy(zero_copy_only=False)
    assert times[[0, -1]].tolist() == pytest.approx([0.0, 10.0])
    assert values == pytest.approx(np.sin(times) + 1.0, abs=1e-6)


def test_charts_and_figures_are_there(path):
    assert {"/panel_01_sweep/curve_0", "/panel_01_sweep/frame", "/figures"} <= set(batches(path))


def test_an_experiment_without_curves_is_recorded_too(tmp_path):
    write_reproduction("bare", "# figures", (), tmp_path / "bare.rrd")
    assert "/figures" in batches(tmp_path / "bare.rrd")
