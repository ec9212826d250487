"""Recordings made ready for a search over delays: their spectra at any delay, on all lines or on a few."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.informative_lines import thinning
from archerfish.identification.axis.rest_start import begins_at_rest, rest_samples
from archerfish.identification.axis.spectra import Spectrum, picked, slow_drift, spectrum, unsettled, with_delay
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

DRIFT = 3
"""Highest power of time that outputs may drift with, whatever the inputs."""


class Ground(NamedTuple):
    """The recordings, ready for any delay."""

    recordings: Sequence[Recording]
    """As given."""
    scale: Array
    """What outputs are divided by, shape (p,)."""
    undelayed: Sequence[Spectrum]
    """Whole spectra without delay."""
    skips: Sequence[int]
    """Samples that are left out at the beginning, per recording."""
    from_rest: Sequence[bool]
    """Whether each recording is taken to begin at rest."""
    lines: Sequence[NDArray[np.intp]]
    """Indices of the lines to look at, per recording, shape (F,) each."""

    def spectra(self, delay: int) -> list[Spectrum]:
        """Spectra with the inputs delayed."""
        logs = zip(self.undelayed, self.recordings, self.skips, self.lines, strict=True)
        return [with_delay(picked(whole, lines), log, delay, skip) for whole, log, skip, lines in logs]

    def thinned(self, count: int) -> "Ground":
        """Only so many lines, as do for a search."""
        kept = thinning(self.spectra(0), count)
        return self._replace(lines=[lines[each] for lines, each in zip(self.lines, kept, strict=True)])

    def reaching_back(self, delay: int) -> "Ground":
        """All lines, and no more left out at the beginning than delays up to this one need."""
        skips = [min(each, delay) for each in self.skips]
        reaching = ground_of(self.recordings, self.scale, skips, self.from_rest)
        return reaching.drifting() if self.undelayed[0].drift is not None else reaching

    def freed(self, free: Sequence[bool], longest: int) -> "Ground":
        """With free initial states where `free` says so, per recording, and without what earlier inputs may have done.

        Args:
          free: per recording.
          longest: longest delay that is tried [samples].
        """
        from_rest = [rest and not each for rest, each in zip(self.from_rest, free, strict=True)]
        skips = [
            unsettled(log.inputs, longest) if each else skip
            for log, skip, each in zip(self.recordings, self.skips, free, strict=True)
        ]
        freed = ground_of(self.recordings, self.scale, skips, from_rest)
        return freed.drifting() if self.undelayed[0].drift is not None else freed

    def drifting(self) -> "Ground":
        """With a slow drift of free size in the outputs of every recording."""
        return self._replace(undelayed=[each._replace(drift=slow_drift(each, DRIFT)) for each in self.undelayed])

    def weighted(self, weights: Sequence[Array]) -> "Ground":
        """With each line multiplied by a weight, shape (F,) for all lines of each recording."""
        undelayed = [
            whole._replace(
                inputs=whole.inputs * weight[:, None],
                outputs=whole.outputs * weight[:, None],
                impulse=whole.impulse * weight,
                drift=None if whole.drift is None else whole.drift * weight[:, None],
            )
            for whole, weight in zip(self.undelayed, weights, strict=True)
        ]
        return self._replace(undelayed=undelayed)


def prepare_ground(recordings: Sequence[Recording], max_delay: int, scale: Array) -> Ground:
    """Transform recordings.

    Args:
      recordings: m inputs and p outputs each.
      max_delay: longest delay that will be asked for [samples].
      scale: outputs are divided by it, shape (p,).
    """
    skips = [0 if rest_samples(each) else unsettled(each.inputs, max_delay) for each in recordings]
    from_rest = [begins_at_rest(each) for each in recordings]
    return ground_of(recordings, scale, skips, from_rest)


def ground_of(recordings: Sequence[Recording], scale: Array, skips: Sequence[int], from_rest: Sequence[bool]) -> Ground:
    """Transform recordings of which it is known how they begin.

    Args:
      recordings: m inputs and p outputs each.
      scale: outputs are divided by it, shape (p,).
      skips: samples that are left out at the beginning, per recording.
      from_rest: whether each recording is taken to begin at rest.
    """
    undelayed = [
        spectrum(each, 0, scale, skip, from_rest=rest)
        for each, skip, rest in zip(recordings, skips, from_rest, strict=True)
    ]
    return Ground(recordings, scale, undelayed, skips, from_rest, [np.arange(each.lag.size) for each in undelayed])
