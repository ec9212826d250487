"""The last line of a log whose recorder died: whether it breaks off, and where."""

import csv
from collections.abc import Sequence

from archerfish.records.text_rows import TextTable, cut_fields, is_number

_COMPARED = 1000
"""Numbers before the last one that its digits are compared with."""


def torn_end(table: TextTable, wanted: Sequence[int]) -> str | None:
    """Return where the last line breaks off, in words; None where it is whole.

    A line with too few fields breaks off. So does one without a line break at its end whose last field is wanted and
    is no number, or has fewer digits than any number above it in its column: "1.2" was 1.234 where all others have
    three decimals. A field that a separator ends is whole.

    Args:
      table: the lines.
      wanted: positions of the columns that are read.
    """
    if len(table.lines) - table.first < 2:
        return None
    last = table.lines[-1]
    fields = _fields(last, table.delimiter)
    if fields is None:
        return None if table.finished else "inside a quotation mark"
    if len(fields) < table.fewest:
        return f"after {len(fields)} of {table.fewest} fields"
    if table.finished or len(fields) - 1 not in wanted:
        return None
    text = fields[-1].strip()
    if not is_number(text, table.delimiter):
        return "in its last field" if text else "before its last field"
    above = (_fields(line, table.delimiter) or [""] for line in table.lines[table.first : -1][-_COMPARED:])
    if _is_cut(text, [each[-1].strip() for each in above if is_number(each[-1].strip(), table.delimiter)]):
        return f'inside its last number: "{text}" has fewer digits than any above it'
    return None


def _fields(line: str, delimiter: str | None) -> list[str] | None:
    try:
        return cut_fields(line, delimiter)
    except csv.Error:
        return None


def _is_cut(text: str, above: Sequence[str]) -> bool:
    if not above:
        return False
    decimals, exponent = _digits(text)
    known = [_digits(each) for each in above]
    all_decimals, all_exponents = {each for each, _ in known}, {each for _, each in known}
    if decimals < max(all_decimals) and decimals not in all_decimals:
        return True
    # Exponents are written with two digits, by most writers: "1e-0" was 1e-05.
    usual = max(2 if exponent else 0, *all_exponents)
    return exponent < usual and exponent not in all_exponents


def _digits(number: str) -> tuple[int, int]:
    """Return the count of decimals, -1 without a decimal point, and that of the exponent's digits."""
    mantissa, _, exponent = number.lower().partition("e")
    point = max(mantissa.rfind("."), mantissa.rfind(","))
    return (len(mantissa) - point - 1 if point >= 0 else -1), len(exponent.lstrip("+-"))
