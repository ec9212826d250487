"""Stretches of a log in which an axis does not follow its input: motors off, an emergency stop."""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import detrend

from archerfish.identification.axis.encoder import Logs
from archerfish.identification.axis.fit import AxisFit, fit_axis
from archerfish.identification.simulation import free_run
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_WINDOW_S, _FEWEST = 0.5, 100  # shortest stretch [s]; samples of a part that is kept
_BETTER = 1 / 3  # error of the parts over that of the whole log
_STILL, _MOVES, _FOLLOWED = 0.3, 0.03, 0.5  # deviation over that of the plant, or of the log; error of what is followed


def without_idle(found: AxisFit, fitted: list[Recording], held_back: list[Recording]) -> Logs:
    """Leave out stretches in which an output rests although its input moves as it does where it is followed.

    Args:
      found: plant of the recordings.
      fitted: recordings from which it was identified.
      held_back: other ones, which stay as they are.
    """
    kept, findings = list[Recording](), list[Finding]()
    for log in fitted if found.plant.D.shape == (1, 1) else ():
        begin, end = _idle(found.plant, log)
        if begin < end and (parts := _parts(log, begin, end)):
            plant = fit_axis(parts, 2).plant  # the one that was found is of both
            errors = [100 - _fit(plant, part) for part in parts]
            begin, end = _idle(plant, log)
            better = begin < end and max(errors) < _BETTER * (100 - _fit(found.plant, log))
            if better and (parts := _parts(log, begin, end)):
                # A window is no longer followed when about a quarter of it is idle.
                inside_s = 0.75 * _WINDOW_S
                start_s = log.time[begin] + inside_s * (begin > 0)
                end_s = log.time[end - 1] - inside_s * (end < len(log))
                lost = len(log) - sum(map(len, parts))
                message = f'"{log.output_names[0]}" does not follow its input from {start_s:.3g} to {end_s:.3g} s'
                remedy = "keep the motors on, and nothing in the way"
                findings.append(Finding("idle", "repaired", log.source, f"{message}, left out", remedy, lost))
                kept += parts
                continue
        kept.append(log)
    return (kept if findings else fitted), held_back, findings


def _fit(plant: PlantRecord, log: Recording) -> float:
    return float(free_run(plant, log.inputs, log.outputs).fit_percent[0])


def _parts(log: Recording, begin: int, end: int) -> list[Recording]:
    """Return what is before a stretch and after it, as far as it moves."""
    return [
        replace(log, inputs=log.inputs[a:b], outputs=log.outputs[a:b], start_s=log.start_s + a * log.period_s)
        for a, b in ((0, begin), (end, len(log)))
        if b - a >= _FEWEST and np.ptp(log.inputs[a:b]) and np.ptp(log.outputs[a:b])
    ]


def _idle(plant: PlantRecord, log: Recording) -> tuple[int, int]:
    """Return the first sample of windows that are not followed, the most of them idle, and the one after their last.

    Both are 0 where there are none. An input that is held shows nothing, so that such windows beside idle ones count.
    """
    width = round(_WINDOW_S / log.period_s)
    if not 10 <= width <= len(log) // 4:
        return 0, 0
    expected = free_run(plant, log.inputs, log.outputs).outputs[:, 0]
    step = max(width // 8, 1)
    signals = log.outputs[:, 0], expected, log.outputs[:, 0] - expected
    windows = (sliding_window_view(signal, width)[::step] for signal in signals)
    still, moves, error = (detrend(each).std(axis=1) for each in windows)  # a limp axis may creep
    size = np.ptp(sliding_window_view(log.inputs[:, 0], width)[::step], axis=1)
    moving = moves > _MOVES * np.std(log.outputs)
    followed = moving & (error < _FOLLOWED * moves)
    idle = moving & (still < _STILL * moves) & (size > np.min(size[followed], initial=np.inf))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ~followed, [0]]))).reshape(-1, 2)
    first, after = max(edges.tolist(), key=lambda run: np.count_nonzero(idle[slice(*run)]), default=(0, 0))
    return (first * step, (after - 1) * step + width) if idle[first:after].any() else (0, 0)
