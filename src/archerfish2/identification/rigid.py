"""A rigid axis from logs of its torque and angle, eqs (1)–(3): inertia, damping, gravity and Coulomb friction.

    inertia θ̈ + damping θ̇ + friction sign θ̇ + gravity_moment sin(θ − gravity_phase) = torque + torque_offset

Output error: parameters and initial states of all segments of the logs are those whose simulation, from the torque
alone, is nearest to what was measured. An axis under torque alone drifts away from any simulation, hence segments.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import sparse
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import lfilter, savgol_filter

from archerfish2.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish2.errors import InputError
from archerfish2.identification.simulation import Array
from archerfish2.identification.statistics import long_run_covariance
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Finding, Log, Recording
from archerfish2.logs.stamps import resampled
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate, Table

_UNITS = {"inertia": "kg m²", "damping": "N m s/rad", "gravity_moment": "N m", "gravity_phase": "rad"}
_UNITS |= {"torque_offset": "N m", "friction": "N m"}
_FREE, _DRY = {"pitch": [0, 1, 2, 3], "yaw": [0, 1, 4]}, 5
Source = str | Path | Log | Recording
"""Which of these are estimated; a fit has moment · cos phase and moment · sin phase in place of moment and phase."""
_FINE_S = 5e-3  # longest step with friction: within it the axis can't both stop and break free
_SMOOTH_S = 0.1  # over which an angle is nearly a parabola
_SIZES = (0.01, 0.1)  # of the largest torque, from which the friction is searched
_EVIDENCE = 6.0  # that friction must gain beyond the BIC, in twice the log odds: strong (Kass and Raftery 1995)
_FEWEST, _LONGEST_MEMORY, _AGREE, _USABLE_PERCENT = 50, 0.97, 0.1, 80.0
_PER_RADIAN = {"degrees": 180 / math.pi, "turns": 0.5 / math.pi, "counts of 8192": 4096 / math.pi}
_MISSING = "record a log that speeds up and slows down, and for pitch one that moves slowly through the whole travel"


class Segments(NamedTuple):
    """S stretches of logs of L samples; p outputs: the angle, then the rate where it is used."""

    torque: Array  # [N m], (S, L)
    outputs: Array  # [rad], [rad/s], (S, L, p)
    period_s: float  # sampling period [s]


class Fit(NamedTuple):
    """Parameters whose simulation is nearest to the outputs; k of them are free."""

    free: list[int]
    values: Array  # (6,)
    starts: Array  # initial angle and rate of each segment, (S, 2)
    scale: Array  # root mean square of the residual of each output, (p,)
    residual: Array  # simulated less measured, over the scale, (S, L, p)
    slopes: Array  # of the residual in the free parameters, less what initial states explain, (S, L, p, k)


@dataclass(frozen=True)
class RigidResult:
    """An identified rigid axis."""

    estimates: dict[str, Estimate]  # by name, as in the equation of motion
    fits: tuple[tuple[str, float], ...]  # of the angle of each recording, segment by segment [%]
    findings: tuple[Finding, ...]
    report: Report


def identify_rigid(
    logs: Sequence[Source],
    kind: Literal["pitch", "yaw"],
    *,
    torque_per_unit: float = 1.0,
    segment_s: float = 2.0,
    friction: Literal["auto", "none", "coulomb"] = "auto",
    rate: str | None = None,
) -> RigidResult:
    """Identify inertia, damping and gravity (pitch) or torque offset (yaw) of a rigid axis.

    Args:
      logs: files with the columns time_s, torque and angle, or logs and recordings whose first output is the angle;
        what is in degrees by its name is turned into radians.
      kind: whether gravity acts.
      torque_per_unit: torque per unit of the input, of a motor's current its torque constant [N m].
      segment_s: longest stretch that is simulated from one initial state [s].
      friction: whether Coulomb friction is estimated; "auto" does if the BIC is strongly for it.
      rate: name of a measured rate to use, too; "-NAME" turns its sign.

    Raises:
      InputError: if a log can't be used, rate and angle contradict each other, or the logs leave a parameter open.
    """
    if not (logs and 0 < abs(torque_per_unit) < math.inf and 0.05 <= segment_s < math.inf):
        got = f"got {len(logs)}, {torque_per_unit:g} and {segment_s:g} s; correct it"
        raise InputError(f"identify_rigid: expected logs, torque_per_unit ≠ 0 and segment_s of 0.05 s or more, {got}")
    recordings, findings = _read(logs, rate)
    period_s, sources = recordings[0].period_s, ", ".join(each.source for each in recordings)
    length = min(len(each) // math.ceil(len(each) * period_s / segment_s - 1e-6) for each in recordings)
    parts = [len(each) // length for each in recordings]
    cut = [each.slice(0, part * length) for each, part in zip(recordings, parts, strict=True)]
    torque = torque_per_unit * np.concatenate([each.inputs.reshape(-1, length) for each in cut])
    outputs = np.concatenate([each.outputs.reshape(part, length, -1) for each, part in zip(cut, parts, strict=True)])
    segments = Segments(torque, outputs, period_s)
    if rate:
        _check_rate(segments, sources, rate)
    fit = _fit(segments, _FREE[kind], *_first_guess(segments, _FREE[kind], sources))
    if friction != "none":
        sizes = np.array(_SIZES) * np.ptp(torque) / 2
        tried = [_fit(segments, [*fit.free, _DRY], np.append(fit.values[:_DRY], each), fit.starts) for each in sizes]
        dry = min(tried, key=lambda each: float(np.prod(each.scale)))
        fit = dry if friction == "coulomb" or _pays(fit, dry) else fit
    estimates = _estimates(fit)
    errors = np.split(fit.residual[..., 0] * fit.scale[0], np.cumsum(parts)[:-1])
    fits = {each.source: _percent(each.outputs[:, 0], left) for each, left in zip(cut, errors, strict=True)}
    wide = [name for name, (value, low, high, _) in estimates.items() if high - low > abs(value)]
    reasons = [f"{name} is hardly determined: {_MISSING}" for name in wide if name in ("inertia", "gravity_moment")]
    reasons += [f"the model misses part of {name}: other friction, backlash or units" for name, each in fits.items() if each < _USABLE_PERCENT]
    doubts = ["damping and friction are hardly separated"] * ("damping" in wide)
    rows = (*estimates.items(), *((f"fit of {name} [%]", each) for name, each in fits.items()))
    table = Table("Parameters", ("", "value"), rows)
    headline = f"inertia {estimates['inertia'].value:.4g} kg m², damping {estimates['damping'].value:.4g} N m s/rad"
    report = Report(f"Rigid {kind} axis", headline, not reasons, tuple(reasons), doubts=tuple(doubts), tables=(table,), findings=findings)
    return RigidResult(estimates, fits, findings, report)


def _read(logs: Sequence[Source], rate: str | None) -> tuple[list[Recording], tuple[Finding, ...]]:
    """Return recordings of torque, angle and rate in radians, and findings of their logs."""
    name, found = (rate or "").removeprefix("-"), list[Recording]()
    signals: Any = {"inputs": "torque", "outputs": ("angle", name) if name else "angle"}
    read = [read_log(each, **signals) if isinstance(each, str | Path) else each for each in logs]
    for each in [each for log in read for each in (log.recordings if isinstance(log, Log) else (log,))]:
        names = (each.output_names[0], *(other for other in each.output_names[1:] if other == name))
        if len(each) < _FEWEST or (name and len(names) == 1):
            expected = f"expected at least {_FEWEST} samples of {name or names[0]}, got {len(each)} of {each.output_names}"
            raise InputError(f"{each.source}: {expected}; record longer or name another rate")
        scale = [math.pi / 180 * (-1) ** (rate != name) if "deg" in ..]
        outputs = each.outputs[:, [each.output_names.index(other) for other in names]] * scale
        found.append(resampled(replace(each, outputs=outputs, output_names=names), found[0].period_s if found else each.period_s))
    return found, tuple(finding for log in read if isinstance(log, Log) for finding in log.findings)


def _check_rate(segments: Segments, sources: str, rate: str) -> None:
    """Refuse a rate that is not the angle's derivative; the angle is regressed on the rate's integral, which is smooth."""
    turned = cumulative_trapezoid(segments.outputs[..., 1], dx=segments.period_s, axis=1, initial=0.0)
    turned, angle = (each - each.mean(axis=1, keepdims=True) for each in (turned, segments.outputs[..., 0]))
    product, power = np.sum(turned * angle), np.sum(turned**2)
    slope, explained = power / product, product**2 / (power * np.sum(angle**2))
    sizes = {"": 1.0} | {f"the rate is in {unit} per second": size for unit, size in _PER_RADIAN.items()}
    sizes |= {f"the angle is in {unit}": 1 / size for unit, size in _PER_RADIAN.items()}
    meanings = [text for text, size in sizes.items() if abs(abs(slope) / size - 1) <= _AGREE] or ["no usual unit explains it"]
    meanings = [*filter(None, meanings), *["its sign is turned"] * bool(slope < 0)] if explained > 0.5 else ["it is of another axis"]
    if meanings:
        problem = f'rate "{rate}" is {slope:.4g} times the derivative of the angle, expected 1: {" and ".join(meanings)}'
        raise InputError(f'{sources}: {problem}; correct it ("-{rate}" turns its sign), or leave it out', "rate")


def _first_guess(segments: Segments, free: list[int], sources: str) -> tuple[Array, Array]:
    """Estimate parameters (6,) and initial states (S, 2) by regression of the acceleration, from local parabolas."""
    window = min(max(2 * round(_SMOOTH_S / segments.period_s / 2) + 1, 5), 2 * (segments.torque.shape[1] // 2) - 1)
    smooth = partial(savgol_filter, segments.outputs[..., 0], window, 2, delta=segments.period_s)
    angle, rate, acceleration = (smooth(deriv=order) for order in range(3))
    terms = [segments.torque, -rate, -np.sin(angle), np.cos(angle), np.ones_like(angle)]
    columns = np.stack([terms[each] for each in free], axis=-1).reshape(-1, len(free))
    scale = np.linalg.norm(columns, axis=0) + 1e-300
    phi, values = np.linalg.lstsq(columns / scale, acceleration.ravel())[0] / scale, np.zeros(6)
    if not phi[0] > 0:
        remedy = "check that both move and aren't exchanged, and the sign of torque_per_unit"
        raise InputError(f"{sources}: the angle does not accelerate with the torque; {remedy}")
    values[free] = np.append(1.0, phi[1:]) / phi[0]
    return values, np.stack([angle[:, 0], rate[:, 0]], axis=-1)


def _simulate(segments: Segments, values: Array, starts: Array) -> Array:
    """Simulate angle and rate from the torque for parameters B + (6,) and initial states B + (S, 2): B + (S, L, 2)."""
    inertia, damping, cosine, sine, offset, friction = np.moveaxis(values, -1, 0)[..., None]
    # Of m and l only m l² and g / l act: l = 1 m makes m the inertia.
    axis, phase = RigidAxis(inertia, 1.0, damping, np.hypot(cosine, sine) / inertia), np.arctan2(sine, cosine)
    steps = math.ceil(segments.period_s / _FINE_S) if (slides := bool(np.any(friction > 0))) else 1
    step_s, run = segments.period_s / steps, np.empty((segments.torque.shape[1], *starts.shape))
    state = RigidState(starts[..., 0] - phase, starts[..., 1])
    for index, torque in enumerate(segments.torque.T):
        run[index, ..., 0], run[index, ..., 1] = state.angle + phase, state.rate
        for _ in range(steps):
            held = dry_friction(axis, state, torque + offset, friction, step_s) if slides else 0.0
            state = rigid_step(axis, state, torque + offset + held, step_s)
    return np.moveaxis(run, 0, -2)


def _fit(segments: Segments, free: list[int], values: Array, starts: Array) -> Fit:
    """Fit parameters and initial states by least squares, outputs in units of their noise."""
    count, shape, scale = len(free), segments.outputs.shape, segments.outputs.std(axis=(0, 1))
    x = np.concatenate([values[free], starts.ravel()])
    moves = np.vstack([np.eye(count, x.size), np.zeros((2, x.size))])  # each parameter, all angles, all rates
    moves[count, count::2], moves[count + 1, count + 1 :: 2] = 1.0, 1.0
    lowest = np.where(np.isin(np.arange(x.size), [0, *np.flatnonzero(np.equal(free, _DRY))]), 0.0, -np.inf)

    def residual(x: Array) -> Array:
        every = np.tile(values, (*x.shape[:-1], 1))
        every[..., free] = x[..., :count]
        with np.errstate(over="ignore", invalid="ignore"):
            run = _simulate(segments, every, x[..., count:].reshape(*x.shape[:-1], -1, 2))
        return np.asarray((run[..., : shape[-1]] - segments.outputs) / scale)

    def slopes(x: Array) -> Array:
        steps = _STEP * np.append(np.maximum(np.abs(x[:count]), 1e-2 * np.abs(x[:count]).max()), [1, 1])
        runs = residual(np.vstack([x, x + steps[:, None] * moves]))
        return np.moveaxis((runs[1:] - runs[0]), 0, -1).reshape(shape[0], -1, count + 2) / steps

    def jacobian(x: Array) -> Any:
        shared, own = np.split(slopes(x), [count], axis=-1)
        return sparse.hstack([shared.reshape(-1, count), sparse.block_diag(list(own))]).tocsr()

    flat = lambda x: residual(x).ravel()
    for _ in range(shape[-1]):
        found = least_squares(flat, x, jacobian, (lowest, np.inf), x_scale="jac", max_nfev=_EVALUATIONS)
        x, scale = found.x, scale * np.sqrt(np.mean(found.fun.reshape(shape) ** 2, axis=(0, 1)))
    shared, own = np.split(slopes(x), [count], axis=-1)
    basis = np.linalg.qr(own)[0]
    shared -= basis @ (basis.swapaxes(1, 2) @ shared)
    values[free] = x[:count]
    return Fit(free, values, x[count:].reshape(-1, 2), scale, residual(x), shared.reshape(*shape, count))


def _pays(smooth: Fit, dry: Fit) -> bool:
    """Return whether friction pays by the BIC, over as many samples as the residual's memory leaves independent."""
    memory = np.mean(dry.residual[:, 1:] * dry.residual[:, :-1], axis=(0, 1)).clip(0.0, 0.99)
    samples = dry.residual[..., 0].size * (1 - memory) / (1 + memory)
    return bool(2 * np.sum(samples * np.log(smooth.scale / dry.scale)) > np.log(samples.max()) + _EVIDENCE)


