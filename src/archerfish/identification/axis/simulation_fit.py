"""What is linear once the poles are known: numerators, feedthrough and initial states, by simulation least squares.

With poles in parallel sections an output of an experiment is, line by line,

    Y = Σ_sections (b₁ z⁻¹ + b₂ z⁻²) / (1 + a₁ z⁻¹ + a₂ z⁻²) U + D U  +  Σ_sections (t₁ + t₂ z⁻¹) / (1 + …),

b and D shared by all experiments, t (the transient) each experiment's own. The own columns are projected out experiment
by experiment, so that the cost grows with the number of samples and not with the square of the number of experiments.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from archerfish.identification.axis.modal_form import Sections, section_offsets
from archerfish.identification.axis.rest_start import (
    SectionEnd,
    driven_transients,
    section_ends,
    slope_transients,
)
from archerfish.identification.axis.spectra import Spectrum, real_rows

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_WELL_CONDITIONED, _VERY_WELL_CONDITIONED = 1e-5, 1e-2


class Penalty(NamedTuple):
    """Squares that are added to the simulation error: linear wishes about the transfer function."""

    lag: ComplexArray
    """z⁻¹ of the points at which wishes are made, shape (P,)."""
    rows: tuple[Array, ...]
    """Per input j the weights of real over imaginary parts of G_j at the points, shape (R_j, 2 P)."""
    targets: tuple[Array, ...]
    """Per input what the weighted sums should be, shape (R_j, p)."""
    pull: float = 0.0
    """Weight of the squared free numbers of the poles, for `pole_refinement`."""


class LinearFit(NamedTuple):
    """Least-squares estimate for given poles, and what a search over the poles needs."""

    numerators: Array
    """b of all sections in order, shape (n, m, p)."""
    feedthrough: Array
    """D, shape (m, p)."""
    residuals: Array
    """Real rows of all experiments, output by output, then the penalty's; shape (R,)."""
    slopes: Array
    """∂(model)/∂(section coefficients), projected off all linear parameters, shape (R, n)."""
    misfit: float
    """Sum of squared simulation errors, without the penalty."""

    @property
    def cost(self) -> float:
        """Sum of squared simulation errors, and the penalty."""
        return float(self.residuals @ self.residuals)


class Span(NamedTuple):
    """Orthonormal basis of the columns of a matrix, blind to directions that rounding alone tells apart."""

    basis: Array
    """Shape (R, r)."""
    recover: Array
    """From coordinates in the basis to coefficients of the columns, shape (columns, r)."""

    def coefficients(self, target: Array) -> Array:
        """Return the least-squares coefficients of the columns for targets, shape (R,) or (R, k)."""
        return np.asarray(self.recover @ (self.basis.T @ target))

    def remove(self, signals: Array) -> Array:
        """Return what of the signals, shape (R,) or (R, k), is orthogonal to the columns."""
        return np.asarray(signals - self.basis @ (self.basis.T @ signals))


class _Columns(NamedTuple):
    """One experiment's columns for given poles."""

    inverse: list[ComplexArray]
    """1 / (1 + a₁ z⁻¹ + a₂ z⁻²) per section, shape (F,) each."""
    own: ComplexArray
    """Transients, shape (F, n)."""
    driven: ComplexArray
    """Responses through each b (section entry by section entry, input by input), then through D, shape (F, c)."""
    ends: Sequence[SectionEnd] = ()
    """Of the sections, in an experiment that begins at rest: its transients are no parameters, and `own` is empty."""
    basis: ComplexArray | None = None
    """Transients of the sections, likewise; shape (F, n), scaled."""


def fit_linear_parameters(
    sections: Sections,
    experiments: Sequence[Spectrum],
    feedthrough: bool,
    penalty: Penalty | None = None,
    *,
    with_slopes: bool = True,
) -> LinearFit:
    """Estimate everything but the poles by least squares on the simulated output.

    Args:
      sections: the poles, as stable sections.
      experiments: of one axis, m inputs and p outputs each.
      feedthrough: whether D is estimated; it is zero otherwise.
      penalty: added to the squared errors.
      with_slopes: whether `slopes` are wanted; left empty otherwise, for speed.
    """
    inputs, outputs = experiments[0].inputs.shape[1], experiments[0].outputs.shape[1]
    columns = [_experiment_columns(sections, each, feedthrough) for each in experiments]
    targets = [real_rows(each.outputs) for each in experiments]
    wishes = _wishes(sections, penalty, inputs, feedthrough)
    weights, wished = (penalty.rows, penalty.targets) if penalty is not None else ((), ())
    asked = [rows @ real_rows(each.driven) for rows, each in zip(weights, wishes, strict=True)]
    solve = _solve_one if len(experiments) == 1 else _solve_several
    solution = solve(columns, targets, asked, wished)
    common, order = solution.common, sum(section.size for section in sections)
    measured = sum(len(each) for each in targets)
    slopes = np.empty((0, order))
    if with_slopes:
        steep = [
            _slopes(sections, each, experiment.lag, inputs, common, local).reshape(2 * experiment.lag.size, -1)
            for each, experiment, local in zip(columns, experiments, solution.local, strict=True)
        ]
        bent = [
            rows @ _slopes(sections, each, penalty.lag, inputs, common).reshape(2 * penalty.lag.size, -1)
            for rows, each in zip(weights, wishes, strict=True)
            if penalty is not None
        ]
        # Rows × (outputs · n): each output's slopes are projected off the same columns.
        projected = solution.project(steep, bent).reshape(-1, outputs, order)
        slopes = projected.swapaxes(0, 1).reshape(-1, order)
    return LinearFit(
        common[: order * inputs].reshape(order, inputs, outputs),
        common[order * inputs :] if feedthrough else np.zeros((inputs, outputs)),
        solution.residual.T.reshape(-1),
        slopes,
        float(np.sum(solution.residual[:measured] ** 2)),
    )


