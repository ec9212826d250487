"""From logs of one axis to its plant, how certain it is, and whether it is usable."""

from collections import defaultdict
from collections.abc import Sequence
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from archerfish2.errors import InputError
from archerfish2.identification.axis.bootstrap import draw_plants, interval
from archerfish2.identification.axis.checks import (
    check_logs,
    contradictions,
    exchanged_columns,
    fit_alone,
    plant_findings,
    silent_logs,
)
from archerfish2.identification.axis.fit import DELAY, AxisFit, fit_axis
from archerfish2.identification.axis.nonlinearity import nonlinearity
from archerfish2.identification.axis.plateaus import plateau_gain
from archerfish2.identification.axis.report import GAIN_WIDTH, axis_report
from archerfish2.identification.axis.result import AxisEstimates, GivenGain, LogFit, Pole, judged
from archerfish2.identification.frequency import excited_band
from archerfish2.identification.simulation import TINY, Array, Complex, balanced, free_run
from archerfish2.identification.sources import AxisLogs, Source, read_sources
from archerfish2.identification.statistics import Z95
from archerfish2.logs.recording import Recording
from archerfish2.provenance import provenance
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Estimate

_DRAWS = 100
_NEAR_BAND, _SCATTER = 1.5, 1 / 3  # of a natural frequency: beyond the band, and of its draws' logarithm


