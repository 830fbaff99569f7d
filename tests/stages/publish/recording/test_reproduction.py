"""The recording of an experiment read back."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.reproducing import measure
from schemas.experiment import Curve, Panel
from stages.publish.recording.reproduction import published, published_rows, shown_range, write_reproduction
from tests.pipeline.experiments.fake import EXPERIMENT, measured


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "fake.rrd"
    write_reproduction("fake", "# figures", measured(1).panels, path, measure(EXPERIMENT, 2).figures)
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
    batch = next(b for b in batches(path)["/panel_00_error_x_arcmin/0_published"] if "trial_time" in b.schema.names)
    times = batch.column("trial_time").cast("int64").to_numpy() * 1e-9
    values = batch.column("Scalars:scalars").flatten().to_numpy(zero_copy_only=False)
    assert times[[0, -1]].tolist() == pytest.approx([0.0, 10.0])
    assert values == pytest.approx(np.sin(times) + 1.0, abs=1e-6)


def test_charts_and_figures_are_there(path):
    assert {"/panel_01_sweep/curve_0", "/panel_01_sweep/frame", "/figures"} <= set(batches(path))


def test_an_experiment_without_curves_is_recorded_too(tmp_path):
    write_reproduction("bare", "# figures", (), tmp_path / "bare.rrd")
    assert "/figures" in batches(tmp_path / "bare.rrd")


def test_every_figure_that_was_printed_stands_beside_the_measured_one():
    (group,) = published(measure(EXPERIMENT, 2).figures)
    rows = published_rows(group)
    assert [row.name for row in rows] == ["published x", "published z"]  # nothing was printed of y
    assert [row.value for row in rows] == pytest.approx([1.5, 4.5])
    assert [row.mark for row in rows] == [4.0, 6.0]


def test_published_bars_are_drawn_and_tabs_are_there(path):
    found = batches(path)
    names = found["/published/quantity_0/names"][0].column("Points2D:labels")[0].as_py()
    assert names == ["published x", "published z"]
    assert found["/published/quantity_0/notes"][0].column("Points2D:labels")[0].as_py() == ["1.5 (4)", "4.5 (6)"]


def test_a_few_outliers_do_not_flatten_the_curves():
    t = np.linspace(0.0, 100.0, 5000)
    calm = np.sin(t)
    spiky = calm.copy()
    spiky[1000:1003] = 500.0
    (low, high), cut = shown_range(Panel("", "", "", (Curve("truth", t, calm), Curve("a", t, spiky))))
    assert cut
    assert -4 < low < -1 < 1 < high < 4
    assert not shown_range(Panel("", "", "", (Curve("truth", t, calm), Curve("a", t, 1.2 * calm))))[1]
