"""Grey-box identification of an axis: inertia, damping and gravity of eqs (1)–(3) from torque and angle.

Non-linear least squares on the simulated output. Each segment of a log starts from a state of its own, which is
estimated along and projected out: an axis under torque alone drifts away from any simulation in the long run, since
whatever the model leaves out adds up. Standard errors hold under coloured residuals. Coulomb friction is estimated too
where the logs are that much better explained with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.rigid.checks import check_rigid_recordings, check_separable, rigid_remarks
from archerfish.identification.rigid.coloured_residuals import coloured_covariance, first_lag
from archerfish.identification.rigid.simulation import Segments, cut_segments, simulate_segments
from archerfish.identification.rigid.start import first_guess, measured_starts
from archerfish.identification.validation.free_run import fit_percent
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording
from archerfish.records.rigid_axis import AxisKind, RigidAxisRecord

Array = NDArray[np.float64]

_TWO_SIDED = 1.959964
Friction = Literal["auto", "none", "coulomb"]
"""Whether Coulomb friction is estimated: where it pays, never, or always."""
_FREE = {"yaw": [0, 1, 4], "pitch": [0, 1, 2, 3]}
"""Which of the parameters φ of `rigid.simulation` are estimated; friction, the last, may be added."""
_DRY = 5
_LITTLE, _TYPICAL = 0.002, 0.08
"""Friction that is tried first, as shares of the largest acceleration by the torque."""
_NAMES = {
    "yaw": ("inertia", "damping", "torque_offset"),
    "pitch": ("inertia", "damping", "gravity_moment", "gravity_phase"),
}
_HINT = 3.0
"""Standard errors by which a little friction must help before its size is sought."""
_ROUNDS = 40
_FEW_ROUNDS = 12
_STEP = 1e-6
_LONGEST_MEMORY = 0.99
_MARGIN = 6.0
"""What friction must gain beyond Bayes's penalty, in twice the log odds: strong evidence (Kass and Raftery 1995)."""
_TINY = 1e-300


@dataclass(frozen=True)
class RigidIdentification:
    """An identified rigid axis and how it came about."""

    record: RigidAxisRecord
    """Parameters with their intervals."""
    simulated: tuple[Array, ...]
    """Per recording the simulated angle [rad] and, where it was measured, rate [rad/s]; shape (N, p)."""
    fit_percent: tuple[float, ...]
    """Fit of each recording's angle [%]."""
    residual_sd: tuple[float, ...]
    """Standard deviation of the residuals of each output."""
    remarks: tuple[str, ...]
    """What may spoil the estimate, each a sentence."""


class _Fit(NamedTuple):
    free: list[int]
    phi: Array
    initial: Array
    residuals: Array
    """Weighted, zero where padded, shape (L, S, p)."""
    slopes: Array
    """Weighted and projected off the initial states, shape (L, S, p, k)."""
    local: Array
    """What recovers the initial states from shared changes, shape (S, 2, k)."""
    towards: Array
    """Change of the initial states with the parameters held, shape (S, 2)."""
    weight: Array
    """Of each output, shape (p,)."""

    @property
    def cost(self) -> float:
        return float(np.sum(self.residuals**2))


def identify_rigid_axis(
    recordings: Sequence[Recording],
    axis_kind: AxisKind,
    *,
    torque_per_unit: float = 1.0,
    segment_s: float = 2.0,
    friction: Friction = "auto",
    axis: str = "axis",
) -> RigidIdentification:
    """Identify a rigid axis.

    Args:
      recordings: the torque (or what is proportional to it) as the one input; the angle [rad] and optionally the rate
        [rad/s] as outputs.
      axis_kind: "yaw" (inertia, damping, torque offset) or "pitch" (inertia, damping, moment and phase of gravity).
      torque_per_unit: torque per unit of the input [N m], for a motor current its torque constant.
      segment_s: longest stretch that is simulated from one initial state [s]; 0 for whole recordings.
      friction: whether Coulomb friction is estimated; "auto" does if Bayes's information criterion is for it.
      axis: name for the record.

    Raises:
      InputError: if a recording can't be used, or the recordings can't separate the parameters.
    """
    check_rigid_recordings(recordings, torque_per_unit, segment_s)
    segments = cut_segments(recordings, torque_per_unit, segment_s)
    free = _FREE[axis_kind]
    phi, initial = first_guess(segments, free)
    spread = np.array([np.std(each) or 1.0 for each in np.moveaxis(segments.outputs, -1, 0)])
    smooth = _weighted(segments, free, phi, initial, 1 / spread)
    dry = None if friction == "none" else _with_friction(segments, free, smooth, friction == "coulomb")
    fit = smooth if dry is None or (friction == "auto" and not _pays(segments, smooth, dry)) else dry
    return _identification(recordings, segments, fit, axis_kind, axis)


