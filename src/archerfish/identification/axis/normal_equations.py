"""The least squares of `simulation_fit` by normal equations: what a step of a search over the poles needs, and fast.

All columns of an experiment lie in one array, of which a single matrix product gives every sum that there is. The
parameters then follow from a small system. Residual and gradient are made of the columns once more and not of the sums,
so that they are as exact as those of an orthogonal projection until the columns are nearly dependent or nothing is left
but rounding; there the projection takes over.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dtrtri

from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.axis.rest_start import (
    RestStart,
    SectionEnd,
    driven_transients,
    section_ends,
    slope_transients,
)
from archerfish.identification.axis.simulation_fit import LinearFit, Penalty, fit_linear_parameters
from archerfish.identification.axis.spectra import Spectrum, picked, real_rows

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_INDEPENDENT = 1e-4
"""Share of a column's length that the columns before it must leave for the sums to be exact enough."""
_PIECE = 1500
"""Lines of a part."""
_ROUNDING = 1e-12
"""Share of the outputs' squares below which a cost is for the projection to tell."""


class Bench(NamedTuple):
    """A problem laid out for many fits."""

    experiments: Sequence[Spectrum]
    """As given."""
    feedthrough: bool
    """As given."""
    penalty: Penalty | None
    """As given."""
    parts: tuple["Part", ...]
    """Of the experiments, in their order, then what is wished about an input each."""
    energy: float
    """Sum of squares of the outputs."""


class Part(NamedTuple):
    """Rows of the least squares: an experiment, or the wishes about an input. Real lies beside imaginary part."""

    lag: ComplexArray
    """z⁻¹, shape (F,)."""
    impulse: Array | None
    """What drives the transient, shape (F,); wishes have none."""
    inputs: ComplexArray
    """Shape (m, F)."""
    driving: ComplexArray
    """z⁻¹ times inputs, shape (m, F)."""
    targets: Array
    """Shape (p, R), R = 2 F for an experiment."""
    weights: Array | None
    """From values at the points to wishes, shape (2 F, R)."""
    rest: RestStart | None = None
    """Of an experiment that begins at rest; its transient is no parameter."""
    drift: ComplexArray | None = None
    """Slow motions that no input makes, shape (q, F)."""

    def own(self, order: int) -> tuple[int, int]:
        """Return how many columns of the experiment's own are transients of n poles, and how many drift."""
        free = 0 if self.impulse is None or self.rest is not None else order
        return free, 0 if self.drift is None else len(self.drift)


class Solution(NamedTuple):
    """The linear parameters for given poles."""

    sections: Sections
    """The poles."""
    fit: LinearFit
    """The fit, without slopes."""
    solved: Sequence["_Solved"]
    """Per part; empty where the projection took over."""
    root: Array
    """Inverse of the factor of the shared columns' sums, shape (c, c)."""
    residuals: Sequence[Array]
    """Per part, shape (p, R)."""


class _Solved(NamedTuple):
    """A part for given poles. Where there are several experiments, transients are eliminated one by one."""

    inverse: ComplexArray
    """1 / (1 + a₁ z⁻¹ + a₂ z⁻²) per section, shape (S, F)."""
    columns: ComplexArray
    """Transients, responses through b, then through D, shape (k, F)."""
    rows: Array
    """The same as the least squares see them, shape (k, R)."""
    root: Array | None
    """Inverse of the factor of the transients' sums, shape (t, t); none where they count among the shared columns."""
    coupling: Array
    """Shared columns in the transients' coordinates, shape (t, c)."""
    reach: Array
    """Targets in the transients' coordinates, shape (t, p)."""
    parameters: Array
    """Of all columns, shape (k, p)."""
    ends: Sequence[SectionEnd] = ()
    """Of the sections, in an experiment that begins at rest."""
    basis: ComplexArray | None = None
    """Transients of the sections, likewise; shape (n, F)."""


