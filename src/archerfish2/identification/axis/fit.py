"""One axis at a given order: from recordings to its plant."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
from scipy.special import chdtri

from archerfish2.errors import InputError
from archerfish2.identification.axis.log_start import first_guess, guarded, rounding_floor
from archerfish2.identification.axis.output_error import LinearFit, refine, refine_best, residuals_by_log, solve
from archerfish2.identification.axis.prior import out_of_band
from archerfish2.identification.axis.sections import Sections, state_matrices
from archerfish2.identification.axis.spectrum import Experiment, Lines, lines_of, strongest, thinned
from archerfish2.identification.axis.starts import distinct, vector_fits
from archerfish2.identification.axis.structure import Structure, choose_structure, delay_table
from archerfish2.identification.simulation import Array, Complex
from archerfish2.identification.validation import free_run
from archerfish2.records.plant import PlantRecord

_ALL_LINES, _FEW_LINES = 8000, 1000  # up to so many all lines are fitted, beyond only those that respond; for starts
_RESPONDS = 0.02  # response over noise, in power, from which a line is fitted
_OTHER_OPTIMUM = 1.15  # cost over the best one's up to which optima on a few lines are in doubt
_CONTRADICTED = 0.05  # probability at which constraints count as contradicted by the logs
_LARGEST_ORDER = 20
_LEAST_NOISE = 1e-8  # of an output's standard deviation, by which outputs are weighed


class Series(Protocol):
    """Inputs and outputs at equal intervals, as of a `Recording`."""

    @property
    def inputs(self) -> Array:
        """Inputs, shape (N, m)."""

    @property
    def outputs(self) -> Array:
        """Outputs, shape (N, p)."""

    @property
    def period_s(self) -> float:
        """Sampling period [s]."""


class AxisFit(NamedTuple):
    """A plant, and how it explains the recordings from which it was identified."""

    plant: PlantRecord
    fit_percent: Array  # of a free run, initial state and constant fitted, for each recording and output, (k, p)
    delay: int  # of the inputs [samples]
    gain: Array  # steady output per steady input, (p, m)
    poles: Complex  # in the z plane, largest first, (n,)
    extended: tuple[bool, ...]  # whether each recording begins at a rest that was put before it once more
    skipped: tuple[int, ...]  # samples at its beginning that were left out


def fit_axis(
    recordings: Sequence[Series], order: int, delay: int | None = None, *, max_delay: int = 20, feedthrough: bool = True
) -> AxisFit:
    """Identify the plant of one axis by output error, of one output or of one input.

    Args:
      recordings: of the same axis, all of the same period, each with an initial state and a level of its own.
      order: number of poles.
      delay: of the inputs [samples]; searched if not given.
      max_delay: up to which it is searched at first, a tenth of the shortest recording at most [samples].
      feedthrough: whether the plant may have one; it has if the logs say so.

    Raises:
      InputError: if arrays don't fit together or aren't finite, inputs or outputs don't move, a recording is too short
        for the order, or there are several inputs with several outputs.
    """
    logs = _checked(recordings, order, max_delay if delay is None else delay)
    delays = (0, min(max_delay, min(len(u) for u, _ in logs) // 10)) if delay is None else (delay, delay)
    scale = np.sqrt(np.mean(np.concatenate([y for _, y in logs]) ** 2, 0))
    experiments = [first_guess(u, y / scale, delays[1]) for u, y in logs]
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
    fits, poles = np.array([free_run(plant, u, y).fit_percent for u, y in logs]), np.linalg.eigvals(A).astype(complex)
    poles = poles[np.lexsort((-poles.imag, -np.abs(poles).round(12)))]
    starts_of_logs = tuple(e.pad > 0 for e in final), tuple(e.skip for e in final)
    return AxisFit(plant, fits, plant.delay_samples, plant.dc_gain, poles, *starts_of_logs)


def _checked(recordings: Sequence[Series], order: int, delay: int) -> list[tuple[Array, Array]]:
    """Return inputs and outputs of each recording less their means."""
    if not (recordings and 1 <= order <= _LARGEST_ORDER and delay >= 0):
        wanted = f"a recording or more, an order of 1…{_LARGEST_ORDER} and a delay of at least 0"
        raise InputError(f"fit_axis: expected {wanted}, got {len(recordings)}, {order} and {delay}; correct it")
    logs = [(np.asarray(each.inputs, float), np.asarray(each.outputs, float)) for each in recordings]
    shapes = (logs[0][0].shape[1:], logs[0][1].shape[1:])
    inputs, outputs = (size[0] if len(size) == 1 else 0 for size in shapes)
    if min(inputs, outputs) != 1:
        got = f"u (N, {inputs}) and y (N, {outputs}); identify one output at a time"
        raise InputError(f"fit_axis: expected arrays of one input or of one output, got {got}")
    period, least = recordings[0].period_s, 2 * (order + 2) * (1 + inputs) + 10
    for number, ((u, y), each) in enumerate(zip(logs, recordings, strict=True), 1):
        fits = len(u) == len(y) > 0 and (u.shape[1:], y.shape[1:]) == shapes
        other_period = abs(each.period_s - period) > 1e-9 * period
        faults = {
            f"arrays as of the first, got u {u.shape} and y {y.shape}; correct it": not fits,
            f"the first one's period of {period} s, got {each.period_s} s; resample it": other_period,
            f"at least {least} samples, got {len(u)}; record longer": len(u) < least,
            "finite numbers; leave out where there are none": not (np.isfinite(u).all() and np.isfinite(y).all()),
            "outputs that move, got a constant one; leave it out": bool(fits) and not np.ptp(y, axis=0).all(),
        }
        for expected in (text for text, wrong in faults.items() if wrong):
            raise InputError(f"fit_axis: recording {number}: expected {expected}")
    if not np.max([np.ptp(u, axis=0) for u, _ in logs], axis=0).all():
        raise InputError("fit_axis: expected inputs that move, got a constant; leave that input out")
    return [(u - u.mean(0), y - y.mean(0)) for u, y in logs]


def _settled(experiments: list[Experiment], structure: Structure, starts: list[Sections]) -> tuple[LinearFit, int]:
    """Fit by the plain sum of squares, with constraints as far as the logs accept them; also the rows of the logs."""
    data = [e.at(structure.delay, structure.feedthrough) for e in experiments]
    few = lines_of(experiments, thinned(experiments, _FEW_LINES), structure.delay, structure.feedthrough)
    fresh = [fit.sections for fit in vector_fits(few, structure.order)[:6]]
    begun = distinct([solve(each, few) for each in [*starts, *fresh]], 8)
    rough = distinct([refine(fit.sections, few, 25, 1e-4) for fit in begun], 3)
    best = solve(rough[0].sections, data)
    informative = _responding(best, data) if best.residual.shape[1] > 2 * _ALL_LINES else data
    finalists = [starts[0], *(fit.sections for fit in rough[:2])]
    if len(rough) > 1 and rough[1].cost < _OTHER_OPTIMUM * rough[0].cost:
        finalists += [fit.sections for fit in vector_fits(informative, structure.order)[:3]]
    free = refine_best(finalists, informative, 40, 1e-9)
    missed = solve(free.sections, data).cost > best.cost  # a pole between the lines that were left out
    free, data = (refine_best(finalists, data, 40, 1e-9), data) if missed else (free, informative)
    constraints, ridge = out_of_band(free, data, structure.delay)
    rows = 2 * sum(len(lines.z) for lines in data)
    allowed = 1 + chdtri(3 * structure.order + 1, _CONTRADICTED) / (rows * len(free.residual))
    for strength in (1.0, 0.1, 0.01):
        both = data + [c._replace(inputs=strength * c.inputs, outputs=strength * c.outputs) for c in constraints]
        fit = refine_best([free.sections, starts[0]], both, 30, 1e-8, ridge * strength**2)
        if np.sum(fit.residual[:, :rows] ** 2) <= max(free.cost, rounding_floor(experiments)) * allowed:
            return fit, rows
    return free, rows


def _responding(fit: LinearFit, data: list[Lines]) -> list[Lines]:
    """Lines at which the fit, or a plant of its mean gain, responds: where a fit is wrongly silent a line shows it."""
    squares = [np.abs(e.outputs - r) ** 2 for e, r in zip(data, residuals_by_log(fit, data), strict=True)]
    powers = [np.abs(lines.inputs) ** 2 for lines in data]
    gain = sum(map(np.sum, squares)) / sum(map(np.sum, powers))
    responses = [np.maximum(y.mean(0), gain * u.sum(0)) for y, u in zip(squares, powers, strict=True)]
    picks = strongest(responses, np.inf, _RESPONDS * 2 * fit.cost / fit.residual.size)
    return [lines.pick(k) for lines, k in zip(data, picks, strict=True)]