def _weighted(segments: Segments, free: list[int], phi: Array, initial: Array, weight: Array) -> _Fit:
    """Fit twice: the outputs count by their noise, which the first fit tells."""
    fit = _minimise(segments, free, phi, initial, weight)
    scale = np.sqrt(np.sum(fit.residuals**2, axis=(0, 1)) / sum(segments.lengths)) / weight
    return _minimise(segments, free, fit.phi, fit.initial, 1 / np.maximum(scale, 1e-9 / weight))


def _with_friction(segments: Segments, free: list[int], smooth: _Fit, asked: bool) -> _Fit | None:
    """Fit with friction; None if not even a little of it helps, and it was not asked for.

    The simulation bends where the axis stops, so the search starts from a size that a little friction's effect
    suggests, and from others.
    """
    strongest = smooth.phi[0] * float(np.abs(segments.torque - segments.torque.mean()).max())
    phi = smooth.phi.copy()
    phi[_DRY] = _LITTLE * strongest
    little = _linearised(segments, [*free, _DRY], phi, smooth.initial, smooth.weight)
    suggested = float(_newton_step(little, 0.0)[-1]) + phi[_DRY]
    flat = little.slopes.reshape(-1, len(free) + 1)
    # As if the residuals were white and had a power of 1, which they have at best.
    error = float(np.sqrt(np.linalg.pinv(flat.T @ flat)[-1, -1]))
    if not asked and suggested < _HINT * error:
        return None
    fits, seen = [], measured_starts(segments)
    for size in {min(max(suggested, _LITTLE * strongest), 0.5 * strongest), _TYPICAL * strongest}:
        phi[_DRY] = size
        fits.append(_minimise(segments, [*free, _DRY], phi.copy(), seen, smooth.weight, _FEW_ROUNDS))
    best = min(fits, key=lambda each: each.cost)
    return _weighted(segments, [*free, _DRY], best.phi, best.initial, smooth.weight)


def _pays(segments: Segments, smooth: _Fit, dry: _Fit) -> bool:
    """Tell by Bayes's information criterion, over as many samples as the residuals' memory leaves independent."""
    left = [np.concatenate(_by_recording(segments, each.residuals / each.weight)) for each in (smooth, dry)]
    memory = first_lag(left[1]).clip(0.0, _LONGEST_MEMORY)
    samples = len(left[0]) * (1 - memory) / (1 + memory)
    power = [np.maximum(np.mean(each**2, axis=0), _TINY) for each in left]
    gained = float(np.sum(samples * np.log(power[0] / power[1])))
    return bool(dry.phi[_DRY] > 0 and gained > np.log(float(samples.max())) + _MARGIN)


def _minimise(
    segments: Segments, free: list[int], phi: Array, initial: Array, weight: Array, rounds: int = _ROUNDS
) -> _Fit:
    """Levenberg–Marquardt over the shared parameters, the initial states following along."""
    fit, damping = _linearised(segments, free, phi, initial, weight), 1e-3
    for _ in range(rounds):
        step = _newton_step(fit, damping)
        trial = fit.phi.copy()
        trial[free] += step
        trial[_DRY] = max(trial[_DRY], 0.0)
        # Where friction stops the axis, the simulation bends in its initial states too.
        moved = fit.initial + (fit.towards - fit.local @ step) / (1 + damping)
        candidate = _linearised(segments, free, trial, moved, weight) if trial[0] > 0 else None
        if candidate is not None and candidate.cost <= fit.cost:
            gained, fit, damping = 1 - candidate.cost / max(fit.cost, 1e-300), candidate, 0.1 * damping
            if gained < 1e-9:
                break
        else:
            damping *= 10
            if damping > 1e8:
                break
    return fit


def _newton_step(fit: _Fit, damping: float) -> Array:
    flat = fit.slopes.reshape(-1, len(fit.free))
    normal, gradient = flat.T @ flat, flat.T @ fit.residuals.ravel()
    return np.asarray(np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), gradient, rcond=None)[0])


def _linearised(segments: Segments, free: list[int], phi: Array, initial: Array, weight: Array) -> _Fit:
    """Simulate with every parameter and initial state moved a little, all in one run."""
    count, channels = len(free), segments.outputs.shape[-1]
    steps = _STEP * np.maximum(np.abs(phi), 1e-2 * np.abs(phi).max())
    phis = np.tile(phi, (count + 3, 1))
    starts = np.tile(initial, (count + 3, 1, 1))
    for row, index in enumerate(free, start=1):
        phis[row, index] += steps[index]
    starts[count + 1, :, 0] += _STEP
    starts[count + 2, :, 1] += _STEP
    run = simulate_segments(segments, phis, starts)[..., :channels]
    kept = np.arange(len(run))[:, None] < np.array(segments.lengths)
    weights = kept[..., None] * weight
    residuals = (segments.outputs - run[:, 0]) * weights
    divisors = np.concatenate([steps[free], [_STEP, _STEP]])
    slopes = np.moveaxis((run[:, 1:] - run[:, :1]) / divisors[:, None, None], 1, -1) * weights[..., None]
    return _project(free, phi, initial, residuals, slopes, weight)


