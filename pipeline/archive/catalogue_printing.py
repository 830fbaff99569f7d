"""What ``deckflex catalogue`` prints, and the page and recording it writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import polars as pl
from rich.table import Table

from pipeline.archive.batch_printing import one_line
from pipeline.files import staged, writing
from pipeline.publishing import now, recording, save_page
from pipeline.tables import plain_table
from stages.publish.archive import ArchiveReport, Listing

WORDS = frozenset({"axis", "effect", "standing", "parameters", "why", "reason"})  # columns to the left
MOST_ROWS = 50  # of a table on the terminal


def catalogue_parts(report: ArchiveReport, written: Mapping[str, str], path: str) -> list[object]:
    """The answer in words, the tables, what to distrust."""
    parts: list[object] = [f"{report.title}: {report.about}", report.headline, *report.sentences]
    for listing in report.listings:
        parts += ["", listing_table(listing)]
    parts += ["", *(f"warning     {warning}" for warning in report.warnings)]
    parts += [f"wrote       {kind}: {file}" for kind, file in written.items()]
    return [one_line(part) if isinstance(part, str) else part for part in [*parts, f"data set    {path}"]]


def listing_table(listing: Listing) -> Table:
    """A table; of a long one the rest is counted."""
    table = plain_table(*listing.header, title=listing.title)
    for column, name in zip(table.columns, listing.header):
        column.justify = "left" if name in WORDS else column.justify
    for row in listing.rows[:MOST_ROWS]:
        table.add_row(*(one_line(str(cell)) for cell in row))
    if len(listing.rows) > MOST_ROWS:
        table.add_row(f"and {len(listing.rows) - MOST_ROWS} more", *[""] * (len(listing.header) - 1))
    return table


def frame_table(frame: pl.DataFrame) -> Table:
    """The answer to a query."""
    rows = [[_cell(value) for value in row] for row in frame.head(MOST_ROWS).rows()]
    table = plain_table(*frame.columns) if frame.columns else plain_table("nothing")
    for row in rows:
        table.add_row(*row)
    if len(frame) > MOST_ROWS:
        table.add_row(f"and {len(frame) - MOST_ROWS} more", *[""] * (frame.width - 1))
    return table


def _cell(value: object) -> str:
    if value is None:
        return "–"
    return one_line(f"{value:.6g}" if isinstance(value, float) else str(value))


def write_report(report: ArchiveReport, outputs: Mapping[str, Path]) -> dict[str, str]:
    """Write ``recording`` and ``report``, as far as they are wanted; both whole, or none. Raises DataError."""
    with staged(list(outputs.values())) as temporary:
        for (kind, target), path in zip(outputs.items(), temporary):
            with writing(target, path):
                _write(kind, report, path)
    return {kind: str(path) for kind, path in outputs.items()}


def _write(kind: str, report: ArchiveReport, path: Path) -> None:
    if kind == "report":
        from stages.publish.page.archive import archive_page

        save_page(archive_page(report, now()), path)
        return
    with recording(path):
        from stages.publish.recording.archive import write_archive

        write_archive(report, path)
