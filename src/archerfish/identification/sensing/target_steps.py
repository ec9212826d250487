"""Camera latency from a target that steps at known moments: which frame is the first to show it elsewhere."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from archerfish.identification.sensing.stamp_timing import Z95, Interval, standard_error
from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import Detections

Array = NDArray[np.float64]

LONGEST = 0.5
"""Longest latency that is tried [s]."""
EARLIEST = -0.02
"""Shortest: less than nothing shows a fault of the clocks."""
_FEWEST = 5
_MISLABELLED = 0.01
_APART = 6.0


class StepLatency(NamedTuple):
    """Latency from exposure to receipt."""

    latency: float
    """Mean time from exposure to receipt [s]."""
    interval: Interval
    """Its 95 % interval [s]."""
    steps: int
    """Target steps that were used."""


class _Labels(NamedTuple):
    """Frames around steps: shape (F,) each."""

    since: Array
    """Receipt less the moment of the step, as it were with the mean time from stamp to receipt [s]."""
    new: NDArray[np.bool_]
    """Whether the frame shows the target after the step."""


def step_latency(detections: Detections, moments: Array, frame_period: float) -> StepLatency:
    """Estimate the latency from the frames around known target steps.

    A frame shows the target after its step exactly if it was exposed after it, so each step bounds the latency from
    both sides, one frame apart; many steps at different phases narrow that down. The posterior (flat in the latency and
    in the logarithm of the exposure's jitter) is integrated on a grid.

    Args:
      detections: with the times of receipt.
      moments: of the target's steps, on the clock of receipts [s], increasing, shape (S,).
      frame_period: time from frame to frame [s].

    Raises:
      InputError: if times of receipt are missing, fewer than five steps can be used, or no latency explains the frames.
    """
    if detections.receive is None:
        raise InputError(
            f"{detections.source}: target steps tell the latency only if the time of receipt is logged; name its "
            "column with --receive (the stamp's own column, if frames are stamped on receipt)"
        )
    delay = detections.receive - detections.time
    # Stamps jitter less than receipts, so the edge is sought on them; the mean delay is put back.
    received = detections.time + delay.mean()
    labels, used = _labels(received, detections.position, moments)
    if used < _FEWEST:
        raise InputError(
            f"{detections.source}: {used} of {moments.size} target steps can be used, expected at least {_FEWEST}; "
            "step by more than six times the detection noise, a second apart, the gimbal still, and stamp the steps "
            "on the clock of receipts"
        )
    latency, low, high = _posterior(labels, frame_period)
    error = standard_error(delay)
    widened = [latency + np.copysign(np.hypot(end - latency, Z95 * error), end - latency) for end in (low, high)]
    return StepLatency(latency, (float(widened[0]), float(widened[1])), used)


def _labels(received: Array, position: Array, moments: Array) -> tuple[_Labels, int]:
    since, new, used = [], [], 0
    neighbours = np.concatenate([[-np.inf], moments, [np.inf]])
    for before, moment, after in zip(neighbours[:-2], moments, neighbours[2:], strict=True):
        # What was received up to the step shows the target before it, what came LONGEST later the target after it.
        start = max(before + LONGEST, moment - LONGEST)
        end = min(after, moment + 2 * LONGEST)
        near = (received > start) & (received < end)
        labelled = _halves(received[near] - moment, position[near])
        if labelled is not None:
            used += 1
            kept, after_step = labelled
            since.append((received[near] - moment)[kept])
            new.append(after_step[kept])
    if not used:
        return _Labels(np.zeros(0), np.zeros(0, bool)), 0
    return _Labels(np.concatenate(since), np.concatenate(new)), used


def _halves(since: Array, position: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Tell frames with the target before its step from those after it; None if the step can't be seen."""
    old, late = since < 0, since > LONGEST
    if old.sum() < 3 or late.sum() < 3:
        return None
    first, last = np.median(position[old], axis=0), np.median(position[late], axis=0)
    path = last - first
    length = float(np.linalg.norm(path))
    if length == 0:
        return None
    along = (position - first) @ path / length
    scatter = 1.4826 * max(np.median(np.abs(along[old])), np.median(np.abs(along[late] - length)))
    if length < _APART * scatter:
        return None
    kept = (along > -0.25 * length) & (along < 1.25 * length)
    return kept, along > 0.5 * length


def _posterior(labels: _Labels, frame_period: float) -> tuple[float, float, float]:
    """Return mean, 2.5 % and 97.5 % of the latency's posterior."""
    jitters = np.geomspace(2e-4, max(frame_period, 4e-4), 8)
    coarse = np.arange(EARLIEST, LONGEST, frame_period / 8)
    peak = coarse[np.argmax(_log_likelihood(labels, coarse, np.array([0.25 * frame_period]))[:, 0])]
    if not EARLIEST + frame_period < peak < LONGEST - 2 * frame_period:
        raise InputError(
            f"no latency within {EARLIEST:g}…{LONGEST:g} s explains which frames show the target steps; stamp the "
            "steps on the clock of receipts"
        )
    fine = peak + np.arange(-2.5 * frame_period, 2.5 * frame_period, frame_period / 80)
    # Frames that are far from the edge count alike everywhere.
    close = np.abs(labels.since - peak) < 8 * frame_period
    log_density = _log_likelihood(_Labels(labels.since[close], labels.new[close]), fine, jitters)
    density = np.exp(log_density - log_density.max()).sum(axis=1)
    cumulative = np.cumsum(density) / density.sum()
    low, high = np.interp([0.025, 0.975], cumulative, fine)
    return float(fine @ density / density.sum()), float(low), float(high)


def _log_likelihood(labels: _Labels, latency: Array, jitters: Array) -> Array:
    """Return the log-likelihood at each latency and jitter, shape (L, J)."""
    sign = np.where(labels.new, 1.0, -1.0)
    total = np.empty((latency.size, jitters.size))
    for index, value in enumerate(latency):
        margin = sign * (labels.since - value)
        right = ndtr(margin[:, None] / jitters)
        total[index] = np.log(_MISLABELLED / 2 + (1 - _MISLABELLED) * right).sum(axis=0)
    return total