def _project(free: list[int], phi: Array, initial: Array, residuals: Array, slopes: Array, weight: Array) -> _Fit:
    """Take out of the slopes, segment by segment, what the initial state can do as well."""
    count = len(free)
    shared, local = slopes[..., :count].copy(), np.empty((slopes.shape[1], 2, count))
    towards = np.empty((slopes.shape[1], 2))
    for index in range(slopes.shape[1]):
        own = slopes[:, index, :, count:].reshape(-1, 2)
        rows = slopes[:, index, :, :count].reshape(-1, count)
        inverse = np.linalg.pinv(own)
        local[index], towards[index] = inverse @ rows, inverse @ residuals[:, index].ravel()
        shared[:, index] = (rows - own @ local[index]).reshape(shared[:, index].shape)
    return _Fit(free, phi, initial, residuals, shared, local, towards, weight)


def _identification(
    recordings: Sequence[Recording], segments: Segments, fit: _Fit, axis_kind: AxisKind, axis: str
) -> RigidIdentification:
    free, scale = fit.free, 1 / fit.weight
    slopes, residuals = (_by_recording(segments, each) for each in (fit.slopes, fit.residuals))
    if not np.linalg.matrix_rank(np.concatenate(slopes).reshape(-1, len(free))) == len(free):
        raise InputError(
            f"{recordings[0].source}: the parameters of a {axis_kind} axis can't be told apart; "
            "record torque that changes and an angle that follows it"
        )
    stretches = np.bincount(segments.owners).tolist()
    covariance = coloured_covariance(slopes, residuals, stretches, len(free) + 2 * len(segments.lengths))
    values, slope = _physical(fit.phi, axis_kind, _DRY in free)
    errors = np.sqrt(np.diag(slope @ covariance @ slope.T))
    names = (*_NAMES[axis_kind], "friction")[: len(free)]
    estimates = dict(zip(names, values.tolist(), strict=True))
    spread = dict(zip(names, errors.tolist(), strict=True))
    check_separable(recordings, axis_kind, estimates, spread)
    intervals = {
        name: (estimates[name] - _TWO_SIDED * spread[name], estimates[name] + _TWO_SIDED * spread[name])
        for name in names
    }
    simulated = tuple(
        recording.outputs - residual * scale for recording, residual in zip(recordings, residuals, strict=True)
    )
    fits = [
        fit_percent(recording.outputs[:, :1], run[:, :1]).item()
        for recording, run in zip(recordings, simulated, strict=True)
    ]
    return RigidIdentification(
        RigidAxisRecord(axis_kind=axis_kind, axis=axis, standard_errors=spread, intervals=intervals, **estimates),
        simulated,
        tuple(fits),
        tuple((np.concatenate(residuals).std(axis=0) * scale).tolist()),
        tuple(rigid_remarks(estimates, spread, fits)),
    )


def _by_recording(segments: Segments, values: Array) -> list[Array]:
    """Join the segments of each recording again, less their padding; values of shape (L, S, …)."""
    parts: dict[int, list[Array]] = {}
    for index, (owner, length) in enumerate(zip(segments.owners, segments.lengths, strict=True)):
        parts.setdefault(owner, []).append(values[:length, index])
    return [np.concatenate(parts[owner]) for owner in sorted(parts)]


def _physical(phi: Array, axis_kind: AxisKind, dry: bool) -> tuple[Array, Array]:
    """Return the parameters of the record and their slopes in the free φ, shape (k,) and (k, k)."""
    values, slopes = _smooth_physical(phi, axis_kind)
    if not dry:
        return values, slopes
    count, inertia = len(values), 1 / phi[0]
    friction = phi[_DRY] * inertia
    wider = np.zeros((count + 1, count + 1))
    wider[:count, :count] = slopes
    wider[count, [0, count]] = -friction * inertia, inertia
    return np.append(values, friction), wider


def _smooth_physical(phi: Array, axis_kind: AxisKind) -> tuple[Array, Array]:
    """Return them without friction."""
    inertia, damping = 1 / phi[0], phi[1] / phi[0]
    by_inertia = [[-(inertia**2), 0.0], [-damping * inertia, inertia]]
    if axis_kind == "yaw":
        offset = phi[4] * inertia
        slopes = [[*by_inertia[0], 0.0], [*by_inertia[1], 0.0], [-offset * inertia, 0.0, inertia]]
        return np.array([inertia, damping, offset]), np.array(slopes)
    size = max(float(np.hypot(phi[2], phi[3])), 1e-300)
    cosine, sine = phi[2] / size, phi[3] / size
    slopes = [
        [*by_inertia[0], 0.0, 0.0],
        [*by_inertia[1], 0.0, 0.0],
        [-size * inertia**2, 0.0, cosine * inertia, sine * inertia],
        [0.0, 0.0, -sine / size, cosine / size],
    ]
    return np.array([inertia, damping, size * inertia, np.arctan2(phi[3], phi[2])]), np.array(slopes)
