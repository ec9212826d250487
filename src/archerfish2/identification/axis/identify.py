"""From logs of one axis to its plant, how certain it is, and whether it is usable."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.axis.bootstrap import draw_plants, interval
from archerfish2.identification.axis.checks import contradictions, exchanged_columns, log_findings, plant_findings
from archerfish2.identification.axis.fit import DELAY, AxisFit, fit_axis, with_gain
from archerfish2.identification.axis.hammerstein import Nonlinearity, nonlinearity
from archerfish2.identification.axis.plateaus import plateau_gain
from archerfish2.identification.axis.plots import bode_plot, run_plot
from archerfish2.identification.axis.report import axis_report, judged
from archerfish2.identification.axis.selection import Candidate
from archerfish2.identification.frequency import excited_band, measured_response
from archerfish2.identification.residuals import ResidualTests, residual_tests
from archerfish2.identification.result import Result
from archerfish2.identification.simulation import Array, Complex, FreeRun, balanced, free_run, simulate
from archerfish2.identification.sources import Source, read_sources
from archerfish2.logs.recording import Finding, Recording
from archerfish2.provenance import provenance
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import Figure
from archerfish2.reports.table import Estimate

_DRAWS = 100
_NEAR_BAND, _SCATTER = 1.5, 1 / 3  # of a natural frequency: beyond the band, and of its draws' logarithm


class LogFit(NamedTuple):
    """How a plant explains a recording."""

    recording: Recording  # as it was fitted
    held_back: bool  # whether it was not fitted
    run: FreeRun  # with initial state and constant of its own
    tests: ResidualTests | None  # of the residual of the first output; None of a short recording

    @property
    def fit_percent(self) -> float:
        """Fit of the first output, by which a plant is judged [%]."""
        return float(self.run.fit_percent[0])


class Pole(NamedTuple):
    """A real pole or a pair of poles of the continuous axis."""

    frequency_hz: Estimate  # natural frequency [Hz]
    damping: Estimate  # 1 and more of real poles
    determined: bool  # whether the logs show where it is


@dataclass(frozen=True, eq=False, repr=False)
class AxisResult(Result):
    """An identified axis."""

    record: PlantRecord  # with draws
    fits: tuple[LogFit, ...]  # of each recording, those held back first
    dc_gain: tuple[Estimate, ...]  # steady output per steady input, output by output and input by input
    delay_samples: Estimate  # of the first response; its range is of all structures by their weights
    poles: tuple[Pole, ...]  # the slowest first
    candidates: tuple[Candidate, ...]  # the likeliest first
    excited_hz: tuple[float, float]  # band that the inputs excite
    nonlinearity: Nonlinearity | None  # that explains the logs better
    findings: tuple[Finding, ...]  # of the logs
    free_gain: tuple[Estimate, ...]  # as the logs have it where it was given; else empty

    @cached_property
    def report(self) -> Report:
        """What is known, how sure that is, and what to do next."""
        return axis_report(self)

    @property
    def part(self) -> str:
        """Name of the part of a robot, and of its files."""
        return self.record.axis

    def plot(self) -> Figure:
        """Draw the recording by which the plant is judged, as measured and as simulated."""
        worst = judged(self.fits)
        return run_plot(worst.recording, worst.run, title=worst.recording.source)

    def bode(self) -> Figure:
        """Draw the frequency response with its band, and as measured."""
        fitted = [each.recording for each in self.fits if not each.held_back]
        return bode_plot(self.record, measured_response(fitted), self.excited_hz, title=self.record.axis)

    def predict(self, u: Array) -> Array:
        """Simulate the outputs from rest, shape (N, p), under inputs (N, m)."""
        rest = np.zeros((self.record.delay_samples, len(self.record.input_names)))
        return simulate(self.record, np.vstack([rest, np.reshape(u, (len(u), -1))]))[len(rest) :]


def identify_axis(
    logs: Source | Sequence[Source],
    *,
    validate: Source | Sequence[Source] = (),
    axis: str = "axis",
    order: int | None = None,
    max_delay: int | None = None,
    feedthrough: bool = True,
    dc_gain: Sequence[float] | float | Literal["plateaus"] | None = None,
    divides_s: float | None = None,
    seed: int = 0,
) -> AxisResult:
    """Identify the plant of one axis from its logs.

    Order, delay, feedthrough and drift are chosen by the BIC of Whittle's likelihood, the order by the logs that are
    held back if there are some; the plant is fitted by output error, its intervals are those of a parametric bootstrap.

    Args:
      logs: files with the columns time_s, u and y, or logs and recordings as `read_log` returns them; one or several.
      validate: logs that are held back.
      axis: name of the axis.
      order: number of poles, 1 to 20; chosen up to 8 if not given.
      max_delay: up to which the input delay is searched at first, 20 if not given; further where the best lies at that
        end [samples].
      feedthrough: whether an input may act within its own sample.
      dc_gain: steady output per steady input that the plant is to have, output by output and input by input, or
        "plateaus": that of `plateau_gain`, if the logs have such steps; fitted if not given.
      divides_s: time that the plant's sampling period is to divide [s].
      seed: of the draws.

    Raises:
      InputError: if a log can't be read, or does not determine a plant.
    """
    read = read_sources(logs, validate, divides_s)
    found_before = log_findings(read.fitted, order or 1)
    for each in found_before:
        if each.severity == "refused":
            raise InputError(f"{each.place}: {each.message}; {each.remedy}", each.code)
    longest = DELAY if max_delay is None else max_delay
    found = free = fit_axis(read.fitted, order, max_delay=longest, feedthrough=feedthrough, held_back=read.held_back)
    given = _given_gain(dc_gain, read.fitted)
    if given:
        found = with_gain(free, np.reshape([each.value for each in given], free.gain.shape))
    names = {"input_names": read.fitted[0].input_names, "output_names": read.fitted[0].output_names}
    drawn = draw_plants(found, _DRAWS, seed)
    draws = {name: np.stack([getattr(each, name) for each in drawn]) for name in "ABCD"}
    facts: Any = provenance(seed) | {"logs": read.hashes}
    delays = np.array([each.delay_samples for each in drawn])
    plant = balanced(found.plant.replace(axis=axis, draws=draws, draw_delays=delays, provenance=facts, **names))
    band = excited_band(read.fitted)
    fits = [
        _log_fit(plant, each, held, found.structure.drift)
        for held, group in ((True, read.held_back), (False, read.fitted))
        for each in group
    ]
    worst = judged(fits).recording
    swapped = exchanged_columns(found, worst, read.fitted)
    findings = [*read.findings, *found_before, *plant_findings(plant, read.fitted[0]), *([swapped] if swapped else [])]
    if plant.D.shape == (1, 1):
        findings += contradictions([(each.recording, each.fit_percent) for each in fits])
    return AxisResult(
        plant,
        tuple(fits),
        given or gains_of(found, drawn),
        _delay(found),
        _poles(found.poles, [np.linalg.eigvals(each.A).astype(complex) for each in drawn], plant.sample_period_s, band),
        found.selection.candidates,
        band,
        nonlinearity(found, read.fitted),
        tuple(findings),
        gains_of(free, draw_plants(free, _DRAWS, seed)) if given else (),
    )


def _given_gain(dc_gain: Sequence[float] | float | str | None, recordings: Sequence[Recording]) -> tuple[Estimate, ...]:
    """Return the gains that a plant is to have; none if they are to be fitted."""
    if dc_gain == "plateaus" and len(recordings[0].input_names) * len(recordings[0].output_names) == 1:
        found = plateau_gain(recordings)
        return () if found is None else (found,)
    expected = len(recordings[0].input_names) * len(recordings[0].output_names)
    given = [] if dc_gain is None else np.ravel(dc_gain).tolist()
    numbers = all(isinstance(each, int | float) and np.isfinite(each) for each in given)
    if given and (len(given) != expected or not numbers):
        raise InputError(
            f"dc_gain: expected {expected} finite numbers, got {given}; give one for each input and output"
        )
    return tuple(Estimate(each, each, each) for each in given)


def _log_fit(plant: PlantRecord, recording: Recording, held_back: bool, drift: bool) -> LogFit:
    run = free_run(plant, recording.inputs, recording.outputs, drift=drift)
    residual = np.asarray(recording.outputs[:, 0] - run.outputs[:, 0])
    return LogFit(recording, held_back, run, residual_tests(residual, recording.inputs))


def gains_of(found: AxisFit, drawn: Sequence[PlantRecord]) -> tuple[Estimate, ...]:
    """Return the steady gains with their intervals, output by output and input by input."""
    low, high = interval(np.array([each.dc_gain.ravel() for each in drawn]))
    gains = found.gain.ravel()
    return tuple(map(Estimate, gains.tolist(), np.minimum(low, gains).tolist(), np.maximum(high, gains).tolist()))


def _delay(found: AxisFit) -> Estimate:
    """Delay of the first response beyond the sample that every input takes; a feedthrough responds a sample earlier."""
    weights: dict[int, float] = defaultdict(float)
    for each, weight in found.selection.weights.items():
        weights[max(each.delay - each.feedthrough, 0)] += weight
    delays = sorted(weights)
    cumulative = np.cumsum([weights[each] for each in delays])
    low, high = (delays[min(int(np.searchsorted(cumulative, level)), len(delays) - 1)] for level in (0.025, 0.975))
    value = max(found.delay - found.structure.feedthrough, 0)
    return Estimate(value, min(low, value), max(high, value), "samples")


def _poles(poles: Complex, drawn: Sequence[Complex], period_s: float, band: tuple[float, float]) -> tuple[Pole, ...]:
    logs = np.log(np.array([_matched(poles, each) for each in drawn]) + 1e-300)
    estimates = []
    for place, pole in enumerate(poles):
        if pole.imag >= 0:
            rates = np.append(np.log(pole + 1e-300), logs[:, place]) / period_s
            frequency, damping = np.abs(rates) / (2 * np.pi), -rates.real / np.abs(rates)
            known = band[0] / _NEAR_BAND <= frequency[0] <= _NEAR_BAND * band[1]
            known = known and np.std(np.log(frequency[1:])) < _SCATTER
            estimates.append(Pole(_estimate(frequency, "Hz"), _estimate(damping, ""), bool(known)))
    return tuple(sorted(estimates, key=lambda each: each.frequency_hz.value))


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
