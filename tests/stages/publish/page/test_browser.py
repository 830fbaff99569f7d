"""Pages in a real browser, where there is one: nothing to complain about, everything drawn, printable."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from stages.publish.page.archive import archive_page
from stages.publish.page.comparison import comparison_page
from stages.publish.page.diagnosis import diagnosis_page
from stages.publish.page.run import run_page
from tests.stages import synthetic_result as synthetic
from tests.stages.publish import diagnosed
from tests.stages.publish.page.reading import chromium
from tests.stages.publish.voyages import archive_report

BROWSER = chromium()
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
PROBE = """<script>
window.addEventListener("load", () => {
  const svgs = [...document.querySelectorAll("figure > svg")];
  const bad = svgs.filter(s => s.getBoundingClientRect().width < 100 || s.getBoundingClientRect().height < 30);
  const wide = [...document.querySelectorAll("main *")].filter(
    e => !e.closest("svg") && e.getBoundingClientRect().right > document.documentElement.clientWidth + 1);
  const cut = svgs.flatMap(s => [...s.querySelectorAll(":scope > text")].filter(t =>
    t.getBoundingClientRect().left < s.getBoundingClientRect().left - 2 ||
    t.getBoundingClientRect().right > s.getBoundingClientRect().right + 2));
  console.log(`PROBE figures=${svgs.length} undrawn=${bad.length} wide=${wide.length} cut=${cut.length}`);
});
</script>"""


@pytest.fixture(scope="module")
def pages():
    case = synthetic.case(duration=60.0, rate=20.0, gap=(30.0, 36.0))
    return {
        "run": run_page(case.result, case.trial),
        "compare": comparison_page([case.result, case.result], case.trial),
        "diagnose": diagnosis_page(diagnosed.diagnosis(), {"log": "a"}),
        "batch": archive_page(archive_report()),
    }


def browse(tmp_path, html, *options):
    """What the browser said while it showed a page."""
    page = tmp_path / "page.html"
    page.write_text(html, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
               "--enable-logging=stderr", "--window-size=1000,1400", *options, page.as_uri()]  # fmt: skip
    told = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return "\n".join(line for line in told.stderr.splitlines() if "CONSOLE" in line)


@pytest.mark.parametrize("kind", ["run", "compare", "diagnose", "batch"])
def test_browser_finds_nothing_wrong_and_draws_every_figure(pages, tmp_path, kind):
    assert browse(tmp_path, pages[kind], "--dump-dom") == ""
    guard = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
    probed = guard.sub("", pages[kind]).replace("</body>", PROBE + "</body>")
    told = browse(tmp_path, probed, "--dump-dom")
    figures, undrawn, wide, cut = (int(n) for n in re.search(
        r"PROBE figures=(\d+) undrawn=(\d+) wide=(\d+) cut=(\d+)", told).groups())  # fmt: skip
    assert figures == pages[kind].count("<figure>")
    assert (undrawn, wide, cut) == (0, 0, 0)


def test_the_guard_stops_what_slips_in(pages, tmp_path):
    """A script put into the page by force does not run."""
    told = browse(tmp_path, pages["run"].replace("</body>", PROBE + "</body>"), "--dump-dom")
    assert "PROBE" not in told
    assert "Content Security Policy" in told


@pytest.mark.parametrize("kind", ["run", "compare", "diagnose", "batch"])
def test_page_prints_to_pdf_with_its_text(pages, tmp_path, kind):
    pdf = tmp_path / "page.pdf"
    browse(tmp_path, pages[kind], "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
    assert pdf.read_bytes().startswith(b"%PDF")
    assert pdf.stat().st_size > 20_000
    if shutil.which("pdftotext"):
        words = subprocess.run(["pdftotext", "-layout", pdf, "-"], capture_output=True, text=True).stdout
        assert "What to distrust" in words
        assert "[arcmin]" in words
