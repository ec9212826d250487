"""What a command reports, once for terminal, JSON and page.

A page is one self-contained HTML file: figures inside as SVG, no script, readable in dark and on paper.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

from archerfish.errors import one_line
from archerfish.reports.style import Figure, svg_text
from archerfish.reports.table import Table, entry_texts, table_dict, tables_text
from archerfish.storage import write_bytes

Verdict = Literal["usable", "not usable", "assumed", ""]
_COLORS: dict[Verdict, str] = {"usable": "good", "not usable": "bad", "assumed": "fair", "": ""}


class PageLink(NamedTuple):
    """Another page, or a part that has none, with its verdict."""

    name: str  # of the part, or of what the page reports
    page: str = ""  # path from the folder of this page; empty where there is none
    verdict: Verdict = ""  # of the part; "assumed" of one that no log says anything of


def badge(usable: bool | None, links: Iterable[PageLink] = ()) -> tuple[str, str]:
    """Return word and colour of a verdict: green and red, amber where what is usable has assumed parts."""
    if usable is None:
        return "", ""
    if usable and any(link.verdict == "assumed" for link in links):
        return "Usable, partly assumed", _COLORS["assumed"]
    return ("Usable", _COLORS["usable"]) if usable else ("Not usable", _COLORS["not usable"])


@dataclass(frozen=True)
class Report:
    """A headline with all that supports it; `print` shows it, `to_dict` is for JSON, `write_page` for a browser."""

    title: str  # of what it is
    headline: str  # the finding, with its figures
    usable: bool | None = None  # the verdict; None where there is none to give
    reasons: tuple[str, ...] = ()  # of the verdict
    known: tuple[str, ...] = ()  # what the figures mean and rest on
    doubts: tuple[str, ...] = ()  # what may be otherwise
    next_steps: tuple[str, ...] = ()  # what to do
    tables: tuple[Table, ...] = ()  # the figures
    figures: tuple[tuple[str, Callable[[], Figure]], ...] = ()  # captions, and what draws, called for a page alone
    findings: tuple[Any, ...] = ()  # what was found in the logs, NamedTuples
    links: tuple[PageLink, ...] = ()  # to other pages, in the order of their buttons
    provenance: dict[str, Any] = field(default_factory=dict)  # seed, commit, versions, hashes: what JSON can hold

    def __str__(self) -> str:
        verdict = {None: "", True: "usable: ", False: "not usable: "}[self.usable]
        parts = ["\n".join(map(one_line, (self.title, verdict + self.headline)))]
        for name, lines in self.lists():
            parts.append("\n".join([name, *(f"  - {one_line(line)}" for line in lines)]))
        return "\n\n".join([*parts, *([tables_text(self.tables)] if self.tables else [])])

    def lists(self) -> list[tuple[str, list[str]]]:
        """Return heading and lines of each list that is not empty, in the order of the page."""
        findings = [f"{found.severity}, {found.place}: {found.message}; {found.remedy}" for found in self.findings]
        named = {
            "Why": self.reasons,
            "What to do next": self.next_steps,
            "What is known": self.known,
            "What is in doubt": self.doubts,
            "Findings in the logs": findings,
        }
        return [(name, list(lines)) for name, lines in named.items() if lines]

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the figures, of which the captions, for JSON."""
        return {
            **vars(self),
            "tables": [table_dict(table) for table in self.tables],
            "figures": [caption for caption, _ in self.figures],
            "findings": [finding._asdict() for finding in self.findings],
        }

    def write_page(self, path: str | Path) -> None:
        """Write the report as one HTML page that needs no other file.

        Raises:
          InputError: if the file can't be written.
        """
        figures = list[tuple[str, str]]()
        for place, (caption, draw) in enumerate(self.figures):
            figures.append((caption, svg_text(draw(), prefix=f"figure{place}", label=caption)))
        page = _template().render(self._facts(), figures=figures, links=self.links)
        write_bytes(Path(path), page.encode())

    def linked(self, page: Path, others: Iterable[Path]) -> Self:
        """Return the report for a page with links to those of other pages that are there, named after their folders."""
        there = (other.resolve() for other in others if other.is_file())
        start = page.parent.resolve()
        return replace(
            self,
            links=tuple(PageLink(other.parent.name, Path(os.path.relpath(other, start)).as_posix()) for other in there),
        )

    def _repr_html_(self) -> str:
        """Return the lists and tables of the page alone: what a notebook shows, in its own style."""
        template = _template()
        facts = {**self._facts(), "figures": [], "links": []}
        return "".join(template.blocks["content"](template.new_context(facts)))

    def _facts(self) -> dict[str, Any]:
        """Return what page and notebook show alike."""
        verdict = badge(self.usable, self.links)
        return {"report": self, "lists": self.lists(), "texts": entry_texts, "verdict": verdict, "colors": _COLORS}


def _template() -> Any:
    """Return the template of a page; every text is escaped."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    return environment.from_string(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))


class Reported:
    """Base of what has a report: it is printed as that report."""

    report: Any
    """A `Report`, as an attribute or a property."""

    def __repr__(self) -> str:
        return str(self.report)

    def _repr_html_(self) -> str:
        return str(self.report._repr_html_())


class Result(Reported):
    """Base of what is identified of a part of a robot: a record, and the report on it."""

    record: Any
    """A `PlantRecord`, `MuzzleRecord` or `SensingRecord`."""

    @property
    def part(self) -> str:
        """Name of the part, and of its files: the axis of a plant; other results have a fixed one."""
        return str(self.record.axis)

    def save(self, path: str | Path) -> None:
        """Write the record, and its page beside it: PART.json and PART.html into a folder, or to a path with .json.

        Raises:
          InputError: if a file can't be written.
        """
        file = Path(path) if str(path).endswith(".json") else Path(path, f"{self.part}.json")
        self.record.save(file)
        self.report.write_page(file.with_suffix(".html"))
