"""The last line of a log whose recorder died: whether it breaks off, and where."""

import csv
from collections.abc import Sequence
from typing import NamedTuple

from archerfish.records.text_rows import TextTable, cut_fields, is_number

_PRECISE = 15
"""Significant digits after which a further one changes a number of 64 bits by little more than its rounding."""


class _Number(NamedTuple):
    """How a number is written."""

    whole: str  # digits before the decimal point
    decimals: str | None  # those after it; None without one
    exponent: int  # digits of the exponent, 0 without one

    @property
    def places(self) -> int:
        return -1 if self.decimals is None else len(self.decimals)

    @property
    def significant(self) -> int:
        return len((self.whole + (self.decimals or "")).lstrip("0"))


def torn_end(table: TextTable, wanted: Sequence[int]) -> str | None:
    """Return where the last line breaks off, in words; None where it is whole.

    A line with too few fields breaks off. One without a line break at its end does if its last field is wanted and is
    no number, or can be the beginning of a longer one: "1.2" was 1.234 where others have three decimals, and "16" was
    1650 where others lie between 1000 and 1637. What the numbers above it do not show to be whole counts as torn. A
    field that a separator, a blank or a quotation mark ends is whole.

    Args:
      table: the lines.
      wanted: positions of the columns that are read.
    """
    above = table.lines[table.first : -1]
    if len(table.lines) <= table.first or (table.finished and not above):
        return None
    last = table.lines[-1]
    fields = _fields(last, table.delimiter)
    if fields is None:
        return None if table.finished else "inside a quotation mark"
    if len(fields) < table.fewest:
        return f"after {len(fields)} of {table.fewest} fields"
    at = len(fields) - 1
    if table.finished or at not in wanted:
        return None
    text = fields[-1].strip()
    if not is_number(text, table.delimiter):
        return "in its last field" if text else "before its last field"
    if last[-1].isspace() or last[-1] == '"':
        return None
    rows = ((_fields(line, table.delimiter) or [])[at : at + 1] for line in above)
    if _is_whole(text, [row[0].strip() for row in rows if row and is_number(row[0].strip(), table.delimiter)]):
        return None
    return f'inside its last number, or lacks only its line break: "{text}" can be the beginning of a longer number'


def _fields(line: str, delimiter: str | None) -> list[str] | None:
    try:
        return cut_fields(line, delimiter)
    except csv.Error:
        return None


def _is_whole(text: str, above: Sequence[str]) -> bool:
    """Return whether numbers above one show that it has all its digits."""
    last, known = _number(text), [number for each in above if (number := _number(each)) is not None]
    if last is None or not known:
        return last is None  # "nan" is no number with more digits to come
    exponents = [each.exponent for each in known]
    if last.exponent:
        # Two digits, by most writers: "1e-0" was 1e-05.
        return last.exponent >= max(2, *exponents)
    scientific = len(last.whole) == 1 and last.whole != "0"
    if all(exponents) or (any(exponents) and scientific):
        return False  # "1.234" was 1.234e-05
    if last.places > 0 and last.significant >= _PRECISE and not scientific:
        return True
    places = max(each.places for each in known)
    if places < 0:
        return last.places < 0 and _is_whole_integer(last.whole, [each.whole for each in known])
    significant = max(each.significant for each in known)
    if any(each.significant == significant and each.places < places for each in known):
        return last.significant >= significant  # rounded to significant digits
    return last.places >= places and _are_rounded([each.decimals or "" for each in known if each.places == places])


def _is_whole_integer(last: str, above: Sequence[str]) -> bool:
    """Return whether a further digit would take an integer far beyond all above it."""
    if any(len(each) > 1 and each.startswith("0") for each in above):
        return {len(each) for each in above} == {len(last)}  # padded with zeros
    return last == "0" or 10 * int(last) > 2 * max(int(each) for each in above) > 0


def _are_rounded(decimals: Sequence[str]) -> bool:
    """Return whether a writer cuts decimals to one length.

    One that writes what a binary number needs and no more writes 0.0, 0.5 and then 0.625: it ends short numbers with
    a five, and with a zero that of 0.0 alone.
    """
    return bool({each[-1:] for each in decimals} - {"", "5", "0" if len(decimals[0]) == 1 else ""})


def _number(text: str) -> _Number | None:
    """Return how a number is written; None for "nan" and "inf"."""
    mantissa, _, exponent = text.lower().lstrip("+-").replace(",", ".").partition("e")
    whole, point, decimals = mantissa.partition(".")
    if not (whole + decimals).isdecimal():
        return None
    return _Number(whole, decimals if point else None, len(exponent.lstrip("+-")))
