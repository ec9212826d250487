"""A plant is fitted again to logs that are corrected by what the first fit shows of them."""

from collections.abc import Callable, Sequence

from archerfish.identification.axis.checks import GOOD
from archerfish.identification.axis.departures import changed_delay, early_outputs
from archerfish.identification.axis.encoder import without_angle_error, without_leaps
from archerfish.identification.axis.fit import AxisFit, fit_axis
from archerfish.identification.axis.idle import without_idle
from archerfish.identification.axis.nonlinearity import nonlinearity
from archerfish.identification.axis.result import LogFit
from archerfish.identification.axis.sources import AxisLogs
from archerfish.identification.simulation import free_run
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_FEW_POLES = 4
_MOSTLY = 0.5  # share of a residual that a nonlinearity leaves at most, so that it is no output that comes early


def corrected_fit(fit: Callable[[AxisLogs], AxisFit], logs: AxisLogs) -> tuple[AxisFit, AxisLogs, list[Finding]]:
    """Fit a plant, and again after each correction of the logs that the fit calls for.

    Args:
      fit: of a plant to logs.
      logs: as they were read.

    Returns:
      The last fit, the logs to which it belongs, and findings of outputs that respond before their input.
    """
    found = fit(logs)
    if early := _early(found, logs.fitted):
        # An output that was smoothed both ways responds too little to fast inputs, which passes for an idle axis.
        return found, logs, early
    for correct in (without_leaps, without_angle_error, without_idle):
        fitted, held_back, findings = correct(found, logs.fitted, logs.held_back)
        if not findings:
            continue
        # What follows after another delay looks as if it did not follow.
        if correct is without_idle and _delay_changes(found, logs):
            continue
        corrected = AxisLogs(fitted, held_back, (*logs.findings, *findings), logs.hashes)
        again = fit(corrected)
        # Of exchanged columns the steps of a command pass for leaps, and no plant fits what is left.
        if _least_fit(again, fitted) >= GOOD:
            found, logs = again, corrected
    return found, logs, []


def log_fits(
    found: AxisFit, plant: PlantRecord, fitted: Sequence[Recording], held_back: Sequence[Recording] = ()
) -> list[LogFit]:
    """Return how a plant explains recordings, those that are held back first.

    Args:
      found: has the drift.
      plant: runs freely.
      fitted: recordings to which it was fitted.
      held_back: recordings by which it is judged.
    """
    roles = [(log, True) for log in held_back] + [(log, False) for log in fitted]
    drift = found.structure.drift
    return [LogFit(log, role, free_run(plant, log.inputs, log.outputs, drift=drift)) for log, role in roles]


def _delay_changes(found: AxisFit, logs: AxisLogs) -> bool:
    return any(changed_delay(fit, 1.0) for fit in log_fits(found, found.plant, logs.fitted, logs.held_back))


def _early(found: AxisFit, recordings: Sequence[Recording]) -> list[Finding]:
    """Find outputs that respond before their input, also where many poles approximate that badly.

    A rate limit under a sweep answers as a filter that runs both ways, so that a nonlinearity comes first.
    """
    fits = [found] if len(found.plant.A) <= _FEW_POLES else [found, fit_axis(recordings, _FEW_POLES)]
    for fit in fits:
        if early := early_outputs(log_fits(fit, fit.plant, recordings)):
            nonlinear = nonlinearity(found, recordings)
            return [] if nonlinear and nonlinear.residual_share < _MOSTLY else early
    return []


def _least_fit(found: AxisFit, recordings: Sequence[Recording]) -> float:
    """Return how well a plant explains the log that it explains least, by the first output [%]."""
    return min(fit.fit_percent for fit in log_fits(found, found.plant, recordings))
