"""A rigid axis from logs of its torque and angle, eqs (1)–(3): inertia, damping, gravity and Coulomb friction.

    inertia θ̈ + damping θ̇ + friction sign θ̇ + gravity_moment sin(θ − gravity_phase) = torque + torque_offset

Output error: parameters and initial states of all segments of the logs are those whose simulation, from the torque
alone, is nearest to what was measured. An axis under torque alone drifts away from any simulation, hence segments.
"""

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import integrate, linalg, optimize, signal, sparse

from archerfish.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish.errors import InputError
from archerfish.identification.axis.sources import Source, read_sources
from archerfish.identification.simulation import Array
from archerfish.identification.statistics import normal_estimate
from archerfish.logs.log import read_log
from archerfish.reports.report import Report
from archerfish.reports.table import Estimate, Table

_NAMES = "inertia", "damping", "gravity_moment", "gravity_phase", "torque_offset", "friction"
_UNITS = "kg m²", "N m s/rad", "N m", "rad", "N m", "N m"
_FREE, _DRY = {"pitch": [0, 1, 2, 3], "yaw": [0, 1, 4]}, 5
"""Which of these are estimated."""
_FINE_S, _SMOOTH_S = 5e-3, 0.1  # within them an axis can't both stop and break free; an angle is nearly a parabola
_FRICTIONS, _CERTAIN = (0.01, 0.1), 0.5
"""Of the torque's range, from which friction is searched; share of it above which its interval is to lie."""
_FEWEST, _AGREE, _USABLE_PERCENT, _WANTED = 50, 0.1, 80.0, ("inertia", "gravity_moment")
_RECORD = "record a log that speeds up and slows down, and for pitch one that moves slowly through the whole travel"


class Segments(NamedTuple):
    """S stretches of logs of L samples."""

    torque: Array  # [N m], (S, L)
    angle: Array  # [rad], (S, L)
    period_s: float  # sampling period [s]


class RigidFit(NamedTuple):
    """Parameters whose simulation is nearest to the angle."""

    values: Array  # all of them, (6,)
    starts: Array  # initial angle and rate of each segment, (S, 2)
    residual: Array  # simulated less measured angle [rad], (S, L)
    estimates: dict[str, Estimate]  # of those that were free


