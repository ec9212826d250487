"""Delays that steps show: from a commanded step to the first logged motion, and from a target's step to its receipt.

A fitted plant trades its delay against fast poles, in whole samples. What is certain of an axis is its inertia: the
torque may jump, the angle then starts as a parabola. So an onset is fitted as a τ² + b τ³ in the time τ since.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from archerfish2.errors import InputError
from archerfish2.identification.sensing.timing import Z95, standard_error
from archerfish2.identification.statistics import Array
from archerfish2.logs.timing import Detections, GimbalLog
from archerfish2.reports.table import Estimate

LONGEST_S, EARLIEST_S = 0.5, -0.02
"""Range of latencies; one below zero shows a fault of the clocks [s]."""
FEWEST_STEPS = 5
"""Target steps that an estimate takes."""
_REST_S, _RISE, _SAMPLES = 0.15, 0.3, 5
"""The command rests this long before and after a step; share of the travel, and least samples, that show the onset."""
_MISLABELLED = 0.01  # share of frames around a step that are something else


class CommandSteps(NamedTuple):
    """Command steps of a log."""

    delays: list[float]  # from a step to the onset of motion, of each that shows one [s]
    logged: int  # steps with the command at rest before and after


def command_steps(log: GimbalLog) -> CommandSteps:
    """Find the steps of the command, and the delay of each."""
    if log.command is None:
        return CommandSteps([], 0)
    edges = log.time[[0, *np.flatnonzero(np.diff(log.command)) + 1, -1]]
    rests = np.diff(edges) >= _REST_S
    steps = np.flatnonzero(rests[:-1] & rests[1:]) + 1
    found = [_onset(log.time - edges[step], log.yaw, edges[step + 1] - edges[step]) for step in steps]
    return CommandSteps([each for each in found if each is not None], steps.size)


def _onset(since: Array, yaw: Array, length: float) -> float | None:
    """Return the time from a step to the onset of the motion [s]; None if it can't be seen."""
    rest, later = (since > -0.1) & (since <= 0), (since > min(_REST_S, 0.5 * length)) & (since < length)
    if rest.sum() < _SAMPLES or not later.any():
        return None
    start = yaw[rest].mean()
    travel = np.median(yaw[later]) - start
    if abs(travel) < 20 * max(yaw[rest].std(), 1e-9):
        return None
    risen = np.flatnonzero((since > 0) & ((yaw - start) / travel > _RISE))[:1]
    if not risen.size or since[risen[0]] > 0.35 or np.sum(since[: risen[0]] > 0) < _SAMPLES - 1:
        return None
    window = slice(np.argmax(rest), risen[0] + 1)
    time, travelled = since[window] / since[risen[0]], (yaw[window] - start) / travel
    onsets = np.linspace(-0.1, 0.9, 501)
    moved = np.maximum(time - onsets[:, None], 0.0)
    design = np.stack([np.ones_like(moved), moved**2, moved**3], axis=-1)
    normal = design.swapaxes(1, 2) @ design + 1e-12 * np.eye(3)
    fitted = design @ np.linalg.solve(normal, design.swapaxes(1, 2) @ travelled[:, None])
    misfit = np.sum((travelled - fitted[..., 0]) ** 2, axis=1)
    return float(onsets[np.argmin(misfit)] * since[risen[0]])


def step_latency(detections: Detections, moments: Array, period: float) -> tuple[Estimate, int]:
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
    if detections.receive is None:
        problem = "target steps show the latency only with the times of receipt"
        raise InputError(f"{detections.source}: {problem}; log receive_s of each detection", "no-receipts")
    delay = detections.receive - detections.time
    # Stamps jitter less than receipts, so the edge is sought on them; the mean delay is put back.
    received = detections.time + delay.mean()
    steps = [
        _labelled(received[near] - moment, detections.position[near])
        for before, moment, after in zip([-np.inf, *moments[:-1]], moments, [*moments[1:], np.inf], strict=True)
        # What was received up to the step shows the target before it, what came LONGEST_S later the target after it.
        for near in [
            (received > max(before + LONGEST_S, moment - LONGEST_S)) & (received < min(after, moment + 2 * LONGEST_S))
        ]
    ]
    used = [each for each in steps if each.size]
    if len(used) < FEWEST_STEPS:
        problem = f"{len(used)} of {moments.size} target steps can be used, expected at least {FEWEST_STEPS}"
        remedy = "step by more than six times the noise, a second apart, the gimbal still, by the clock of receipts"
        raise InputError(f"{detections.source}: {problem}; {remedy}", "few-target-steps")
    since, sign = np.concatenate(used).T
    coarse = np.arange(EARLIEST_S, LONGEST_S, period / 8)
    wrong = np.sum(sign * (since - coarse[:, None]) < 0, axis=1)
    rough = float(np.mean(coarse[wrong == wrong.min()]))
    if not EARLIEST_S + period < rough < LONGEST_S - 2 * period or wrong.min() > 0.1 * since.size:
        problem = f"no latency within {EARLIEST_S:g} to {LONGEST_S:g} s explains which frames show the target steps"
        raise InputError(f"{detections.source}: {problem}; stamp steps and receipts by one clock", "no-latency")
    latencies = rough + np.arange(-2.5, 2.5, 1 / 80) * period
    jitters = np.geomspace(2e-4, max(period, 4e-4), 8)
    close = np.abs(since - rough) < 8 * period  # other frames count alike everywhere
    margin = (sign * (since - latencies[:, None]))[:, close]
    right = _MISLABELLED / 2 + (1 - _MISLABELLED) * ndtr(margin[:, None] / jitters[:, None])
    likelihood = np.log(right).sum(axis=-1)
    density = np.exp(likelihood - likelihood.max()).sum(axis=1)
    density /= density.sum()
    latency = float(density @ latencies)
    ends = np.interp([0.025, 0.975], np.cumsum(density), latencies) - latency
    low, high = latency + np.sign(ends) * np.hypot(ends, Z95 * standard_error(delay))
    return Estimate(latency, float(low), float(high), "s"), len(used)


def _labelled(since: Array, position: Array) -> Array:
    """Return time since a step, and 1 if a frame shows the target after it, else −1, (F, 2); empty if it can't be seen.

    Args:
      since: receipts less the moment of the step [s], shape (K,).
      position: of the target [m], shape (K, 3).
    """
    old, late = since < 0, since > LONGEST_S
    if min(old.sum(), late.sum()) >= 3:
        first = np.median(position[old], axis=0)
        path = np.median(position[late], axis=0) - first
        along = (position - first) @ path / max(path @ path, 1e-300)
        scatter = 1.4826 * max(np.median(np.abs(along[old])), np.median(np.abs(along[late] - 1)))
        if 6 * scatter < 1 and path.any():
            return np.column_stack([since, np.sign(along - 0.5)])[np.abs(along - 0.5) < 0.75]
    return np.empty((0, 2))