def lay_out(experiments: Sequence[Spectrum], feedthrough: bool, penalty: Penalty | None = None) -> Bench:
    """Prepare a problem for `solve`; arguments as those of `fit_linear_parameters`."""
    # Of a single experiment the transient is a parameter like the others, and lines may be dealt out to several parts.
    whole = experiments if len(experiments) > 1 else _dealt(experiments[0])
    parts = [_experiment(each) for each in whole]
    energy = sum(float(np.sum(part.targets**2)) for part in parts)
    if penalty is not None:
        parts += [_wish(penalty, channel) for channel in range(len(penalty.rows))]
    return Bench(experiments, feedthrough, penalty, tuple(parts), energy)


def _dealt(experiment: Spectrum) -> list[Spectrum]:
    """Cut an experiment into pieces whose columns stay in the processor's cache."""
    count = experiment.lag.size
    return [picked(experiment, np.arange(start, min(start + _PIECE, count))) for start in range(0, count, _PIECE)]


def _experiment(each: Spectrum) -> Part:
    inputs, outputs = (np.ascontiguousarray(signal.T) for signal in (each.inputs, each.outputs))
    drift = None if each.drift is None else np.ascontiguousarray(each.drift.T)
    return Part(each.lag, each.impulse, inputs, each.lag * inputs, outputs.view(np.float64), None, each.rest, drift)


def _wish(penalty: Penalty, channel: int) -> Part:
    points = penalty.lag.size
    inputs = np.zeros((len(penalty.rows), points), np.complex128)
    inputs[channel] = 1.0
    weights = penalty.rows[channel].reshape(-1, 2, points).transpose(2, 1, 0).reshape(2 * points, -1)
    return Part(penalty.lag, None, inputs, penalty.lag * inputs, penalty.targets[channel].T, weights)


def solve(sections: Sections, bench: Bench) -> Solution:
    """Estimate everything but the poles by least squares on the simulated output.

    Args:
      sections: the poles, as stable sections, those of second order first.
      bench: what they are to explain.
    """
    order = sum(section.size for section in sections)
    transients = _shared_transients(bench, order)
    ends = _ends(sections, bench)
    try:
        solved = [
            _prepared(sections, order, transients, part, bench.feedthrough, each)
            for part, each in zip(bench.parts, ends, strict=True)
        ]
        root, shared = _shared(solved, bench.parts)
    except np.linalg.LinAlgError:
        return _projected(sections, bench)
    solved = [_completed(each, shared) for each in solved]
    residuals = [part.targets - each.parameters.T @ each.rows for part, each in zip(bench.parts, solved, strict=True)]
    fit = _linear_fit(order, shared[transients:], residuals, bench)
    if fit.misfit <= _ROUNDING * bench.energy:
        return _projected(sections, bench)
    return Solution(sections, fit, solved, root, residuals)


def _shared_transients(bench: Bench, order: int) -> int:
    """Return how many columns of an experiment's own count among the shared ones: those of a single experiment."""
    return sum(bench.parts[0].own(order)) if len(bench.experiments) == 1 else 0


def _ends(sections: Sections, bench: Bench) -> list[Sequence[SectionEnd]]:
    """Filter the inputs of experiments that begin at rest; parts of one experiment share what comes of it."""
    known: dict[int, Sequence[SectionEnd]] = {}
    for part in bench.parts:
        if part.rest is not None and id(part.rest) not in known:
            known[id(part.rest)] = section_ends(sections, part.rest)
    return [() if part.rest is None else known[id(part.rest)] for part in bench.parts]


def _projected(sections: Sections, bench: Bench) -> Solution:
    fit = fit_linear_parameters(sections, *bench[:3], with_slopes=False)
    return Solution(sections, fit, (), np.empty((0, 0)), ())


def _prepared(
    sections: Sections, order: int, transients: int, part: Part, feedthrough: bool, ends: Sequence[SectionEnd]
) -> _Solved:
    """Lay out the columns of a part, and eliminate its transient if it is not one of the shared parameters."""
    own = 0 if transients else sum(part.own(order))
    inverse, columns, basis = _columns(sections, order, own or transients, part, feedthrough, ends)
    rows = columns.view(np.float64) if part.weights is None else columns.view(np.float64) @ part.weights
    nothing = np.empty(0)
    if not own:
        return _Solved(inverse, columns, rows, None, nothing, nothing, nothing, ends, basis)
    sums = rows[:own] @ rows.T
    root = _inverse_root(sums[:, :own], sums.diagonal())
    return _Solved(inverse, columns, rows, root, root @ sums[:, own:], root @ (rows[:own] @ part.targets.T), nothing)