class RigidResult(NamedTuple):
    """An identified rigid axis."""

    estimates: dict[str, Estimate]  # by name, as in the equation of motion
    fits: tuple[tuple[str, float], ...]  # of the angle of each recording, segment by segment [%]
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
      friction: whether Coulomb friction is estimated; "auto" does if its interval lies above half of it.
      rate: name of a measured rate that the angle is compared with; "-NAME" turns its sign.

    Raises:
      InputError: if a log can't be used, rate and angle contradict each other, or the logs leave a parameter open.
    """
    name, free = (rate or "").removeprefix("-"), _FREE[kind]
    signals: Any = {"inputs": "torque", "outputs": ("angle", name) if name else "angle"}
    read = read_sources([read_log(each, **signals) if isinstance(each, str | Path) else each for each in logs])
    logged, names, period_s = read.fitted, read.fitted[0].output_names, read.fitted[0].period_s
    fewest, expected = min(map(len, logged)), f"torque_per_unit ≠ 0, segment_s ≥ 0.05, {_FEWEST} samples of each log"
    if not (0 < abs(torque_per_unit) < math.inf and 0.05 <= segment_s < math.inf and fewest >= _FEWEST):
        raise InputError(f"rigid: expected {expected}, got {torque_per_unit:g}, {segment_s:g}, {fewest}; correct it")
    if name not in ("", *names[1:]):
        raise InputError(f"rigid: expected an output {name}, got {', '.join(names)}; name the rate, or leave it out")
    length = min(len(each) // math.ceil(len(each) * period_s / segment_s - 1e-6) for each in logged)
    cut = [np.hstack([each.inputs, each.outputs])[: len(each) // length * length] for each in logged]
    torque, *outputs = np.concatenate(cut).T.reshape(-1, sum(map(len, cut)) // length, length)
    outputs = [x * (math.radians(1.0) if "deg" in each else 1.0) for x, each in zip(outputs, names, strict=True)]
    segments, sources = Segments(torque_per_unit * torque, outputs[0], period_s), ", ".join(e.source for e in logged)
    if rate:
        _check_rate(segments, outputs[names.index(name, 1)] * (1.0 if rate == name else -1.0), sources, rate)
    fit = _fit(segments, free, *_first_guess(segments, free, sources))
    if friction != "none":
        begun = [np.append(fit.values[:_DRY], size * np.ptp(segments.torque)) for size in _FRICTIONS]
        tried = [_fit(segments, [*free, _DRY], each, fit.starts) for each in begun]
        dry = min(tried, key=lambda each: float(np.sum(each.residual**2)))
        dry = _fit(segments, [*free, _DRY], dry.values, dry.starts)
        if friction == "coulomb" or dry.estimates["friction"].low > _CERTAIN * dry.values[_DRY]:
            fit = dry
    starts = np.cumsum([len(each) // length for each in logged])[:-1]
    pairs = zip(logged, np.split(fit.residual, starts), np.split(segments.angle, starts), strict=True)
    fits = tuple((each.source, 100 * (1 - float(np.sqrt(np.mean(e**2)) / angle.std()))) for each, e, angle in pairs)
    wide = [name for name, each in fit.estimates.items() if each.high - each.low > abs(each.value)]
    reasons = tuple(f"{each} is not determined: {_RECORD}" for each in wide if each in _WANTED)
    reasons += tuple(f"the model misses part of {each}" for each, share in fits if share < _USABLE_PERCENT)
    table = Table("Parameters and fits [%]", ("", "value"), (*fit.estimates.items(), *fits))
    headline = ", ".join(f"{each} {found.value:.4g} {found.unit}" for each, found in fit.estimates.items())
    report = Report(f"Rigid {kind} axis", headline, not reasons, reasons, tables=(table,), findings=read.findings)
    return RigidResult(fit.estimates, fits, report)


def _check_rate(segments: Segments, rates: Array, sources: str, rate: str) -> None:
    """Refuse a rate that is not the angle's derivative: the angle is regressed on its integral, which is smooth."""
    turned = integrate.cumulative_trapezoid(rates, dx=segments.period_s, initial=0.0)
    turned, angle = (signal.detrend(each, type="constant") for each in (turned, segments.angle))
    product, power = np.sum(turned * angle), np.sum(turned**2)
    slope, explained = power / product, product**2 / (power * np.sum(angle**2))
    if explained < 0.5 or abs(slope - 1) > _AGREE:
        meaning = "its sign is turned" if abs(slope + 1) <= _AGREE else "its unit is another one, as degrees for 57.3"
        problem = f'rate "{rate}" is {slope:.4g} times the derivative of the angle, expected 1: '
        problem += meaning if explained > 0.5 else "it is of another axis"
        raise InputError(f'{sources}: {problem}; correct it ("-NAME" turns the sign), or leave it out', "rate")


