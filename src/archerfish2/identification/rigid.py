"""A rigid axis from logs of its torque and angle, eqs (1)–(3): inertia, damping, gravity and Coulomb friction.

    inertia θ̈ + damping θ̇ + friction sign θ̇ + gravity_moment sin(θ − gravity_phase) = torque + torque_offset

Output error: parameters and initial states of all segments of the logs are those whose simulation, from the torque
alone, is nearest to what was measured. An axis under torque alone drifts away from any simulation, hence segments.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import integrate, linalg, optimize, signal, sparse

from archerfish2.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish2.errors import InputError
from archerfish2.identification.simulation import Array
from archerfish2.identification.sources import Source, read_sources
from archerfish2.identification.statistics import long_run_covariance
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Finding
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate, Table

_UNITS = {"inertia": "kg m²", "damping": "N m s/rad", "gravity_moment": "N m", "gravity_phase": "rad"}
_UNITS |= {"torque_offset": "N m", "friction": "N m"}
_FREE, _DRY = {"pitch": [0, 1, 2, 3], "yaw": [0, 1, 4]}, 5
"""Which of these are estimated."""
_FINE_S, _SMOOTH_S = 5e-3, 0.1  # step within which an axis can't both stop and break free; nearly a parabola
_SIZES, _EVIDENCE = (0.005, 0.05), 6.0
"""Of the torque's range, from which friction is searched; what it must gain beyond the BIC, in twice the log odds."""
_FEWEST, _AGREE, _USABLE_PERCENT = 50, 0.1, 80.0
_PER_RADIAN = {"degrees": 180 / math.pi, "turns": 0.5 / math.pi, "counts of 8192": 4096 / math.pi}
_RECORD = "record a log that speeds up and slows down, and for pitch one that moves slowly through the whole travel"


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


