"""How well a number can be read in the paper."""

from enum import StrEnum


class Legibility(StrEnum):
    """A flag on every group of printed numbers."""

    CLEAR = "clear"
    """Read as printed."""
    DAMAGED = "damaged"
    """Printed, but not as it can have been meant; our reading stands beside it."""
    ABSENT = "absent"
    """Not printed; the value is our assumption."""
