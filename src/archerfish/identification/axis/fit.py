"""From recordings of one axis to its plant."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import chdtri

from archerfish.errors import InputError
from archerfish.identification.axis.constraints import out_of_band, steady_gain
from archerfish.identification.axis.output_error import (
    LinearFit,
    plant_of,
    refine,
    refine_best,
    solve,
)
from archerfish.identification.axis.sections import Sections, Structure, poles_of
from archerfish.identification.axis.selection import Selection, Validation, select_structure
from archerfish.identification.axis.spectrum import (
    Experiment,
    Lines,
    begun_log,
    lines_of,
    rounding_floor,
    thinned,
)
from archerfish.identification.axis.vector_fitting import distinct, search_delays, vector_fits
from archerfish.identification.simulation import Array, Complex
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_MOST_LINES = 12_000  # of a fit
_FEW_LINES = 1000  # for starts
_OTHER_OPTIMUM = 1.15  # cost over the best one's up to which optima on a few lines are in doubt
_CONTRADICTED = 0.05  # probability at which constraints count as contradicted by the logs
_OTHER_GAIN, _UNLIKELY = 0.05, 1e-3  # a gain that is given contradicts the logs: difference, and probability
DELAY = 20  # up to which a delay is searched at first [samples]
_LARGEST_ORDER, _ORDERS, _COARSE = 20, range(1, 9), 4  # that can be given; from which is chosen; of coarse fits
_LEAST_NOISE = 1e-8  # of an output's standard deviation, by which outputs are weighed


class CorrectedLogs(NamedTuple):
    """Recordings of one axis, and what was found and corrected in them."""

    fitted: list[Recording]  # to which a plant is fitted
    held_back: list[Recording]  # by which it is judged
    findings: list[Finding]  # of all of them


class KnownGain(NamedTuple):
    """A steady gain that is known beside the fit, and what the logs say without it."""

    gain: Array  # steady output per steady input, (p, m)
    error: Array  # its standard error, 0 where it is exact, (p, m)
    source: Literal["given", "plateaus"] = "given"  # where it comes from
    by_logs: Array = np.zeros((0, 0))  # steady gain of the fit without it, (p, m) after the fit
    contradicted: bool = False  # whether the logs exclude it


class AxisFit(NamedTuple):
    """A plant, and the fit that gave it."""

    plant: PlantRecord
    structure: Structure
    fit: LinearFit  # of outputs over their scale
    scale: Array  # of the outputs, (p,)
    experiments: list[Experiment]  # as they were fitted
    constraints: list[Lines]  # that were added to them
    ridge: float  # weight of the squared unconstrained parameters
    selection: Selection
    known_gain: KnownGain | None = None

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
    gain: KnownGain | None = None,
) -> AxisFit:
    """Identify the plant of one axis by output error, of one output or of one input.

    Args:
      recordings: of the same axis, all of the same period, each with an initial state and a level of its own.
      order: number of poles; chosen from 1 to 8 if not given.
      delay: of the inputs [samples]; searched if not given.
      max_delay: up to which it is searched at first, a tenth of the shortest recording at most [samples].
      feedthrough: whether the plant may have one; it has if the logs say so.
      held_back: recordings by which the order is chosen.
      gain: that the plant is to have.

    Raises:
      InputError: if arrays don't fit together or aren't finite, inputs or outputs don't move, a recording is too short
        for the order, or there are several inputs with several outputs.
    """
    orders = _ORDERS if order is None else range(order, order + 1)
    every = _checked([*recordings, *held_back], orders[0], max_delay if delay is None else delay)
    logs, others = every[: len(recordings)], every[len(recordings) :]
    shortest, inputs = min(len(u) for u, _ in logs), logs[0][0].shape[1]
    delays = (0, min(max_delay, shortest // 10)) if delay is None else (delay, delay)
    orders = orders[: sum(shortest >= _least_samples(possible, inputs) for possible in orders)]
    scale = np.sqrt(np.mean(np.concatenate([y for _, y in logs]) ** 2, 0))
    period_s = recordings[0].period_s
    begun = [begun_log(u, y / scale, delays[1]) for u, y in logs]
    experiments, table = search_delays(begun, orders[min(_COARSE, len(orders)) - 1], delays)
    validation = Validation(others, scale, period_s) if others else None
    delays = delays[0], max(delays[1], *table)
    selection = select_structure(experiments, table, orders, delays, feedthrough, validation)
    structure = selection.structure
    final = [replace(log, skip=min(log.skip, structure.delay), drift=structure.drift) for log in experiments]
    fit, constraints, ridge = _settled(final, structure, selection.starts)
    if len(scale) > 1:  # again, with outputs in units of their noise
        rows = 2 * sum(len(log.z) for log in final)
        noise = np.maximum(np.sqrt(np.mean(fit.residual[:, :rows] ** 2, 1)), _LEAST_NOISE)
        scale, final = scale * noise, [replace(log, y=log.y / noise) for log in final]
        fit, constraints, ridge = _settled(final, structure, [fit.sections])
    plant = plant_of(fit, structure, scale, period_s)
    found = AxisFit(plant, structure, fit, scale, final, constraints, ridge, selection)
    return found if gain is None else _with_gain(found, gain)


def _with_gain(found: AxisFit, known: KnownGain) -> AxisFit:
    """Return a fit with the constraint that the plant has a steady gain."""
    structure, scale = found.structure, found.scale
    gain, by_logs = known.gain, found.plant.dc_gain
    data = [log.at(structure.delay, structure.feedthrough) for log in found.experiments]
    constraints = [*found.constraints, steady_gain(gain / scale[:, None], data)]
    fit = refine(found.fit.sections, data + constraints, 30, 1e-8, found.ridge)
    free = solve(found.fit.sections, data)
    least = rounding_floor(found.experiments)
    cost = float(np.sum(fit.residual[:, : len(free.residual[0])] ** 2))
    loss = free.residual.size * np.log(max(cost, least) / max(free.cost, least))
    unlikely = loss > chdtri(gain.size, _UNLIKELY)
    different = np.abs(gain - by_logs) > _OTHER_GAIN * np.maximum(np.abs(gain), np.abs(by_logs))
    known = known._replace(by_logs=by_logs, contradicted=bool(unlikely and np.any(different)))
    plant = plant_of(fit, structure, scale, found.plant.sample_period_s)
    return found._replace(plant=plant, fit=fit, known_gain=known)


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
    for log in recordings:
        if abs(log.period_s - period) > 1e-9 * period:
            problem = f"expected the period of {period} s of the first recording, got {log.period_s} s"
            raise InputError(f"{log.source}: {problem}; resample it")
        if len(log) < least:
            raise InputError(f"{log.source}: expected at least {least} samples, got {len(log)}; record longer")
        if not np.ptp(log.outputs, axis=0).all():
            raise InputError(f"{log.source}: expected outputs that move, got a constant one; leave it out")
    if not np.max([np.ptp(log.inputs, axis=0) for log in recordings], axis=0).all():
        raise InputError("fit_axis: expected inputs that move, got a constant; leave that input out")
    return [(log.inputs - log.inputs.mean(0), log.outputs - log.outputs.mean(0)) for log in recordings]


def _least_samples(order: int, inputs: int) -> int:
    return 2 * (order + 2) * (1 + inputs) + 10


def _settled(
    experiments: list[Experiment], structure: Structure, starts: list[Sections]
) -> tuple[LinearFit, list[Lines], float]:
    """Fit by the plain sum of squares, with constraints as far as the logs accept them; also these and the ridge."""
    free, data = _free_fit(experiments, structure, starts)
    constraints, ridge = out_of_band(free, data, structure.delay)
    rows = 2 * sum(len(lines.z) for lines in data)
    allowed = 1 + chdtri(3 * structure.order + 1, _CONTRADICTED) / (rows * len(free.residual))
    least = max(free.cost, rounding_floor(experiments))
    for strength in (1.0, 0.1, 0.01):
        soft = [c._replace(inputs=strength * c.inputs, outputs=strength * c.outputs) for c in constraints]
        fit = refine_best([free.sections, starts[0]], data + soft, 8, 1e-4, ridge * strength**2)
        fit = refine(fit.sections, data + soft, 30, 1e-8, ridge * strength**2)
        if np.sum(fit.residual[:, :rows] ** 2) <= least * allowed:
            return fit, soft, ridge * strength**2
    return free, [], 0.0


def _free_fit(
    experiments: list[Experiment], structure: Structure, starts: list[Sections]
) -> tuple[LinearFit, list[Lines]]:
    """Fit without constraints, from the starts and from vector fits; also the lines that were fitted."""
    data = lines_of(experiments, thinned(experiments, _MOST_LINES), structure.delay, structure.feedthrough)
    few = lines_of(experiments, thinned(experiments, _FEW_LINES), structure.delay, structure.feedthrough)
    fresh = [fit.sections for fit in vector_fits(few, structure.order)[:6]]
    begun = distinct([solve(sections, few) for sections in [*starts, *fresh]], 8)
    rough = distinct([refine(fit.sections, few, 25, 1e-4) for fit in begun], 3)
    finalists = [starts[0], *(fit.sections for fit in rough[:2])]
    if len(rough) > 1 and rough[1].cost < _OTHER_OPTIMUM * rough[0].cost:
        finalists += [fit.sections for fit in vector_fits(data, structure.order)[:3]]
    return refine(refine_best(finalists, data, 20, 1e-4).sections, data, 40, 1e-9), data