class RigidResult(NamedTuple):
    """An identified rigid axis."""

    estimates: dict[str, Estimate]  # by name, as in the equation of motion
    fits: tuple[tuple[str, float], ...]  # of the angle of each recording, segment by segment [%]
    findings: tuple[Finding, ...]  # of the logs
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
    name = (rate or "").removeprefix("-")
    signals: Any = {"inputs": "torque", "outputs": ("angle", name) if name else "angle"}
    read = read_sources([read_log(each, **signals) if isinstance(each, str | Path) else each for each in logs])
    logged, names, period_s = read.fitted, read.fitted[0].output_names, read.fitted[0].period_s
    places = [0, *(place for place, other in enumerate(names) if place and other == name)]
    fewest, expected = min(map(len, logged)), f"torque_per_unit ≠ 0, segment_s ≥ 0.05, {_FEWEST} samples of each log"
    if not (0 < abs(torque_per_unit) < math.inf and 0.05 <= segment_s < math.inf and fewest >= _FEWEST):
        raise InputError(f"rigid: expected {expected}, got {torque_per_unit:g}, {segment_s:g}, {fewest}; correct it")
    if name and len(places) == 1:
        raise InputError(f"rigid: expected an output {name}, got {', '.join(names)}; name the rate, or leave it out")
    length = min(len(each) // math.ceil(len(each) * period_s / segment_s - 1e-6) for each in logged)
    counts = [len(each) // length for each in logged]
    units = np.array([math.radians(1.0) if "deg" in names[each] else 1.0 for each in places])
    units[1:] *= 1.0 if rate == name else -1.0
    pairs, sources = list(zip(logged, counts, strict=True)), ", ".join(each.source for each in logged)
    torque = torque_per_unit * np.concatenate([log.inputs[: n * length].reshape(n, length) for log, n in pairs])
    outputs = units * np.concatenate([log.outputs[: n * length, places].reshape(n, length, -1) for log, n in pairs])
    segments = Segments(torque, outputs, period_s)
    if rate:
        _check_rate(segments, sources, rate)
    fit = _fit(segments, _FREE[kind], *_first_guess(segments, _FREE[kind], sources))
    if friction != "none":
        begun = [np.append(fit.values[:_DRY], size * np.ptp(torque)) for size in _SIZES]
        tried = [_fit(segments, [*fit.free, _DRY], each, fit.starts, 20) for each in begun]
        dry = min(tried, key=lambda each: float(np.prod(each.scale)))
        if friction == "coulomb" or _pays(fit, dry):
            fit = _fit(segments, dry.free, dry.values, dry.starts)
    errors, angles = (
        np.split(each[..., 0], np.cumsum(counts)[:-1]) for each in (fit.residual * fit.scale, segments.outputs)
    )
    shares = [100 * (1 - float(np.sqrt(np.mean(e**2)) / a.std())) for e, a in zip(errors, angles, strict=True)]
    estimates, fits = _estimates(fit), tuple(zip((each.source for each in logged), shares, strict=True))
    wide = [name for name, (value, low, high, _) in estimates.items() if high - low > abs(value)]
    reasons = tuple(f"{each} is not determined: {_RECORD}" for each in wide if each in ("inertia", "gravity_moment"))
    reasons += tuple(f"the model misses part of {each}" for each, share in fits if share < _USABLE_PERCENT)
    table = Table("Parameters and fits [%]", ("", "value"), (*estimates.items(), *fits))
    headline = ", ".join(f"{each} {found.value:.4g} {found.unit}" for each, found in estimates.items())
    report = Report(f"Rigid {kind} axis", headline, not reasons, reasons, tables=(table,), findings=read.findings)
    return RigidResult(estimates, fits, read.findings, report)


def _check_rate(segments: Segments, sources: str, rate: str) -> None:
    """Refuse a rate that is not the angle's derivative: the angle is regressed on its integral, which is smooth."""
    turned = integrate.cumulative_trapezoid(segments.outputs[..., 1], dx=segments.period_s, initial=0.0)
    turned, angle = (each - each.mean(axis=1, keepdims=True) for each in (turned, segments.outputs[..., 0]))
    product, power = np.sum(turned * angle), np.sum(turned**2)
    slope, explained = power / product, product**2 / (power * np.sum(angle**2))
    sizes = {"": 1.0} | {f"the rate is in {unit} per second; ": size for unit, size in _PER_RADIAN.items()}
    sizes |= {f"the angle is in {unit}; ": 1 / size for unit, size in _PER_RADIAN.items()}
    meaning = next((text for text, size in sizes.items() if abs(abs(slope) / size - 1) <= _AGREE), "no usual unit; ")
    meaning = meaning + "its sign is turned; " * bool(slope < 0) if explained > 0.5 else "it is of another axis; "
    if meaning:
        problem = f'rate "{rate}" is {slope:.4g} times the derivative of the angle, expected 1: {meaning}'
        raise InputError(f'{sources}: {problem}correct it ("-NAME" turns the sign), or leave it out', "rate")


def _first_guess(segments: Segments, free: list[int], sources: str) -> tuple[Array, Array]:
    """Estimate parameters (6,) and initial states (S, 2) by regression of the acceleration, from local parabolas."""
    torque, outputs, period_s = segments
    window = min(max(2 * round(_SMOOTH_S / period_s / 2) + 1, 5), 2 * (torque.shape[1] // 2) - 1)
    angle, rate, acceleration = (signal.savgol_filter(outputs[..., 0], window, 2, each, period_s) for each in range(3))
    columns = np.stack([torque, -rate, -np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=-1)[..., free]
    phi, values = np.linalg.lstsq(columns.reshape(-1, len(free)), acceleration.ravel())[0], np.zeros(6)
    if not (phi[0] > 0 and np.ptp(outputs[..., 0]) > 0):
        raise InputError(
            f"{sources}: the angle does not accelerate with the torque; check columns, torque_per_unit's sign"
        )
    values[free] = np.append(1.0, phi[1:]) / phi[0]
    values[2:4] = np.hypot(*values[2:4]), np.arctan2(values[3], values[2])
    return values, np.stack([angle[:, 0], rate[:, 0]], axis=-1)


def _simulate(segments: Segments, values: Array, starts: Array) -> Array:
    """Simulate angle and rate from the torque for parameters B + (6,) and initial states B + (S, 2): B + (S, L, 2)."""
    inertia, damping, moment, phase, offset, friction = np.moveaxis(values, -1, 0)[..., None]
    # Of m and l only m l² and g / l act: l = 1 m makes m the inertia.
    axis = RigidAxis(inertia, 1.0, damping, moment / inertia)
    steps = math.ceil(segments.period_s / _FINE_S) if (slides := bool(np.any(friction > 0))) else 1
    step_s, run = segments.period_s / steps, np.empty((segments.torque.shape[1], *starts.shape))
    state = RigidState(starts[..., 0] - phase, starts[..., 1])
    for index, torque in enumerate(segments.torque.T):
        run[index, ..., 0], run[index, ..., 1] = state.angle + phase, state.rate
        for _ in range(steps):
            held = dry_friction(axis, state, torque + offset, friction, step_s) if slides else 0.0
            state = rigid_step(axis, state, torque + offset + held, step_s)
    return np.moveaxis(run, 0, -2)


def _fit(segments: Segments, free: list[int], values: Array, starts: Array, evaluations: int = 60) -> Fit:
    """Fit parameters and initial states by least squares, outputs in units of their noise."""
    count, shape, scale = len(free), segments.outputs.shape, segments.outputs.std(axis=(0, 1))
    x, values = np.concatenate([values[free], starts.ravel()]), values.copy()
    moves = linalg.block_diag(np.eye(count), np.tile(np.eye(2), len(starts)))  # each parameter, all angles, all rates
    lowest = np.where(np.isin([*free, *[1] * starts.size], [0, 2, _DRY]), 0.0, -np.inf)

    def residual(x: Array) -> Array:
        every = np.tile(values, (*x.shape[:-1], 1))
        every[..., free] = x[..., :count]
        with np.errstate(over="ignore", invalid="ignore"):
            run = _simulate(segments, every, x[..., count:].reshape(*x.shape[:-1], -1, 2))
        return np.asarray(((run[..., : shape[-1]] - segments.outputs) / scale).reshape(*x.shape[:-1], -1))

    def slopes(x: Array) -> Any:
        steps = 1e-6 * np.append(np.maximum(np.abs(x[:count]), 1e-2 * np.abs(x[:count]).max()), [1, 1])
        runs = residual(np.vstack([x, x + steps[:, None] * moves]))
        return np.split(((runs[1:] - runs[0]).T / steps).reshape(shape[0], -1, count + 2), [count], axis=-1)

    def jacobian(x: Array) -> Any:
        shared, own = slopes(x)
        return sparse.hstack([shared.reshape(-1, count), sparse.block_diag(list(own))]).tocsr()

    for _ in range(shape[-1]):
        found = optimize.least_squares(residual, x, jacobian, (lowest, np.inf), x_scale="jac", max_nfev=evaluations)
        x, scale = found.x, scale * np.sqrt(np.mean(found.fun.reshape(shape) ** 2, axis=(0, 1)))
    shared, own = slopes(x)
    basis, values[free] = np.linalg.qr(own)[0], x[:count]
    shared = (shared - basis @ (basis.swapaxes(1, 2) @ shared)).reshape(*shape, count)
    return Fit(free, values, x[count:].reshape(-1, 2), scale, residual(x).reshape(shape), shared)


def _pays(smooth: Fit, dry: Fit) -> bool:
    """Return whether friction pays by the BIC, over as many samples as the residual's memory leaves independent."""
    memory = np.mean(dry.residual[:, 1:] * dry.residual[:, :-1], axis=(0, 1)).clip(0.0, 0.99)
    samples = dry.residual[..., 0].size * (1 - memory) / (1 + memory)
    return bool(2 * np.sum(samples * np.log(smooth.scale / dry.scale)) > np.log(samples.max()) + _EVIDENCE)


def _estimates(fit: Fit) -> dict[str, Estimate]:
    """Return the parameters with their intervals, which hold where residuals have a memory.

    Their covariance is (JᵀJ)⁻¹ Jᵀ Γ J (JᵀJ)⁻¹; Γ is of first order, times the long-run covariance of what that leaves
    (prewhitening, Andrews and Monahan 1992).
    """
    left, length = fit.residual, fit.residual.shape[1]
    bread = np.linalg.inv(np.einsum("slpi,slpj->ij", fit.slopes, fit.slopes))
    # A level and a trend of its own, fitted to each segment, bias the memory ρ by −(2 + 4 ρ) / length (Kendall 1954).
    memory = ((np.mean(left[:, 1:] * left[:, :-1], axis=(0, 1)) + 2 / length) / (1 - 4 / length)).clip(-0.97, 0.97)
    white = (left[:, 1:] - memory * left[:, :-1]).reshape(-1, len(memory))
    power = max(white.T @ white / len(white), long_run_covariance(white), key=np.trace)
    backward = fit.slopes.reshape(-1, *fit.slopes.shape[2:])[::-1]
    coloured = [signal.lfilter([1.0], [1.0, -each], backward[:, p], axis=0) for p, each in enumerate(memory)]
    middle = np.einsum("pni,pq,qnj->ij", coloured, power, coloured, optimize=True)
    values = fit.values[fit.free]
    variance = np.diag(bread @ middle @ bread) / (1 - (len(bread) + fit.starts.size) / left.size)
    half, named = 1.96 * np.sqrt(variance), [list(_UNITS.items())[place] for place in fit.free]
    ends = zip(named, values.tolist(), (values - half).tolist(), (values + half).tolist(), strict=True)
    return {name: Estimate(value, low, high, unit) for (name, unit), value, low, high in ends}
