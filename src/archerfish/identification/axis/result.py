"""What is known of an identified axis."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from archerfish.errors import InputError
from archerfish.identification.axis.bootstrap import interval
from archerfish.identification.axis.fit import AxisFit, KnownGain
from archerfish.identification.axis.nonlinearity import Nonlinearity
from archerfish.identification.axis.plots import bode_plot, run_plot
from archerfish.identification.axis.selection import Candidate
from archerfish.identification.frequency import measured_response
from archerfish.identification.residuals import ResidualTests, residual_tests
from archerfish.identification.simulation import TINY, Array, Complex, FreeRun, simulate
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord
from archerfish.reports.report import Result
from archerfish.reports.style import Figure
from archerfish.reports.table import Estimate
from archerfish.safety.plausibility import IN_A_ROW

_NEAR_BAND, _SCATTER = 1.5, 1 / 3  # of a natural frequency: beyond the band, and of its draws' logarithm
_HARDLY_DAMPED, _LIGHT = 0.1, 0.01  # damping of a mode, and its share of an output's deviation, below which it is light
_DECISION_S = 0.02  # between decisions of the usual tasks
_MOVING = 0.3  # deviation of an output over that of the recording that moves most, from which a recording counts


@dataclass(frozen=True, eq=False)
class LogFit:
    """How a plant explains a recording."""

    recording: Recording  # as it was fitted
    held_back: bool  # whether it was not fitted
    run: FreeRun  # with initial state and constant of its own

    @property
    def residual(self) -> Array:
        """Measured less simulated first output, shape (N,)."""
        return np.asarray(self.recording.outputs[:, 0] - self.run.outputs[:, 0])

    @cached_property
    def tests(self) -> ResidualTests | None:
        """Tests of the residual of the first output; None of a short recording."""
        return residual_tests(self.residual, self.recording.inputs)

    @property
    def fit_percent(self) -> float:
        """Fit of the first output, by which a plant is judged [%]."""
        return float(self.run.fit_percent[0])


class Pole(NamedTuple):
    """A real pole or a pair of poles of the continuous axis."""

    frequency_hz: Estimate  # natural frequency [Hz]
    damping: Estimate  # 1 and more of real poles
    determined: bool  # whether the logs show where it is
    light: bool = False  # whether it is hardly damped and moves the output by less than one per cent


@dataclass(frozen=True, eq=False, repr=False)
class AxisEstimates(Result):
    """The plant of an axis, how sure it is, and how it explains the logs."""

    record: PlantRecord  # with draws
    fits: tuple[LogFit, ...]  # of each recording, those held back first
    dc_gain: tuple[Estimate, ...]  # steady output per steady input, output by output and input by input
    given_gain: KnownGain | None  # if it was not fitted
    dead_time_samples: Estimate  # see `PlantRecord.dead_time_samples`; range of all structures
    poles: tuple[Pole, ...]  # the slowest first
    candidates: tuple[Candidate, ...]  # the likeliest first
    excited_hz: tuple[float, float]  # band that the inputs excite
    nonlinearity: Nonlinearity | None  # that explains the logs better
    findings: tuple[Finding, ...]  # of the logs

    @property
    def judged(self) -> LogFit:
        """The fit by which the plant is judged."""
        return judged(self.fits)

    @property
    def unit(self) -> str:
        """Unit in which logs are drawn: degrees of pitch and yaw, which are logged in radians; else empty."""
        return "°" if self.record.axis in ("pitch", "yaw") and self.record.D.size == 1 else ""

    def plot(self) -> Figure:
        """Draw the recording by which the plant is judged, as measured and as simulated."""
        judged = self.judged
        return run_plot(judged.recording, judged.run, title=judged.recording.source, unit=self.unit)

    def bode(self) -> Figure:
        """Draw the frequency response with its band, and as measured."""
        fitted = [fit.recording for fit in self.fits if not fit.held_back]
        return bode_plot(self.record, measured_response(fitted), self.excited_hz, title=self.record.axis)

    def simulate(self, u: Array) -> Array:
        """Simulate the outputs from rest, shape (N, p), under inputs, shape (N, m) or (N,), that are zero before.

        Raises:
          InputError: if the inputs have another shape, or aren't finite.
        """
        inputs, channels = np.atleast_2d(np.asarray(u, dtype=np.float64).T).T, len(self.record.input_names)
        if inputs.ndim != 2 or inputs.shape[1] != channels or not np.isfinite(inputs).all():
            problem = f"simulate: got an array of shape {np.shape(u)}, expected finite inputs of shape (N, {channels})"
            raise InputError(f"{problem}; samples come first")
        rest = np.zeros((self.record.delay_samples, channels))
        return simulate(self.record, np.vstack([rest, inputs]))[len(rest) :]


def judged(fits: tuple[LogFit, ...]) -> LogFit:
    """Return the worst fit of a recording that moves, of those that were held back if there are some."""
    validation = [fit for fit in fits if fit.held_back] or list(fits)
    largest_spread = np.max([fit.recording.outputs.std(0) for fit in validation], axis=0)
    moving = [fit for fit in validation if np.any(fit.recording.outputs.std(0) >= _MOVING * largest_spread)]
    return min(moving, key=lambda fit: fit.fit_percent)


def validation_residual(fits: Sequence[LogFit]) -> float | None:
    """Return the largest residual that lasted `IN_A_ROW` decisions in a log that was held back; None without one.

    Feedback is judged at decisions, which may fall anywhere between the samples: every sample begins some in a row.

    Args:
      fits: of recordings.
    """
    lasting = list[float]()
    for fit in fits:
        step = max(1, round(_DECISION_S / fit.recording.period_s))
        residual = np.abs(fit.residual)
        count = len(residual) - (IN_A_ROW - 1) * step
        if fit.held_back and count > 0:
            in_a_row = [residual[step * place :][:count] for place in range(IN_A_ROW)]
            lasting.append(float(np.min(in_a_row, axis=0).max()))
    return max(lasting, default=None)


def gain_estimates(found: AxisFit, drawn: Sequence[PlantRecord]) -> tuple[Estimate, ...]:
    """Return the steady gains with their intervals, output by output and input by input; a given one is exact."""
    if found.known_gain is not None and not found.known_gain.error.any():
        return tuple(Estimate(gain, gain, gain) for gain in found.known_gain.gain.ravel().tolist())
    low, high = interval(np.array([plant.dc_gain.ravel() for plant in drawn]))
    gains = found.plant.dc_gain.ravel()
    return tuple(map(Estimate, gains.tolist(), np.minimum(low, gains).tolist(), np.maximum(high, gains).tolist()))


def dead_time_estimate(found: AxisFit) -> Estimate:
    """Return the dead time, and its range by the weights of all structures."""
    weights: dict[int, float] = defaultdict(float)
    for structure, weight in found.selection.weights.items():
        weights[structure.dead_time] += weight
    dead_times = sorted(weights)
    cumulative = np.cumsum([weights[dead_time] for dead_time in dead_times])
    last = len(dead_times) - 1
    low, high = (dead_times[min(place, last)] for place in np.searchsorted(cumulative, [0.025, 0.975]).tolist())
    value = found.structure.dead_time
    return Estimate(value, min(low, value), max(high, value), "samples")


def pole_estimates(
    found: AxisFit, drawn: Sequence[PlantRecord], band: tuple[float, float], log: Recording
) -> tuple[Pole, ...]:
    """Return frequency and damping of each pole or pair, the slowest first.

    Args:
      found: the fit.
      drawn: plants of the bootstrap.
      band: that the inputs excite [Hz].
      log: by whose motion the share of a mode is judged.
    """
    poles, period_s, estimates = found.poles, found.plant.sample_period_s, list[Pole]()
    matched = [_matched(poles, np.linalg.eigvals(plant.A).astype(complex)) for plant in drawn]
    logarithms = np.log(np.array(matched) + TINY)
    for place, pole in enumerate(poles):
        if pole.imag >= 0:
            rates = np.append(np.log(pole + TINY), logarithms[:, place]) / period_s
            frequency, damping = np.abs(rates) / (2 * np.pi), -rates.real / np.abs(rates)
            known = band[0] / _NEAR_BAND <= frequency[0] <= _NEAR_BAND * band[1]
            light = damping[0] < _HARDLY_DAMPED and _share(found.plant, pole, log) < _LIGHT
            known = known and np.std(np.log(frequency[1:])) < _SCATTER and not light
            estimates.append(Pole(_estimate(frequency, "Hz"), _estimate(damping, ""), bool(known), bool(light)))
    return tuple(sorted(estimates, key=lambda pole: pole.frequency_hz.value))


def _share(plant: PlantRecord, pole: complex, log: Recording) -> float:
    """Return the deviation of what a pair of poles adds to the first output of a log, over that of the output."""
    values, vectors = np.linalg.eig(plant.A)
    mode = int(np.argmin(np.abs(values - pole)))
    driven = np.asarray(log.inputs) @ np.linalg.solve(vectors, plant.B.astype(complex))[mode]
    motion = 2 * (plant.C[0] @ vectors[:, mode] * lfilter([0, 1], [1, -values[mode]], driven)).real
    return float(motion.std() / max(log.outputs[:, 0].std(), TINY))


def _matched(poles: Complex, others: Complex) -> Complex:
    """Return other poles in the order of those that they are nearest to."""
    distance, found = np.abs(poles[:, None] - others), others.copy()
    for _ in poles:
        one, other = np.unravel_index(np.argmin(distance), distance.shape)
        found[one] = others[other]
        distance[one], distance[:, other] = np.inf, np.inf
    return found


def _estimate(values: Array, unit: str) -> Estimate:
    """Return the first value with the interval of the others."""
    low, high = interval(values[1:])
    return Estimate(float(values[0]), float(low), float(high), unit)