def _columns(
    sections: Sections,
    order: int,
    transients: int,
    part: Part,
    feedthrough: bool,
    ends: Sequence[SectionEnd],
) -> tuple[ComplexArray, ComplexArray, ComplexArray | None]:
    lag, inputs = part.lag, len(part.inputs)
    inverse = np.empty((len(sections), lag.size), np.complex128)
    for row, section in zip(inverse, sections, strict=True):
        np.divide(1.0, 1 + lag * (section[0] if section.size == 1 else section[0] + section[1] * lag), out=row)
    entries = np.empty((order, lag.size), np.complex128)
    entries[::2] = inverse
    np.multiply(inverse[: order // 2], lag, out=entries[1::2])
    stop = transients + order * inputs
    columns = np.empty((stop + feedthrough * inputs, lag.size), np.complex128)
    free, drifting = part.own(order)
    columns[:transients] = 0.0
    own = entries if part.impulse is None else entries * part.impulse
    if free:
        columns[:free] = own
    if drifting:
        columns[free : free + drifting] = part.drift
    np.multiply(entries[:, None], part.driving, out=columns[transients:stop].reshape(order, inputs, lag.size))
    columns[stop:] = part.inputs if feedthrough else 0.0
    if part.rest is None:
        return inverse, columns, None
    transient = driven_transients(sections, ends, part.rest.unit) @ own.view(np.float64)
    columns[transients:stop] += transient.view(np.complex128)
    return inverse, columns, own


def _inverse_root(sums: Array, squares: Array) -> Array:
    """Return L⁻¹ of sums = L Lᵀ; fails where a column is nearly dependent on those before it.

    Args:
      sums: shape (k, k).
      squares: of the columns, before anything was taken from them, shape (k,).
    """
    scale = np.sqrt(squares)
    scale[scale == 0] = 1.0
    factor, fault = dpotrf(sums / (scale[:, None] * scale), lower=1)
    if fault or factor.diagonal().min() < _INDEPENDENT:
        raise np.linalg.LinAlgError("nearly dependent columns")
    return np.asarray(dtrtri(factor, lower=1)[0] / scale)


def _products(rows: Array) -> Array:
    """Return rows @ rows.T, in halves: as one product it goes to a routine that is slower for few rows."""
    half = len(rows) // 2
    return np.concatenate([rows[:half] @ rows.T, rows[half:] @ rows.T])


def _shared(solved: Sequence[_Solved], parts: Sequence[Part]) -> tuple[Array, Array]:
    """Return L⁻¹ of the shared columns' sums, shape (c, c), and the shared parameters, shape (c, p)."""
    sums = moments = squares = np.zeros(())
    for each, part in zip(solved, parts, strict=True):
        rows = each.rows if each.root is None else each.rows[len(each.root) :]
        whole, moment = _products(rows), rows @ part.targets.T
        squares = squares + whole.diagonal()
        if each.root is not None:
            whole, moment = whole - each.coupling.T @ each.coupling, moment - each.coupling.T @ each.reach
        sums, moments = sums + whole, moments + moment
    root = _inverse_root(np.asarray(sums), np.asarray(squares))
    return root, root.T @ (root @ moments)


def _completed(each: _Solved, shared: Array) -> _Solved:
    if each.root is None:
        return each._replace(parameters=shared)
    transient = each.root.T @ (each.reach - each.coupling @ shared)
    return each._replace(parameters=np.concatenate([transient, shared]))


def _linear_fit(order: int, shared: Array, residuals: Sequence[Array], bench: Bench) -> LinearFit:
    inputs, outputs = len(bench.parts[0].inputs), shared.shape[1]
    count = sum(part.weights is None for part in bench.parts)
    measured, wished = residuals[:count], residuals[count:]
    if len(bench.experiments) == 1:
        measured = [np.concatenate(measured, axis=1)]
    rows = [real_rows(each.view(np.complex128).T) for each in measured]
    stacked = np.concatenate([*rows, *(each.T for each in wished)])
    return LinearFit(
        shared[: order * inputs].reshape(order, inputs, outputs),
        shared[order * inputs :] if bench.feedthrough else np.zeros((inputs, outputs)),
        stacked.T.reshape(-1),
        np.empty((0, order)),
        sum(float(np.sum(each**2)) for each in measured),
    )


def tangent(solution: Solution, bench: Bench) -> tuple[Array, Array]:
    """Tell how the cost changes with the coefficients of the sections (Kaufman's approximation).

    Args:
      solution: of `solve`.
      bench: the same.

    Returns:
      Slopes of the model times themselves, what the linear parameters explain projected out, shape (n, n); and slopes
      times residuals, minus half the derivative of the cost, shape (n,).
    """
    if not solution.solved:
        slopes = fit_linear_parameters(solution.sections, *bench[:3]).slopes
        return slopes.T @ slopes, slopes.T @ solution.fit.residuals
    order = sum(section.size for section in solution.sections)
    curvature = gradient = left = np.zeros(())
    for part, each, residual in zip(bench.parts, solution.solved, solution.residuals, strict=True):
        slopes = _slopes(order, part, each, bench.feedthrough, solution)
        gradient = gradient + sum(slope @ miss for slope, miss in zip(slopes, residual, strict=True))
        steep = slopes.reshape(-1, slopes.shape[2])
        curvature, product = curvature + _products(steep), each.rows @ steep.T
        if each.root is not None:
            taken = each.root @ product[: len(each.root)]
            curvature, product = curvature - taken.T @ taken, product[len(each.root) :] - each.coupling.T @ taken
        left = left + product
    removed = solution.root @ left
    return _over_outputs(curvature - removed.T @ removed, order), np.asarray(gradient)


def _slopes(order: int, part: Part, solved: _Solved, feedthrough: bool, solution: Solution) -> Array:
    """Differentiate the model by every aᵢ, −z⁻ⁱ S / (1 + …) for a section's output S; shape (p, n, R)."""
    own = part.own(order) if part.impulse is not None else (0, 0)
    spare = len(solved.columns) - sum(own) - (order + feedthrough) * len(part.inputs)
    owner = _owners(order, len(part.inputs), feedthrough, own[0], own[1] + spare)
    chosen = solved.parameters.T[:, None] * (owner == np.arange(len(solved.inverse))[:, None])
    responses = chosen.reshape(-1, owner.size) @ solved.columns.view(np.float64)
    filtered = responses.view(np.complex128).reshape(*chosen.shape[:2], -1) * (-part.lag * solved.inverse)
    slopes = np.empty((len(filtered), order, part.lag.size), np.complex128)
    slopes[:, ::2] = filtered
    np.multiply(filtered[:, : order // 2], part.lag, out=slopes[:, 1::2])
    if part.rest is not None and solved.basis is not None:
        of_slopes = slope_transients(solution.sections, solved.ends, part.rest.unit, solution.fit.numerators)
        slopes -= (of_slopes @ solved.basis.view(np.float64)).view(np.complex128)
    rows = slopes.view(np.float64)
    return rows if part.weights is None else rows @ part.weights


@cache
def _owners(order: int, inputs: int, feedthrough: bool, transients: int, others: int) -> NDArray[np.intp]:
    """Return which section each column belongs to, −1 for the feedthrough's and those of no section."""
    driven, through = np.arange(order * inputs) // (2 * inputs), np.full(feedthrough * inputs, -1)
    return np.concatenate([np.arange(transients) // 2, np.full(others, -1), driven, through])


def _over_outputs(whole: Array, order: int) -> Array:
    """Sum the blocks of each output with itself."""
    if len(whole) == order:
        return whole
    outputs = len(whole) // order
    return np.asarray(np.einsum("pipj->ij", whole.reshape(outputs, order, outputs, order)))
