"""How sure an identified axis is: the covariance of its parameters, with residuals of any colour.

Residuals of real logs are coloured, and a covariance that takes them for white is several times too small. Between
lines of a spectrum, though, stationary noise is as good as uncorrelated, whatever its colour; only its power differs.
So the sandwich

    H⁻¹ (Σ_lines S_k J_kᵀ J_k) H⁻¹,    H = Σ_lines J_kᵀ J_k + prior,

with the power S_k of the residuals around each line, each corrected for what the fit has taken of it (its leverage), is
right for white and for coloured noise.

It is kept as a root, from orthogonal factors of J and not from H: of modes that the lines hardly tell apart each is a
million times less sure than their sum, and squares would leave nothing but rounding of what is known of the sum.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtr, chdtri, ndtri

from archerfish.identification.axis.modal_form import (
    Poles,
    Sections,
    coefficient_slopes,
    free_numbers,
    section_offsets,
    section_poles,
    sections_from_numbers,
)
from archerfish.identification.axis.pole_refinement import Problem, Refinement
from archerfish.identification.axis.simulation_fit import (
    design_rows,
    linear_parameters,
    penalty_rows,
    transfer_columns,
)

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_STEP = 1e-6
_OCTAVES = (3, 6, 12, 24, 48, 96)
"""Lines between which the power of a slow wander is looked for."""
_STEEP, _STEEPEST = 0.7, 2.0
"""Least and greatest exponent of frequency that it falls with."""
_LARGEST_LEVERAGE = 0.9
_NOTHING = 3e-7
"""Share of the best known direction's strength up to which a direction counts as not determined."""
_SIGNIFICANT = float(chdtr(1, 9.0))
"""Confidence of three standard deviations."""


class Posterior(NamedTuple):
    """Parameters of an axis, normally distributed about their estimates."""

    free: Array
    """Free numbers of the poles, shape (n,)."""
    linear: Array
    """Numerators and, if estimated, feedthrough of each output, shape (c, p)."""
    root: Array
    """R of the covariance R Rᵀ of the free numbers and the linear parameters, output by output, shape (n + c p, k)."""
    inputs: int
    """Number of inputs m."""
    feedthrough: bool
    """Whether `linear` ends with a feedthrough."""
    inflation: float
    """Variance of the parameters over what it were if the residuals were white (median over the parameters)."""

    @property
    def order(self) -> int:
        """Number of poles n."""
        return self.free.size

    @property
    def covariance(self) -> Array:
        """Of the free numbers, then the linear parameters output by output, shape (n + c p, n + c p)."""
        return np.asarray(self.root @ self.root.T)


def posterior(problem: Problem, refinement: Refinement) -> Posterior:
    """Find the distribution of the parameters of a fit.

    Args:
      problem: what was fitted, all lines.
      refinement: its optimum.
    """
    free = free_numbers(refinement.sections)
    linear = linear_parameters(refinement.fit, problem.feedthrough)
    turn = coefficient_slopes(free)
    rows = [design_rows(refinement.sections, each, problem.feedthrough, refinement.fit) for each in problem.experiments]
    inputs, outputs = problem.experiments[0].inputs.shape[1], linear.shape[1]
    wishes = None
    if problem.penalty is not None:
        wishes = penalty_rows(refinement.sections, problem.penalty, inputs, problem.feedthrough, refinement.fit)
    residuals = _residuals(problem, refinement, outputs)
    stacked, powers, plain_powers = [], [], []
    for output in range(outputs):
        designs = [_design(by_linear, slopes[output] @ turn, output, linear) for by_linear, slopes in rows]
        measured = np.concatenate(designs)
        whole = measured
        if wishes is not None and problem.penalty is not None:
            wished = _design(wishes[0], wishes[1][output] @ turn, output, linear)
            pull = np.sqrt(problem.penalty.pull / outputs) * np.eye(free.size, wished.shape[1])
            whole = np.concatenate([measured, wished, pull])
        leverage = np.sum(_factors(whole)[0][: len(measured)] ** 2, axis=1)
        by_line = _powers(leverage, residuals[output])
        variance = float(np.mean(np.concatenate(by_line)))
        stacked.append(whole)
        powers += [*(np.tile(each, 2) for each in by_line), np.full(len(whole) - len(measured), variance)]
        plain_powers.append(np.full(len(whole), variance))
    space, back = _factors(np.concatenate(stacked))
    root, plain_root = (back @ _root(space, np.concatenate(each)) for each in (powers, plain_powers))
    spread, plain = np.sum(root**2, axis=1), np.sum(plain_root**2, axis=1)
    inflation = float(np.median(spread[plain > 0] / plain[plain > 0]))
    return Posterior(free, linear, root, inputs, problem.feedthrough, inflation)


