"""All that speaks for and against an identified axis: its logs simulated and tested, its numbers with intervals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.axis_picture import shown_run
from archerfish.cli.sample_count import SampleCount, count_samples
from archerfish.figures.identification import SimulatedRun
from archerfish.identification.axis.gimbal import AxisIdentification
from archerfish.identification.axis.nonlinearity import NonlinearFit, nonlinear_fits
from archerfish.identification.axis.order_choice import OrderTrial
from archerfish.identification.validation.confidence_bands import band, drawn_poles, parameter_errors
from archerfish.identification.validation.free_run import FreeRun, free_run, own_zero_run
from archerfish.identification.validation.frequency import natural_frequency_hz
from archerfish.identification.validation.residual_tests import ResidualTests, long_enough, residual_tests
from archerfish.records.findings import Finding
from archerfish.records.plant import dc_gain
from archerfish.records.recording import Recording

Interval = tuple[float, float]

_FAR = 1.5
"""Half widths of the interval beyond which a gain that was asked for is contradicted: three standard deviations."""
_TRIFLE = 0.01
"""Share of the gain below which a difference matters to nobody."""


class Log(NamedTuple):
    """A recording and the file that it is from; a file with gaps gives several."""

    path: Path
    """The file."""
    recording: Recording
    """What was read from it."""


@dataclass(frozen=True)
class LogEvidence:
    """One recording beside its simulation."""

    path: Path
    """The file that it is from."""
    kind: str
    """"training" or "validation"."""
    recording: Recording
    """The recording."""
    run: SimulatedRun
    """Its free run."""
    tests: ResidualTests | None
    """Tests of its residual; none where it is too short."""
    shift: float
    """Its own zero less the one that the fitted recordings share, in units of the output."""
    unshifted_percent: float
    """Fit with its own zero [%]."""
    settled_percent: float
    """The same without the first samples, which answer to inputs from before the recording [%]."""

    @property
    def residual_sd(self) -> float:
        """Standard deviation of the residual, in units of the output."""
        return float(np.std(self.run.measured - self.run.simulated))


class PoleEvidence(NamedTuple):
    """One pole, or the upper of a conjugate pair, as its equivalent in continuous time."""

    pole: complex
    """In the z plane."""
    frequency_hz: float | None
    """Natural frequency [Hz]; none for a pole at 0, which is a delay."""
    damping: float | None
    """Damping ratio."""
    frequency_interval_hz: Interval | None
    """95 % interval of the natural frequency [Hz], from the draws; none where it is not determined."""
    damping_interval: Interval | None
    """95 % interval of the damping ratio, likewise."""
    determined: bool
    """Whether the recordings determine it."""


class HeldGain(NamedTuple):
    """A steady gain that the plant was held to, beside what the recordings say of it on their own."""

    name: str
    """Of the input."""
    asked: float
    """Gain that the plant was held to."""
    free: float
    """Gain of a plant of the same order that was not held to any."""
    interval: Interval
    """95 % interval of that."""
    free_fits: tuple[float, ...]
    """Fit of that plant to each recording, in the order of the logs [%]."""

    @property
    def contradicted(self) -> bool:
        """Whether the recordings speak against the gain that was asked for."""
        half = 0.5 * (self.interval[1] - self.interval[0])
        return abs(self.asked - self.free) > _FAR * half and abs(self.asked - self.free) > _TRIFLE * abs(self.free)


@dataclass(frozen=True)
class AxisEvidence:
    """An identified axis and all that it was held against."""

    result: AxisIdentification
    """The identification."""
    logs: tuple[LogEvidence, ...]
    """The fitted recordings, then those held back."""
    samples: SampleCount
    """Samples that the logs hold, and those that were left out."""
    findings: tuple[Finding, ...] = ()
    """What the examination of the logs found."""
    trials: tuple[OrderTrial, ...] = ()
    """Orders that were tried, where the order was not given."""
    held_gains: tuple[HeldGain, ...] = ()
    """Steady gains that the plant was held to, by input."""
    nonlinear: tuple[NonlinearFit, ...] = ()
    """The plant behind nonlinear operators, the best one first."""

    def of_kind(self, kind: str) -> list[LogEvidence]:
        """Return the recordings for "training" or for "validation"."""
        return [log for log in self.logs if log.kind == kind]


def gather_evidence(
    result: AxisIdentification,
    training: Sequence[Log],
    validation: Sequence[Log],
    findings: Iterable[Finding] = (),
    trials: Sequence[OrderTrial] = (),
    free: AxisIdentification | None = None,
    samples: int | None = None,
) -> AxisEvidence:
    """Simulate and test every recording.

    Args:
      result: the identified axis.
      training: what was fitted.
      validation: what was held back.
      findings: what the examination of the logs found.
      trials: orders that were tried.
      free: where the plant was held to steady gains, one that was not.
      samples: that the logs hold, those included that findings left out; by default all in the recordings, and these.

    Raises:
      InputError: if a recording that was held back does not suit the plant.
    """
    logs = [_tested(result, log, kind) for kind, group in _groups(training, validation) for log in group]
    held = () if free is None else _held_gains(result, free, logs)
    found = tuple(findings)
    if samples is None:
        samples = sum(len(each.recording) for each in logs) + sum(each.samples for each in found)
    nonlinear: list[NonlinearFit] = []
    if result.plant.D.shape == (1, 1):
        nonlinear = nonlinear_fits(result.ground, result.structures[0].fitted)
    return AxisEvidence(
        result, tuple(logs), count_samples(samples, found), found, tuple(trials), held, tuple(nonlinear)
    )


def _held_gains(
    result: AxisIdentification, free: AxisIdentification, logs: Sequence[LogEvidence]
) -> tuple[HeldGain, ...]:
    fits = tuple(float(_run(free, log.recording, log.kind).fit_percent[0]) for log in logs)
    gains = zip(result.plant.input_names, steady_gains(result), steady_gains(free), free.dc_gain_interval, strict=True)
    return tuple(HeldGain(*each, fits) for each in gains)


def _groups(training: Sequence[Log], validation: Sequence[Log]) -> tuple[tuple[str, Sequence[Log]], ...]:
    return ("training", training), ("validation", validation)


def _run(result: AxisIdentification, recording: Recording, kind: str) -> FreeRun:
    if kind == "training":
        return own_zero_run(result.plant, recording, drift=result.drift)[1]
    return free_run(result.plant, recording, result.offset, drift=result.drift)


def _tested(result: AxisIdentification, log: Log, kind: str) -> LogEvidence:
    recording, inputs = log.recording, log.recording.inputs
    own, unshifted = own_zero_run(result.plant, recording, drift=result.drift)
    run = unshifted if kind == "training" else free_run(result.plant, recording, result.offset, drift=result.drift)
    errors = parameter_errors(result.plant, inputs)
    shown = shown_run(recording, run, errors, kind)
    zero = float((own - result.offset)[0]), float(unshifted.fit_percent[0]), _settled_percent(result, recording)
    if not long_enough(*inputs.shape):
        return LogEvidence(log.path, kind, recording, shown, None, *zero)
    # A fitted recording has taken its share of the parameters' errors already.
    tests = residual_tests(run.residual[:, 0], inputs, errors if kind == "validation" else None)
    return LogEvidence(log.path, kind, recording, shown, tests, *zero)


def _settled_percent(result: AxisIdentification, recording: Recording) -> float:
    """Return the fit of the samples whose delayed inputs are in the recording [%]."""
    late = result.plant.delay_samples
    if late >= len(recording) // 2:
        return -np.inf
    rest = replace(
        recording,
        time=recording.time[late:],
        inputs=recording.inputs[: len(recording) - late],
        outputs=recording.outputs[late:],
    )
    if np.ptp(rest.outputs[:, 0]) == 0:
        return -np.inf
    prompt = replace(result.plant, delay_samples=0, draws={}, draw_delays=np.zeros(0, np.int64))
    return float(own_zero_run(prompt, rest, drift=result.drift)[1].fit_percent[0])


def pole_evidence(result: AxisIdentification) -> list[PoleEvidence]:
    """Return each pole with its intervals, in the order of `result.poles`."""
    drawn = drawn_poles(result.plant, result.poles)
    period = result.plant.sample_period_s
    return [_pole(*each, period) for each in zip(result.poles, drawn.T, result.determined.tolist(), strict=True)]


def _pole(pole: complex, drawn: NDArray[np.complex128], determined: bool, period: float) -> PoleEvidence:
    pole = complex(pole)
    if pole == 0:
        return PoleEvidence(pole, None, None, None, None, determined)
    intervals: list[Interval | None] = [None, None]
    if drawn.size and determined:
        # A draw at zero, a pure delay, counts as very fast.
        places = np.where(np.abs(drawn) > 1e-9, drawn, 1e-9)
        frequency = np.abs(np.log(places)) / (2 * np.pi * period)
        damping = -np.log(places).real / np.abs(np.log(places))
        intervals = [_interval(frequency), _interval(damping)]
    frequency_hz = natural_frequency_hz(pole, period)
    damping_ratio = -float(np.log(abs(pole))) / (2 * np.pi * frequency_hz * period)
    return PoleEvidence(pole, frequency_hz, damping_ratio, intervals[0], intervals[1], determined)


def _interval(values: NDArray[np.float64]) -> Interval:
    low, high = band(values)
    return float(low), float(high)


def gain_words(gain: float, interval: Interval) -> str:
    """Write a gain with its interval."""
    return f"{gain:.4g} ({interval[0]:.4g}…{interval[1]:.4g})"


def steady_gains(result: AxisIdentification) -> list[float]:
    """Return the steady gain from each input, output per input."""
    gains: list[float] = dc_gain(result.plant)[0].tolist()
    return gains
