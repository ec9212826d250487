"""The picture of an identified axis: a recording beside its simulation, and the frequency response."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from archerfish.figures.identification import BodeData, SimulatedRun, axis_figure
from archerfish.identification.frequency import measured_response, plant_response
from archerfish.identification.gimbal import AxisIdentification
from archerfish.identification.validation import free_run
from archerfish.records.recording import Recording


def simulated_run(result: AxisIdentification, recording: Recording, kind: str) -> SimulatedRun:
    """Simulate a recording from its inputs alone.

    Args:
      result: the identified axis.
      recording: of that axis.
      kind: what the recording served for, "training" or "validation".
    """
    run = free_run(result.plant, recording, result.offset)
    return SimulatedRun(
        recording.time,
        recording.outputs[:, 0],
        run.simulated[:, 0],
        run.fit_percent.item(),
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
    return axis_figure(run, _bode(result, logs), output=output, title=result.plant.axis)


def _bode(result: AxisIdentification, logs: Sequence[Recording]) -> BodeData:
    nyquist = 0.5 / result.plant.sample_period_s
    lowest = max(result.excited_band_hz[0], 1e-3 * nyquist)
    frequency = np.geomspace(lowest, 0.999 * nyquist, 400)
    measured = measured_response(list(logs))
    empty: NDArray[np.float64] = np.zeros(0)
    kept = measured.coherence > 0.5 if measured else empty.astype(bool)
    return BodeData(
        frequency,
        plant_response(result.plant, frequency)[:, 0, 0],
        measured.frequency_hz[kept] if measured else empty,
        measured.response[kept] if measured else empty.astype(np.complex128),
        result.excited_band_hz,
    )
