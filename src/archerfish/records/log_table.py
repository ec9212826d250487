"""The table that every reader of logs returns: raw columns, each row with its place in the source."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.findings import Finding

Array = NDArray[np.float64]

MAX_BYTES = 512 * 2**20
"""Largest log that is read: an hour of two axes at 1 kHz as text. Beyond it a small file may fill the memory."""

_SPELLED = {"deg": "deg", "rad": "rad", "s": "s", "sec": "s", "ms": "ms", "us": "us", "µs": "us", "ns": "ns"}
_UNIT = re.compile(r"(?:^|[_\W])\(?\[?(deg|rad|s|sec|ms|us|µs|ns)(_s|/s)?\]?\)?$", re.IGNORECASE)


class LogTable(NamedTuple):
    """Columns of a log as the source has them: not yet checked, nor brought to equal intervals."""

    columns: dict[str, Array]
    """Signal → values, each of shape (N,); NaN where a value is missing."""
    stamps: Array | None
    """Time stamps in the unit that their name tells, shape (N,); None if the log has none."""
    stamp_name: str
    """Name of the time column, which may tell its unit ("tempo_ms")."""
    places: NDArray[np.int64]
    """Line, row or message that each sample came from, counted from 1; shape (N,)."""
    place_kind: str
    """What `places` counts: "line", "row" or "message"."""
    source: str
    """The file, for messages."""
    findings: tuple[Finding, ...] = ()
    """What the reader repaired, in order of the file."""

    @property
    def samples(self) -> int:
        """Samples that the source holds, those included that the reader left out."""
        return int(self.places.size) + sum(finding.samples for finding in self.findings)

    def place(self, index: int) -> str:
        """Return the file and the place of a sample in it."""
        return f"{self.source}: {self.place_kind} {self.places[index]}"


def stated_unit(name: str) -> str:
    """Return the unit that a signal's name states at its end ("angle_deg", "time [ms]"), or "" if it states none."""
    found = _UNIT.search(name.strip())
    return _SPELLED[found[1].lower()] + ("/s" if found[2] else "") if found else ""
