"""From logs of one axis to its plant, how certain it is, and whether it is usable."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

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
from archerfish.identification.axis.departures import changed_delay, early_outputs, half_angle, rate_output
from archerfish.identification.axis.encoder import without_angle_error, without_leaps
from archerfish.identification.axis.fit import DELAY, AxisFit, KnownGain, fit_axis
from archerfish.identification.axis.idle import without_idle
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
from archerfish.identification.frequency import excited_band
from archerfish.identification.simulation import balanced, free_run
from archerfish.identification.statistics import Z95
from archerfish.logs.log import read_log
from archerfish.logs.recording import Finding, Log, Recording
from archerfish.logs.stamps import period_findings, resampled
from archerfish.provenance import provenance
from archerfish.records.plant import PlantRecord
from archerfish.reports.report import Report

Source = str | Path | Log | Recording | Mapping[str, Any]
"""A file or arrays with the columns time_s, u and y, or what was read or made of other ones."""
_DRAWS = 100
_PLATEAU_WIDTH = 0.015  # of a gain by plateaus, to either side: beyond, the fit of the whole logs knows it better
_MOST = 40  # recordings that are fitted
_FEW_POLES = 4
_MOSTLY = 0.5  # share of a residual that a nonlinearity leaves at most, so that it is no output that comes early
_COARSER = 3.0  # sampling period over that of a log, from which much of the log is lost


class AxisLogs(NamedTuple):
    """Recordings of one sampling period."""

    fitted: list[Recording]  # to which a plant is fitted
    held_back: list[Recording]  # by which it is judged
    findings: tuple[Finding, ...]  # of all logs
    hashes: dict[str, str | int | float | None]  # SHA-256 by file


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

        found = fit(logs_of_axis)
        early = _early(found, logs_of_axis.fitted)
        # An output that was smoothed both ways responds too little to fast inputs, which passes for an idle axis.
        for corrected in () if early else (without_leaps, without_angle_error, without_idle):
            fitted, held_back, findings = corrected(found, logs_of_axis.fitted, logs_of_axis.held_back)
            # What follows after another delay looks as if it did not follow.
            if findings and not (corrected is without_idle and _delay_changes(found, logs_of_axis)):
                others = AxisLogs(fitted, held_back, (*logs_of_axis.findings, *findings), logs_of_axis.hashes)
                again = fit(others)
                # Of exchanged columns the steps of a command pass for leaps, and no plant fits what is left.
                if _least_fit(again, fitted) >= GOOD:
                    found, logs_of_axis = again, others
        return _result(found, logs_of_axis, axis, seed, early)


def _delay_changes(found: AxisFit, logs: AxisLogs) -> bool:
    return any(changed_delay(fit, 1.0) for fit in _runs(found, found.plant, logs.fitted, logs.held_back))


def _runs(
    found: AxisFit, plant: PlantRecord, fitted: Sequence[Recording], held_back: Sequence[Recording] = ()
) -> list[LogFit]:
    """Return how a plant explains recordings, those that are held back first."""
    roles = [(log, True) for log in held_back] + [(log, False) for log in fitted]
    drift = found.structure.drift
    return [LogFit(log, role, free_run(plant, log.inputs, log.outputs, drift=drift)) for log, role in roles]


def _early(found: AxisFit, recordings: Sequence[Recording]) -> list[Finding]:
    """Find outputs that respond before their input, also where many poles approximate that badly.

    A rate limit under a sweep answers as a filter that runs both ways, so that a nonlinearity comes first.
    """
    fits = [found] if len(found.plant.A) <= _FEW_POLES else [found, fit_axis(recordings, _FEW_POLES)]
    for each in fits:
        if early := early_outputs(_runs(each, each.plant, recordings)):
            nonlinear = nonlinearity(found, recordings)
            return [] if nonlinear and nonlinear.residual_share < _MOSTLY else early
    return []


def _least_fit(found: AxisFit, recordings: Sequence[Recording]) -> float:
    """Return how well a plant explains the log that it explains least, by the first output [%]."""
    return min(fit.fit_percent for fit in _runs(found, found.plant, recordings))


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
    fits = _runs(found, plant, logs.fitted, logs.held_back)
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


def read_sources(
    logs: Source | Sequence[Source], validate: Source | Sequence[Source] = (), divides_s: float | None = None
) -> AxisLogs:
    """Read logs and bring them to one sampling period: the longest, or the next longer one that divides a time.

    Args:
      logs: to be fitted.
      validate: to be held back.
      divides_s: the time [s].

    Raises:
      InputError: if one can't be read, none is given, or their signals have other names.
    """
    to_fit = [_log(source) for source in _sources(logs)]
    to_hold_back = [_log(source) for source in _sources(validate)]
    read = [*to_fit, *to_hold_back]
    fitted, held_back = _numbered(
        [recording for log in to_fit for recording in log.recordings],
        [recording for log in to_hold_back for recording in log.recordings],
    )
    if not fitted:
        raise InputError("identify: expected a log or more, got none; pass a file")
    for log in (*fitted, *held_back):
        if (log.input_names, log.output_names) != (fitted[0].input_names, fitted[0].output_names):
            names = f"{', '.join(fitted[0].input_names)} and {', '.join(fitted[0].output_names)}"
            raise InputError(f"{log.source}: expected the signals {names} of {fitted[0].source}; read the same ones")
    findings = [finding for log in read for finding in log.findings]
    kept, repeated = _without_repeats(fitted)
    longest, left_out = _longest(kept)
    others, not_held_back = _not_fitted(held_back, kept)
    findings += [*repeated, *left_out, *not_held_back]
    used = [*longest, *others]
    slowest = max(used, key=lambda log: log.period_s)
    period_s = _period(fitted[0], slowest.period_s, divides_s)
    message = f"brought to a sampling period of {1e3 * period_s:.4g} ms, since {slowest.source} has no shorter one"
    for log in used:
        if abs(log.period_s / period_s - 1) > 1e-6:
            severity: Any = "warning" if log.period_s < period_s / _COARSER else "repaired"
            findings.append(Finding("other-period", severity, log.source, message, "log all at one rate"))
    hashes: dict[str, str | int | float | None] = {log.source: log.sha256 for log in read if log.sha256}
    return AxisLogs(
        [resampled(log, period_s) for log in longest],
        [resampled(log, period_s) for log in others],
        tuple(findings),
        hashes,
    )


def _sources(group: Any) -> list[Source]:
    """Return the logs of a group, which may be one; arrays and data frames are one."""
    one = isinstance(group, str | Path | Log | Recording | Mapping) or hasattr(group, "columns")
    if not (one or isinstance(group, Iterable)):
        expected = "expected files, recordings, mappings of names to arrays, or data frames"
        raise InputError(f"identify_axis: {expected}, got one of type {type(group).__name__}; give one or several")
    return [group] if one or hasattr(group, "shape") else list(group)


def _log(source: Source) -> Log:
    if isinstance(source, Recording):
        return Log((source,), period_findings(source), len(source), source.source, "")
    return source if isinstance(source, Log) else read_log(source)


def _numbered(*groups: list[Recording]) -> list[list[Recording]]:
    """Return recordings, numbered where different ones have one name, so that messages tell them apart."""
    numbers = defaultdict[str, dict[bytes, int]](dict)
    for log in itertools.chain(*groups):
        of_name = numbers[log.source]
        of_name.setdefault(_content(log), 1 + len(of_name))

    def named(log: Recording) -> Recording:
        of_name = numbers[log.source]
        return replace(log, source=f"{log.source} ({of_name[_content(log)]})") if len(of_name) > 1 else log

    return [[named(log) for log in group] for group in groups]


def _without_repeats(fitted: Sequence[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Leave out recordings that are the same as an earlier one."""
    first, findings = dict[bytes, Recording](), list[Finding]()
    for log in fitted:
        earlier = first.setdefault(_content(log), log)
        if earlier is not log:
            message = f"the same as {earlier.source}, and left out"
            findings.append(Finding("repeated-log", "repaired", log.source, message, "name each log once", len(log)))
    return list(first.values()), findings


