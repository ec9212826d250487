"""What an encoder adds to an angle: an error once or twice per turn, and another zero from a sample on.

Each is a column of a log beside its input. A fit that has the column as well shows how much of the residual it
explains, and how large it is; it is then subtracted.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from archerfish.identification.axis.fit import AxisFit
from archerfish.identification.axis.output_error import plant_of, refine, solve
from archerfish.identification.simulation import TINY, Array, free_responses, simulate
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_TURNS = (2 * np.pi, 360.0, 4096.0, 8192.0, 16384.0)  # one turn in radians, degrees and counts
_LEAST_PART, _MOST_TURNS = 0.25, 50.0  # of a turn, that a motion must span to show an error; turns of a motion
_SMALLEST_ERROR = 1e-4  # of a turn, below which it may be rounding
_LARGEST_ERROR = 0.02  # of a turn; a larger multiple of the angle's sine would replace the angle itself
_LEFT_OF_ANGLE, _LEFT_OF_LEAPS = 0.6, 1 / 3  # shares of the residual that may remain beside those columns
_STEPS, _TOLERANCE = 15, 1e-5  # of a fit
_LEAP, _MOST_LEAPS = 2.5, 4  # over what 99 % of a residual's steps stay below; in a log
_ALIKE = 0.4  # share by which a leap of the residual may differ from the column's coefficient


Logs = tuple[list[Recording], list[Recording], list[Finding]]
"""Recordings that are fitted and those that are held back, corrected, and what was found in them."""


def without_angle_error(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> Logs:
    """Subtract an error once or twice per turn, as of a magnet beside the axis.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones of the same encoder.
    """
    span = max(float(np.ptp(log.outputs)) for log in fitted)
    best: tuple[float, float, int, Array] = (_LEFT_OF_ANGLE, 0.0, 0, np.zeros(2))
    turns = [turn for turn in _TURNS if _LEAST_PART * turn <= span <= _MOST_TURNS * turn]
    for turn, harmonic in product(turns if found.plant.D.shape == (1, 1) else (), (1, 2)):
        left, coefficients = _explained(found, fitted, [_harmonic(log, turn, harmonic) for log in fitted])
        if left < best[0] and _SMALLEST_ERROR * turn < np.linalg.norm(coefficients) < _LARGEST_ERROR * turn:
            best = left, turn, harmonic, coefficients
    _, turn, harmonic, coefficients = best
    if not harmonic:
        return fitted, held_back, []

    def corrected(log: Recording) -> Recording:
        return replace(log, outputs=log.outputs - (_harmonic(log, turn, harmonic) @ coefficients)[:, None])

    size = f"{np.linalg.norm(coefficients):.2g} {'once' if harmonic == 1 else 'twice'} per turn of {turn:.6g}"
    message = f'"{fitted[0].output_names[0]}" errs by {size}, as if the magnet were beside the axis: subtracted'
    finding = Finding("angle-error", "repaired", fitted[0].source, message, "centre it, or calibrate the encoder")
    return [*map(corrected, fitted)], [*map(corrected, held_back)], [finding]


def without_leaps(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> Logs:
    """Subtract leaps of an output's zero from one sample to the next, as of an index pulse.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones, which stay as they are.
    """
    leaps = [(place, *leap) for place, log in enumerate(fitted) for leap in _leaps(found.plant, log)]
    left, columns = 1.0, list[Array]()
    sizes: Array = np.zeros(0)
    for _ in range(2):  # once more without what a plant beside the others does not need
        if found.plant.D.shape != (1, 1) or not leaps:
            return fitted, held_back, []
        columns = [np.zeros((len(log), len(leaps))) for log in fitted]
        for column, (place, at, _) in enumerate(leaps):
            columns[place][at:, column] = 1
        left, sizes = _explained(found, fitted, columns)
        leaps = [leap for leap, size in zip(leaps, sizes, strict=True) if abs(size - leap[2]) < _ALIKE * abs(size)]
        if len(leaps) == len(sizes):
            break
    if left > _LEFT_OF_LEAPS or len(leaps) < len(sizes):
        return fitted, held_back, []
    findings = list[Finding]()
    for size, (place, at, _) in zip(sizes, leaps, strict=True):
        log, remedy = fitted[place], "set the encoder's zero before a log begins"
        leap = f"leaps by {size:.3g} at {log.time[at]:.4g} s without its input: subtracted"
        findings.append(Finding("offset-jump", "repaired", log.source, f'"{log.output_names[0]}" {leap}', remedy))
    logs = zip(fitted, columns, strict=True)
    return [replace(log, outputs=log.outputs - (own @ sizes)[:, None]) for log, own in logs], held_back, findings


def _harmonic(log: Recording, turn: float, harmonic: int) -> Array:
    """Return sine and cosine of a multiple of the angle, shape (N, 2)."""
    angle = 2 * np.pi * harmonic / turn * log.outputs[:, 0]
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def _leaps(plant: PlantRecord, log: Recording) -> list[tuple[int, float]]:
    """Return where a residual leaps most beyond its other steps, and by how much."""
    steps = np.diff(_beside_free_response(plant, log, np.zeros((len(log), 0)))[:, -1])
    leaps = steps[1:-1] - (steps[:-2] + steps[2:]) / 2
    least = _LEAP * np.quantile(np.abs(leaps), 0.99)
    size = np.abs(leaps)
    alone = np.flatnonzero((size > least) & (size >= np.maximum(np.roll(size, 1), np.roll(size, -1))))
    largest = sorted(alone.tolist(), key=lambda at: -size[at])[:_MOST_LEAPS]
    return [(at + 2, float(leaps[at])) for at in largest]


def _explained(found: AxisFit, recordings: Sequence[Recording], columns: Sequence[Array]) -> tuple[float, Array]:
    """Return the share of the residual that remains beside columns of each log, (N, k) of each, and coefficients (k,).

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
    return fit.cost / max(solve(found.fit.sections, data).cost, TINY), coefficients


def _beside_free_response(plant: PlantRecord, log: Recording, columns: Array) -> Array:
    """Return columns and what the input leaves of the output, less a free response and a constant, shape (N, k + 1)."""
    free = np.hstack([free_responses(plant, len(log))[:, 0], np.ones((len(log), 1))])
    both = np.hstack([columns, log.outputs - simulate(plant, np.asarray(log.inputs))])
    return np.asarray(both - free @ np.linalg.lstsq(free, both, rcond=None)[0])
