"""Times that stamps and steps show: the frame period, the latency of detections, and the delay of commands.

A fitted plant trades its delay against fast poles, in whole samples. What is certain of an axis is its inertia: the
torque may jump, the angle then starts as a parabola. So an onset is fitted as a τ² + b τ³ in the time τ since.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from archerfish.errors import file_error
from archerfish.identification import statistics
from archerfish.identification.statistics import Array, converted, difference, mean_estimate
from archerfish.logs.timing import DetectionLog, GimbalLog
from archerfish.reports.table import Estimate

OUT_OF_VIEW_S = 0.25
"""Longer gaps are the plate out of view, not frames in which it was missed [s]."""
LATEST_S, EARLIEST_S = 0.5, -0.02
"""Range of latencies; one below zero shows a fault of the clocks [s]."""
_REST_S, _BEFORE_S, _RISE, _SAMPLES = 0.15, 0.1, 0.2, 5
"""The command rests this long before and after a step; time before it that shows the noise; share of the travel, and
least samples, that show the onset."""
_SEPARATION = 6  # travel of a target in standard deviations of its position
_MISLABELLED = 0.01  # share of frames around a step that are something else


def frame_timing(stamps: Array, source: str = "detections", period: float | None = None) -> tuple[Estimate, Estimate]:
    """Estimate the frame period [s] and the share of frames without a detection.

    Stamps may jitter by up to a quarter of a period. Of the frames, those count that are not out of view.

    Args:
      stamps: increasing [s], shape (K,).
      source: name of the log, for messages.
      period: about that of the frames [s], where intervals don't show it.

    Raises:
      InputError: if there are fewer than 20 stamps, or hardly two close to each other.
    """
    intervals = np.diff(stamps)
    counted = intervals < OUT_OF_VIEW_S
    if stamps.size < 20 or counted.sum() < 10:
        problem = f"has {stamps.size} detections, {counted.sum()} of them within {OUT_OF_VIEW_S} s of the one before"
        raise file_error(source, problem, "record longer, the plate in view", "too-short")
    # Where many frames are missed the median may already be two periods; a quartile is one up to 75 % of misses.
    period = period or float(np.median(intervals[intervals < 1.5 * np.quantile(intervals[counted], 0.25)]))
    steps, grid = np.empty(intervals.size), float(stamps[0])
    for index, stamp in enumerate(stamps[1:].tolist()):  # along the frames' grid, so that jitter counts once, not twice
        # Zero is allowed: a stamp that jumped ahead a whole period is followed by one that has no period of its own.
        steps[index] = count = max(round((stamp - grid) / period), 0)
        error = stamp - (grid + count * period)
        grid += count * period + 0.1 * error
        period += 0.002 * error / max(count, 1)
    seen = int(counted.sum()) + 1
    frames = max(int(steps[counted].sum()) + 1, seen)
    return _period(stamps, steps), statistics.share_estimate(frames - seen, frames)


def _period(stamps: Array, steps: Array) -> Estimate:
    """Estimate the period by how the errors of intervals follow each other.

    Jitter about an even grid makes a long interval follow a short one; the grid is then known far better than by the
    mean interval, whose standard error holds for a timer that each frame restarts.
    """
    index = np.concatenate([[0.0], np.cumsum(steps)])
    mean = float(stamps[-1] - stamps[0]) / index[-1]
    errors = np.diff(stamps) - steps * mean
    if errors[1:] @ errors[:-1] > -0.25 * (errors @ errors):
        return statistics.normal_estimate(mean, statistics.standard_error(errors) * errors.size / index[-1])
    slope, start = np.polyfit(index, stamps, 1)
    score = (index - index.mean()) * (stamps - start - slope * index)
    # Estimated from a line's residuals, the long-run variance comes out some percent low, and uncertain; stamps of a
    # grid are hardly ever known better than independent jitter lets them be.
    spread = max(statistics.long_run_covariance(score[:, None]).item(), float(np.mean(score**2)))
    return statistics.normal_estimate(slope, np.sqrt(spread * index.size) / np.sum((index - index.mean()) ** 2))


def receipts(detections: DetectionLog) -> Array:
    """Return when detections were received [s], NaN where it was not logged, (K,)."""
    return np.asarray(np.full(detections.time.size, np.nan) if detections.receive is None else detections.receive)


def latency_jitter(delay: Array, stamp_jitter: Estimate) -> Estimate:
    """Return the standard deviation of the latency, from the times between stamp and receipt [s], shape (K,)."""
    scatter = statistics.scatter_estimate(delay)
    if scatter.value < 1e-6:  # frames that are stamped on receipt carry the latency's jitter in their stamps
        return stamp_jitter
    rest = difference(converted(scatter, np.square), converted(stamp_jitter, np.square))
    return converted(rest, lambda variance: float(np.sqrt(max(variance, 0.0))))


def command_delays(logs: Sequence[GimbalLog]) -> tuple[Array, int]:
    """Find the steps of the command, at rest before and after each, and the delay to the onset of the motion.

    Returns:
      Delays of the steps that show one [s], shape (S,), and the number of all.
    """
    found, steps = list[float](), 0
    for log in logs:
        changes = np.flatnonzero(np.diff(log.yaw * 0 if log.command is None else log.command)) + 1
        edges = log.time[[0, *changes, -1]]
        rests = np.diff(edges) >= _REST_S
        for step in np.flatnonzero(rests[:-1] & rests[1:]) + 1:
            near = (log.time > edges[step] - _BEFORE_S) & (log.time < edges[step + 1])
            onset = _onset(log.time[near] - edges[step], log.yaw[near])
            found += [] if onset is None else [onset]
            steps += 1
    delays = np.array(found)
    if delays.size:  # less those during which something else moved the axis
        deviation = np.abs(delays - np.median(delays))
        delays = delays[deviation <= 7.4 * np.median(deviation) + 1e-3]
    return delays, steps


def _onset(since: Array, yaw: Array) -> float | None:
    """Return the time from a step to the onset of the motion [s]; None if it can't be seen."""
    rest, settled = since <= 0, since >= 0.5 * since[-1]
    moved = yaw - yaw[rest].mean()
    travel, noise = float(np.median(moved[settled])) or 1e-9, max(moved[rest].std(), 1e-9)
    travelled = moved / travel
    count = int(np.argmax((since > 0) & (travelled > _RISE))) + 1
    if abs(travel) < 20 * noise or min(rest.sum(), count - rest.sum()) < _SAMPLES:
        return None
    time, travelled = since[:count] / since[count - 1], travelled[:count]

    def misfit(onset: float) -> float:
        moving = np.maximum(time - onset, 0.0)
        design = np.column_stack([np.ones(count), moving**2, moving**3])
        weights = np.linalg.lstsq(design, travelled)[0]
        backwards = weights[1] < 0  # an early onset followed by motion to the other side fits about as well
        return np.inf if backwards else float(np.sum((travelled - design @ weights) ** 2))

    misfits = {onset: misfit(onset) for onset in np.linspace(-0.1, 0.9, 201).tolist()}
    best = min(misfits, key=misfits.__getitem__)
    return best * float(since[count - 1]) if np.isfinite(misfits[best]) else None


