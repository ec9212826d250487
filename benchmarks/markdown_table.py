"""Tables of pages."""

from collections.abc import Sequence

Rows = Sequence[Sequence[str]]


def markdown(headings: Sequence[str], rows: Rows) -> str:
    """Write a table in Markdown, a line per row."""
    rule = f"|{'---|' * len(headings)}"
    first, *others = (f"| {' | '.join(line)} |" for line in (headings, *rows))
    return "\n".join((first, rule, *others))
