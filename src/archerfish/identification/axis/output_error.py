"""Output error by variable projection (Golub and Pereyra 1973) with Kaufman's Jacobian (1975).

For given poles the outputs are linear in the numerators and in what is specific to a log: transients and levels. These
log-specific regressors are projected out log by log, one factorisation serves all outputs, and Levenberg and
Marquardt's method moves the poles.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack, lstsq

from archerfish.identification.axis.sections import (
    Sections,
    Structure,
    free_numbers,
    section_states,
    sections_of,
    state_matrices,
    theta_slopes,
)
from archerfish.identification.axis.spectrum import Lines
from archerfish.identification.simulation import TINY, Array, Complex
from archerfish.records.plant import PlantRecord

_LARGEST = 8.5  # |θ|; its tanh is 1 − 8e−8
_ROUNDING = 1e-18  # of a input regressor's power, up to which what log-specific regressors leave of it is rounding


class LogFactors(NamedTuple):
    """Of one log: its sections' states, and the QR factorisation of its k log-specific regressors."""

    states: Complex  # (n, F)
    inverses: list[Complex]  # of the sections' denominators, (F,) each
    basis: Array  # (R, k)
    triangle: Array  # (k, k)
    outputs: Array  # coefficients of the outputs in the basis, (p, k)
    driven: Array  # of the input regressors, (c, k)


class LinearFit(NamedTuple):
    """Linear least squares for given poles, c input regressors, and R real rows of all logs together."""

    sections: Sections
    cost: float  # sum of the squared residual
    numerators: Array  # as of `sections.response`, (c, p)
    residual: Array  # (p, R)
    basis: Array  # of the input regressors, (R, c)
    logs: list[LogFactors]  # one each


def solve(sections: Sections, data: list[Lines]) -> LinearFit:
    """Fit the numerators and each log's log-specific regressors to all outputs for given poles."""
    columns, outputs, logs = [], [], []
    for lines in data:
        states, inverses, x, own = _columns(sections, lines)
        y, (q, triangle) = _real(lines.outputs), _factorised(own)
        logs.append(LogFactors(states, inverses, q, triangle, y @ q, x @ q))
        left = x - logs[-1].driven @ q.T
        # An input that moves in the first samples alone is what a transient is.
        columns.append(left * (_squares(left) > _ROUNDING * _squares(x))[:, None])
        outputs.append(y - logs[-1].outputs @ q.T)
    X, Y = np.concatenate(columns, 1), np.concatenate(outputs, 1)
    Q, triangle = _factorised(X)
    if _is_regular(triangle):
        numerators, residual = lapack.dtrtrs(triangle, Q.T @ Y.T)[0], Y - (Y @ Q) @ Q.T
    else:  # columns depend on each other, as those of equal poles
        size = np.maximum(np.sqrt(_squares(X)), TINY)
        numerators = lstsq(X.T / size, Y.T, lapack_driver="gelsy", cond=1e-11)[0] / size[:, None]
        residual = Y - numerators.T @ X
    return LinearFit(sections, float(np.vdot(residual, residual)), numerators, residual, Q, logs)


def project(fit: LinearFit, columns: Sequence[Complex]) -> Array:
    """Return columns less what both kinds of regressors explain, shape (k, R).

    Args:
      fit: whose columns are projected out.
      columns: of each log, shape (k, F).
    """
    rows = [_real(column) for column in columns]
    own_removed = [x - (x @ log.basis) @ log.basis.T for x, log in zip(rows, fit.logs, strict=True)]
    every = np.concatenate(own_removed, 1)
    return np.asarray(every - (every @ fit.basis) @ fit.basis.T)


def jacobian(fit: LinearFit, data: list[Lines], theta: Array) -> Array:
    """Return Kaufman's Jacobian of the residual by the unconstrained parameters of the poles, shape (n, p R).

    It is minus the projected derivative of each section's part ŷ of the fit: ∂ŷ/∂a_i = −zⁱ ŷ / (1 + a₁ z + a₂ z²).

    Args:
      fit: at theta.
      data: that was fitted.
      theta: unconstrained parameters, shape (n,).
    """
    slopes = []
    for lines, log in zip(data, fit.logs, strict=True):
        own = (log.outputs - fit.numerators.T @ log.driven).T
        if len(own):
            own = lapack.dtrtrs(log.triangle, own)[0] if _is_regular(log.triangle) else lstsq(log.triangle, own)[0]
        at, parts = 0, []
        for section, inverse in zip(fit.sections, log.inverses, strict=True):
            k, m = slice(at, at + len(section)), len(lines.inputs)
            b = fit.numerators[at * m : (at + len(section)) * m].reshape(len(section), m, -1)
            part = np.einsum("kmp,kf,mf->pf", b, log.states[k] * lines.z, lines.inputs)
            if lines.impulse.size:
                part += own[k].T @ (log.states[k] * lines.impulse)
            part *= inverse * lines.z
            parts += [part, part * lines.z][: len(section)]
            at += len(section)
        slopes.append(np.concatenate(parts))
    by_coefficients = project(fit, slopes).reshape(len(theta), -1)
    return np.asarray(theta_slopes(theta) @ by_coefficients)