def sweep_latency(delay: Array, offset: Estimate, source: str) -> Estimate:
    """Return the mean latency less the feedback's delay, if one clock stamped receipts and gimbal log.

    Args:
      delay: times between stamps and receipts [s], shape (K,).
      offset: what is added to a stamp to get its exposure on the gimbal log's clock [s].
      source: name of the log, for messages.

    Raises:
      InputError: if detections are received too early or too late.
    """
    latency = difference(mean_estimate(delay), offset)
    if not EARLIEST_S <= latency.value <= LATEST_S:
        problem = f"received {latency.value:.3g} s after exposure, expected {EARLIEST_S:g} to {LATEST_S:g} s"
        remedy = 'stamp receipts and gimbal log by one clock, or write gimbal_clock = "own" to [sensing] in logs.toml'
        raise file_error(source, problem, remedy, "two-clocks")
    return latency


def step_latency(detections: DetectionLog, moments: Array, period: float) -> tuple[Estimate, int]:
    """Estimate the latency from exposure to receipt, as a probit model of which frames show a target after its step.

    A frame shows it exactly if it was exposed after the step, so each step bounds the latency from both sides, a frame
    apart; many steps at different phases narrow that down. The posterior (flat in the latency and in the logarithm of
    the exposures' jitter) is integrated on a grid.

    Args:
      detections: with the times of receipt.
      moments: of the target's steps, on the clock of receipts [s], increasing, shape (S,).
      period: time from frame to frame [s].

    Returns:
      The mean latency [s], and how many steps were used.

    Raises:
      InputError: if times of receipt are missing, fewer than five steps can be used, or no latency explains the frames.
    """
    receive = receipts(detections)
    logged = ~np.isnan(receive)
    time, position, receive = detections.time[logged], detections.position[logged], receive[logged]
    if not time.size:
        raise file_error(detections.source, "target steps take receive_s of each detection", "log it", "no-receipts")
    # Stamps jitter less than receipts, so the edge is sought on them; the mean delay after the first is added below.
    since_first, moments = time - time[0], moments - receive[0]
    delay = mean_estimate(receive - receive[0] - since_first)
    steps, edges = [], [-np.inf, *moments, np.inf]
    for before, moment, after in zip(edges[:-2], moments, edges[2:], strict=True):
        # What was received up to the step shows the target before it, what came LATEST_S later the target after it.
        near = since_first > max(before + LATEST_S, moment - LATEST_S)
        near &= since_first < min(after, moment + 2 * LATEST_S)
        steps.append(_labelled(since_first[near] - moment, position[near]))
    used = sum(frames.size > 0 for frames in steps)
    if used < 5:
        problem = f"{used} of {moments.size} target steps can be used, expected at least 5"
        remedy = "step by more than six times the noise, a second apart, the gimbal still, by the clock of receipts"
        raise file_error(detections.source, problem, remedy, "few-target-steps")
    since, sign = np.concatenate(steps).T
    coarse = np.arange(EARLIEST_S, LATEST_S, period / 8)
    wrong = np.sum(sign * (since - coarse[:, None]) < 0, axis=1)
    rough = float(np.mean(coarse[wrong == wrong.min()]))
    if not EARLIEST_S + period < rough < LATEST_S - 2 * period:
        problem = f"no latency within {EARLIEST_S:g} to {LATEST_S:g} s explains which frames show the target steps"
        raise file_error(detections.source, problem, "stamp steps and receipts by one clock", "no-latency")
    latencies = rough + np.arange(-2.5, 2.5, 1 / 80) * period
    jitters = np.geomspace(2e-4, max(period, 4e-4), 8)[:, None]
    close = np.abs(since - rough) < 8 * period  # other frames count alike everywhere
    right = ndtr((sign * (since - latencies[:, None]))[:, None, close] / jitters)
    likelihood = np.log(_MISLABELLED / 2 + (1 - _MISLABELLED) * right).sum(axis=-1)
    density = np.exp(likelihood - likelihood.max()).sum(axis=1)
    cumulative = np.cumsum(density) / density.sum()
    low, high = np.interp([0.025, 0.975], cumulative, latencies)
    edge = Estimate(float(density @ latencies / density.sum()), float(low), float(high), "s")
    return difference(edge, converted(delay, lambda value: -value)), used


def _labelled(since: Array, position: Array) -> Array:
    """Return time since a step, and 1 if a frame shows the target after it, else −1, (F, 2); empty if it can't be seen.

    Args:
      since: receipts less the moment of the step [s], shape (K,).
      position: of the target [m], shape (K, 3).
    """
    old, late = since < 0, since > LATEST_S
    if min(old.sum(), late.sum()) < 3:
        return np.empty((0, 2))
    first = np.median(position[old], axis=0)
    path = np.median(position[late], axis=0) - first
    along = (position - first) @ path / max(float(path @ path), 1e-300)
    deviation = max(np.median(np.abs(along[old])), np.median(np.abs(along[late] - 1)))
    shown = (np.abs(along - 0.5) < 0.75) & (_SEPARATION * 1.4826 * deviation < 1)
    return np.asarray(np.column_stack([since, np.sign(along - 0.5)])[shown])
