"""What an encoder adds to an angle: an error once or twice per turn, and another zero from a sample on.

Each is a column of a log beside its input. A fit that has the column as well shows how much of the residual it
explains, and how large it is; it is then subtracted.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from archerfish.identification.axis.fit import AxisFit, CorrectedLogs
from archerfish.identification.axis.output_error import plant_of, refine, solve
from archerfish.identification.simulation import TINY, Array, free_responses, simulate
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_TURNS = (2 * np.pi, 360.0, 4096.0, 8192.0, 16384.0)  # one turn in radians, degrees and counts
_LEAST_PART, _MOST_TURNS = 0.25, 50.0  # of a turn, that a motion must span to show an error; turns of a motion
_SMALLEST_ERROR = 1e-4  # of a turn, below which it may be rounding
_LARGEST_ERROR = 0.02  # of a turn; a larger multiple of the angle's sine would replace the angle itself
_WIDE = 0.6  # of a turn, from which a motion separates errors and gain
_ALIKE_LEFT, _OTHER_GAIN = 2.5, 0.02  # ratio of what two errors leave, and of the gains beside them less one
_WORTH_BOTH = 0.7  # share of what one harmonic leaves that both may leave, to be taken
_LEFT_OF_ANGLE, _LEFT_OF_LEAPS = 0.6, 1 / 3  # shares of the residual that may remain beside those columns
_STEPS, _TOLERANCE = 15, 1e-5  # of a fit
_LEAP, _MOST_LEAPS = 2.5, 4  # over what 99 % of a residual's steps stay below; in a log
_ALIKE = 0.4  # share by which a leap of the residual may differ from the column's coefficient


class _AngleError(NamedTuple):
    """Multiples of an angle's sine and cosine."""

    turn: float  # in the output's unit
    harmonics: tuple[int, ...]  # errors per turn
    coefficients: Array  # of sine and cosine of each

    @property
    def sizes(self) -> list[float]:
        """Amplitude of each harmonic."""
        return [float(size) for size in np.linalg.norm(self.coefficients.reshape(-1, 2), axis=1)]

    def removed(self, log: Recording) -> Recording:
        """Return a log without the error."""
        error = _harmonics(log, self.turn, self.harmonics) @ self.coefficients
        return replace(log, outputs=log.outputs - error[:, None])


class _Leap(NamedTuple):
    """A leap of an output from one sample to the next."""

    at: int  # first sample after it
    size: float


