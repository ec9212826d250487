"""Bounds of a robot's values: part of their types, so that they stand where a field is declared."""

import math
from typing import Annotated, NamedTuple


class Bounds(NamedTuple):
    """Where a value may lie."""

    low: float = -math.inf
    """Smallest value."""
    high: float = math.inf
    """Largest value."""
    open_low: bool = False
    """Whether the smallest value itself is out."""


AboveZero = Annotated[float, Bounds(0.0, open_low=True)]
NotNegative = Annotated[float, Bounds(0.0)]
Finite = Annotated[float, Bounds()]
Probability = Annotated[float, Bounds(0.0, 1.0)]
AngleDeg = Annotated[float, Bounds(-360.0, 360.0)]
"""[°]."""
Tilt = Annotated[float, Bounds(-45.0, 45.0)]
"""[°]."""
Aside = Annotated[float, Bounds(-10.0, 10.0)]
"""[°]."""
Spread = Annotated[float, Bounds(0.0, 10.0)]
"""[°]."""
Opening = Annotated[float, Bounds(1.0, 179.0)]
"""[°]."""
OffsetM = Annotated[float, Bounds(-1.0, 1.0)]
"""[m]."""
Frequency = Annotated[float, Bounds(1.0, 1000.0)]
"""[Hz], no faster than the firmware."""
Ratio = Annotated[float, Bounds(0.5, 2.0)]
Ticks = Annotated[int, Bounds(0.0, 20.0)]


def broken_bound(bounds: Bounds, value: float) -> str:
    """Return what a value must be if it breaks its bounds, else nothing."""
    if not math.isfinite(value):
        return "a finite number"
    if bounds.low <= value <= bounds.high and not (bounds.open_low and value == bounds.low):
        return ""
    if math.isfinite(bounds.high):
        return f"within {bounds.low:g}…{bounds.high:g}"
    return f"> {bounds.low:g}" if bounds.open_low else f"≥ {bounds.low:g}"
