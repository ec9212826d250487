"""The pictures of an identified axis: what its recordings, its plant and the plant's draws look like."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.bode import BodeData
from archerfish.figures.identification import SimulatedRun, axis_figure, worst_stretch
from archerfish.figures.pole_map import PoleMap
from archerfish.figures.residuals import CorrelationPanel
from archerfish.figures.step_response import StepResponse
from archerfish.identification.axis.gimbal import AxisIdentification
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.validation.confidence_bands import (
    band,
    drawn_outputs,
    drawn_poles,
    drawn_responses,
    parameter_errors,
)
from archerfish.identification.validation.free_run import FreeRun, free_run, own_zero_run
from archerfish.identification.validation.frequency import measured_response, plant_response
from archerfish.identification.validation.residual_tests import ResidualTests
from archerfish.records.plant import dc_gain
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_STEP_SAMPLES = (50, 2000)
"""Fewest and most samples of a step response that are drawn."""
_SETTLED = 1e-3
"""Share of its start at which the slowest mode no longer shows."""


def simulated_run(result: AxisIdentification, recording: Recording, kind: str) -> SimulatedRun:
    """Simulate a recording from its inputs alone.

    Args:
      result: the identified axis.
      recording: of that axis.
      kind: what the recording served for, "training" or "validation". A fitted recording has a zero of its own; one
        that was held back is held against the zero that the fitted ones share.
    """
    if kind == "training":
        _, run = own_zero_run(result.plant, recording, drift=result.drift)
    else:
        run = free_run(result.plant, recording, result.offset, drift=result.drift)
    return shown_run(recording, run, parameter_errors(result.plant, recording.inputs), kind)


def shown_run(recording: Recording, run: FreeRun, errors: Array, kind: str) -> SimulatedRun:
    """Gather what a picture shows of a free run.

    Args:
      recording: what was simulated.
      run: its free run.
      errors: what the uncertainty of the plant adds to its residual, shape (k, N); k may be 0.
      kind: what the recording served for, "training" or "validation".
    """
    measured, simulated = recording.outputs[:, 0], run.simulated[:, 0]
    shown = worst_stretch(measured, simulated)
    return SimulatedRun(
        recording.time,
        measured,
        simulated,
        _spread(simulated[shown] + errors[:, shown]),
        run.fit_percent[0].item(),
        f"{kind} {recording.source}",
    )


def axis_picture(result: AxisIdentification, run: SimulatedRun, logs: Sequence[Recording], *, output: str) -> Figure:
    """Draw an identified axis.

    Args:
      result: the axis.
      run: the recording to show.
      logs: what was fitted; the measured frequency response comes from it.
      output: name of the output, for the labels.
    """
    return axis_figure(run, bode_data(result, logs), output=output, title=result.plant.axis)


def bode_data(result: AxisIdentification, logs: Sequence[Recording], channel: int = 0) -> BodeData:
    """Gather the frequency response from one input: the model's, its draws' and the measured one.

    Args:
      result: the axis.
      logs: what was fitted.
      channel: which input.
    """
    nyquist = 0.5 / result.plant.sample_period_s
    driven = result.excited_band_hz
    frequency = np.geomspace(max(driven[0] / 4, 1e-3 * nyquist), 0.999 * nyquist, 400)
    measured = measured_response(list(logs), channel)
    empty: Array = np.zeros(0)
    return BodeData(
        frequency,
        plant_response(result.plant, frequency)[:, 0, channel],
        drawn_responses(result.plant, frequency)[:, :, 0, channel],
        measured.frequency_hz if measured else empty,
        measured.response if measured else empty.astype(np.complex128),
        measured.coherence if measured else empty,
        driven,
    )


def pole_map(result: AxisIdentification, determined: NDArray[np.bool_], driven_hz: tuple[float, float]) -> PoleMap:
    """Gather the poles of an axis.

    Args:
      result: the axis.
      determined: whether its recordings determine each pole, shape (n,).
      driven_hz: frequencies that the inputs excite [Hz].
    """
    period = result.plant.sample_period_s
    drawn = drawn_poles(result.plant, result.poles)
    return PoleMap(result.poles, drawn, determined, period, driven_hz)


def unit_steps(result: AxisIdentification) -> list[StepResponse]:
    """Return the unit step response from each input, until it has settled."""
    plant = result.plant
    count = _settling_samples(result)
    panels = []
    for channel, name in enumerate(plant.input_names):
        inputs = np.zeros((count, len(plant.input_names)))
        # The sample before the step is at rest: an input is taken to have been held before the first.
        inputs[1:, channel] = 1.0
        panels.append(
            StepResponse(
                f"Unit step of {name}",
                np.arange(-1.0, count - 1.0) * plant.sample_period_s,
                simulate(plant, inputs)[:, 0],
                _spread(drawn_outputs(plant, inputs)[..., 0]),
                dc_gain(plant)[0, channel].item(),
            )
        )
    return panels


def _settling_samples(result: AxisIdentification) -> int:
    slowest = min(float(np.abs(result.poles).max()), 1 - 1e-6)
    settled = result.plant.delay_samples + np.log(_SETTLED) / np.log(max(slowest, 1e-3))
    return int(np.clip(settled, *_STEP_SAMPLES))


def correlation_panels(tests: ResidualTests, names: Sequence[str]) -> list[CorrelationPanel]:
    """Return what a residual is tested for, as panels: with itself, then with each input.

    Args:
      tests: of one recording.
      names: of the inputs.
    """
    titles = ("Residual with itself", *(f"Residual with {name}" for name in names))
    correlograms = (tests.whiteness, *tests.independence)
    return [
        CorrelationPanel(title, each.lag, each.correlation, each.half_width)
        for title, each in zip(titles, correlograms, strict=True)
    ]


def _spread(drawn: Array) -> tuple[Array, Array]:
    if not len(drawn):
        return np.zeros(0), np.zeros(0)
    low, high = band(drawn)
    return low, high
