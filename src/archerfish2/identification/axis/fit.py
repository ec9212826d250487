"""One axis at a given order: from recordings to its plant."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
from scipy.special import chdtri

from archerfish2.errors import InputError
from archerfish2.identification.axis.log_start import first_guess, guarded, rounding_floor
from archerfish2.identification.axis.output_error import LinearFit, refine, residuals_by_log, solve
from archerfish2.identification.axis.prior import out_of_band, weighed
from archerfish2.identification.axis.sections import Array, Complex, Sections, state_matrices
from archerfish2.identification.axis.spectrum import Experiment, Lines, strongest, thinned
from archerfish2.identification.axis.starts import distinct, vector_fits
from archerfish2.identification.axis.structure import Structure, choose_structure, delay_table
from archerfish2.identification.simulation import balanced
from archerfish2.identification.validation import free_run
from archerfish2.records.plant import PlantRecord

_ALL_LINES, _FEW_LINES = 8000, 1000  # up to so many all lines are fitted, beyond only those that respond; for starts
_RESPONDS = 0.02  # response over noise, in power, from which a line is fitted
_OTHER_OPTIMUM = 1.15  # cost over the best one's up to which optima on a few lines are in doubt
_CONTRADICTED = 0.05  # probability at which constraints count as contradicted by the logs
_LARGEST_ORDER = 20
_LEAST_NOISE = 1e-8  # of an output's standard deviation, by which outputs are weighed


class AxisRecording(Protocol):
    """A recording at equal intervals."""

    @property
    def u(self) -> Array:
        """Inputs, shape (N, m)."""

    @property
    def y(self) -> Array:
        """Outputs, shape (N, p)."""

    @property
    def period_s(self) -> float:
        """Sampling period [s]."""


class AxisFit(NamedTuple):
    """A plant, and how it explains the recordings from which it was identified."""

    plant: PlantRecord
    fit_percent: Array  # of a free run, initial state and constant fitted, for each recording and output, (k, p)
    poles: Complex  # in the z plane, largest first, (n,)
    extended: tuple[bool, ...]  # whether each recording begins at a rest that was put before it once more
    skipped: tuple[int, ...]  # samples at its beginning that were left out

    @property
    def delay(self) -> int:
        """Input delay [samples]."""
        return self.plant.delay_samples

    @property
    def gain(self) -> Array:
        """Steady output per steady input, shape (p, m)."""
        return self.plant.dc_gain


def fit_axis(
    recordings: Sequence[AxisRecording],
    order: int,
    delay: int | None = None,
    *,
    max_delay: int = 20,
    feedthrough: bool = True,
    axis: str = "axis",
) -> AxisFit:
    """Identify the plant of one axis by output error, of one output or of one input.

    Args:
      recordings: of the same axis, all of the same period, each with an initial state and a level of its own.
      order: number of poles.
      delay: of the inputs [samples]; searched if not given.
      max_delay: up to which it is searched at first, a tenth of the shortest recording at most [samples].
      feedthrough: whether the plant may have one; it has if the logs say so.
      axis: name of the plant.

    Raises:
      InputError: if arrays don't fit together or aren't finite, inputs or outputs don't move, a recording is too short
        for the order, or there are several inputs with several outputs.
    """
    logs, delays = _checked(recordings, order, delay), (delay or 0, delay or 0)
    if delay is None:
        delays = (0, min(max_delay, min(len(u) for u, _ in logs) // 10))
    scale = np.sqrt(np.mean(np.concatenate([y for _, y in logs]) ** 2, 0))
    experiments: Sequence[Experiment] = [first_guess(u, y / scale, delays[1]) for u, y in logs]
    experiments, table = guarded(experiments, delays[1], lambda each: delay_table(each, order, delays))
    structure, starts = choose_structure(experiments, table, order, (delays[0], max(delays[1], *table)), feedthrough)
    final = [replace(e, skip=min(e.skip, structure.delay)) for e in experiments]
    fit, rows = _settled(final, structure, starts)
    if len(scale) > 1:  # again, with outputs in units of their noise
        noise = np.maximum(np.sqrt(np.mean(fit.residual[:, :rows] ** 2, 1)), _LEAST_NOISE)
        scale, final = scale * noise, [replace(e, y=e.y / noise) for e in final]
        fit, _ = _settled(final, structure, [fit.sections])
    A, B, C, D = state_matrices(fit.sections, fit.numerators * scale, logs[0][0].shape[1])
    plant = PlantRecord.from_state_space(A, B, C, D, recordings[0].period_s, structure.delay)
    plant = balanced(plant.replace(axis=axis))
    runs = [free_run(plant, u, y) for u, y in logs]
    poles = np.linalg.eigvals(A).astype(complex)
    return AxisFit(
        plant,
        np.array([run.fit_percent for run in runs]),
        poles[np.lexsort((-poles.imag, -np.abs(poles).round(12)))],
        tuple(e.pad > 0 for e in final),
        tuple(e.skip for e in final),
    )


def _checked(recordings: Sequence[AxisRecording], order: int, delay: int | None) -> list[tuple[Array, Array]]:
    """Return inputs and outputs of each recording less their means."""
    if not recordings:
        raise InputError("fit_axis: expected at least one recording, got none; give one")
    if not 1 <= order <= _LARGEST_ORDER:
        raise InputError(f"fit_axis: order must be 1…{_LARGEST_ORDER}, got {order}; choose another")
    logs = [(np.asarray(each.u, float), np.asarray(each.y, float)) for each in recordings]
    shapes = (logs[0][0].shape[1:], logs[0][1].shape[1:])
    inputs, outputs = (size[0] if len(size) == 1 else 0 for size in shapes)
    if min(inputs, outputs) != 1:
        raise InputError(
            f"fit_axis: expected one input or one output, arrays u (N, m) and y (N, p), got {inputs} inputs and "
            f"{outputs} outputs; identify one output at a time"
        )
    for number, ((u, y), each) in enumerate(zip(logs, recordings, strict=True), 1):
        name, least = f"fit_axis: recording {number}", 4 * order + 10 + (delay or 0)
        if len(u) != len(y) or (u.shape[1:], y.shape[1:]) != shapes:
            raise InputError(f"{name}: expected arrays as of the first, got {u.shape} and {y.shape}; correct it")
        if abs(each.period_s - recordings[0].period_s) > 1e-9 * recordings[0].period_s:
            periods = f"{recordings[0].period_s} s, got {each.period_s} s"
            raise InputError(f"{name}: expected the first one's period of {periods}; resample it")
        if len(u) < least:
            raise InputError(f"{name}: expected at least {least} samples, got {len(u)}; record longer")
        if not (np.all(np.isfinite(u)) and np.all(np.isfinite(y))):
            raise InputError(f"{name}: expected finite numbers; leave out where there are none")
        if not np.all(np.ptp(y, axis=0) > 0):
            raise InputError(f"{name}: expected outputs that move, got a constant; leave it out")
    if not np.all(np.max([np.ptp(u, axis=0) for u, _ in logs], axis=0) > 0):
        raise InputError("fit_axis: expected inputs that move, got a constant; leave that input out")
    if delay is not None and delay < 0:
        raise InputError(f"fit_axis: delay must be at least 0 samples, got {delay}; correct it")
    return [(u - u.mean(0), y - y.mean(0)) for u, y in logs]


def _settled(
    experiments: Sequence[Experiment], structure: Structure, starts: Sequence[Sections]
) -> tuple[LinearFit, int]:
    """Fit by the plain sum of squares, with constraints as far as the logs accept them; also the rows of the logs."""
    feedthrough, data = structure.feedthrough, [e.at(structure.delay) for e in experiments]
    few = [lines.pick(k) for lines, k in zip(data, thinned(experiments, _FEW_LINES), strict=True)]
    fresh = [fit.sections for fit in vector_fits(few, structure.order, feedthrough)[:6]]
    begun = distinct([solve(each, few, feedthrough) for each in [*starts, *fresh]], 8)
    rough = distinct([refine(fit.sections, few, feedthrough, steps=25, tolerance=1e-4) for fit in begun], 3)
    best = solve(rough[0].sections, data, feedthrough)
    informative = _responding(best, data) if best.residual.shape[1] > 2 * _ALL_LINES else data
    finalists = [starts[0], *(fit.sections for fit in rough[:2])]
    if len(rough) > 1 and rough[1].cost < _OTHER_OPTIMUM * rough[0].cost:
        finalists += [fit.sections for fit in vector_fits(informative, structure.order, feedthrough)[:3]]
    free = _best(finalists, informative, feedthrough, 40, 1e-9)
    if solve(free.sections, data, feedthrough).cost > best.cost:  # a pole between the lines that were left out
        free = _best(finalists, data, feedthrough, 40, 1e-9)
    else:
        data = informative
    constraints, ridge = out_of_band(free, data, structure.delay)
    rows = 2 * sum(len(lines.z) for lines in data)
    allowed = 1 + chdtri(3 * structure.order + 1, _CONTRADICTED) / (rows * len(free.residual))
    for strength in (1.0, 0.1, 0.01):
        both = data + weighed(constraints, strength)
        fit = _best([free.sections, starts[0]], both, feedthrough, 30, 1e-8, ridge * strength**2)
        if np.sum(fit.residual[:, :rows] ** 2) <= max(free.cost, rounding_floor(experiments)) * allowed:
            return fit, rows
    return free, rows


def _best(
    starts: Sequence[Sections], data: list[Lines], feedthrough: bool, steps: int, tolerance: float, ridge: float = 0.0
) -> LinearFit:
    fits = [refine(each, data, feedthrough, steps=steps, tolerance=tolerance, ridge=ridge) for each in starts]
    return min(fits, key=lambda fit: fit.cost)


def _responding(fit: LinearFit, data: list[Lines]) -> list[Lines]:
    """Lines at which the fit, or a plant of its mean gain, responds: where a fit is wrongly silent a line shows it."""
    squares = [np.abs(e.outputs - r) ** 2 for e, r in zip(data, residuals_by_log(fit, data), strict=True)]
    powers = [np.abs(lines.inputs) ** 2 for lines in data]
    gain = sum(map(np.sum, squares)) / sum(map(np.sum, powers))
    responses = [np.maximum(y.mean(0), gain * u.sum(0)) for y, u in zip(squares, powers, strict=True)]
    picks = strongest(responses, np.inf, _RESPONDS * 2 * fit.cost / fit.residual.size)
    return [lines.pick(k) for lines, k in zip(data, picks, strict=True)]
