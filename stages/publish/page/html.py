"""Markup that cannot be broken by what it shows: every string that is not markup already is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

VOID = frozenset({"meta", "br", "hr", "path", "rect", "circle", "line", "polyline"})
SPACES = "\n\t\u00a0\u202f"


class Html(str):
    """Text that is markup already."""

    __slots__ = ()


def text(value: object) -> Html:
    """Escaped, unless it is markup; a character that cannot be printed becomes a replacement mark."""
    if isinstance(value, Html):
        return value
    shown = str(value)
    if not shown.isprintable():
        shown = "".join(c if c.isprintable() or c in SPACES else "\ufffd" for c in shown)
    return Html(escape(shown, quote=True))


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """``<name attributes>children</name>``; an underscore in an attribute's name is a hyphen, None leaves it out."""
    given = {key.rstrip("_").replace("_", "-"): value for key, value in attributes.items() if value is not None}
    stated = "".join(f' {key}="{text(value)}"' for key, value in given.items())
    if name in VOID:
        return Html(f"<{name}{stated}/>")
    return Html(f"<{name}{stated}>{join(children)}</{name}>")


def join(parts: Iterable[object]) -> Html:
    """One piece of markup from many; None counts for nothing."""
    return Html("".join(text(part) for part in parts if part is not None))


def paragraph(*parts: object, class_: str | None = None) -> Html:
    """A paragraph."""
    return tag("p", *parts, class_=class_)


def bullets(lines: Iterable[object], class_: str | None = None) -> Html:
    """A list; nothing where there are no lines."""
    items = [tag("li", line) for line in lines]
    return tag("ul", *items, class_=class_) if items else Html("")


def table(
    header: Sequence[object], rows: Iterable[Sequence[object]], caption: str = "", class_: str | None = None
) -> Html:
    """A table: the first column names its row, the others hold figures."""
    head = tag("thead", tag("tr", *(tag("th", cell, scope="col") for cell in header)))
    body = [tag("tr", tag("th", row[0], scope="row"), *(tag("td", cell) for cell in row[1:])) for row in rows]
    title = tag("caption", caption) if caption else None
    return tag("div", tag("table", title, head, tag("tbody", *body), class_=class_), class_="table")


def section(title: str, *parts: object) -> Html:
    """A part of the page under a heading; nothing where all parts are empty."""
    body = join(parts)
    return tag("section", tag("h2", title), body) if body else Html("")
