"""Named columns of a log as its file has them, each row with its place: what the readers of all formats return."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from archerfish2.errors import InputError, file_error, one_line
from archerfish2.logs.recording import Finding, Values

MAX_BYTES = 512 * 2**20
"""Of the largest file, and the largest array unpacked: an hour of two axes at 1 kHz as text."""
_LARGEST_VALUE = 1e30  # its square is finite
_UNIT = re.compile(r"(?:(?<![^\W\d_])|(?<=[a-z])(?=[A-Z]))(?i:([muµμn]|milli|micro|nano)s(ecs?|econds?)?)[\])}\s]*$")


class LogTable(NamedTuple):
    """Columns of a log, not at equal intervals yet."""

    columns: dict[str, Values]  # by name, each of shape (N,); NaN where a value is missing
    places: Sequence[int]  # line or row of the file that each sample comes from, counted from 1; shape (N,)
    place_kind: str  # "line" or "row"
    source: str  # the file, for messages
    findings: tuple[Finding, ...] = ()  # what the reader repaired

    def place(self, index: int) -> str:
        """Return file and place of a sample."""
        return f"{self.source}: {self.place_kind} {self.places[index]}"

    def check(self) -> None:
        """Refuse a table without samples, and values that are infinite or beyond all units."""
        if not len(self.places):
            raise log_fault(self.source, "has names but no samples", "pass a log that has some", "no-data")
        for name, values in self.columns.items():
            if (beyond := np.abs(values) > _LARGEST_VALUE).any():
                problem = f'"{name}" is {values[beyond][0]:g}, expected a number within ±{_LARGEST_VALUE:g}'
                raise log_fault(self.place(int(np.argmax(beyond))), problem, "cut the log there into two", "infinite")


def log_fault(path: str | Path, problem: str, remedy: str, code: str) -> InputError:
    """Return the error of a file, in one line whatever the file puts into the message; see `file_error`."""
    return file_error(path, one_line(problem), one_line(remedy), code)


def listed(names: Iterable[str]) -> str:
    """Return names in quotation marks, for a message; of a long list its beginning."""
    return (", ".join(f'"{each}"' for each in names if each) or "none")[:300]


def time_unit(name: str) -> str:
    """Return the unit that the name of stamps ends with ("TimeUS", "time [ms]", "t_nsec"), s where with no other."""
    prefix = found[1].lower() if (found := _UNIT.search(name)) else ""
    return {"milli": "m", "micro": "u", "µ": "u", "μ": "u", "nano": "n"}.get(prefix, prefix) + "s"
