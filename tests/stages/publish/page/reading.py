"""A page taken apart as a browser would, and a browser if there is one."""

import shutil
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"meta", "br", "hr"}
LOADING = {"src", "href", "srcset", "data", "action", "poster", "background", "xlink:href"}


@dataclass
class Page(HTMLParser):
    """Elements in order, text by element, and what is not closed as it was opened."""

    elements: list = field(default_factory=list)
    texts: dict = field(default_factory=dict)
    unbalanced: list = field(default_factory=list)
    _open: list = field(default_factory=list)

    def __post_init__(self):
        super().__init__(convert_charrefs=True)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self._open or self._open.pop() != tag:
            self.unbalanced.append(tag)

    def handle_data(self, data):
        for tag in set(self._open):
            self.texts[tag] = self.texts.get(tag, "") + data

    def count(self, tag):
        return sum(1 for name, _ in self.elements if name == tag)


def read(html: str) -> Page:
    page = Page()
    page.feed(html)
    page.close()
    return page


def loads_from_elsewhere(page: Page) -> list:
    """Elements that would make a browser fetch something."""
    asked = [(tag, attrs) for tag, attrs in page.elements if LOADING & set(attrs) or tag in {"script", "link", "img"}]
    return asked + [(tag, attrs) for tag, attrs in page.elements if "url(" in str(attrs)]


def chromium() -> str | None:
    """The browser, where there is one."""
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome", "chrome"))
    return next((path for path in found if path), None)
