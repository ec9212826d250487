"""Files with one fault each: how one is made, and what the command must say of it."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .recorded_axis import sound, table, write

Maker = Callable[[Path], list[object]]


class Fault(NamedTuple):
    """A bad log."""

    make: Maker
    """Writes it into a folder and returns the command's arguments."""
    outcome: str
    """"refused", "repaired", "warning", or "accepted" for what is only unusual."""
    code: str


FAULTS: list[Fault] = []


def fault(outcome: str, code: str = "") -> Callable[[Maker], Maker]:
    def register(make: Maker) -> Maker:
        FAULTS.append(Fault(make, outcome, code))
        return make

    return register


def csv(folder, time, u, y, **options):
    return [write(folder, table(time, u, y, **options))]


def lines(**options):
    return table(*sound(**options)).splitlines()


def joined(rows):
    return "\n".join(rows) + "\n"
