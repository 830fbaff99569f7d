"""Pictures of real recordings and pages into docs/gallery: ``python -m benchmarks.gallery``.

Needs what draws without a screen: a Vulkan driver (Mesa's llvmpipe serves) for the Rerun viewer, Chromium for pages.
"""

from __future__ import annotations

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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from schemas.wire import Table, read_log, write_log

TARGET = Path(__file__).parents[1] / "docs" / "gallery"
WINDOW = (1600, 1000)
SHOWN_WIDTH = 1120
COLOURS = 96
PATIENCE = 90.0  # s for the viewer to open a recording
SETTLE = 6.0  # s until its opening messages are gone
LENGTH = "120"  # s of the simulated trial
EXPERIMENT = "sliding"
VOYAGES, VOYAGE = 5, 50.0  # s each
FIRST = 1_767_225_600  # s, of the first voyage
ESTIMATORS = ("smoother", "filter", "td-ma", "traditional")


def main() -> None:
    """Simulate, run, draw."""
    TARGET.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        draw_all(Path(folder))
    size = sum(path.stat().st_size for path in TARGET.glob("*.png"))
    print(f"{len(list(TARGET.glob('*.png')))} pictures, {size / 1e6:.2f} MB in all")


def draw_all(folder: Path) -> None:
    log, bad = folder / "trial.mcap", folder / "bad.mcap"
    deckflex("simulate", "sample", "-o", log, "--seed", "7", "--duration", LENGTH)
    spoil(log, bad)
    deckflex("run", log, "--rrd", folder / "run.rrd", "--report", folder / "run.html")
    deckflex("run", bad, "--rrd", folder / "bad.rrd", "--report", folder / "bad.html")
    chosen = [word for name in ESTIMATORS for word in ("--estimator", name)]
    deckflex("compare", log, *chosen, "--rrd", folder / "compare.rrd", "--report", folder / "compare.html")
    draw_tabs(folder / "run.rrd", "run")
    draw_tabs(folder / "bad.rrd", "bad", ("Overview",))
    draw_tabs(folder / "compare.rrd", "compare")
    for name in ("run", "bad", "compare"):
        draw_page(folder / f"{name}.html", f"page-{name}")
    draw_reproduction(folder)
    draw_archive(folder)
    if diagnosed(folder, log):
        draw_tabs(folder / "diagnosis.rrd", "diagnosis")
        draw_page(folder / "diagnosis.html", "page-diagnosis")


def deckflex(*words: object, check: bool = True) -> int:
    """The command as installed."""
    command = [sys.executable, "-c", "from pipeline.cli import main; main()", *map(str, words)]
    return subprocess.run(command, check=check, stdout=subprocess.DEVNULL).returncode


def diagnosed(folder: Path, log: Path) -> bool:
    """The log held against a twin that knows nothing of its time delay."""
    twin = folder / "believed.toml"
    twin.write_text(changed({"time_delay = 0.004": "time_delay = 0.0"}), encoding="utf-8")
    outputs = ("--rrd", folder / "diagnosis.rrd", "--report", folder / "diagnosis.html")
    return deckflex("diagnose", log, "--twin", twin, *outputs, check=False) == 0


def draw_reproduction(folder: Path) -> None:
    """A published experiment, one seed: the page of all of them is docs/reproduction.md."""
    out = folder / "reproduction"
    deckflex("reproduce", EXPERIMENT, "--seeds", "1", "-o", out, check=False)
    draw_tabs(next(out.glob("*.rrd")), "reproduce")


def draw_archive(folder: Path) -> None:
    """Voyages month by month, the mount drifting and the sea changing; one log is damaged."""
    logs, out = folder / "voyages", folder / "archive"
    logs.mkdir()
    for month in range(VOYAGES):
        deckflex("simulate", voyage(folder, month), "-o", logs / f"voyage-{month:02d}.mcap", "--seed", str(month + 1))
    whole = (logs / "voyage-03.mcap").read_bytes()
    (logs / "voyage-03.mcap").write_bytes(whole[: len(whole) // 50])
    deckflex("batch", logs, "-o", out, "--workers", "1", check=False)
    deckflex("catalogue", out, "--rrd", folder / "archive.rrd", "--report", folder / "archive.html", check=False)
    draw_tabs(folder / "archive.rrd", "archive")
    draw_page(folder / "archive.html", "page-archive")


def voyage(folder: Path, month: int) -> Path:
    """The sample twin at another date: its mount turned a little further, in another sea."""
    sea, twin = 0.6 + 0.4 * (month % 3), folder / f"voyage-{month:02d}.toml"
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
    twin.write_text(changed(changes), encoding="utf-8")
    return twin


def changed(changes: dict[str, str]) -> str:
    """The sample twin with some of its lines changed; each must be there."""
    text = (Path(__file__).parents[1] / "twin" / "twins" / "sample.toml").read_text("utf-8")
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
    small.quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