def without_angle_error(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> CorrectedLogs:
    """Subtract an error once or twice per turn, as of a magnet beside the axis.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones of the same encoder.
    """
    if found.plant.D.shape != (1, 1):
        return CorrectedLogs(fitted, held_back, [])
    span = max(float(np.ptp(log.outputs)) for log in fitted)
    best, least, single = _AngleError(0.0, (), np.zeros(0)), _LEFT_OF_ANGLE, dict[int, tuple[float, float]]()
    for turn in _TURNS:
        if not _LEAST_PART * turn <= span <= _MOST_TURNS * turn:
            continue
        for harmonics in ((1,), (2,), (1, 2)) if span > _WIDE * turn else ((1,), (2,)):
            columns = [_harmonics(log, turn, harmonics) for log in fitted]
            left, coefficients, plant = _explained(found, fitted, columns)
            if len(harmonics) == 1:
                single[harmonics[0]] = left, plant.dc_gain.item()
            error = _AngleError(turn, harmonics, coefficients)
            is_better = left < (_WORTH_BOTH if len(harmonics) > 1 and best.harmonics else 1.0) * least
            if is_better and all(_SMALLEST_ERROR * turn < size < _LARGEST_ERROR * turn for size in error.sizes):
                best, least = error, left
    if not best.harmonics:
        return CorrectedLogs(fitted, held_back, [])
    words = {1: "once", 2: "twice"}
    sizes = [f"{size:.2g} {words[harmonic]}" for harmonic, size in zip(best.harmonics, best.sizes, strict=True)]
    errs = f'"{fitted[0].output_names[0]}" errs by {" and ".join(sizes)} per turn of {best.turn:.6g}'
    message = f"{errs}, as of a magnet beside the axis, or of gravity: subtracted"
    remedy = "centre the magnet, calibrate the encoder, or balance the axis"
    # Over part of a turn each of the two errors explains nearly what the other does, with another gain.
    (left, gain), (other_left, other_gain) = sorted(single.values())
    is_open = span < _WIDE * best.turn and other_left < _ALIKE_LEFT * left and abs(other_gain / gain - 1) > _OTHER_GAIN
    if is_open:
        message += f"; over {span / best.turn:.2g} of a turn another gain explains the log as well"
        remedy = f"record more than {_WIDE:g} of a turn; {remedy}"
    finding = Finding("angle-error", "warning" if is_open else "repaired", fitted[0].source, message, remedy)
    return CorrectedLogs([*map(best.removed, fitted)], [*map(best.removed, held_back)], [finding])


def without_leaps(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> CorrectedLogs:
    """Subtract leaps of an output's zero from one sample to the next, as of an index pulse.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones.
    """
    if found.plant.D.shape != (1, 1):
        return CorrectedLogs(fitted, held_back, [])
    plant, leaps = _leaps_of_all(found, fitted)
    findings = list[Finding]()
    corrected = [_subtracted(log, of_log, findings) for log, of_log in zip(fitted, leaps, strict=True)]
    others = [_subtracted(log, _leaps_of_one(plant, log), findings) for log in held_back]
    return CorrectedLogs(corrected, others, findings)


def _leaps_of_all(found: AxisFit, recordings: list[Recording]) -> tuple[PlantRecord, list[list[_Leap]]]:
    """Return the plant beside the leaps of recordings that are fitted with them, and the leaps of each."""
    leaps = [_candidates(found.plant, log) for log in recordings]
    none: list[list[_Leap]] = [[] for _ in recordings]
    for _ in range(2):  # once more without what a plant beside the others does not need
        count = sum(map(len, leaps))
        if not count:
            break
        first, columns = 0, list[Array]()
        for log, of_log in zip(recordings, leaps, strict=True):
            columns.append(np.zeros((len(log), count)))
            columns[-1][:, first : first + len(of_log)] = _steps(log, of_log)
            first += len(of_log)
        left, sizes, plant = _explained(found, recordings, columns)
        leaps = _alike(leaps, sizes)
        if sum(map(len, leaps)) == count:
            return (plant, leaps) if left < _LEFT_OF_LEAPS else (found.plant, none)
    return found.plant, none


def _leaps_of_one(plant: PlantRecord, log: Recording) -> list[_Leap]:
    """Return the leaps of a recording to which the plant was not fitted."""
    leaps = _candidates(plant, log)
    for _ in range(2):
        rows = _beside_free_response(plant, log, _steps(log, leaps))
        sizes = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0]
        left = np.sum((rows[:, -1] - rows[:, :-1] @ sizes) ** 2)
        (alike,) = _alike([leaps], sizes)
        if len(alike) == len(leaps):
            return alike if left < _LEFT_OF_LEAPS * np.sum(rows[:, -1] ** 2) else []
        leaps = alike
    return []


def _alike(leaps: list[list[_Leap]], sizes: Array) -> list[list[_Leap]]:
    """Return leaps with their fitted sizes, without those that a fit has otherwise."""
    kept, first = list[list[_Leap]](), 0
    for of_log in leaps:
        sized = zip(of_log, sizes[first : first + len(of_log)].tolist(), strict=True)
        kept.append([_Leap(leap.at, size) for leap, size in sized if abs(size - leap.size) < _ALIKE * abs(size)])
        first += len(of_log)
    return kept


def _steps(log: Recording, leaps: list[_Leap]) -> Array:
    """Return a column for each leap, one from it on, shape (N, k)."""
    return np.asarray(np.arange(len(log))[:, None] >= [leap.at for leap in leaps], dtype=float).reshape(len(log), -1)


def _subtracted(log: Recording, leaps: list[_Leap], findings: list[Finding]) -> Recording:
    """Return a log without its leaps, of which findings are added."""
    for at, size in leaps:
        message = f'"{log.output_names[0]}" leaps by {size:.3g} at {log.time[at]:.4g} s without its input: subtracted'
        remedy = "set the encoder's zero before a log begins"
        findings.append(Finding("offset-jump", "repaired", log.source, message, remedy))
    sizes = np.array([leap.size for leap in leaps])
    return replace(log, outputs=log.outputs - (_steps(log, leaps) @ sizes)[:, None]) if leaps else log


def _harmonics(log: Recording, turn: float, harmonics: tuple[int, ...]) -> Array:
    """Return sine and cosine of multiples of the angle, shape (N, 2 for each)."""
    angles = [2 * np.pi * harmonic / turn * log.outputs[:, 0] for harmonic in harmonics]
    return np.stack([function(angle) for angle in angles for function in (np.sin, np.cos)], axis=1)


def _candidates(plant: PlantRecord, log: Recording) -> list[_Leap]:
    """Return where a residual leaps most beyond its other steps."""
    steps = np.diff(_beside_free_response(plant, log, np.zeros((len(log), 0)))[:, -1])
    leaps = steps[1:-1] - (steps[:-2] + steps[2:]) / 2
    least = _LEAP * np.quantile(np.abs(leaps), 0.99)
    size = np.abs(leaps)
    alone = np.flatnonzero((size > least) & (size >= np.maximum(np.roll(size, 1), np.roll(size, -1))))
    largest = sorted(alone.tolist(), key=lambda at: -size[at])[:_MOST_LEAPS]
    return [_Leap(at + 2, float(leaps[at])) for at in largest]


def _explained(
    found: AxisFit, recordings: Sequence[Recording], columns: Sequence[Array]
) -> tuple[float, Array, PlantRecord]:
    """Return the share of the residual beside columns of each log, (N, k) of each, coefficients (k,) and the plant.

    All logs share the coefficients. Poles start from those that were found, of which some may have explained what the
    columns do.
    """
    at, data, beside = found.structure, list[Any](), list[Any]()
    for experiment, own in zip(found.experiments, columns, strict=True):
        data.append(experiment.at(at.delay, at.feedthrough))
        added = experiment.transform(experiment.lengthened(own[:, own.any(axis=0)]))
        beside.append(data[-1]._replace(own=np.concatenate([data[-1].own, added])))
    fit = refine(found.fit.sections, beside, _STEPS, _TOLERANCE)
    plant = plant_of(fit, at, found.scale, recordings[0].period_s)
    logs = zip(recordings, columns, strict=True)
    rows = np.concatenate([_beside_free_response(plant, log, own) for log, own in logs])
    coefficients = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0]
    return fit.cost / max(solve(found.fit.sections, data).cost, TINY), coefficients, plant


def _beside_free_response(plant: PlantRecord, log: Recording, columns: Array) -> Array:
    """Return columns and what the input leaves of the output, less a free response and a constant, shape (N, k + 1)."""
    free = np.hstack([free_responses(plant, len(log))[:, 0], np.ones((len(log), 1))])
    both = np.hstack([columns, log.outputs - simulate(plant, np.asarray(log.inputs))])
    return np.asarray(both - free @ np.linalg.lstsq(free, both, rcond=None)[0])