def _residuals(problem: Problem, refinement: Refinement, outputs: int) -> list[list[Array]]:
    """Output → experiment → residuals, real over imaginary parts."""
    counts = [2 * each.lag.size for each in problem.experiments]
    by_output = refinement.fit.residuals.reshape(outputs, -1)
    return [np.split(rows[: sum(counts)], np.cumsum(counts)[:-1]) for rows in by_output]


def _design(by_linear: Array, by_free: Array, output: int, linear: Array) -> Array:
    """One output's rows of the Jacobian over all parameters."""
    design = np.zeros((len(by_linear), by_free.shape[1] + linear.size))
    design[:, : by_free.shape[1]] = by_free
    start = by_free.shape[1] + output * len(linear)
    design[:, start : start + len(linear)] = by_linear
    return design


def _factors(design: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis U of a design's columns, shape (rows, k), and B of its pseudo-inverse B Uᵀ.

    Directions of the parameters that nothing determines are left out: they get no variance.
    """
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    basis, triangle = np.linalg.qr(design / scale)
    left, values, right = np.linalg.svd(triangle, full_matrices=False)
    kept = values > _NOTHING * values.max(initial=0.0)
    return basis @ left[:, kept], (right[kept].T / values[kept]) / scale[:, None]


def _root(basis: Array, power: Array) -> Array:
    """Return a root of Uᵀ diag(power) U, shape (k, k)."""
    values, vectors = np.linalg.eigh(basis.T @ (power[:, None] * basis))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _powers(leverage: Array, residuals: Sequence[Array]) -> list[Array]:
    """Mean square of each experiment's residual, real and imaginary part, around each line, shape (F,) each."""
    kept = 1 - np.minimum(leverage, _LARGEST_LEVERAGE)
    powers = []
    for square in np.split(np.concatenate(residuals) ** 2 / kept, np.cumsum([each.size for each in residuals])[:-1]):
        lines = square.size // 2
        width = 2 * max(2, round(np.sqrt(lines) / 2)) + 1
        each = 0.5 * (square[:lines] + square[lines:])
        # Mirrored, since the first lines hold most of a step and must not be weighed by one of them alone.
        smooth = uniform_filter1d(each, width, mode="reflect")
        powers.append(np.maximum(smooth, _wander(each, width)))
    return powers


def _wander(squares: Array, width: int) -> Array:
    """Return the power of a slow wander of the output at each line, shape (F,): a power law, zero if there is none.

    Its lowest lines, on which the steady gain rests, stand so far above their neighbours that a mean around them hides
    them, and the fit has taken much of what is there; so the law of the lines above is continued.
    """
    edges = [each for each in _OCTAVES if each <= min(squares.size, width)]
    if len(edges) < 3:
        return np.zeros_like(squares)
    means = np.array([squares[low - 1 : high - 1].mean() for low, high in pairwise(edges)])
    if not np.all(means > 0):
        return np.zeros_like(squares)
    centres = np.log([np.sqrt(low * high) for low, high in pairwise(edges)])
    weights = np.sqrt([high - low for low, high in pairwise(edges)])
    slope, level = np.polyfit(centres, np.log(means), 1, w=weights)
    if slope > -_STEEP:
        return np.zeros_like(squares)
    line = np.arange(1, squares.size + 1)
    law = np.exp(level + max(slope, -_STEEPEST) * np.log(line))
    return np.where(line < edges[-1], law, 0.0)


def standard_deviations(known: Posterior, function: Callable[[Posterior], Array]) -> Array:
    """Return the standard deviations of what is computed from the parameters, by the delta method.

    Args:
      known: the parameters.
      function: of them, to an array of any shape.

    Returns:
      Same shape as the function's.
    """
    jacobian = _slopes(known, function, known.free.size + known.linear.size)
    return np.asarray(np.linalg.norm(np.tensordot(jacobian, known.root, (0, 0)), axis=-1))


def _slopes(known: Posterior, function: Callable[[Posterior], Array], count: int) -> Array:
    """Differentiate a function by the first few parameters, shape (count, …)."""
    slopes = []
    point = np.concatenate([known.free, known.linear.T.reshape(-1)])
    for index in range(count):
        step = _STEP * max(1.0, abs(point[index]))
        sides = [function(_moved(known, point, index, sign * step)) for sign in (1.0, -1.0)]
        slopes.append((sides[0] - sides[1]) / (2 * step))
    return np.stack(slopes)


def interval(value: Array, deviation: Array, level: float = 0.95) -> tuple[Array, Array]:
    """Return the two ends of a normal interval; value, deviation and ends have one shape."""
    half = ndtri(0.5 + level / 2) * deviation
    return value - half, value + half


def _moved(known: Posterior, point: Array, index: int, step: float) -> Posterior:
    moved = point.copy()
    moved[index] += step
    return _at(known, moved)


def _at(known: Posterior, point: Array) -> Posterior:
    linear = point[known.order :].reshape(known.linear.shape[1], -1).T
    return known._replace(free=point[: known.order], linear=linear)


def transfer(known: Posterior, lag: ComplexArray) -> ComplexArray:
    """Return the transfer function without its delay at points z⁻¹ = `lag`, shape (P, p, m)."""
    sections = sections_from_numbers(known.free)
    columns = transfer_columns(sections, lag, known.inputs, known.feedthrough)
    return np.stack([each @ known.linear for each in columns], axis=2)


def steady_gain(known: Posterior) -> Array:
    """Return the steady output per steady input, shape (p, m)."""
    return np.asarray(transfer(known, np.ones(1, np.complex128))[0].real)


def pole_deviations(known: Posterior) -> tuple[Poles, Array, Array]:
    """Return the poles, section by section, and the deviations of their real and imaginary parts, shape (n,) each."""
    real, imaginary = np.linalg.norm(pole_slopes(known) @ known.root[: known.order], axis=2).T
    return section_poles(sections_from_numbers(known.free)), real, imaginary


def pole_slopes(known: Posterior) -> Array:
    """Return ∂(real and imaginary part of each pole)/∂(free numbers), shape (n poles, 2, n)."""
    return _slopes(known, _places, known.order).transpose(2, 1, 0)


def _places(known: Posterior) -> Array:
    poles = section_poles(sections_from_numbers(known.free))
    return np.stack([poles.real, poles.imag])


def heard_sections(known: Posterior, sections: Sections) -> list[bool]:
    """Tell for each section whether what it adds to some output is three standard deviations from nothing."""
    heard = []
    for start, section in section_offsets(sections):
        entries = slice(start * known.inputs, (start + section.size) * known.inputs)
        found = False
        for output in range(known.linear.shape[1]):
            place = known.order + output * len(known.linear)
            root = known.root[place + entries.start : place + entries.stop]
            values = known.linear[entries, output]
            distance = _squared_distance(root, values) if np.any(root) else np.inf
            found = found or distance > chdtri(values.size, 1 - _SIGNIFICANT)
        heard.append(found)
    return heard


def _squared_distance(root: Array, values: Array) -> float:
    """Return vᵀ (R Rᵀ)⁺ v."""
    scale = np.linalg.norm(root, axis=1)
    scale[scale == 0] = 1.0
    steps = np.linalg.lstsq(root / scale[:, None], values / scale, rcond=_NOTHING)[0]
    return float(steps @ steps)
