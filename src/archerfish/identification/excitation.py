"""Commands that identify an axis, within its limits: as large as they allow, from rest to rest; and what to expect.

The amplitude of sweep, multisine and PRBS falls with frequency where rate or acceleration is the limit. A step is a
jump, unless it is to be slewed. The prediction simulates the logs and runs the identification on them, so that its
intervals are the tool's own.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from scipy.signal import chirp, max_len_seq
from scipy.signal.windows import tukey

from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.identification.axis.identify import AxisResult, identify_axis
from archerfish.identification.simulation import Array, simulate
from archerfish.logs.recording import Recording
from archerfish.paper.gimbal import gate_limits
from archerfish.records.limits import AxisLimits
from archerfish.records.plant import PlantRecord
from archerfish.records.record import Angle, Struct
from archerfish.reports.report import Report, Reported
from archerfish.reports.style import Figure, new_figure, plot_style
from archerfish.reports.table import Entry, Table

ExcitationKind = Literal["sweep", "multisine", "prbs", "step"]
Positive = Annotated[float, Meta(gt=0.0, le=1000.0)]
_LEVELS = (1.0, 0.0, -1.0, 0.0), (-0.7, 0.0, 0.5, 0.0)  # of the steps, and of those held back, in their size
ENCODER_NOISE = 2 * math.pi / 8192 / math.sqrt(12)
"""Standard deviation of the rounding of an encoder of 8192 counts a turn [rad]."""
_COLUMNS = ("command", "length [s]", "lowest [°]", "highest [°]", "rate [°/s]", "acceleration [°/s²]")
_JUMPS = "Steps jump beyond the limits: the motor saturates for their first milliseconds (--slew-steps keeps them)."


class ExcitationSettings(Struct, frozen=True, kw_only=True):
    """Choices that the commands are made from."""

    sample_period_s: Positive = 1e-3
    """Of commands and logs, where no plant is given [s]."""
    duration_s: Positive = 10.0
    """Of a sweep, multisine or PRBS, less the rest before and after [s]."""
    low_hz: Positive = 2.0
    """Lowest frequency [Hz]."""
    high_hz: Positive | None = None
    """Highest frequency [Hz]; 50, but at most 0.4 times the sampling rate, if None."""
    amplitude: Positive | None = None
    """Largest distance of sweep, multisine and PRBS from the centre [rad]; as large as the limits allow if None."""
    period_s: Positive = 2.0
    """Of multisine and PRBS, which repeat [s]."""
    step: Positive = float(np.deg2rad(3.0))
    """Size of the steps [rad]."""
    hold_s: Positive = 1.0
    """How long each step is held [s]."""
    slew_steps: bool = False
    """Whether steps, too, keep the limits of rate and acceleration."""
    settle_s: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.5
    """Rest at the centre before and after [s]."""
    centre: Angle | None = None
    """Angle about which the axis is moved [rad]; the middle of its travel if None."""
    limit_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.8
    """Share of the limits that is used; the rest is for the axis's own overshoot."""


def demand(signal: Array, period_s: float) -> Array:
    """Return how far, how fast and how sharply a signal moves, from rest to rest about zero.

    Args:
      signal: angle [rad], shape (N,).
      period_s: sampling period [s].

    Returns:
      Largest distance from zero [rad], difference per period [rad/s] and second difference per period squared
      [rad/s²], shape (3,).
    """
    padded = np.pad(signal, 2, mode="edge")
    return np.array([np.abs(np.diff(padded, order)).max() / period_s**order for order in range(3)])


