"""Recordings made ready for a search over delays: their spectra at any delay, on all lines or on a few."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.informative_lines import thinning
from archerfish.identification.axis.spectra import Spectrum, picked, spectrum, unsettled, with_delay
from archerfish.records.recording import Recording

Array = NDArray[np.float64]


class Ground(NamedTuple):
    """The recordings, ready for any delay."""

    recordings: Sequence[Recording]
    """As given."""
    undelayed: Sequence[Spectrum]
    """Whole spectra without delay."""
    skips: Sequence[int]
    """Samples that are left out at the beginning, per recording."""
    lines: Sequence[NDArray[np.intp]]
    """Lines to look at, per recording, shape (number of them,) each."""

    def spectra(self, delay: int) -> list[Spectrum]:
        """Spectra with the inputs delayed."""
        logs = zip(self.undelayed, self.recordings, self.skips, self.lines, strict=True)
        return [with_delay(picked(whole, lines), log, delay, skip) for whole, log, skip, lines in logs]

    def thinned(self, count: int) -> "Ground":
        """Only so many lines, as do for a search."""
        kept = thinning(self.spectra(0), count)
        return self._replace(lines=[lines[each] for lines, each in zip(self.lines, kept, strict=True)])


def prepare_ground(recordings: Sequence[Recording], max_delay: int, scale: Array) -> Ground:
    """Transform recordings.

    Args:
      recordings: m inputs and p outputs each.
      max_delay: longest delay that will be asked for [samples].
      scale: outputs are divided by it, shape (p,).
    """
    skips = [unsettled(each.inputs, max_delay) for each in recordings]
    undelayed = [spectrum(each, 0, scale, skip) for each, skip in zip(recordings, skips, strict=True)]
    return Ground(recordings, undelayed, skips, [np.arange(each.lag.size) for each in undelayed])
