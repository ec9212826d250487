"""What is known of an identified axis."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from archerfish2.identification.axis.nonlinearity import Nonlinearity
from archerfish2.identification.axis.plots import bode_plot, run_plot
from archerfish2.identification.axis.selection import Candidate
from archerfish2.identification.frequency import measured_response
from archerfish2.identification.residuals import ResidualTests, residual_tests
from archerfish2.identification.result import Result
from archerfish2.identification.simulation import Array, FreeRun, simulate
from archerfish2.logs.recording import Finding, Recording
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.style import Figure
from archerfish2.reports.table import Estimate

_MOVING = 0.3  # deviation of an output over that of the recording that moves most, from which a recording counts


@dataclass(frozen=True, eq=False)
class LogFit:
    """How a plant explains a recording."""

    recording: Recording  # as it was fitted
    held_back: bool  # whether it was not fitted
    run: FreeRun  # with initial state and constant of its own

    @cached_property
    def tests(self) -> ResidualTests | None:
        """Tests of the residual of the first output; None of a short recording."""
        residual = np.asarray(self.recording.outputs[:, 0] - self.run.outputs[:, 0])
        return residual_tests(residual, self.recording.inputs)

    @property
    def fit_percent(self) -> float:
        """Fit of the first output, by which a plant is judged [%]."""
        return float(self.run.fit_percent[0])


class Pole(NamedTuple):
    """A real pole or a pair of poles of the continuous axis."""

    frequency_hz: Estimate  # natural frequency [Hz]
    damping: Estimate  # 1 and more of real poles
    determined: bool  # whether the logs show where it is


class GivenGain(NamedTuple):
    """A steady gain that was not fitted."""

    source: str  # "given", or "plateaus"
    by_logs: tuple[float, ...]  # that of a fit without it, output by output and input by input
    contradicted: bool  # whether the logs exclude it


@dataclass(frozen=True, eq=False, repr=False)
class AxisEstimates(Result):
    """The plant of an axis, how sure it is, and how it explains the logs."""

    record: PlantRecord  # with draws
    fits: tuple[LogFit, ...]  # of each recording, those held back first
    dc_gain: tuple[Estimate, ...]  # steady output per steady input, output by output and input by input
    given_gain: GivenGain | None  # where it comes from if it was not fitted
    delay_samples: Estimate  # of the first response, a sample less with a feedthrough; range of all structures
    poles: tuple[Pole, ...]  # the slowest first
    candidates: tuple[Candidate, ...]  # the likeliest first
    excited_hz: tuple[float, float]  # band that the inputs excite
    nonlinearity: Nonlinearity | None  # that explains the logs better
    findings: tuple[Finding, ...]  # of the logs

    @property
    def part(self) -> str:
        """Name of the axis, and of its files."""
        return self.record.axis

    @property
    def judged(self) -> LogFit:
        """The fit by which the plant is judged."""
        return judged(self.fits)

    def plot(self) -> Figure:
        """Draw the recording by which the plant is judged, as measured and as simulated."""
        judged = self.judged
        return run_plot(judged.recording, judged.run, title=judged.recording.source)

    def bode(self) -> Figure:
        """Draw the frequency response with its band, and as measured."""
        fitted = [fit.recording for fit in self.fits if not fit.held_back]
        return bode_plot(self.record, measured_response(fitted), self.excited_hz, title=self.record.axis)

    def simulate(self, u: Array) -> Array:
        """Simulate the outputs from rest, shape (N, p), under inputs, shape (N, m) or (N,), that are zero before."""
        inputs = np.reshape(u, (len(u), -1))
        rest = np.zeros((self.record.delay_samples, inputs.shape[1]))
        return simulate(self.record, np.vstack([rest, inputs]))[len(rest) :]


def judged(fits: tuple[LogFit, ...]) -> LogFit:
    """Return the worst fit of a recording that moves, of those that were held back if there are some."""
    validation = [fit for fit in fits if fit.held_back] or list(fits)
    largest_spread = np.max([fit.recording.outputs.std(0) for fit in validation], axis=0)
    moving = [fit for fit in validation if np.any(fit.recording.outputs.std(0) >= _MOVING * largest_spread)]
    return min(moving, key=lambda fit: fit.fit_percent)