def plan_command(
    kind: ExcitationKind, limits: AxisLimits, settings: ExcitationSettings, period_s: float, held_back: bool = False
) -> Array:
    """Return a command from rest to rest [rad], shape (N,).

    Args:
      kind: of its signal.
      limits: of the axis.
      settings: what it is made from.
      period_s: sampling period [s].
      held_back: whether it is another one, for validation: the signal from its end and the other way, or other steps.

    Raises:
      InputError: if the signal can't be made, or does not fit the limits.
    """
    low, high = _travel(limits)
    centre = 0.5 * (low + high) if settings.centre is None else settings.centre
    reach = settings.limit_share * max(min(high - centre, centre - low), 0.0)
    size = settings.step if kind == "step" else settings.amplitude or reach
    if not 0 < size <= reach:
        angles = (size, centre, reach, low, high)
        got, about, most, lowest, highest = (f"{math.degrees(angle):.3g}°" for angle in angles)
        expected = f"expected up to {most}, as the travel is {lowest} to {highest}"
        problem = f"excitation: {kind}: {got} about {about}, {expected}"
        raise InputError(f"{problem}; give --amplitude-deg, --step-deg, --centre-deg, or the travel by --range-deg")
    budget = np.array([size, *settings.limit_share * np.array([limits.max_rate, limits.max_acceleration])])
    if kind == "step":
        signal = _steps(settings, budget, period_s, _LEVELS[held_back])
    else:
        signal = _within(budget, _signal(kind, settings, budget, period_s), period_s, 1 / settings.low_hz)
        signal = -signal[::-1] if held_back else signal
    return np.asarray(centre + np.pad(signal, round(settings.settle_s / period_s)))


def _travel(limits: AxisLimits) -> tuple[float, float]:
    """Return between which angles an axis is moved [rad]: within a turn where it has no ends."""
    return (-math.pi, math.pi) if limits.low is None else limits.ends


def _steps(settings: ExcitationSettings, budget: Array, period_s: float, levels: tuple[float, ...]) -> Array:
    signal = np.append(0.0, budget[0] * np.repeat(levels, max(1, round(settings.hold_s / period_s))))
    jump = np.abs(np.diff(signal)).max()
    half_s = max(np.sqrt(jump / budget[2]), jump / budget[1])
    return _slewed(signal, math.ceil(half_s / period_s)) if settings.slew_steps else signal