def _first_guess(segments: Segments, free: list[int], sources: str) -> tuple[Array, Array]:
    """Estimate parameters (6,) and initial states (S, 2) by regression of the acceleration, from local parabolas."""
    torque, measured, period_s = segments
    window = min(max(2 * round(_SMOOTH_S / period_s / 2) + 1, 5), 2 * (torque.shape[1] // 2) - 1)
    angle, rate, acceleration = (signal.savgol_filter(measured, window, 2, each, period_s) for each in range(3))
    columns = np.stack([torque, -rate, -np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=-1)[..., free]
    phi, values = np.linalg.lstsq(columns.reshape(-1, len(free)), acceleration.ravel())[0], np.zeros(6)
    if not (phi[0] > 0 and np.ptp(measured) > 0):
        raise InputError(f"{sources}: angle does not accelerate with the torque; check columns, torque_per_unit's sign")
    values[free] = np.append(1.0, phi[1:]) / phi[0]
    values[2:4] = np.hypot(*values[2:4]), np.arctan2(values[3], values[2])
    return values, np.stack([angle[:, 0], rate[:, 0]], axis=-1)


def _simulate(segments: Segments, values: Array, starts: Array) -> Array:
    """Simulate the angle from the torque for parameters B + (6,) and initial states B + (S, 2): B + (S, L)."""
    inertia, damping, moment, phase, offset, friction = np.moveaxis(values, -1, 0)[..., None]
    # Of m and l only m l² and g / l act: l = 1 m makes m the inertia.
    axis = RigidAxis(inertia, 1.0, damping, moment / inertia)
    steps = math.ceil(segments.period_s / _FINE_S) if (slides := bool(np.any(friction > 0))) else 1
    step_s, angles = segments.period_s / steps, list[Array]()
    state = RigidState(starts[..., 0] - phase, starts[..., 1])
    for torque in segments.torque.T:
        angles.append(state.angle + phase)
        for _ in range(steps):
            held = dry_friction(axis, state, torque + offset, friction, step_s) if slides else 0.0
            state = rigid_step(axis, state, torque + offset + held, step_s)
    return np.stack(angles, axis=-1)


def _fit(segments: Segments, free: list[int], values: Array, starts: Array) -> RigidFit:
    """Fit parameters and initial states by least squares."""
    count, values = len(free), values.copy()
    moves = linalg.block_diag(np.eye(count), np.tile(np.eye(2), len(starts)))  # each parameter, all angles, all rates

    @functools.lru_cache(1)  # the Jacobian is wanted where the residual was computed last
    def linearised(packed: bytes) -> tuple[Array, Array]:
        """Return the residual (S, L), and its slopes in the parameters and in the own initial state (S, L, k + 2)."""
        x = np.frombuffer(packed)
        steps = 1e-6 * np.append(np.maximum(np.abs(x[:count]), 1e-2 * np.abs(x[:count]).max()), [1, 1])
        tried = np.vstack([x, x + steps[:, None] * moves])
        every = np.tile(values, (len(tried), 1))
        every[:, free] = tried[:, :count]
        with np.errstate(over="ignore", invalid="ignore"):
            runs = _simulate(segments, every, tried[:, count:].reshape(len(tried), -1, 2))
        return runs[0] - segments.angle, np.moveaxis(runs[1:] - runs[0], 0, -1) / steps

    def jacobian(x: Array) -> Any:
        slopes = linearised(x.tobytes())[1]
        own = sparse.block_diag(list(slopes[..., count:]))  # an initial state acts in its own segment alone
        return sparse.hstack([slopes[..., :count].reshape(-1, count), own]).tocsr()

    x = np.concatenate([values[free], starts.ravel()])
    lowest = np.where(np.isin([*free, *[1] * starts.size], [0, 2, _DRY]), 0.0, -np.inf)
    options: Any = {"bounds": (lowest, np.inf), "x_scale": "jac", "ftol": 1e-6, "xtol": 1e-6, "gtol": None}
    found = optimize.least_squares(lambda x: linearised(x.tobytes())[0].ravel(), x, jacobian, max_nfev=60, **options)
    values[free], residual = found.x[:count], found.fun.reshape(segments.angle.shape)
    return RigidFit(values, found.x[count:].reshape(-1, 2), residual, _estimates(free, values, residual, found.jac))


def _estimates(free: list[int], values: Array, left: Array, jacobian: Any) -> dict[str, Estimate]:
    """Return parameters with intervals, by (JᵀJ)⁻¹ Jᵀ Γ J (JᵀJ)⁻¹, Γ of an autoregression of first order."""
    length, influence = left.shape[1], jacobian @ np.linalg.inv((jacobian.T @ jacobian).toarray())[:, : len(free)]
    # A level and a trend of its own, fitted to each segment, bias the memory ρ by −(2 + 4 ρ) / length (Kendall 1954).
    memory = np.mean(left[:, 1:] * left[:, :-1]) / np.mean(left**2)
    memory = ((memory + 2 / length) / (1 - 4 / length)).clip(-0.99, 0.99)
    coloured = signal.lfilter([1.0], [1.0, -memory], influence[::-1], axis=0)
    power = np.mean((left[:, 1:] - memory * left[:, :-1]) ** 2) / (1 - jacobian.shape[1] / left.size)
    errors = np.sqrt(power * np.sum(coloured**2, axis=0))
    return {_NAMES[at]: normal_estimate(values[at], e, _UNITS[at]) for at, e in zip(free, errors, strict=True)}
