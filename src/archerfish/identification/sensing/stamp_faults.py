"""Faults of a camera's stamps: a clock that was set or slewed, dropped frames, coarse stamps, detections written again.

The time from stamp to receipt shows where stamps or the latency change, and by how much. Which of the two it was shows
the sweep: a stamp that jumps moves the plate's bearing against the yaw, a latency does not.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter, uniform_filter1d

from archerfish.errors import InputError
from archerfish.identification.sensing.alignment import GRID_STEP_S, GimbalTrack, quantum_of, rough_offset
from archerfish.identification.sensing.timing import OUT_OF_VIEW_S
from archerfish.identification.statistics import Array
from archerfish.logs.timing import DetectionLog

_WINDOW = 40  # detections on each side of a change, so that a stall of half as many is none
_NEAR, _SHARP = 10, 0.6  # detections on each side, between which a jump has such a share of its size, a slew less
_CLEAR = 2.7  # scatters between their medians at a change: 5 standard errors at a correlation of 0.7 between frames
_LEAST_S = 0.002  # change of the delay, its slow scatter, and step of the stamps, that matter
_MOST = 20  # changes that are looked for
_OF_PERIOD = 0.15  # of a period, within which a change is one of whole frames
_BETTER = 0.97  # of the bearing's misfit, below which a more complicated explanation is taken
_LONGER = 0.5  # periods by which an interval between receipts is longer where a frame was dropped
_UNCLEAR = 0.2  # periods by which half of the frames come earlier or later, so that single ones show no drop
_WRITTEN_AGAIN = 0.05  # share of repeated positions that rounding does not explain
_COHERENCE = 4.0  # of coarse stamps at a frequency, in that of stamps without one: 1 in 5,000 recordings reaches it
_ALIKE = 0.9  # of the largest coherence, from which a frequency may be the frames' as well
_WHOLE, _ON_STEPS = 0.1, 0.95  # how far from a whole number of steps, and share of intervals that are as near
_ENOUGH = 500  # detections whose bearings are compared
_LISTED = 6  # levels that are listed in a sentence
_TEXTS = {
    "dropped": "Stamps fall behind the receipts by {}: frames were dropped there and stamps counted on. Each part was "
    "aligned for itself; stamp exposures.",
    "set": "The clock of the stamps was set, and they jump: from stamp to exposure it is {}. Each part was aligned for "
    "itself; stamp by a clock that is not set.",
    "latency": "The latency is {}: it changes in blocks, which its interval spans, not from frame to frame; record "
    "under the usual load.",
    "slewed": "The clock of the stamps drifts, or was slewed: from stamp to exposure it is {}, which its interval "
    "spans. Stamps were corrected by the receipts; stamp by the clock of the receipts.",
}


class DelayChanges(NamedTuple):
    """How the time from stamp to receipt changes along N detections: it jumps in K places, and stamps are slewed."""

    rows: Any  # first detection after each jump, increasing, (K,)
    sizes: Array  # by which the time grows there [s], (K,)
    kinds: Any  # "dropped" or "set" of the stamps, or "latency", (K,)
    slew: Array  # by which slewed stamps are late, less its mean [s], (N,)

    def late(self) -> Array:
        """Return by how much the stamps are late, since the first jump [s], (N,)."""
        return _grown(self.rows, self.sizes * (self.kinds != "latency"), self.slew.size) + self.slew

    def sentences(self, stamps: Array, offset: float, latency: float) -> list[str]:
        """Return a sentence for each kind.

        Args:
          stamps: of the detections, corrected [s], (N,).
          offset: from stamp to exposure before the jumps [s].
          latency: mean of all detections [s].
        """
        found = list[str]()
        latency -= float(_grown(self.rows, self.sizes * (self.kinds == "latency"), max(stamps.size, 1)).mean())
        for kind, level in (("dropped", 0.0), ("set", offset), ("latency", latency)):
            among = self.kinds == kind
            if among.any():
                moments, levels = stamps[self.rows[among]] + offset, level + np.cumsum(self.sizes[among])
                later = [f"from {at:.1f} s on {1e3 * now:.1f} ms" for at, now in zip(moments, levels, strict=True)]
                if len(later) > _LISTED:
                    later[2:-1] = [f"… in {len(later)} steps"]
                found.append(_TEXTS[kind].format(", ".join([f"{1e3 * level:.1f} ms", *later])))
        if self.slew.any():
            ends = 1e3 * (offset + self.slew.min()), 1e3 * (offset + self.slew.max())
            found.append(_TEXTS["slewed"].format("{:.1f} to {:.1f} ms".format(*ends)))
        return [sentence.replace("-", "−") for sentence in found]


def _grown(rows: Any, sizes: Array, count: int) -> Array:
    return np.asarray(sizes @ (np.arange(count) >= np.asarray(rows, dtype=int)[:, None]))


def delay_changes(stamps: Array, received: Array, period: float) -> DelayChanges:
    """Find jumps of the time from stamp to receipt, as ones of the latency or of frames that were dropped.

    A clock that drifts or is slewed does not jump; a drift is fitted along with the sizes.

    Args:
      stamps: of detections with a receipt [s], shape (N,).
      received: their receipts, increasing [s], shape (N,).
      period: of the frames [s].
    """
    delay, index = received - stamps, np.arange(stamps.size)
    gaps = np.append(0.0, np.diff(received) / period)
    dropped = _dropped_frames(delay / period, gaps)
    left = delay - _grown([*dropped], period * np.array([*dropped.values()]), delay.size)
    rows = np.array(sorted({*dropped, *_jumps(left)}), dtype=int)
    columns = np.column_stack([np.ones(delay.size), index, index[:, None] >= rows])
    sizes: Any = np.linalg.lstsq(columns, delay)[0][2:]
    frames = np.zeros(rows.size)
    for place, row in enumerate(rows):  # a jitter may hide which interval is the long one
        longest = gaps[max(row - _NEAR // 2, 0) : row + _NEAR // 2].max()
        frames[place] = dropped.get(int(row)) or _whole_frames(sizes[place] / period, longest)
    sizes = np.where(frames > 0, frames * period, sizes)
    return DelayChanges(rows, sizes, np.where(frames > 0, "dropped", "latency"), 0 * delay)


def _dropped_frames(delay: Array, gaps: Array) -> dict[int, int]:
    """Return where frames pass between receipts, and not between stamps: first detection after it → their number.

    Args:
      delay: from stamp to receipt, in periods, shape (N,).
      gaps: from the receipt before each to its own, in periods, shape (N,).
    """
    found, steps = dict[int, int](), np.diff(delay, prepend=delay[:1])
    scatter = float(np.median(np.abs(steps))) if steps.size else 0.0
    longer = np.flatnonzero((steps > _LONGER) & (gaps > 1 + _LONGER)).tolist() if scatter < _UNCLEAR else []
    for previous, row, following in zip([0, *longer], longer, [*longer[1:], delay.size], strict=False):
        before, after = delay[max(row - _WINDOW, previous) : row], delay[row : min(row + _WINDOW, following)]
        error = 2 * scatter / np.sqrt(min(before.size, after.size))
        if frames := _whole_frames(float(np.median(after) - np.median(before)), gaps[row], _OF_PERIOD + error):
            found[row] = frames
    return found


def _whole_frames(growth: float, gap: float, tolerance: float = _OF_PERIOD) -> int:
    """Return how many frames were dropped, by the growth of the delay and the gap between receipts, in periods."""
    frames = round(growth)
    return frames if 0 < frames < gap - _LONGER and abs(growth - frames) < tolerance else 0


def _jumps(delay: Array) -> list[int]:
    """Return the first detection after each jump of the time from stamp to receipt, shape (N,), increasing.

    The medians of 40 detections before and after a place are compared. The largest difference is taken out, until none
    is left. Where the time grows slowly it is left as it is.
    """
    left, rows = delay.copy(), list[int]()
    considered = np.ones(max(delay.size - 2 * _WINDOW + 1, 0))
    while considered.any() and len(rows) < _MOST:
        medians = np.median(sliding_window_view(left, _WINDOW), axis=1)
        noise = 1.4826 * np.median(np.abs(left[_WINDOW // 2 :][: medians.size] - medians))
        steps = considered * (medians[_WINDOW:] - medians[:-_WINDOW])
        place = int(np.argmax(np.abs(steps)))
        if abs(steps[place]) < max(_CLEAR * noise, _LEAST_S):
            break
        near = left[place : place + 2 * _WINDOW]
        later = np.abs(near - medians[place]) - np.abs(near - medians[place + _WINDOW])
        row = place + 1 + int(np.argmin(np.cumsum(later)))
        growth = np.median(left[row : row + _NEAR]) - np.median(left[max(row - _NEAR, 0) : row])
        if abs(growth) > _SHARP * abs(steps[place]):
            rows.append(row)
            left[row:] -= steps[place]
        else:
            considered[max(place - _WINDOW, 0) : place + _WINDOW] = 0
    return sorted({*rows})


def attributed(
    changes: DelayChanges, track: GimbalTrack, stamps: Array, azimuth: Array, delay: Array, limit_s: float | None
) -> DelayChanges:
    """Find by the plate's bearing which changes are of the stamps, and whether these were slewed.

    Args:
      changes: of the time from stamp to receipt.
      track: the gimbal.
      stamps: of the detections [s], shape (N,).
      azimuth: of the plate in the camera's frame [rad], shape (N,).
      delay: from stamp to receipt [s], shape (N,).
      limit_s: see `rough_offset`.
    """
    fine = np.linspace(-GRID_STEP_S, GRID_STEP_S, 21)[:, None]
    thin = slice(None, None, max(stamps.size // _ENOUGH, 1))

    def misfit(tried: DelayChanges) -> float:
        moments = (stamps + tried.late())[thin]
        try:
            moments = moments + fine + rough_offset(track, moments, azimuth[thin], limit_s)
        except InputError:
            return np.inf
        left = azimuth[thin] + track.angles(np.clip(moments, *track.stamps[[0, -1]]))[..., 0]
        return float(np.min(np.mean(np.abs(left - np.median(left, axis=1, keepdims=True)), axis=1)))

    level = median_filter(delay - _grown(changes.rows, changes.sizes, delay.size), _WINDOW + 1, mode="nearest")
    level -= level.mean()
    line: Any = np.polyval(np.polyfit(np.arange(delay.size), level, 1), np.arange(delay.size))
    of_stamps = np.where(changes.kinds == "dropped", "dropped", "set")
    kinds, least = changes.kinds, np.inf
    for group in [of_stamps == "", of_stamps == "dropped", of_stamps == "set", *np.eye(kinds.size, dtype=bool)[:_MOST]]:
        other = np.where(group, np.where(kinds == "latency", of_stamps, "latency"), kinds)
        # At the slow beginning of a sweep, the bearing hardly shows what a gap between receipts does.
        enough = _BETTER if np.any(group & (kinds == "dropped")) else 1.0
        if kinds.size and (left := misfit(changes._replace(kinds=other, slew=level))) < enough * least:
            kinds, least = other, left
    least, best = np.inf, changes
    # The smoothed level has less noise, and rounds the ends of a slew.
    for slew in (0 * line, line, level, uniform_filter1d(level, 2 * _WINDOW + 1, mode="nearest")):
        tried = changes._replace(kinds=kinds, slew=slew)
        if (left := misfit(tried)) < _BETTER * least:
            least, best = left, tried
    return best


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


def coarse_stamps(stamps: Array, step: float | None = None) -> tuple[float, float] | None:
    """Return the step of which all stamps are multiples, and the period of the frames [s]; None where they are fine.

    Frames at even times, stamped in steps, keep their frequency in the stamps. Stamps in steps mirror each frequency
    about half of the steps' own; that of the frames is the lowest that is not below the rate of detections.

    Args:
      stamps: increasing [s], shape (N,).
      step: of the stamps [s], where it is known.
    """
    intervals = np.diff(stamps)
    if step is None:
        step = quantum_of(stamps) or quantum_of(np.append(0.0, intervals.round(6)))
        if step is None or np.mean(_from_whole(intervals / step) < _WHOLE) < _ON_STEPS:
            return None
    if step < _LEAST_S:
        return None
    lowest = 0.97 / float(np.mean(intervals[intervals < OUT_OF_VIEW_S]))
    frequencies = np.arange(lowest, 0.95 / step, 0.5 / np.ptp(stamps))
    coherence = np.array([abs(np.exp(2j * np.pi * frequency * stamps).mean()) for frequency in frequencies])
    if coherence.max(initial=0.0) < _COHERENCE / np.sqrt(stamps.size):
        return None
    first = int(np.argmax(coherence > _ALIKE * coherence.max()))
    period = 1 / float(frequencies[first + np.argmax(coherence[first : first + 3])])
    return (step, period) if _from_whole(period / step) > _WHOLE else None  # at whole steps, their size is no fault


def _from_whole(ratio: Any) -> Any:
    return np.abs(ratio - np.round(ratio))


def written_once(detections: DetectionLog) -> tuple[DetectionLog, int, float | None]:
    """Leave out detections that repeat the position before them; return how many, and at what interval they come [s].

    A program that writes the newest detection at a rate of its own repeats it until the next frame.
    """
    fresh = np.append(True, np.any(np.diff(detections.position, axis=0) != 0, axis=1))
    if np.mean(~fresh) < _WRITTEN_AGAIN:
        return detections, 0, None
    receive = None if detections.receive is None else detections.receive[fresh]
    once = DetectionLog(detections.time[fresh], detections.position[fresh], receive, detections.source)
    return once, int(np.sum(~fresh)), float(np.median(np.diff(detections.time)))
