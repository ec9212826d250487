"""Self-contained HTML pages from the templates beside this module: no script, no file but the page itself."""

import math
from typing import Any

import jinja2

MISSING = "–"
"""Stands in a table where there is no figure."""


def render_page(template: str, **content: Any) -> str:
    """Fill a template of the folder `templates`; texts are escaped; a template says itself what is markup.

    Args:
      template: file name of the template.
      content: its variables.

    Raises:
      jinja2.UndefinedError: if the template uses a variable that is not given.
    """
    return _environment().get_template(template).render(**content)


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("archerfish.figures"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "percent": percent,
        "points": points,
        "number": number,
        "count": count,
        "duration": duration,
        "bins": bins,
    }
    return environment


def percent(rate: float | None, digits: int = 1) -> str:
    """Write a rate (0 to 1) in percent, without the sign; NaN, as None, is no rate."""
    return MISSING if rate is None or math.isnan(rate) else f"{100 * rate:.{digits}f}"


def points(difference: float | None) -> str:
    """Write a difference of rates in percentage points, with its sign."""
    return MISSING if difference is None else f"{_unsigned_zero(100 * difference, 1):+.1f}".replace("-", "−")


def number(value: float | None, digits: int = 3) -> str:
    """Write a number to so many significant digits, without an exponent unless it is very small; counts as they are."""
    if value is None:
        return MISSING
    if value == 0 or isinstance(value, int):
        return f"{value:.0f}".replace("-", "−")
    exponent = math.floor(math.log10(abs(value)))
    text = f"{value:.{digits}g}" if exponent < -4 else f"{value:.{max(0, digits - 1 - exponent)}f}"
    return text.replace("-", "−")


def count(value: int) -> str:
    """Write a whole number with thin spaces between the thousands."""
    return f"{value:,}".replace(",", "\u2009")


def duration(seconds: float) -> str:
    """Write a duration in seconds, above a minute in minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"


def bins(range_m: tuple[float, float]) -> str:
    """Write a range of distances."""
    return f"{range_m[0]:g}–{range_m[1]:g}"


def _unsigned_zero(value: float, digits: int) -> float:
    return round(value, digits) + 0.0