class AxisResult(AxisEstimates):
    """An identified axis."""

    @cached_property
    def report(self) -> Report:
        """What is known, how sure that is, and what to do next."""
        return axis_report(self)


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
        "plateaus": that of `plateau_gain`, if the logs have steps that give it within 5 %; fitted if not given.
      divides_s: time that the plant's sampling period is to divide [s].
      seed: of the draws.

    Raises:
      InputError: if a log can't be read, or does not determine a plant.
    """
    # Matrices are small: more threads cost more than they save.
    with threadpool_limits(1, "blas"):
        logs_of_axis = read_sources(logs, validate, divides_s)
        check_logs(logs_of_axis.fitted, order or 1)
        gain, source = _known_gain(dc_gain, logs_of_axis.fitted)
        longest = DELAY if max_delay is None else max_delay
        found = fit_axis(
            logs_of_axis.fitted,
            order,
            max_delay=longest,
            feedthrough=feedthrough,
            held_back=logs_of_axis.held_back,
            gain=gain,
        )
        return _result(found, logs_of_axis, axis, source, seed)


def _result(found: AxisFit, logs: AxisLogs, axis: str, gain_source: str, seed: int) -> AxisResult:
    """Draw plants, run the tests and collect what is known."""
    first = logs.fitted[0]
    drawn = draw_plants(found, _DRAWS, seed)
    draws = {name: np.stack([getattr(plant, name) for plant in drawn]) for name in "ABCD"}
    facts: Any = provenance(seed) | {"inputs": logs.hashes}
    plant = balanced(
        found.plant.replace(
            axis=axis,
            input_names=first.input_names,
            output_names=first.output_names,
            draws=draws,
            draw_delays=np.array([plant.delay_samples for plant in drawn]),
            provenance=facts,
        )
    )
    drift = found.structure.drift
    fits = [LogFit(log, True, free_run(plant, log.inputs, log.outputs, drift=drift)) for log in logs.held_back]
    fits += [LogFit(log, False, free_run(plant, log.inputs, log.outputs, drift=drift)) for log in logs.fitted]
    alone = cache(fit_alone)
    findings = [*logs.findings, *silent_logs(logs.fitted, alone), *plant_findings(plant, first)]
    if swapped := exchanged_columns(found, judged(tuple(fits)).recording, logs.fitted):
        findings.append(swapped)
    if plant.D.shape == (1, 1):
        findings += contradictions([(fit.recording, fit.fit_percent) for fit in fits], alone)
    known, given = found.known_gain, None
    if known is not None:
        given = GivenGain(gain_source, tuple(known.by_logs.ravel().tolist()), known.contradicted)
    band = excited_band(logs.fitted)
    drawn_poles = [np.linalg.eigvals(plant.A).astype(complex) for plant in drawn]
    return AxisResult(
        record=plant,
        fits=tuple(fits),
        dc_gain=gains_of(found, drawn),
        given_gain=given,
        delay_samples=_delay(found),
        poles=_poles(found.poles, drawn_poles, plant.sample_period_s, band),
        candidates=found.selection.candidates,
        excited_hz=band,
        nonlinearity=nonlinearity(found, logs.fitted),
        findings=tuple(findings),
    )


def _known_gain(
    dc_gain: Sequence[float] | float | str | None, recordings: Sequence[Recording]
) -> tuple[tuple[Array, Array] | None, str]:
    """Return the gain that a plant is to have and its standard error, shape (p, m) each, and where it comes from."""
    shape = len(recordings[0].output_names), len(recordings[0].input_names)
    if dc_gain is None:
        return None, ""
    if dc_gain == "plateaus":
        found = plateau_gain(recordings) if shape == (1, 1) else None
        # Plateaus that leave the gain open say less than a fit of the whole logs.
        if found is None or found.high - found.value > GAIN_WIDTH * abs(found.value):
            return None, ""
        error = (found.high - found.value) / Z95
        return (np.array([[found.value]]), np.array([[error]])), "plateaus"
    given = np.ravel(dc_gain).tolist()
    numbers = all(isinstance(number, int | float) and np.isfinite(number) for number in given)
    if len(given) != shape[0] * shape[1] or not numbers:
        expected = f"expected {shape[0] * shape[1]} finite numbers, got {given}"
        raise InputError(f"dc_gain: {expected}; give one for each input and output")
    return (np.reshape(np.array(given, float), shape), np.zeros(shape)), "given"


def gains_of(found: AxisFit, drawn: Sequence[PlantRecord]) -> tuple[Estimate, ...]:
    """Return the steady gains with their intervals, output by output and input by input."""
    low, high = interval(np.array([plant.dc_gain.ravel() for plant in drawn]))
    gains = found.plant.dc_gain.ravel()
    return tuple(map(Estimate, gains.tolist(), np.minimum(low, gains).tolist(), np.maximum(high, gains).tolist()))


def _delay(found: AxisFit) -> Estimate:
    """Delay of the first response beyond the sample that every input takes; a feedthrough responds a sample earlier."""
    weights: dict[int, float] = defaultdict(float)
    for structure, weight in found.selection.weights.items():
        weights[max(structure.delay - structure.feedthrough, 0)] += weight
    delays = sorted(weights)
    cumulative = np.cumsum([weights[delay] for delay in delays])
    low, high = (delays[min(int(np.searchsorted(cumulative, level)), len(delays) - 1)] for level in (0.025, 0.975))
    value = max(found.structure.delay - found.structure.feedthrough, 0)
    return Estimate(value, min(low, value), max(high, value), "samples")


def _poles(poles: Complex, drawn: Sequence[Complex], period_s: float, band: tuple[float, float]) -> tuple[Pole, ...]:
    logs = np.log(np.array([_matched(poles, others) for others in drawn]) + TINY)
    estimates = []
    for place, pole in enumerate(poles):
        if pole.imag >= 0:
            rates = np.append(np.log(pole + TINY), logs[:, place]) / period_s
            frequency, damping = np.abs(rates) / (2 * np.pi), -rates.real / np.abs(rates)
            known = band[0] / _NEAR_BAND <= frequency[0] <= _NEAR_BAND * band[1]
            known = known and np.std(np.log(frequency[1:])) < _SCATTER
            estimates.append(Pole(_estimate(frequency, "Hz"), _estimate(damping, ""), bool(known)))
    return tuple(sorted(estimates, key=lambda pole: pole.frequency_hz.value))


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
