"""Faults of a camera's stamps: a clock that was set, frames that were dropped, coarse stamps, detections written again.

The time from stamp to receipt shows where stamps or the latency change, and by how much. Which of the two it was shows
the sweep: a stamp that jumps moves the plate's bearing against the yaw, a latency does not.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from archerfish.errors import InputError
from archerfish.identification.sensing.alignment import GRID_STEP_S, GimbalTrack, quantum_of, rough_offset
from archerfish.identification.sensing.timing import OUT_OF_VIEW_S
from archerfish.identification.statistics import Array
from archerfish.logs.timing import DetectionLog

_WINDOW = 40  # detections on each side of a change, so that a stall of half as many is none
_CLEAR = 2.7  # scatters between their medians at a change: 5 standard errors at a correlation of 0.7 between frames
_LEAST_S = 0.002  # change of the delay, its slow scatter, and step of the stamps, that matter
_MOST = 20  # changes that are looked for
_OF_PERIOD = 0.15  # of a period, within which a change is one of whole frames
_WRITTEN_AGAIN = 0.05  # share of repeated positions that rounding does not explain
_COHERENCE = 4.0  # of coarse stamps at a frequency, in that of stamps without one: 1 in 5,000 recordings reaches it
_WHOLE, _ON_STEPS = 0.1, 0.95  # how far from a whole number of steps, and share of intervals that are as near
_TEXTS = {
    "dropped": "Stamps fall behind the receipts by {}: frames were dropped there and stamps counted on. Each part was "
    "aligned for itself; stamp exposures.",
    "set": "The clock of the stamps was set, and they jump: from stamp to exposure it is {}. Each part was aligned for "
    "itself; stamp by a clock that is not set.",
    "latency": "The latency is {}: it changes in blocks, which its interval spans, not from frame to frame; record "
    "under the usual load.",
}


class DelayChanges(NamedTuple):
    """Where the time from stamp to receipt becomes longer or shorter, and stays so; in K places."""

    starts: Array  # stamp of the first detection after each, increasing [s], (K,)
    sizes: Array  # by which the time grows [s], (K,)
    kinds: Any  # "dropped" or "set" of the stamps, or "latency", (K,)

    def grown(self, stamps: Array, latency: bool = False) -> Array:
        """Return how much stamps of shape (N,) are late since the first change, or how much the latency grew [s]."""
        sizes = self.sizes * ((self.kinds == "latency") == latency)
        return np.asarray(sizes @ (stamps >= self.starts[:, None]))

    def sentences(self, offset: float, latency: float) -> list[str]:
        """Return a sentence for each kind, by the time from stamp to exposure and the latency before changes [s]."""
        moments, found = self.starts + self.grown(self.starts) + offset, list[str]()
        for kind, level in (("dropped", 0.0), ("set", offset), ("latency", latency)):
            among = self.kinds == kind
            later = zip(moments[among], level + np.cumsum(self.sizes[among]), strict=True)
            levels = [f"{1e3 * level:.1f} ms", *(f"from {at:.1f} s on {1e3 * now:.1f} ms" for at, now in later)]
            found += [_TEXTS[kind].format(", ".join(levels).replace("-", "−"))] * bool(among.any())
        return found


def delay_changes(stamps: Array, delay: Array) -> DelayChanges:
    """Find changes of the time from stamp to receipt, as ones of the latency.

    The medians of 40 detections before and after a place are compared. The largest difference is taken out, until none
    is left. A clock that drifts is no change, and is fitted along with the sizes.

    Args:
      stamps: of detections with a receipt [s], shape (N,).
      delay: from stamp to receipt [s], shape (N,).
    """
    left, rows = delay.copy(), set[int]()
    for _ in range(_MOST if delay.size >= 2 * _WINDOW else 0):
        medians = np.median(sliding_window_view(left, _WINDOW), axis=1)
        noise = 1.4826 * np.median(np.abs(left[_WINDOW // 2 :][: medians.size] - medians))
        steps = medians[_WINDOW:] - medians[:-_WINDOW]
        place = int(np.argmax(np.abs(steps)))
        if abs(steps[place]) < max(_CLEAR * noise, _LEAST_S):
            break
        near = left[place : place + 2 * _WINDOW]
        later = np.abs(near - medians[place]) - np.abs(near - medians[place + _WINDOW])
        rows.add(row := place + 1 + int(np.argmin(np.cumsum(later))))
        left[row:] -= steps[place]
    starts, index = np.array(sorted(rows), dtype=int), np.arange(delay.size)
    columns = np.column_stack([np.ones(delay.size), index, index[:, None] >= starts])
    sizes = np.linalg.lstsq(columns, delay)[0][2:]
    return DelayChanges(stamps[starts], np.asarray(sizes), np.full(starts.size, "latency"))


def attributed(
    changes: DelayChanges, track: GimbalTrack, stamps: Array, azimuth: Array, period: float, limit_s: float | None
) -> DelayChanges:
    """Find by the plate's bearing which changes are of the stamps.

    Where stamps fall behind by whole periods frames were dropped, and the size is made that of the periods.

    Args:
      changes: of the time from stamp to receipt.
      track: the gimbal.
      stamps: of the detections [s], shape (N,).
      azimuth: of the plate in the camera's frame [rad], shape (N,).
      period: of the frames [s].
      limit_s: see `rough_offset`.
    """
    fine = np.linspace(-GRID_STEP_S, GRID_STEP_S, 21)[:, None]

    def misfit(kinds: Any) -> float:
        moments = stamps + changes._replace(kinds=kinds).grown(stamps)
        try:
            moments = moments + fine + rough_offset(track, moments, azimuth, limit_s)
        except InputError:
            return np.inf
        left = azimuth + track.angles(np.clip(moments, *track.stamps[[0, -1]]))[..., 0]
        return float(np.min(np.mean(np.abs(left - np.median(left, axis=1, keepdims=True)), axis=1)))

    best = changes.kinds
    for place in (slice(None), *range(best.size)) if best.size else ():  # all of them, then single ones
        other = best.copy()
        other[place] = np.where(other[place] == "latency", "set", "latency")
        best = min(best, other, key=misfit)
    whole = np.maximum(np.round(changes.sizes / period), 1) * period
    dropped = (best == "set") & (np.abs(changes.sizes - whole) < _OF_PERIOD * period)
    kinds, sizes = np.where(dropped, "dropped", best), np.where(dropped, whole, changes.sizes)
    return changes._replace(kinds=kinds, sizes=sizes)


def slow_changes(delay: Array, known: bool) -> tuple[Array, Array]:
    """Return how a latency differs from its mean for long, and how from frame to frame [s], (N,) each.

    The first is zero in a normal jitter, of which it scatters less than the second, the drift of clocks left out.

    Args:
      delay: from stamp to receipt [s], shape (N,).
      known: that the latency changes for long.
    """
    index, level = np.arange(delay.size), median_filter(delay, _WINDOW + 1, mode="nearest")
    slow = level - np.polyval(np.polyfit(index, level, 1), index)
    clear = known or slow.std() > max((delay - level).std(), _LEAST_S)
    return (level - delay.mean(), delay - level) if clear else (0 * delay, delay)


def coarse_stamps(stamps: Array) -> tuple[float, float] | None:
    """Return the step of which all stamps are multiples, and the period of the frames [s]; None where they are fine.

    Frames at even times, stamped in steps, keep their frequency in the stamps. Stamps in steps mirror each frequency
    about half of the steps' own; that of the frames is not below the rate of detections.

    Args:
      stamps: increasing [s], shape (N,).
    """
    intervals = np.diff(stamps)
    step = quantum_of(stamps) or quantum_of(np.append(0.0, intervals.round(6)))
    if step is None or step < _LEAST_S or np.mean(_from_whole(intervals / step) < _WHOLE) < _ON_STEPS:
        return None
    lowest = max(0.97 / float(np.mean(intervals[intervals < OUT_OF_VIEW_S])), 0.25 / step)
    frequencies = np.arange(lowest, 0.95 / step, 0.5 / np.ptp(stamps))
    found = [abs(np.exp(2j * np.pi * frequency * stamps).mean()) for frequency in frequencies]
    if max(found, default=0.0) < _COHERENCE / np.sqrt(stamps.size):
        return None
    period = 1 / float(frequencies[np.argmax(found)])
    return (step, period) if _from_whole(period / step) > _WHOLE else None  # at whole steps, their size is no fault


def _from_whole(ratio: Any) -> Any:
    return np.abs(ratio - np.round(ratio))


def written_once(detections: DetectionLog) -> tuple[DetectionLog, int]:
    """Leave out detections that repeat the position before them, and return how many.

    A program that writes the newest detection at a rate of its own repeats it until the next frame.
    """
    fresh = np.append(True, np.any(np.diff(detections.position, axis=0) != 0, axis=1))
    if np.mean(~fresh) < _WRITTEN_AGAIN:
        return detections, 0
    receive = None if detections.receive is None else detections.receive[fresh]
    return DetectionLog(detections.time[fresh], detections.position[fresh], receive, detections.source), sum(~fresh)