def leverage(fit: LinearFit, data: list[Lines]) -> list[Array]:
    """Return the share of the noise at each line that a fit takes out of its residual, of each log, shape (p, F).

    Args:
      fit: of the data.
      data: lines of all logs, then soft constraints.
    """
    slopes = np.linalg.qr(jacobian(fit, data, free_numbers(fit.sections)).T)[0]
    driven = np.sum(slopes**2, axis=1).reshape(len(fit.residual), -1) + np.sum(fit.basis**2, axis=1)
    ends = np.cumsum([2 * len(lines.z) for lines in data if lines.impulse.size])
    logs = zip(np.split(driven, ends, axis=1)[:-1], fit.logs, strict=False)
    rows = [shares + np.sum(log.basis**2, axis=1) for shares, log in logs]
    return [shares.reshape(len(shares), -1, 2).mean(axis=2) for shares in rows]


def refine(sections: Sections, data: list[Lines], steps: int, tolerance: float, ridge: float = 0) -> LinearFit:
    """Move the poles by Levenberg and Marquardt's method to a local minimum of the sum of squares.

    Args:
      sections: from which it begins.
      data: lines of all logs, and soft constraints.
      steps: at most.
      tolerance: relative fall of the sum of squares below which it ends.
      ridge: weight of the squared unconstrained parameters in the sum of squares.
    """
    theta, damping = free_numbers(sections), 1e-3
    fit = solve(sections_of(theta), data)
    for _ in range(steps):
        J = jacobian(fit, data, theta)
        hessian = J @ J.T + ridge * np.eye(len(theta))
        gradient = J @ fit.residual.reshape(-1) + ridge * theta
        scale = np.sqrt(np.maximum(np.diag(hessian), TINY))
        hessian, before = hessian / np.outer(scale, scale), fit.cost + ridge * theta @ theta
        for _ in range(8):
            damped = hessian + damping * np.eye(len(theta))
            move = -np.linalg.solve(damped, gradient / scale) / scale
            tried = np.clip(theta + np.clip(move, -2, 2), -_LARGEST, _LARGEST)
            new = solve(sections_of(tried), data)
            after = new.cost + ridge * tried @ tried
            if after < before:
                break
            damping *= 8
        else:
            return fit
        theta, fit, damping = tried, new, max(damping / 10, 1e-9)
        if before - after < tolerance * before:
            return fit
    return fit


def refine_best(
    starts: Sequence[Sections], data: list[Lines], steps: int, tolerance: float, ridge: float = 0
) -> LinearFit:
    """Return the best of the fits from several starts; arguments as of `refine`."""
    return min((refine(start, data, steps, tolerance, ridge) for start in starts), key=cost_of)


def cost_of(fit: LinearFit) -> float:
    """Return the sum of squares, by which fits are compared."""
    return fit.cost


def residuals_by_log(fit: LinearFit, data: list[Lines]) -> list[Complex]:
    """Return the residual at the lines of each log, shape (p, F) each."""
    ends = 2 * np.cumsum([len(lines.z) for lines in data])
    return [np.ascontiguousarray(rows).view(complex) for rows in np.split(fit.residual, ends, axis=1)[:-1]]


def noise_colour(residual: Complex, response: Complex) -> float:
    """Return by how much noise is stronger where a plant responds than on the average, at least 1.

    Such noise is worth as much as so many times fewer white samples.

    Args:
      residual: at the lines of a log, shape (…, F).
      response: of the plant, of the same shape.
    """
    noise, power = np.abs(residual) ** 2, np.abs(response) ** 2
    return max(1.0, float(np.sum(noise * power) / max(np.mean(noise) * np.sum(power), TINY)))


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


def _columns(sections: Sections, lines: Lines) -> tuple[Complex, list[Complex], Array, Array]:
    """Return states and inverses of the sections, and input and log-specific regressors as real rows."""
    states, inverses = section_states(sections, lines.z)
    driven = ((states * lines.z)[:, None] * lines.inputs).reshape(-1, len(lines.z))
    x = _real(np.concatenate([driven, lines.inputs]) if lines.feedthrough else driven)
    transients = states * lines.impulse if lines.impulse.size else lines.own
    return states, inverses, x, _real(np.concatenate([transients, lines.own]))


def _factorised(columns: Array) -> tuple[Array, Array]:
    """QR factorisation of (k, R) transposed; LAPACK alone takes a fifth of the time that NumPy's function takes."""
    if not len(columns):
        return columns.T, columns @ columns.T
    packed, scales, *_ = lapack.dgeqrf(columns.T)
    return lapack.dorgqr(packed, scales)[0], packed[: len(columns)] * _upper(len(columns))


@cache
def _upper(size: int) -> Array:
    return np.triu(np.ones((size, size)))


def _is_regular(triangle: Array) -> bool:
    """Whether the columns of a triangular matrix are independent."""
    return bool(np.all(np.diag(triangle) ** 2 > 1e-22 * _squares(triangle.T)))


def _squares(rows: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", rows, rows))


def _real(x: Complex) -> Array:
    """Real and imaginary parts as rows: (k, F) → (k, 2 F)."""
    return np.ascontiguousarray(x).view(float)
