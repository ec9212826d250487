"""One axis at a given order: from recordings to its plant."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from archerfish2.errors import InputError
from archerfish2.identification.axis.log_start import first_guess, guarded, rounding_floor
from archerfish2.identification.axis.output_error import LinearFit, refine, refine_best, residuals_by_log, solve
from archerfish2.identification.axis.prior import out_of_band, steady_gain
from archerfish2.identification.axis.sections import Sections, poles_of, state_matrices
from archerfish2.identification.axis.selection import Selection, Structure, delay_table, select_structure
from archerfish2.identification.axis.spectrum import Experiment, Lines, lines_of, strongest, thinned
from archerfish2.identification.axis.starts import distinct, vector_fits
from archerfish2.identification.simulation import Array, Complex, free_run
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

_ALL_LINES, _MOST_LINES = 8000, 12_000  # up to which all lines are fitted; beyond, so many of those that respond
_FEW_LINES = 1000  # for starts
_RESPONDS = 0.02  # response over noise, in power, from which a line is fitted
_OTHER_OPTIMUM = 1.15  # cost over the best one's up to which optima on a few lines are in doubt
_CONTRADICTED = 0.05  # probability at which constraints count as contradicted by the logs
DELAY = 20  # up to which a delay is searched at first [samples]
_LARGEST_ORDER, _ORDERS, _PILOT = 20, range(1, 9), 4  # that can be given; from which is chosen; of the first fits
_LEAST_NOISE = 1e-8  # of an output's standard deviation, by which outputs are weighed


class AxisFit(NamedTuple):
    """A plant, and the fit that gave it."""

    plant: PlantRecord
    structure: Structure
    fit: LinearFit  # of outputs over their scale
    scale: Array  # of the outputs, (p,)
    experiments: list[Experiment]  # as they were fitted
    constraints: list[Lines]  # that were added to them
    ridge: float  # of the free numbers
    selection: Selection

    @property
    def delay(self) -> int:
        """Delay of the inputs [samples]."""
        return self.structure.delay

    @property
    def gain(self) -> Array:
        """Steady output per steady input, shape (p, m)."""
        return self.plant.dc_gain

    @property
    def poles(self) -> Complex:
        """Poles in the z plane, largest first, shape (n,)."""
        poles = poles_of(self.fit.sections)
        return np.asarray(poles[np.lexsort((-poles.imag, -np.abs(poles).round(12)))])


def fit_axis(
    recordings: Sequence[Recording],
    order: int | None = None,
    delay: int | None = None,
    *,
    max_delay: int = DELAY,
    feedthrough: bool = True,
    held_back: Sequence[Recording] = (),
) -> AxisFit:
    """Identify the plant of one axis by output error, of one output or of one input.

    Args:
      recordings: of the same axis, all of the same period, each with an initial state and a level of its own.
      order: number of poles; chosen from 1 to 8 if not given.
      delay: of the inputs [samples]; searched if not given.
      max_delay: up to which it is searched at first, a tenth of the shortest recording at most [samples].
      feedthrough: whether the plant may have one; it has if the logs say so.
      held_back: recordings by which the order is chosen.

    Raises:
      InputError: if arrays don't fit together or aren't finite, inputs or outputs don't move, a recording is too short
        for the order, or there are several inputs with several outputs.
    """
    longest, orders = max_delay if delay is None else delay, _ORDERS if order is None else range(order, order + 1)
    every = _checked([*recordings, *held_back], orders[0], longest)
    logs, kept = every[: len(recordings)], every[len(recordings) :]
    shortest = min(len(u) for u, _ in logs)
    delays = (0, min(max_delay, shortest // 10)) if delay is None else (delay, delay)
    orders = orders[: sum(shortest >= _least_samples(each, logs[0][0].shape[1]) for each in orders)]
    scale = np.sqrt(np.mean(np.concatenate([y for _, y in logs]) ** 2, 0))
    experiments, period = [first_guess(u, y / scale, delays[1]) for u, y in logs], recordings[0].period_s
    pilot = orders[min(_PILOT, len(orders)) - 1]
    experiments, table = guarded(experiments, delays[1], lambda each: delay_table(each, pilot, delays))

    def predicted(structure: Structure, fit: LinearFit) -> float:
        logs = [replace(e, drift=structure.drift) for e in experiments]
        data = lines_of(logs, thinned(logs, _FEW_LINES), structure.delay, structure.feedthrough)
        constraints, ridge = out_of_band(solve(fit.sections, data), data, structure.delay)
        fit = refine(fit.sections, data + constraints, 15, 1e-5, ridge)
        plant = plant_of(fit, structure, scale, period)
        return min(float(free_run(plant, u, y, drift=structure.drift).fit_percent.min()) for u, y in kept)

    delays = delays[0], max(delays[1], *table)
    selection = select_structure(experiments, table, orders, delays, feedthrough, predicted if kept else None)
    structure, starts = selection.structure, selection.starts
    final = [replace(e, skip=min(e.skip, structure.delay), drift=structure.drift) for e in experiments]
    fit, constraints, ridge = _settled(final, structure, starts)
    if len(scale) > 1:  # again, with outputs in units of their noise
        rows = 2 * sum(len(e.z) for e in final)
        noise = np.maximum(np.sqrt(np.mean(fit.residual[:, :rows] ** 2, 1)), _LEAST_NOISE)
        scale, final = scale * noise, [replace(e, y=e.y / noise) for e in final]
        fit, constraints, ridge = _settled(final, structure, [fit.sections])
    plant = plant_of(fit, structure, scale, period)
    return AxisFit(plant, structure, fit, scale, final, constraints, ridge, selection)


def with_gain(found: AxisFit, gain: Array) -> AxisFit:
    """Return the fit with the constraint that the plant has a steady gain.

    Args:
      found: without it.
      gain: steady output per steady input, shape (p, m).
    """
    structure, scale = found.structure, found.scale
    data = [e.at(structure.delay, structure.feedthrough) for e in found.experiments]
    constraints = [*found.constraints, steady_gain(gain / scale[:, None], data)]
    fit = refine(found.fit.sections, data + constraints, 30, 1e-8, found.ridge)
    plant = plant_of(fit, structure, scale, found.plant.sample_period_s)
    return found._replace(plant=plant, fit=fit, constraints=constraints)


def plant_of(fit: LinearFit, structure: Structure, scale: Array, period_s: float) -> PlantRecord:
    """Return the plant of a fit.

    Args:
      fit: of outputs over their scale.
      structure: of it.
      scale: of the outputs, shape (p,).
      period_s: sampling period [s].
    """
    numerators = fit.numerators * scale
    inputs = len(numerators) // (structure.order + structure.feedthrough)
    A, B, C, D = state_matrices(fit.sections, numerators, inputs)
    # Nearly equal poles have huge numerators of opposite signs, which a record would refuse.
    size = np.sqrt(max(np.abs(C).max(), 1e-100) / max(np.abs(B).max(), 1e-100))
    return PlantRecord.from_state_space(A, size * B, C / size, D, period_s, structure.delay)


def _checked(recordings: Sequence[Recording], order: int, delay: int) -> list[tuple[Array, Array]]:
    """Return inputs and outputs of each recording less their means."""
    if not (recordings and 1 <= order <= _LARGEST_ORDER and delay >= 0):
        wanted = f"a recording or more, an order of 1…{_LARGEST_ORDER} and a delay of at least 0"
        raise InputError(f"fit_axis: expected {wanted}, got {len(recordings)}, {order} and {delay}; correct it")
    inputs, outputs = recordings[0].inputs.shape[1], recordings[0].outputs.shape[1]
    if min(inputs, outputs) != 1:
        got = f"{inputs} inputs and {outputs} outputs; identify one output at a time"
        raise InputError(f"fit_axis: expected one input or one output, got {got}")
    least, period = _least_samples(order, inputs), recordings[0].period_s
    for each in recordings:
        faults = {
            f"the period of {period} s of the first recording, got {each.period_s} s; resample it": (
                abs(each.period_s - period) > 1e-9 * period
            ),
            f"at least {least} samples, got {len(each)}; record longer": len(each) < least,
            "outputs that move, got a constant one; leave it out": not np.ptp(each.outputs, axis=0).all(),
        }
        for expected in (text for text, wrong in faults.items() if wrong):
            raise InputError(f"{each.source}: expected {expected}")
    if not np.max([np.ptp(each.inputs, axis=0) for each in recordings], axis=0).all():
        raise InputError("fit_axis: expected inputs that move, got a constant; leave that input out")
    return [(each.inputs - each.inputs.mean(0), each.outputs - each.outputs.mean(0)) for each in recordings]


def _least_samples(order: int, inputs: int) -> int:
    return 2 * (order + 2) * (1 + inputs) + 10


def _settled(
    experiments: list[Experiment], structure: Structure, starts: list[Sections]
) -> tuple[LinearFit, list[Lines], float]:
    """Fit by the plain sum of squares, with constraints as far as the logs accept them; also these and the ridge."""
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
    free = refine_best(finalists, informative, 20, 1e-4)
    if solve(free.sections, data).cost > best.cost:  # a pole between the lines that were left out
        free, informative = refine_best(finalists, data, 20, 1e-4), data
    free, data = refine(free.sections, informative, 40, 1e-9), informative
    constraints, ridge = out_of_band(free, data, structure.delay)
    rows = 2 * sum(len(lines.z) for lines in data)
    allowed = 1 + chdtri(3 * structure.order + 1, _CONTRADICTED) / (rows * len(free.residual))
    least = max(np.sum(free.residual[:, :rows] ** 2), rounding_floor(experiments))
    for strength in (1.0, 0.1, 0.01):
        soft = [c._replace(inputs=strength * c.inputs, outputs=strength * c.outputs) for c in constraints]
        fit = refine_best([free.sections, starts[0]], data + soft, 8, 1e-4, ridge * strength**2)
        fit = refine(fit.sections, data + soft, 30, 1e-8, ridge * strength**2)
        if np.sum(fit.residual[:, :rows] ** 2) <= least * allowed:
            return fit, soft, ridge * strength**2
    return free, [], 0.0


def _responding(fit: LinearFit, data: list[Lines]) -> list[Lines]:
    """Lines at which the fit, or a plant of its mean gain, responds: where a fit is wrongly silent a line shows it."""
    squares = [np.abs(e.outputs - r) ** 2 for e, r in zip(data, residuals_by_log(fit, data), strict=True)]
    powers = [np.abs(lines.inputs) ** 2 for lines in data]
    gain = sum(map(np.sum, squares)) / sum(map(np.sum, powers))
    responses = [np.maximum(y.mean(0), gain * u.sum(0)) for y, u in zip(squares, powers, strict=True)]
    picks = strongest(responses, _MOST_LINES, _RESPONDS * 2 * fit.cost / fit.residual.size)
    return [lines.pick(k) for lines, k in zip(data, picks, strict=True)]