def _signal(kind: ExcitationKind, settings: ExcitationSettings, budget: Array, period_s: float) -> Array:
    """Return a sweep, multisine or PRBS."""
    low_hz, high_hz = settings.low_hz, settings.high_hz or min(50.0, 0.4 / period_s)
    least_s, most_hz = settings.period_s if kind != "sweep" else 1 / low_hz, 0.5 / period_s
    if not (low_hz < high_hz < most_hz and 1 / (high_hz - low_hz) <= least_s <= settings.duration_s):
        expected = f"low_hz < high_hz < {most_hz:g}, half the sampling rate, and duration_s of {least_s:g} or more"
        problem = f"expected {expected}, got {low_hz:g}, {high_hz:g} and {settings.duration_s:g}"
        raise InputError(f"excitation: {kind}: {problem}; change --low-hz, --high-hz, --duration-s")
    count, repeat = round(settings.duration_s / period_s), round(least_s / period_s)
    if kind == "sweep":
        frequency = low_hz + (high_hz - low_hz) * np.arange(count) / count
        sine = chirp(np.arange(count), low_hz * period_s, count, high_hz * period_s, phi=-90)
        return np.asarray(sine * _largest_sine(frequency, budget))
    if kind == "multisine":
        length_s = repeat * period_s
        harmonics = np.arange(max(1, round(low_hz * length_s)), int(high_hz * length_s + 1e-9) + 1)
        period = multisine(repeat, harmonics, _largest_sine(harmonics / length_s, budget))
        return np.tile(period, count // repeat)
    clock = max(2, int(0.44 / high_hz / period_s))
    return _slewed(prbs(count, clock, int(np.clip(np.log2(repeat / clock + 1), 2, 32))), clock // 2)


def multisine(count: int, harmonics: NDArray[np.int64], amplitude: Array) -> Array:
    """Return one period of Σ aₙ cos(2π n t + φₙ), t in periods, whose second derivative has a low peak.

    With p the share of each sine in the power of the second derivative, Schroeder's phases (1970, eq 10) are
    φₙ = −2π Σ (n − l) pₗ over l < n.

    Args:
      count: samples N of the period.
      harmonics: consecutive numbers n, below N / 2, shape (L,).
      amplitude: aₙ, shape (L,).

    Returns:
      Shape (N,).
    """
    power = (amplitude * harmonics**2) ** 2
    share = np.cumsum(power) / np.sum(power)
    spectrum = np.zeros(count // 2 + 1, np.complex128)
    spectrum[harmonics] = 0.5 * count * amplitude * np.exp(-2j * np.pi * (np.cumsum(share) - share))
    return np.fft.irfft(spectrum, count)


def prbs(count: int, clock: int, bits: int) -> Array:
    """Return a pseudo-random binary sequence of the levels −1 and 1, of maximum length: 2^bits − 1 clock periods.

    Its spectrum is flat from 1 / ((2^bits − 1) clock period) to half its power at 0.44 / clock period.

    Args:
      count: samples N; the sequence repeats.
      clock: shortest time at one level [samples].
      bits: length of the shift register, 2…32.

    Returns:
      Shape (N,).
    """
    levels = max_len_seq(bits, length=-(-count // clock))[0]
    return np.repeat(2.0 * levels - 1.0, clock)[:count]


def _largest_sine(frequency_hz: Array, budget: Array) -> Array:
    """Return min(angle, rate / ω, acceleration / ω²), rounded: in a sweep a corner is a jump of the rate."""
    bounds = budget[:, None] / (2 * np.pi * frequency_hz) ** np.arange(3)[:, None]
    return np.asarray(np.sum(bounds**-6.0, axis=0) ** (-1 / 6.0))  # a corner lies 11 % below a sharp one


def _within(budget: Array, signal: Array, period_s: float, fade_s: float) -> Array:
    """Return a signal that fades in and out, scaled to use up one part of the budget: angle, rate or acceleration."""
    # Fading within a period of the lowest frequency costs no more acceleration than its sine.
    fade = min(fade_s / period_s, len(signal) / 10)
    signal = signal * tukey(len(signal), min(2 * fade / (len(signal) - 1), 1))
    # A little less than the budget, for the rounding of the sum with the centre.
    return np.asarray(signal * (1 - 1e-9) / np.max(demand(signal, period_s) / budget))


def _slewed(signal: Array, half: int) -> Array:
    """Replace each jump by even acceleration and even braking of `half` samples each: its rate becomes a triangle."""
    triangle = np.convolve(np.full(half, 1 / half), np.full(half, 1 / half))
    return np.convolve(np.pad(signal, (len(triangle) - 1, 0), mode="edge"), triangle, mode="valid")


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Reported):
    """Commands for one axis, and what to expect of their logs."""

    limits: AxisLimits
    logs: dict[str, Recording]  # by file name: the command "u", and the "expected" angle with noise [rad]
    expected: AxisResult  # what the identification makes of them

    def save(self, folder: str | Path) -> None:
        """Write each command to a file, with the expected angle beside it.

        Raises:
          InputError: if the folder can't be written, or has a file of that name, which may be a log.
        """
        paths = {Path(folder) / name: log for name, log in self.logs.items()}
        for path in filter(Path.exists, paths):
            raise file_error(path, "is there already, and may be a log", "move it, or save into another folder")
        for path, log in paths.items():
            log.write_csv(path)

    def plot(self) -> Figure:
        """Draw the commands."""
        with plot_style():
            figure, ((panel,),) = new_figure()
            for name, log in self.logs.items():
                panel.plot(log.time, np.degrees(log.inputs[:, 0]), label=name)
            panel.set(xlabel="time [s]", ylabel="command [°]")
            figure.legend(loc="outside lower center", ncols=2)
        return figure

    @property
    def report(self) -> Report:
        """The commands, and what the identification reports of their simulated logs."""
        found, limits, rows = self.expected.report, self.limits, list[tuple[Entry, ...]]()
        for name, log in self.logs.items():
            u = np.degrees(log.inputs[:, 0])
            moved = demand(u - u[0], log.period_s)[1:].tolist()
            jumps = moved[1] > np.degrees(limits.max_acceleration)
            rows.append((name, len(log) * log.period_s, u.min(), u.max(), *(["jump"] * 2 if jumps else moved)))
        most = np.degrees([*_travel(limits), limits.max_rate, limits.max_acceleration]).tolist()
        jumping, start, every = any("jump" in row for row in rows), f"{u[0]:.3g}°", f"{1e3 * log.period_s:g} ms"
        steps = (
            f"Bring the axis to {start}, its centre, and play u [rad] of each file, a value every {every}.",
            f"Log time_s, u and the angle y [rad] side by side, into files of the same names, as logs/{rows[0][0]}.",
            "Then: archerfish identify logs --out my-robot",
        )
        return Report(
            f"{self.expected.record.axis}: commands for its identification",
            f"expected of their logs: {found.headline}",
            known=found.known,
            doubts=(*[_JUMPS] * jumping, *found.reasons, *found.doubts),
            next_steps=(*steps, *found.next_steps),
            tables=(Table("Commands", _COLUMNS, (*rows, ("limit", None, *most))), *found.tables[:2]),
            figures=(("Commands", self.plot), *found.figures),
        )


@checked_arguments
def excite(
    axis: Literal["pitch", "yaw"],
    limits: AxisLimits | None = None,
    *,
    kinds: Sequence[ExcitationKind] = ("sweep", "step"),
    validation: bool = True,
    plant: PlantRecord | None = None,
    noise_sd: float = ENCODER_NOISE,
    settings: ExcitationSettings | None = None,
    seed: int = 0,
) -> Excitation:
    """Plan the commands that identify an axis, and predict what their logs will give.

    Args:
      axis: names the files.
      limits: of the axis; those of a gimbal of GM6020 motors if None.
      kinds: signals, a command for each.
      validation: whether there is another command of each kind, to be held back.
      plant: what the axis is taken to be, of one input and one output, whose sampling period the commands have; of
        second order with 10 Hz, a damping of 0.7 and a delay of 5 ms if None.
      noise_sd: standard deviation of the measured angle's noise [rad].
      settings: what the commands are made from.
      seed: of noise and identification.

    Raises:
      InputError: if a command does not fit the limits, or logs of them would not determine a plant.
    """
    if axis not in ("pitch", "yaw"):
        raise InputError(f"excite: axis: expected pitch or yaw, got {axis!r}; give one of these")
    for name, given, kind in (
        ("limits", limits, AxisLimits),
        ("plant", plant, PlantRecord),
        ("settings", settings, ExcitationSettings),
    ):
        if given is not None and not isinstance(given, kind):
            got = type(given).__name__
            raise InputError(f"excite: {name}: expected {kind.__name__} or None, got one of type {got}; give one")
    if not isinstance(kinds, tuple | list):
        raise InputError(f"excite: kinds: expected a tuple of names, got one of type {type(kinds).__name__}; give one")
    rng, settings = np.random.default_rng(seed), settings or ExcitationSettings()
    limits = limits or getattr(gate_limits(), axis)
    period_s = plant.sample_period_s if plant else settings.sample_period_s
    plant = plant or PlantRecord.second_order(10.0, 0.7, round(5e-3 / period_s) * period_s, period_s)
    if plant.D.shape != (1, 1) or not 0 <= noise_sd < math.inf:
        found = f"a plant of shape {plant.D.shape} and noise_sd {noise_sd:g}"
        raise InputError(f"excite: {found}, expected shape (1, 1) and noise_sd ≥ 0; change --plant, --noise-deg")
    logs: tuple[list[Recording], list[Recording]] = [], []
    for held_back, group in enumerate(logs[: 1 + validation]):
        for kind in kinds:
            u = plan_command(kind, limits, settings, period_s, bool(held_back))[:, None]
            y = u[0] @ plant.dc_gain.T + simulate(plant, u - u[0]) + noise_sd * rng.standard_normal(u.shape)
            source = f"{axis}_{kind}{'_validation' * held_back}.csv"
            group.append(Recording.from_arrays(u, y, period_s, output_names=("expected",), source=source))
    expected = identify_axis(logs[False], validate=logs[True], axis=axis, order=len(plant.A), seed=seed)
    return Excitation(limits, {log.source: log for log in (*logs[False], *logs[True])}, expected)
