"""From logs of one axis to its plant, how certain it is, and whether it is usable."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from archerfish.errors import InputError, checked_arguments
from archerfish.identification.axis.bootstrap import draw_plants
from archerfish.identification.axis.checks import (
    GOOD,
    check_logs,
    contradictions,
    exchanged_columns,
    plant_findings,
    silent_logs,
)
from archerfish.identification.axis.corrections import corrected_fit, log_fits
from archerfish.identification.axis.departures import changed_delay, half_angle, rate_output
from archerfish.identification.axis.fit import DELAY, AxisFit, KnownGain, fit_axis
from archerfish.identification.axis.nonlinearity import Nonlinearity, nonlinearity
from archerfish.identification.axis.plateaus import plateau_gain
from archerfish.identification.axis.report import axis_report
from archerfish.identification.axis.result import (
    AxisEstimates,
    LogFit,
    dead_time_estimate,
    gain_estimates,
    judged,
    pole_estimates,
    validation_residual,
)
from archerfish.identification.axis.sources import AxisLogs, Source, read_sources
from archerfish.identification.frequency import excited_band
from archerfish.identification.simulation import balanced
from archerfish.identification.statistics import Z95
from archerfish.logs.recording import Finding, Recording
from archerfish.provenance import provenance
from archerfish.records.plant import PlantRecord
from archerfish.reports.report import Report

_DRAWS = 100
_PLATEAU_WIDTH = 0.015  # of a gain by plateaus, to either side: beyond, the fit of the whole logs knows it better


class AxisResult(AxisEstimates):
    """An identified axis."""

    @cached_property
    def report(self) -> Report:
        """What is known, how sure that is, and what to do next."""
        return axis_report(self)


@checked_arguments
def identify_axis(
    logs: Source | Sequence[Source],
    *arrays: object,
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
      logs: files, mappings or data frames with the columns time_s, u and y, or logs and recordings; one or several.
      *arrays: none; signals are passed as a recording.
      validate: logs that are held back.
      axis: name of the axis.
      order: number of poles, 1 to 20; chosen up to 8 if not given.
      max_delay: up to which the input delay is searched at first, 20 if not given; further where the best lies at that
        end [samples].
      feedthrough: whether an input may act within its own sample.
      dc_gain: steady output per steady input that the plant is to have, output by output and input by input, or
        "plateaus": that of `plateau_gain`, if the logs have steps that give it within 1.5 %; fitted if not given.
      divides_s: time that the plant's sampling period is to divide [s].
      seed: of the draws.

    Raises:
      InputError: if a log can't be read, or does not determine a plant.
    """
    if arrays:
        problem = f"identify_axis: got {1 + len(arrays)} arguments, expected logs alone"
        raise InputError(f"{problem}; pass archerfish.Recording.from_arrays(u, y, period_s)")
    _check_arguments(axis, order, max_delay)
    # Matrices are small: more threads cost more than they save.
    with threadpool_limits(1, "blas"):
        logs_of_axis = read_sources(logs, validate, divides_s)
        check_logs(logs_of_axis.fitted, order or 1)

        def fit(logs: AxisLogs) -> AxisFit:
            return fit_axis(
                logs.fitted,
                order,
                max_delay=DELAY if max_delay is None else max_delay,
                feedthrough=feedthrough,
                held_back=logs.held_back,
                gain=_known_gain(dc_gain, logs.fitted),
            )

        found, logs_of_axis, early = corrected_fit(fit, logs_of_axis)
        return _result(found, logs_of_axis, axis, seed, early)


def _check_arguments(axis: str, order: int | None, max_delay: int | None) -> None:
    """Refuse before the work what would fail after it, or be taken for something else."""
    if not axis.strip() or "/" in axis:
        raise InputError(f"axis: expected a name, such as pitch, got {axis!r}; choose another")
    for name, number, least in (("order", order, 1), ("max_delay", max_delay, 0)):
        if number is not None and number < least:
            raise InputError(f"{name}: expected a whole number of at least {least}, got {number!r}; choose another")


