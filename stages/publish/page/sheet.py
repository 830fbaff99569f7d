"""The whole page: head, verdict, sections, where it comes from. One file; nothing is loaded from anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from stages.publish.page.html import Html, bullets, join, paragraph, section, table, tag
from stages.publish.page.style import STYLE

GUARD = "default-src 'none'; style-src 'unsafe-inline'"  # not even a log that slips something in loads anything


@dataclass(frozen=True)
class Sheet:
    """kind: what sort of page, above the title. about: a line below it. provenance: names and values at the end.

    made: when the page was made, as text; empty leaves it out.
    """

    kind: str
    title: str
    about: str
    body: Iterable[Html]
    provenance: Mapping[str, str] = field(default_factory=dict)
    made: str = ""


def render(sheet: Sheet) -> str:
    """The HTML document."""
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=GUARD),
        tag("title", f"{sheet.title} – {sheet.kind}"),
        tag("style", Html(STYLE)),
    )
    top = tag(
        "header",
        paragraph(f"deckflex · {sheet.kind}", class_="kind"),
        tag("h1", sheet.title),
        paragraph(sheet.about, class_="about"),
    )
    body = tag("body", top, tag("main", *sheet.body, _provenance(sheet.provenance)), _foot(sheet))
    return "<!DOCTYPE html>\n" + tag("html", head, body, lang="en") + "\n"


def verdict_box(grade: str, headline: str, sentences: Iterable[str], reasons: Iterable[str] = ()) -> Html:
    """The answer, first thing on the page. grade: good, care or bad."""
    lines = [paragraph(sentence) for sentence in sentences if sentence]
    return tag("div", paragraph(headline, class_="grade"), *lines, bullets(reasons), class_=f"verdict {grade}")


def _provenance(stated: Mapping[str, str]) -> Html:
    rows = [[name, tag("span", value, class_="mono")] for name, value in stated.items() if value != ""]
    return section("Where this comes from", table(["", ""], rows, class_="words")) if rows else join([])


def _foot(sheet: Sheet) -> Html:
    made = f"Made {sheet.made}. " if sheet.made else ""
    return tag("footer", paragraph(f"{made}Angles in arcminutes (′) about the axes of the main IMU: x to starboard "
                                   "(pitch), y to the bow (roll), z up (heading). ± is one sigma."))  # fmt: skip
