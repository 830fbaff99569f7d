"""The look of every table on the terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

ANY_WIDTH = 10_000
FOLDED = 10  # characters in which names may still be read on several lines


def plain_table(first: str, *columns: str, title: str | None = None) -> Table:
    """A table of text: the first column to the left, the others to the right."""
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False, show_edge=False, padding=(0, 1))
    table.add_column(first, overflow="fold")
    for column in columns:
        table.add_column(column, justify="right", overflow="fold")
    return table


def listing_table(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    """Names and what they are."""
    table = plain_table(title, "what it is")
    table.columns[1].justify = "left"
    for row in rows:
        table.add_row(*row)
    return table


def fitted(table: Table, console: Console) -> Table:
    """The table, or where a word or figure right of the names would be cut, the same with a line for each cell."""
    unbroken = Measurement.get(console, console.options.update(max_width=ANY_WIDTH), table).minimum
    names = max((len(str(cell)) for cell in table.columns[0].cells), default=0)
    return table if unbroken - max(0, names - FOLDED) <= console.width else _upright(table)


def _upright(table: Table) -> Table:
    """One row under the other: the first cell, and below it the others beside the heads of their columns."""
    lines = Table.grid(padding=(0, 2, 0, 0))
    lines.title, lines.title_justify = table.title, "left"
    lines.add_column(overflow="fold")
    lines.add_column(overflow="fold")
    heads = [column.header for column in table.columns]
    for cells in zip(*(column.cells for column in table.columns)):
        lines.add_row(heads[0], cells[0])
        for head, cell in zip(heads[1:], cells[1:]):
            lines.add_row("  " + str(head), cell)
        lines.add_row("", "")
    return lines
