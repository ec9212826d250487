"""Findings about logs that no causal plant with one delay gives, however well one fits them."""

from collections.abc import Sequence

import numpy as np

from archerfish.identification.axis.checks import GOOD
from archerfish.identification.axis.result import LogFit
from archerfish.identification.frequency import frequency_response
from archerfish.identification.residuals import lead
from archerfish.logs.recording import Finding
from archerfish.records.plant import PlantRecord

_LEAD_SHARE = 0.5  # share of a residual that later inputs explain, from which an output comes early: of feedback 0.3
_NO_GAIN, _FREQUENCIES = 0.02, 50  # steady gain over the largest of the band, below which it is that of a rate


def early_outputs(fits: Sequence[LogFit]) -> list[Finding]:
    """Find outputs that respond before their input, as those of a filter that runs both ways.

    Args:
      fits: of logs of one input and one output; of others none is found.
    """
    found = list[Finding]()
    for log, residual in ((fit.recording, fit.residual) for fit in fits if fit.recording.inputs.shape[1] == 1):
        samples, share = lead(residual, log.inputs[:, 0])
        if share > _LEAD_SHARE:
            early = f'"{log.output_names[0]}" responds {1e3 * samples * log.period_s:.3g} ms or more before its input'
            message = f"{early}, as if it were smoothed forwards and backwards, or stamped too early"
            remedy = "log the angle as measured, with the stamps of its measurement"
            found.append(Finding("early-output", "warning", log.source, message, remedy))
    return found


def rate_output(plant: PlantRecord, band: tuple[float, float], fit: LogFit) -> list[Finding]:
    """Find an output that is the rate of what the input commands: its steady gain is known, and nearly zero.

    Args:
      plant: with draws.
      band: that the inputs excite [Hz].
      fit: by which the plant is judged; a plant that does not explain its log shows nothing.
    """
    if plant.D.shape != (1, 1) or fit.fit_percent < GOOD or not 0 < band[0] < band[1]:
        return []
    largest = np.abs(frequency_response(plant, np.geomspace(*band, _FREQUENCIES))).max()
    steady = np.abs(frequency_response(plant, np.zeros(1), draws=True))
    if np.quantile(steady, 0.95) > _NO_GAIN * largest:
        return []
    log = fit.recording
    message = f'"{log.output_names[0]}" rests wherever "{log.input_names[0]}" does, as the rate of an angle would'
    return [Finding("rate-output", "warning", log.source, message, "log the angle, or integrate the rate")]
