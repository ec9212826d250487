"""The command that a team plays to its gimbal to identify an axis: which signals, how large, and what they ask.

Sweep, multisine and PRBS keep to the limits of rate and acceleration: their amplitude falls with frequency where it
must. A step is a jump unless it shall be slewed. Every command begins and ends at rest at the centre angle.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.excitation.limits import (
    Budget,
    Demand,
    demand,
    excitation_budget,
    faded,
    fitted,
    sine_amplitude,
    slew_time,
    slewed,
)
from archerfish.identification.excitation.signals import (
    linear_sweep,
    low_crest_phases,
    multisine,
    multisine_lines,
    prbs,
    staircase,
)
from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits

Array = NDArray[np.float64]
Kind = Literal["sweep", "multisine", "prbs", "step"]

_HALF_POWER = 0.44
"""Frequency at which a PRBS has half its power, in units of its clock's."""

_VALIDATION_LEVELS = (0.0, -0.7, 0.0, 0.5, 0.0)
"""The other way first and of other sizes than the fitted step, so that it tells something new."""


@dataclass(frozen=True)
class ExcitationSettings:
    """Choices that the signals are made from."""

    sample_period_s: float = 1e-3
    """Sampling period of the command and of the log [s]."""
    duration_s: float = 10.0
    """Length of a sweep, multisine or PRBS [s], less its rest before and after."""
    low_hz: float = 2.0
    """Lowest frequency [Hz]."""
    high_hz: float = 50.0
    """Highest frequency [Hz]."""
    amplitude: float | None = None
    """Largest distance of sweep, multisine and PRBS from the centre [rad]; as much as the limits allow if not given."""
    period_s: float = 2.0
    """Period of multisine and PRBS [s]; the duration holds at least one."""
    step: float = np.deg2rad(3.0)
    """Size of the steps [rad]."""
    hold_s: float = 1.0
    """How long a step is held [s]."""
    slew_steps: bool = False
    """Keep steps within the limits of rate and acceleration too."""
    settle_s: float = 0.5
    """Rest at the centre before and after each signal [s]."""
    limit_share: float = 0.8
    """Share of the limits that is used; the rest is for the axis' own overshoot."""
    seed: int = 0
    """Of the multisine's phases and the PRBS' start."""

    def __post_init__(self) -> None:
        for name in ("sample_period_s", "duration_s", "period_s", "hold_s", "step"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} must be > 0, got {getattr(self, name):g}")
        if not 0 <= self.settle_s < np.inf:
            raise InputError(f"settle_s must be ≥ 0 s, got {self.settle_s:g}")
        if self.amplitude is not None and not 0 < self.amplitude < np.inf:
            raise InputError(f"amplitude must be > 0 rad, got {self.amplitude:g}")
        nyquist = 0.5 / self.sample_period_s
        if not 0 < self.low_hz < self.high_hz < nyquist:
            raise InputError(
                f"the band must keep 0 < low_hz < high_hz < {nyquist:g} Hz (half the sampling rate), got "
                f"{self.low_hz:g} to {self.high_hz:g} Hz; change the band or shorten the sampling period"
            )


class PlannedLog(NamedTuple):
    """One command to be played, and logged with the angle that it brings about."""

    name: str
    """Kind of the signal, "validation" for the step that is held back."""
    command: Array
    """Commanded angle [rad], shape (N,)."""
    demand: Demand
    """What it asks of the axis."""
    held_back: bool
    """Whether the log is for validation only."""
    jumps: bool
    """Whether it holds steps, which no limit of rate or acceleration is asked of."""


def plan_logs(
    kinds: tuple[Kind, ...],
    settings: ExcitationSettings,
    limits: AxisLimits,
    centre: float,
    *,
    validation: bool = True,
) -> list[PlannedLog]:
    """Plan the logs of an axis.

    Args:
      kinds: signals, each a log of its own.
      settings: their choices.
      limits: of the axis.
      centre: angle that each begins and ends at [rad].
      validation: whether a step that is held back is added.

    Raises:
      InputError: if a signal can't be made, or does not fit the travel.
    """
    budget = excitation_budget(limits, centre, settings.limit_share)
    if settings.amplitude is not None:
        budget = _narrowed(budget, settings.amplitude)
    steps = excitation_budget(limits, centre, settings.limit_share)
    planned = [_planned(kind, _SIGNALS[kind](settings, budget), settings, centre) for kind in kinds if kind != "step"]
    if "step" in kinds:
        planned.append(_planned("step", _steps(settings, steps, (0.0, 1.0, 0.0, -1.0, 0.0)), settings, centre))
    if validation:
        planned.append(_planned("validation", _steps(settings, steps, _VALIDATION_LEVELS), settings, centre))
    for log in planned:
        _check(log, limits, centre)
    return planned


