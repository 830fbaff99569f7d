"""Pictures of real recordings and pages into docs/gallery: ``python -m benchmarks.gallery [PART ...]``.

Needs what draws without a screen: a Vulkan driver (Mesa's llvmpipe serves) for the Rerun viewer, Chromium for pages.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from schemas.wire import Table, read_log, write_log

ROOT = Path(__file__).parents[1]
TARGET = ROOT / "docs" / "gallery"
WINDOW = (1600, 1000)
SHOWN_WIDTH = 1120
COLOURS, EXACT = 96, 24  # of a picture; of them the commonest, kept as they are
PATIENCE = 90.0  # s for the viewer to open a recording
SETTLE = 6.0  # s until its opening messages are gone
LENGTH = "120"  # s of the simulated trial
TRIAL = "trial.mcap"
EXPERIMENT, SEEDS = "td-ma", "2"
VOYAGES, VOYAGE = 12, 60.0  # one a month, s each
DAMAGED, BROKEN = 7, 60_000  # the voyage whose log is cut short, and its bytes that are left
FIRST = 1_767_225_600  # s, of the first voyage
ESTIMATORS = ("smoother", "filter", "td-ma", "traditional")


def main() -> None:
    """Simulate, run, draw: all parts, or those named."""
    options = argparse.ArgumentParser(prog="python -m benchmarks.gallery", description=main.__doc__)
    options.add_argument("part", nargs="*", help=f"one of {', '.join(PARTS)}; all of them where none is named")
    options.add_argument("--folder", type=Path, help="keep logs, recordings, pages here; what is there stays")
    chosen = options.parse_args()
    unknown = [name for name in chosen.part if name not in PARTS]
    if unknown:
        options.error(f"there is no part {unknown[0]}; there are {', '.join(PARTS)}")
    TARGET.mkdir(parents=True, exist_ok=True)
    with workplace(chosen.folder) as folder:
        for name in chosen.part or PARTS:
            PARTS[name](folder)
    size = sum(path.stat().st_size for path in TARGET.glob("*.png"))
    print(f"{len(list(TARGET.glob('*.png')))} pictures, {size / 1e6:.2f} MB in all")


@contextmanager
def workplace(kept: Path | None) -> Iterator[Path]:
    """The folder named, or one that is gone afterwards."""
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def draw_run(folder: Path) -> None:
    """The main job on a trial with every channel."""
    make_trial(folder)
    make(folder, ["run.rrd", "run.html"], "run", TRIAL, "--rrd", "run.rrd", "--report", "run.html")
    draw_tabs(folder / "run.rrd", "run")
    draw_page(folder / "run.html", "page-run")


def draw_bad(folder: Path) -> None:
    """The same trial spoilt."""
    make_trial(folder)
    spoil(folder / TRIAL, folder / "bad.mcap")
    make(folder, ["bad.rrd", "bad.html"], "run", "bad.mcap", "--rrd", "bad.rrd", "--report", "bad.html")
    draw_tabs(folder / "bad.rrd", "bad", ("Overview",))
    draw_page(folder / "bad.html", "page-bad")


def draw_comparison(folder: Path) -> None:
    """Several estimators on the trial."""
    make_trial(folder)
    outputs = ("--rrd", "compare.rrd", "--report", "compare.html")
    chosen = [word for name in ESTIMATORS for word in ("--estimator", name)]
    make(folder, ["compare.rrd", "compare.html"], "compare", TRIAL, *chosen, *outputs)
    draw_tabs(folder / "compare.rrd", "compare")
    draw_page(folder / "compare.html", "page-compare")


def draw_diagnosis(folder: Path) -> None:
    """The trial held against a twin that knows nothing of its time delay."""
    make_trial(folder)
    (folder / "believed.toml").write_text(changed({"time_delay = 0.004": "time_delay = 0.0"}), encoding="utf-8")
    outputs = ("--rrd", "diagnosis.rrd", "--report", "diagnosis.html")
    make(folder, ["diagnosis.rrd", "diagnosis.html"], "diagnose", TRIAL, "--twin", "believed.toml", *outputs)
    draw_tabs(folder / "diagnosis.rrd", "diagnosis")
    draw_page(folder / "diagnosis.html", "page-diagnosis")


def draw_reproduction(folder: Path) -> None:
    """A published experiment over few seeds: the page of all of them is docs/reproduction.md."""
    recording = f"reproduction/{EXPERIMENT}.rrd"
    make(folder, [recording], "reproduce", EXPERIMENT, "--seeds", SEEDS, "-o", "reproduction")
    draw_tabs(folder / recording, "reproduce")


def draw_archive(folder: Path) -> None:
    """Voyages month by month, the mount drifting and the sea changing; one log is damaged."""
    (folder / "voyages").mkdir(exist_ok=True)
    for month in range(VOYAGES):
        make_voyage(folder, month)
    make(folder, ["archive"], "batch", "voyages", "-o", "archive", "--workers", "1")
    outputs = ("--rrd", "archive.rrd", "--report", "archive.html")
    make(folder, ["archive.rrd", "archive.html"], "catalogue", "archive", *outputs)
    draw_tabs(folder / "archive.rrd", "archive")
    draw_page(folder / "archive.html", "page-archive")


PARTS: dict[str, Callable[[Path], None]] = {
    "run": draw_run,
    "bad": draw_bad,
    "compare": draw_comparison,
    "diagnosis": draw_diagnosis,
    "reproduce": draw_reproduction,
    "archive": draw_archive,
}


def make_trial(folder: Path) -> None:
    """The simulated trial that most parts are drawn from."""
    make(folder, [TRIAL], "simulate", "sample", "-o", TRIAL, "--seed", "7", "--duration", LENGTH)


def make(folder: Path, wanted: Sequence[str], *words: str) -> None:
    """Run the command as installed, unless what it writes is there; stop where it did not write it.

    It works in the folder, so that no picture shows where this machine keeps its files.
    """
    missing = [name for name in wanted if not (folder / name).exists()]
    if not missing:
        return
    command = [sys.executable, "-c", "from pipeline.cli import main; main()", *words]
    places = {**os.environ, "PYTHONPATH": str(ROOT)}
    status = subprocess.run(command, cwd=folder, env=places, stdout=subprocess.DEVNULL).returncode
    if not (folder / missing[0]).exists():
        raise SystemExit(f"deckflex {words[0]} ended with {status} and did not write {missing[0]}")


def make_voyage(folder: Path, month: int) -> None:
    """A log of the sample twin at another date: its mount turned a little further, in another sea."""
    log, twin = f"voyages/voyage-{month + 1:02d}.mcap", f"voyage-{month + 1:02d}.toml"
    if (folder / log).exists():
        return
    sea = 0.6 + 0.4 * (month % 3)
    static = [round(start + drift * month, 2) for start, drift in zip((12.0, -20.0, 30.0), (0.6, -0.9, 1.5))]
    changes = {
        "duration = 100.0": f"duration = {VOYAGE}",
        "rate = 100.0": "rate = 50.0",
        "seed = 7": f"start = {FIRST + month * 30 * 86_400}",
        "pitch_significant = 2.0": f"pitch_significant = {2.0 * sea:.2f}",
        "roll_significant = 5.0": f"roll_significant = {5.0 * sea:.2f}",
        "static_arcmin = [12.0, -20.0, 30.0]": f"static_arcmin = {static}",
        "std_arcmin = [3.0, 2.5, 4.0]": f"std_arcmin = {[round(sea * std, 2) for std in (3.0, 2.5, 4.0)]}",
    }
    (folder / twin).write_text(changed(changes), encoding="utf-8")
    make(folder, [log], "simulate", twin, "-o", log, "--seed", str(month + 1))
    if month + 1 == DAMAGED:
        (folder / log).write_bytes((folder / log).read_bytes()[:BROKEN])


def changed(changes: dict[str, str]) -> str:
    """The sample twin with some of its lines changed; each must be there."""
    text = (ROOT / "twin" / "twins" / "sample.toml").read_text("utf-8")
    for old, new in changes.items():
        if old not in text:
            raise SystemExit(f"the sample twin no longer says '{old}'")
        text = text.replace(old, new)
    return text


def spoil(source: Path, target: Path) -> None:
    """The same trial with 30 s of the sub-IMU lost, its PHINS dead after 40 s, and no truth."""
    tables = dict(read_log(source).tables)
    tables["/imu/sub"] = kept(tables["/imu/sub"], lambda t: (t < 50.0) | (t > 80.0))
    tables["/phins/sub"] = kept(tables["/phins/sub"], lambda t: t < 40.0)
    write_log(target, [table for topic, table in tables.items() if not topic.startswith("/truth")])


def kept(table: Table, wanted: Any) -> Table:
    """Only the messages whose time since the first one is wanted."""
    stamp = table.columns["header.stamp"]
    keep = np.flatnonzero(wanted((stamp - stamp[0]) * 1e-9))
    columns = {name: values[keep] for name, values in table.columns.items()}
    return replace(table, columns=columns, log_time=table.log_time[keep], publish_time=table.publish_time[keep],
                   sequence=table.sequence[keep])  # fmt: skip


def draw_tabs(recording: Path, name: str, only: tuple[str, ...] = ()) -> None:
    """Each tab of a recording as the viewer draws it."""
    with viewer(recording) as client:
        layout = client.get_blueprint(of="recording").blueprint
        root_id = str(layout["/viewport"]["ViewportBlueprint"]["root_container"])
        root = next(path for path in layout if path.startswith("/container/") and path.endswith(root_id.split("/")[-1]))
        for tab in layout[root]["ContainerBlueprint"]["contents"]:
            title = layout["/" + tab.strip("/")]["ContainerBlueprint"].get("display_name", "tab")
            if only and title not in only:
                continue
            chosen = json.loads(json.dumps(layout))
            chosen[root]["ContainerBlueprint"]["active_tab"] = tab
            client.set_blueprint(chosen, of="recording")
            save(steady(client), f"{name}-{title.lower().replace(' ', '-')}")


@contextmanager
def viewer(recording: Path) -> Iterator[Any]:
    """The Rerun viewer without a window, on loopback, the recording open and paused."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [Path(sys.executable).with_name("rerun"), "--headless", "--bind", "127.0.0.1", "--port", str(port),
               "--window-size", "x".join(map(str, WINDOW)), recording]  # fmt: skip
    with tempfile.TemporaryDirectory() as home:
        quiet = {"XDG_RUNTIME_DIR": home, "XDG_DATA_HOME": home, "XDG_CONFIG_HOME": home, "RUST_LOG": "error"}
        shown = subprocess.Popen(
            command,
            env={**os.environ, **quiet},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            client = opened(ViewerClient, f"rerun+http://127.0.0.1:{port}/proxy")
            client.set_time(None, play_state="paused")
            time.sleep(SETTLE)
            yield client
        finally:
            os.killpg(shown.pid, signal.SIGTERM)  # the viewer is a child of what was started
            shown.wait(10)


def opened(kind: Any, address: str) -> Any:
    """The viewer once it has the recording."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            client = kind.connect(address)
            state = client.get_state()
            if state.active_recording and state.views and not state.loading:
                return client
        except Exception:  # whatever it says while it starts
            pass
        time.sleep(0.3)
    raise SystemExit("the viewer did not open the recording; is there a Vulkan driver?")


def steady(client: Any) -> Image.Image:
    """A picture that no longer changes: the viewer loads as it draws."""
    last, end = "", time.monotonic() + PATIENCE
    while True:
        time.sleep(0.8)
        try:
            picture = Image.open(io.BytesIO(client.take_screenshot(max_size=WINDOW[0]))).convert("RGB")
        except TimeoutError:  # a busy machine
            continue
        now = hashlib.sha256(picture.tobytes()).hexdigest()
        if now == last or time.monotonic() > end:
            return picture.crop((0, round(0.036 * picture.height), picture.width, picture.height))
        last = now


def draw_page(page: Path, name: str) -> None:
    """The top of a page as a browser shows it."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        print("no Chromium: pages are not drawn")
        return
    with tempfile.TemporaryDirectory() as home:
        shot = Path(home) / "page.png"
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1000,1500"]
        command = [browser, *options, f"--user-data-dir={home}", f"--screenshot={shot}", page.as_uri()]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        save(Image.open(shot).convert("RGB"), name, 800)


def save(picture: Image.Image, name: str, width: int = SHOWN_WIDTH) -> None:
    """Smaller and in few colours: a page of documentation shall not weigh megabytes."""
    small = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
    target = TARGET / f"{name}.png"
    small.quantize(palette=palette(small), dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB", flush=True)


def palette(picture: Image.Image) -> Image.Image:
    """The commonest colours as they are, and of the rest some, a thin line's among them: each weighs little more."""
    colours, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    common = colours[np.argsort(counts)[-EXACT:]]
    coarse, counts = np.unique(colours & 0xF0, axis=0, return_counts=True)
    weighed = np.repeat(coarse | 0x08, np.ceil(np.sqrt(counts)).astype(int), axis=0)
    others = Image.fromarray(weighed[None]).quantize(COLOURS - EXACT, Image.Quantize.MEDIANCUT, kmeans=2)
    found = Image.new("P", (1, 1))
    found.putpalette([*common.ravel().tolist(), *(others.getpalette() or [])[: 3 * (COLOURS - EXACT)]])
    return found


if __name__ == "__main__":
    main()