def _covariance(fit: Fit) -> Array:
    """Return (JᵀJ)⁻¹ Jᵀ Γ J (JᵀJ)⁻¹ of the free parameters, Γ that of residuals with a memory, shape (k, k).

    Γ is of first order, times the long-run covariance of what that leaves (prewhitening, Andrews and Monahan 1992).
    """
    left, length = fit.residual, fit.residual.shape[1]
    bread = np.linalg.inv(np.einsum("slpi,slpj->ij", fit.slopes, fit.slopes))
    memory = np.mean(left[:, 1:] * left[:, :-1], axis=(0, 1))
    # A level and a trend of its own, fitted to each segment, bias it by −(2 + 4 ρ) / length (Kendall 1954).
    memory = ((memory + 2 / length) / (1 - 4 / length)).clip(-_LONGEST_MEMORY, _LONGEST_MEMORY)
    white = (left[:, 1:] - memory * left[:, :-1]).reshape(-1, len(memory))
    power = max(white.T @ white / len(white), long_run_covariance(white), key=np.trace)
    backward = fit.slopes.reshape(-1, *fit.slopes.shape[2:])[::-1]
    coloured = np.stack([lfilter([1.0], [1.0, -m], backward[:, place], axis=0) for place, m in enumerate(memory)])
    middle = np.einsum("pni,pq,qnj->ij", coloured, power, coloured, optimize=True)
    return np.asarray(bread @ middle @ bread * left.size / (left.size - len(bread) - fit.starts.size))


def _estimates(fit: Fit) -> dict[str, Estimate]:
    """Return the parameters with their intervals."""
    values, turn = fit.values[fit.free], np.eye(len(fit.free))
    if 2 in fit.free:  # from moment · cos phase and moment · sin phase to moment and phase
        (cosine, sine), moment = values[2:4] / np.hypot(*values[2:4]), np.hypot(*values[2:4])
        values[2:4] = moment, np.arctan2(sine, cosine)
        turn[2:4, 2:4] = [[cosine, sine], [-sine / moment, cosine / moment]]
    half = _TWO_SIDED * np.sqrt(np.diag(turn @ _covariance(fit) @ turn.T))
    ends = np.stack([values, values - half, values + half], axis=1).tolist()
    named = [list(_UNITS.items())[place] for place in fit.free]
    return {name: Estimate(*each, unit) for (name, unit), each in zip(named, ends, strict=True)}