def _longest(fitted: list[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Keep the longest of very many recordings: each costs time, and has a beginning of its own to be estimated."""
    if len(fitted) <= _MOST:
        return fitted, []
    order = sorted(range(len(fitted)), key=lambda place: -len(fitted[place]))
    kept = [fitted[place] for place in sorted(order[:_MOST])]
    samples = sum(map(len, fitted)) - sum(map(len, kept))
    message = f"of {len(fitted)} recordings the {_MOST} longest are fitted"
    remedy = "log without interruptions"
    return kept, [Finding("many-pieces", "warning", fitted[0].source, message, remedy, samples)]


def _not_fitted(held_back: list[Recording], fitted: Sequence[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Leave out held-back recordings that are fitted as well."""
    contents, message = set(map(_content, fitted)), "fitted, too, so that it shows nothing of other motions"
    both = [log for log in held_back if _content(log) in contents]
    findings = [Finding("not-held-back", "warning", log.source, message, "hold another log back") for log in both]
    return [log for log in held_back if log not in both], findings


def _period(first: Recording, period_s: float, divides_s: float | None) -> float:
    """Return the sampling period of all logs: the longest, or the next longer one that divides a time."""
    if divides_s is None:
        return period_s
    if period_s > divides_s * (1 + 1e-6):
        problem = f"has a sample every {period_s:.4g} s, expected one every {divides_s:g} s at least"
        raise InputError(f"{first.source}: {problem}; log faster")
    return divides_s / max(1, int(divides_s / period_s * (1 + 1e-6)))


def _content(recording: Recording) -> bytes:
    return str(recording.period_s).encode() + recording.inputs.tobytes() + recording.outputs.tobytes()
