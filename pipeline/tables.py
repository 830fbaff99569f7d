"""The look of every table on the terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.box import SIMPLE_HEAD
from rich.table import Table


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
