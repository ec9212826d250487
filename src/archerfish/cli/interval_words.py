"""How an estimate is written with its 95 % interval: with the digits that tell the ends apart."""

import math

Interval = tuple[float, float]


def with_digits(value: float, interval: Interval | None, scale: float = 1.0) -> str:
    """Write a value with as many digits as tell the ends of its interval apart; with four if it has none.

    Args:
      value: what was estimated, in SI units.
      interval: its 95 % interval, or any other range of which it is an end.
      scale: what turns it into the unit of the words.
    """
    if interval is None:
        return f"{scale * value:.4g}".replace("-", "−")
    width = max(scale * (interval[1] - interval[0]), 1e-9)
    digits = max(0, 1 - math.floor(math.log10(width))) if math.isfinite(width) else 3
    return f"{scale * value:.{digits}f}".replace("-", "−")


def ends(interval: Interval, scale: float = 1.0) -> str:
    """Write the ends of an interval, "low … high"."""
    return " … ".join(with_digits(end, interval, scale) for end in interval)


def with_margin(value: float, interval: Interval | None, scale: float = 1.0) -> str:
    """Write a value as "3.2±0.1" if its interval is about even, else as "3.2 (3.1…3.5)"."""
    shown = with_digits(value, interval, scale)
    if interval is None:
        return shown
    below, above = value - interval[0], interval[1] - value
    # A scatter that may be none has no margin below it.
    if not 0.8 * above <= below <= 1.25 * above or interval[0] == 0:
        return f"{shown} ({ends(interval, scale).replace(' ', '')})"
    return f"{shown}±{with_digits(0.5 * (below + above), interval, scale)}"