class _Solution(NamedTuple):
    """Least squares for given poles."""

    common: Array
    """Parameters that the experiments share, shape (c, p)."""
    local: list[Array]
    """Transient of each experiment, shape (n, p) each."""
    residual: Array
    """All rows, those of the wishes last, shape (R, p)."""
    project: Callable[[Sequence[Array], Sequence[Array]], Array]
    """Takes slopes of the experiments' rows and of the wishes', and removes from them what the parameters explain."""


def _solve_one(
    columns: Sequence[_Columns], targets: Sequence[Array], asked: Sequence[Array], wished: Sequence[Array]
) -> _Solution:
    """Solve for one experiment: its transient is a parameter like the others."""
    (each,) = columns
    design = real_rows(np.concatenate([each.driven, each.own], axis=1))
    padded = [np.pad(rows, ((0, 0), (0, each.own.shape[1]))) for rows in asked]
    everything = span(np.concatenate([design, *padded]))
    target = np.concatenate([*targets, *wished])
    found = everything.coefficients(target)
    shared = each.driven.shape[1]

    def project(steep: Sequence[Array], bent: Sequence[Array]) -> Array:
        return everything.remove(np.concatenate([*steep, *bent]))

    return _Solution(found[:shared], [found[shared:]], everything.remove(target), project)


def _solve_several(
    columns: Sequence[_Columns], targets: Sequence[Array], asked: Sequence[Array], wished: Sequence[Array]
) -> _Solution:
    """Solve for several experiments: transients are projected out one by one, so that many experiments cost no more."""
    driven, own = [real_rows(each.driven) for each in columns], [span(real_rows(each.own)) for each in columns]
    left, wanted = ([s.remove(x) for s, x in zip(own, signals, strict=True)] for signals in (driven, targets))
    shared, target = span(np.concatenate([*left, *asked])), np.concatenate([*wanted, *wished])
    common = shared.coefficients(target)
    local = [s.coefficients(y - x @ common) for s, y, x in zip(own, targets, driven, strict=True)]

    def project(steep: Sequence[Array], bent: Sequence[Array]) -> Array:
        return shared.remove(np.concatenate([*(s.remove(x) for s, x in zip(own, steep, strict=True)), *bent]))

    return _Solution(common, local, shared.remove(target), project)


def design_rows(
    sections: Sections, experiment: Spectrum, feedthrough: bool, fit: LinearFit
) -> tuple[Array, list[Array]]:
    """Differentiate one experiment's model by every parameter, and project off its own transient.

    Args:
      sections: the poles.
      experiment: F lines.
      feedthrough: whether D is estimated.
      fit: at these poles.

    Returns:
      By the linear parameters of an output (b, then D), shape (2 F, c); and per output by the section coefficients,
      shape (2 F, n) each.
    """
    columns = _experiment_columns(sections, experiment, feedthrough)
    own, driven = span(real_rows(columns.own)), real_rows(columns.driven)
    common = linear_parameters(fit, feedthrough)
    local = own.coefficients(real_rows(experiment.outputs) - driven @ common)
    slopes = _slopes(sections, columns, experiment.lag, experiment.inputs.shape[1], common, local)
    return own.remove(driven), [own.remove(each) for each in slopes.swapaxes(0, 1)]


def penalty_rows(
    sections: Sections, penalty: Penalty, inputs: int, feedthrough: bool, fit: LinearFit
) -> tuple[Array, list[Array]]:
    """Return what `design_rows` does, of the penalty: shape (R, c), and (R, n) per output."""
    wishes = _wishes(sections, penalty, inputs, feedthrough)
    common = linear_parameters(fit, feedthrough)
    driven = [rows @ real_rows(each.driven) for rows, each in zip(penalty.rows, wishes, strict=True)]
    slopes = [_slopes(sections, each, penalty.lag, inputs, common) for each in wishes]
    outputs = common.shape[1]
    by_output = [
        np.concatenate([rows @ each[:, output] for rows, each in zip(penalty.rows, slopes, strict=True)])
        for output in range(outputs)
    ]
    return np.concatenate(driven), by_output


