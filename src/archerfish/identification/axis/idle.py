"""Stretches of a log in which an axis does not follow its input: motors off, an emergency stop."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import detrend

from archerfish.identification.axis.fit import AxisFit, CorrectedLogs, fit_axis
from archerfish.identification.simulation import free_run
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_WINDOW_S, _FEWEST = 0.5, 100  # shortest stretch [s]; samples of a part that is kept
_FEWEST_WINDOWS = 2  # that are idle, of a stretch: one may have the begin of a step alone
_BETTER = 1 / 3  # error of the parts over that of the whole log
_STILL, _MOVES, _FOLLOWED = 0.3, 0.03, 0.5  # deviation over that of the plant, or of the log; error of what is followed


def without_idle(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> CorrectedLogs:
    """Leave out stretches in which an output rests although its input moves as it does where it is followed.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones.
    """
    if found.plant.D.shape != (1, 1):
        return CorrectedLogs(fitted, held_back, [])
    findings = list[Finding]()
    kept = [part for log in fitted for part in _followed(found.plant, log, findings)]
    others = [part for log in held_back for part in _followed(found.plant, log, findings)]
    return CorrectedLogs(kept, others, findings)


def _followed(plant: PlantRecord, log: Recording, findings: list[Finding]) -> list[Recording]:
    """Return the parts of a log beside idle stretches, of which findings are added; the log if there are none.

    Args:
      plant: that was identified from both idle and followed stretches.
      log: the log.
      findings: to which those of this log are added.
    """
    parts = _parts(log, _idle(plant, log))
    if not parts:
        return [log]
    of_parts = fit_axis(parts, 2).plant
    errors = [100 - _fit(of_parts, part) for part in parts]
    stretches = _idle(of_parts, log)
    parts = _parts(log, stretches)
    if not parts or max(errors) >= _BETTER * (100 - _fit(plant, log)):
        return [log]
    # A window is no longer followed when about a quarter of it is idle.
    inside_s = 0.75 * _WINDOW_S
    for begin, end in stretches:
        start_s = log.time[begin] + inside_s * (begin > 0)
        end_s = log.time[end - 1] - inside_s * (end < len(log))
        message = f'"{log.output_names[0]}" does not follow its input from {start_s:.3g} to {end_s:.3g} s, left out'
        remedy = "keep the motors on, and nothing in the way"
        findings.append(Finding("idle", "repaired", log.source, message, remedy, end - begin))
    return parts


def _fit(plant: PlantRecord, log: Recording) -> float:
    return float(free_run(plant, log.inputs, log.outputs).fit_percent[0])


def _parts(log: Recording, stretches: Sequence[tuple[int, int]]) -> list[Recording]:
    """Return what is between stretches, as far as it moves; nothing where there are no stretches."""
    begins = [0, *(end for _, end in stretches)]
    ends = [*(begin for begin, _ in stretches), len(log)]
    return [
        replace(log, inputs=log.inputs[a:b], outputs=log.outputs[a:b], start_s=log.start_s + a * log.period_s)
        for a, b in zip(begins, ends, strict=True)
        if stretches and b - a >= _FEWEST and np.ptp(log.inputs[a:b]) and np.ptp(log.outputs[a:b])
    ]


def _idle(plant: PlantRecord, log: Recording) -> list[tuple[int, int]]:
    """Return the first sample of each stretch of windows that are not followed, some of them idle, and that after it.

    An input that is held shows nothing, so that such windows beside idle ones count.
    """
    width = round(_WINDOW_S / log.period_s)
    if not 10 <= width <= len(log) // 4:
        return []
    expected = free_run(plant, log.inputs, log.outputs).outputs[:, 0]
    step = max(width // 8, 1)
    signals = log.outputs[:, 0], expected, log.outputs[:, 0] - expected
    windows = (sliding_window_view(signal, width)[::step] for signal in signals)
    still, moves, error = (detrend(each).std(axis=1) for each in windows)  # a limp axis may creep
    size = np.ptp(sliding_window_view(log.inputs[:, 0], width)[::step], axis=1)
    moving = moves > _MOVES * np.std(log.outputs)
    followed = moving & (error < _FOLLOWED * moves)
    least = max(float(np.min(size[followed], initial=np.inf)), _MOVES * float(np.ptp(log.inputs)))
    idle = moving & (still < _STILL * moves) & (size > least)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ~followed, [0]]))).reshape(-1, 2).tolist()
    found = [(first, after) for first, after in edges if np.count_nonzero(idle[first:after]) >= _FEWEST_WINDOWS]
    stretches = [(first * step, (after - 1) * step + width) for first, after in found]
    # Windows overlap, and so may stretches between which little is followed.
    merged = stretches[:1]
    for begin, end in stretches[1:]:
        if begin < merged[-1][1]:
            merged[-1] = merged[-1][0], end
        else:
            merged.append((begin, end))
    return merged
