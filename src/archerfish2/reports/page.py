"""The self-contained HTML page of a report: figures inside as SVG, no script, readable in dark and on paper."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from archerfish2.reports.style import svg_text
from archerfish2.reports.table import entry_texts

if TYPE_CHECKING:
    from archerfish2.reports.report import Report


def page_html(report: "Report") -> str:
    """Fill the template; every text is escaped."""
    drawn = enumerate(report.figures)
    figures = [(caption, svg_text(draw(), prefix=f"figure{place}", label=caption)) for place, (caption, draw) in drawn]
    return str(_template().render(report=report, lists=report.lists(), figures=figures, texts=entry_texts))


def content_html(report: "Report") -> str:
    """Return the lists and tables of the page alone: what a notebook shows, in its own style."""
    template = _template()
    facts = {"report": report, "lists": report.lists(), "figures": [], "texts": entry_texts}
    return "".join(template.blocks["content"](template.new_context(facts)))


def _template() -> Any:
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    return environment.from_string(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