def linear_parameters(fit: LinearFit, feedthrough: bool) -> Array:
    """Return b and, if it was estimated, D of every output in the order of the columns, shape (c, p)."""
    numerators = fit.numerators.reshape(-1, fit.numerators.shape[-1])
    return np.concatenate([numerators, fit.feedthrough]) if feedthrough else numerators


def transfer_columns(sections: Sections, lag: ComplexArray, inputs: int, feedthrough: bool) -> list[ComplexArray]:
    """Per input the transfer function's derivative by b and D at points z⁻¹ = `lag`, shape (P, c) each."""
    return [_columns(sections, lag, unit, feedthrough).driven for unit in _units(lag.size, inputs)]


def _wishes(sections: Sections, penalty: Penalty | None, inputs: int, feedthrough: bool) -> list[_Columns]:
    if penalty is None:
        return []
    return [_columns(sections, penalty.lag, unit, feedthrough) for unit in _units(penalty.lag.size, inputs)]


def _units(count: int, inputs: int) -> list[ComplexArray]:
    """Per input a unit signal there and nothing in the others, shape (count, m) each."""
    return [np.tile(row, (count, 1)) for row in np.eye(inputs, dtype=np.complex128)]


def _experiment_columns(sections: Sections, experiment: Spectrum, feedthrough: bool) -> _Columns:
    columns = _columns(sections, experiment.lag, experiment.inputs, feedthrough)
    own = columns.own * experiment.impulse[:, None]
    drift = own[:, :0] if experiment.drift is None else experiment.drift
    if experiment.rest is None:
        return columns._replace(own=np.concatenate([own, drift], axis=1))
    ends, basis = section_ends(sections, experiment.rest), experiment.rest.unit * own
    driven, transients = columns.driven.copy(), driven_transients(sections, ends, 1.0)
    driven[:, : len(transients)] += basis @ transients.T
    return columns._replace(own=drift, driven=driven, ends=ends, basis=basis)


def _columns(sections: Sections, lag: ComplexArray, inputs: ComplexArray, feedthrough: bool) -> _Columns:
    inverse = [1 / (1 + lag * (s[0] if s.size == 1 else s[0] + s[1] * lag)) for s in sections]
    own = np.stack([r * lag if i else r for s, r in zip(sections, inverse, strict=True) for i in range(s.size)], axis=1)
    driven = ((own * lag[:, None])[:, :, None] * inputs[:, None, :]).reshape(lag.size, -1)
    return _Columns(inverse, own, np.concatenate([driven, inputs], axis=1) if feedthrough else driven)


def _slopes(
    sections: Sections, columns: _Columns, lag: ComplexArray, inputs: int, common: Array, local: Array | None = None
) -> Array:
    """Differentiate the model by every aᵢ, −z⁻ⁱ S / (1 + …) for a section's output S; shape (2 F, p, n)."""
    parts = []
    for (start, section), inverse in zip(section_offsets(sections), columns.inverse, strict=True):
        stop = start + section.size
        entries = slice(start * inputs, stop * inputs)
        output = columns.driven[:, entries] @ common[entries]
        if local is not None and columns.basis is None:
            output = output + columns.own[:, start:stop] @ local[start:stop]
        filtered = -output * (inverse * lag)[:, None]
        parts += [filtered * lag[:, None] if power else filtered for power in range(section.size)]
    slopes = np.stack(parts, axis=2)
    if columns.basis is not None:
        order = slopes.shape[2]
        numerators = common[: order * inputs].reshape(order, inputs, -1)
        slopes -= np.einsum("fj,pij->fpi", columns.basis, slope_transients(sections, columns.ends, 1.0, numerators))
    return real_rows(slopes)


def span(columns: Array) -> Span:
    """Orthonormalise columns, shape (R, c).

    Cholesky's factor of the Gram matrix, applied twice where once leaves rounding, is as good as Householder's QR and
    several times faster as long as the columns are not nearly dependent.
    """
    if not columns.shape[1]:
        return Span(columns, np.zeros((0, 0)))
    scale = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    scale[scale == 0] = 1.0
    scaled = columns / scale
    try:
        first = np.linalg.cholesky(scaled.T @ scaled).T
        smallest = np.diag(first).min()
        if smallest > _WELL_CONDITIONED:
            once = np.linalg.inv(first)
            basis = scaled @ once
            if smallest > _VERY_WELL_CONDITIONED:
                return Span(basis, once / scale[:, None])
            twice = np.linalg.inv(np.linalg.cholesky(basis.T @ basis).T)
            return Span(basis @ twice, once @ twice / scale[:, None])
    except np.linalg.LinAlgError:
        pass  # nearly dependent
    return _careful_span(scaled, scale)


def _careful_span(scaled: Array, scale: Array) -> Span:
    basis, triangle, pivot = qr(scaled, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    # Poles close to one another give columns that differ by rounding only; such directions are left at zero.
    rank = int(np.count_nonzero(size > 1e-11 * size[0]))
    recover = np.zeros((scaled.shape[1], rank))
    recover[pivot[:rank]] = solve_triangular(triangle[:rank, :rank], np.eye(rank))
    return Span(basis[:, :rank], recover / scale[:, None])
