"""The tables of docs/bounds.md, written from the bounds that come with the library."""

import re
from collections.abc import Sequence
from pathlib import Path

from archerfish.evaluation.bounds.published import PublishedBounds, PublishedCell, read_published
from archerfish.records import storage

PAGE = Path(__file__).parents[1] / "docs" / "bounds.md"
_MARKED = re.compile(r"(<!-- bounds (\S+) (\S+) -->\n)(.*?)(<!-- /bounds -->)", re.DOTALL)


def table(part: PublishedBounds) -> str:
    """Write the bounds of a setting under a command limit in percent, a row per cell.

    Args:
      part: with its cells.
    """
    lines = [
        f"Seed {part.seed}, {part.engagements} engagements a cell, in percent.",
        "",
        "| target, range | reach | hindsight | combined |",
        "|---|---|---|---|",
        *(
            f"| {_place(cell)} | {100 * cell.reach:.2f} | {_hindsight(cell)} | {_combined(cell)} |"
            for cell in part.cells
        ),
    ]
    return "\n".join(lines)


def rendered(page: str, published: Sequence[PublishedBounds]) -> str:
    """Return the text of a page with its tables written again.

    Args:
      page: its text.
      published: the bounds, the largest number of engagements of a setting last.
    """
    parts = {(each.setting, each.command_limit): each for each in published}

    def written(found: re.Match[str]) -> str:
        return f"{found[1]}\n{table(parts[found[2], found[3]])}\n\n{found[5]}"

    return _MARKED.sub(written, page)


def write_tables() -> None:
    """Write the tables of the page."""
    storage.write_text(PAGE, rendered(PAGE.read_text(), read_published()))


def _place(cell: PublishedCell) -> str:
    low, high = cell.range_m
    return f"{'still' if cell.target == 'static' else 'moving'}, {low:g}–{high:g} m"


def _hindsight(cell: PublishedCell) -> str:
    return _figure(cell.hindsight, cell.hindsight_error)


def _combined(cell: PublishedCell) -> str:
    return "as hindsight" if cell.combined is None else _figure(cell.combined, cell.combined_error or 0.0)


def _figure(value: float, error: float) -> str:
    return f"{100 * value:.2f}" + (f" ± {100 * error:.2f}" if error else "")
