"""Logs of one axis at one sampling period, as a difference equation needs them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from archerfish.identification.doctor.time_stamps import held_mean
from archerfish.records.findings import Finding
from archerfish.records.recording import Recording

_SAME = 1e-3
"""Share by which sampling periods may differ and still be one: over a thousand samples it adds up to one."""


def at_common_period(recordings: Sequence[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Bring recordings to the longest of their sampling periods.

    Outputs are interpolated by a cubic spline; an input is what was held, averaged over each new interval.

    Args:
      recordings: of one axis, in any units of time that agree.

    Returns:
      The recordings, in their order, and a finding for each that was resampled.
    """
    period = max((each.sample_period_s for each in recordings), default=0.0)
    brought, findings = [], []
    for each in recordings:
        if each.sample_period_s >= period * (1 - _SAME):
            brought.append(replace(each, sample_period_s=period))
            continue
        brought.append(_resampled(each, period))
        message = f"was sampled every {each.sample_period_s:.4g} s and resampled to {period:.4g} s, as the slowest log"
        findings.append(Finding("other-period", "repaired", each.source, message, "log all at one rate"))
    return brought, findings


def _resampled(recording: Recording, period: float) -> Recording:
    time = recording.time[0] + recording.sample_period_s * np.arange(len(recording))
    grid = time[0] + period * np.arange(max(1, int((time[-1] - time[0]) / period + 1e-9)))
    return replace(
        recording,
        time=grid,
        inputs=held_mean(time, recording.inputs, grid, period),
        outputs=CubicSpline(time, recording.outputs)(grid),
        sample_period_s=period,
    )