def _result(found: AxisFit, logs: AxisLogs, axis: str, seed: int, early: list[Finding]) -> AxisResult:
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
    fits = log_fits(found, plant, logs.fitted, logs.held_back)
    poorly_fitted = [fit.recording for fit in fits if not fit.held_back and fit.fit_percent < GOOD]
    silent = silent_logs(poorly_fitted)
    if len(silent) == len(logs.fitted):
        raise InputError(f"{silent[0].place}: {silent[0].message}; {silent[0].remedy}", silent[0].code)
    nonlinear = nonlinearity(found, logs.fitted)
    band = excited_band(logs.fitted)
    return AxisResult(
        record=plant.replace(validation_residual=validation_residual(fits)),
        fits=tuple(fits),
        dc_gain=gain_estimates(found, drawn),
        given_gain=found.known_gain,
        dead_time_samples=dead_time_estimate(found),
        poles=pole_estimates(found, drawn, band, judged(tuple(fits)).recording),
        candidates=found.selection.candidates,
        excited_hz=band,
        nonlinearity=nonlinear,
        findings=(*logs.findings, *silent, *_suspicions(found, plant, fits, band, nonlinear, early)),
    )


def _suspicions(
    found: AxisFit,
    plant: PlantRecord,
    fits: Sequence[LogFit],
    band: tuple[float, float],
    nonlinear: Nonlinearity | None,
    early: list[Finding],
) -> list[Finding]:
    """Return what is suspicious about the gain of a plant, and about what it leaves of its logs."""
    fitted, worst = [fit.recording for fit in fits if not fit.held_back], judged(tuple(fits))
    given = found.known_gain if found.known_gain and found.known_gain.source == "given" else None
    # The gain of a rate is small by chance, and says nothing of units.
    rate = [] if given else rate_output(plant, band, worst)
    gain = rate or half_angle(worst, plant, given is not None) or plant_findings(plant, fitted[0])
    # Of logs that contradict each other no plant fits all, in whichever direction.
    wrong = contradictions([(fit.recording, fit.fit_percent) for fit in fits])
    wrong = wrong or exchanged_columns(found, worst.recording, fitted)
    # What a wrong gain leaves may look like a changed delay.
    if not wrong and plant.D.shape == (1, 1) and not (given and given.contradicted):
        nonlinear_share = nonlinear.residual_share if nonlinear else 1.0
        wrong = [finding for fit in fits for finding in changed_delay(fit, nonlinear_share)]
    return [*gain, *(wrong or early)]


def _known_gain(dc_gain: Sequence[float] | float | str | None, recordings: Sequence[Recording]) -> KnownGain | None:
    """Return the gain that a plant is to have, if it is given or plateaus give it."""
    shape = len(recordings[0].output_names), len(recordings[0].input_names)
    if dc_gain is None:
        return None
    if isinstance(dc_gain, str) and dc_gain == "plateaus":
        if shape != (1, 1):
            problem = f'dc_gain: "plateaus" give the gain of one input and one output, got {shape[1]} and {shape[0]}'
            raise InputError(f"{problem}; give numbers, or leave it out")
        found = plateau_gain(recordings)
        # Plateaus that leave the gain open say less than a fit of the whole logs.
        if found is None or found.high - found.value > _PLATEAU_WIDTH * abs(found.value):
            return None
        error = (found.high - found.value) / Z95
        return KnownGain(np.array([[found.value]]), np.array([[error]]), "plateaus")
    given = np.ravel(dc_gain).tolist()
    numbers = all(isinstance(number, int | float) and np.isfinite(number) for number in given)
    if len(given) != shape[0] * shape[1] or not numbers:
        expected = f"expected {shape[0] * shape[1]} finite numbers, got {given}"
        raise InputError(f"dc_gain: {expected}; give one for each input and output")
    return KnownGain(np.reshape(np.array(given, float), shape), np.zeros(shape))
