"""What a test reads from a page: its elements, closed in order, its ids, links and text."""

import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "link", "br", "img", "hr", "use", "path"}


class Outline(HTMLParser):
    """Checks that elements are closed in order, and collects ids, links and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.tags: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.open += [] if tag in VOID else [tag]
        for name, value in attributes:
            self.ids += [value or ""] if name == "id" else []
            self.targets += [value or ""] if name in {"href", "src", "xlink:href"} else []

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in {"style", "path"}:
            self.text += data


def outline(path: Path) -> Outline:
    found = Outline()
    found.feed(path.read_text())
    assert found.open == []
    found.text = re.sub(r"\s+", " ", found.text)
    return found