def _narrowed(budget: Budget, amplitude: float) -> Budget:
    if amplitude > budget.angle:
        raise InputError(
            f"an amplitude of {np.degrees(amplitude):.3g}° leaves the travel that may be used, "
            f"±{np.degrees(budget.angle):.3g}° about the centre; lower it, or move the centre"
        )
    return budget._replace(angle=amplitude)


def _planned(name: str, signal: Array, settings: ExcitationSettings, centre: float) -> PlannedLog:
    rest = np.zeros(max(1, round(settings.settle_s / settings.sample_period_s)))
    command = centre + np.concatenate([rest, signal, rest])
    stepped = name in ("step", "validation")
    jumps = stepped and not settings.slew_steps
    return PlannedLog(name, command, demand(command, settings.sample_period_s), name == "validation", jumps)


def _check(log: PlannedLog, limits: AxisLimits, centre: float) -> None:
    """Hold the samples themselves against the limits: what is written is what is played."""
    slack = 1 + 1e-9
    inside = limits.low <= log.demand.low and log.demand.high <= limits.high
    gentle = log.demand.rate <= limits.max_rate * slack and log.demand.acceleration <= limits.max_acceleration * slack
    at_rest = abs(log.command[0] - centre) + abs(log.command[-1] - centre) < 1e-12
    if not (inside and at_rest and (gentle or log.jumps)):
        raise InputError(f"the {log.name} can't be made within the limits of the axis; widen the band or the period")


def _sweep(settings: ExcitationSettings, budget: Budget) -> Array:
    period, low, high = settings.sample_period_s, settings.low_hz, settings.high_hz
    sine = linear_sweep(settings.duration_s, period, low_hz=low, high_hz=high)
    frequency = low + (high - low) * np.arange(len(sine)) / len(sine)
    return fitted(faded(sine * sine_amplitude(frequency, budget), _fade_s(settings), period), budget, period)


def _multisine(settings: ExcitationSettings, budget: Budget) -> Array:
    """Sum sines whose phases let it be largest: of angle, rate or acceleration, whichever is the limit."""
    period_s = _period(settings)
    lines = multisine_lines(period_s, settings.low_hz, settings.high_hz)
    amplitude = sine_amplitude(lines, budget)
    repeats = int(settings.duration_s / period_s + 1e-9)
    signals = []
    for power in range(3):
        phase = low_crest_phases(amplitude * lines**power, round(lines[0] * period_s), settings.seed)
        one = multisine(lines, amplitude, phase - 0.5 * np.pi * power, period_s, settings.sample_period_s)
        whole = faded(np.tile(one, repeats), _fade_s(settings), settings.sample_period_s)
        signals.append(fitted(whole, budget, settings.sample_period_s))
    return max(signals, key=lambda signal: float(np.sum(signal**2)))


def _prbs(settings: ExcitationSettings, budget: Budget) -> Array:
    """Slew a binary sequence from level to level within one clock period at most."""
    period = settings.sample_period_s
    clock = max(2, int(_HALF_POWER / settings.high_hz / period)) * period
    bits = max(2, int(np.log2(_period(settings) / clock + 1)))
    amplitude = min(budget.angle, budget.rate * clock / 4, budget.acceleration * clock**2 / 8)
    levels = amplitude * prbs(settings.duration_s, clock, period, bits=bits, seed=settings.seed)
    levels = np.concatenate([[0.0], levels, np.zeros(round(clock / period))])
    return fitted(slewed(levels, slew_time(2 * amplitude, budget), period), budget, period)


def _steps(settings: ExcitationSettings, budget: Budget, levels: tuple[float, ...]) -> Array:
    if settings.step > budget.angle:
        raise InputError(
            f"a step of {np.degrees(settings.step):.3g}° leaves the travel that may be used, "
            f"±{np.degrees(budget.angle):.3g}° about the centre; lower it, or move the centre"
        )
    period = settings.sample_period_s
    signal = np.append(0.0, staircase([settings.step * level for level in levels[1:]], settings.hold_s, period))
    if not settings.slew_steps:
        return signal
    largest = float(np.abs(np.diff(signal)).max())
    return slewed(signal, slew_time(largest, budget), period)


def _period(settings: ExcitationSettings) -> float:
    if settings.period_s > settings.duration_s:
        raise InputError(
            f"a period of {settings.period_s:g} s does not fit into {settings.duration_s:g} s; "
            "shorten it or record longer"
        )
    return settings.period_s


def _fade_s(settings: ExcitationSettings) -> float:
    """One period of the lowest frequency, so that fading in costs no more acceleration than the sine itself."""
    return min(1 / settings.low_hz, 0.1 * settings.duration_s)


_SIGNALS: dict[Kind, Callable[[ExcitationSettings, Budget], Array]] = {
    "sweep": _sweep,
    "multisine": _multisine,
    "prbs": _prbs,
}
