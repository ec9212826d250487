"""Findings about the relation of inputs and outputs: whether there is one, in which direction, and in which units."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import fdtri

from archerfish2.identification.frequency import measured_response
from archerfish2.identification.simulation import Array, simulate
from archerfish2.identification.validation import free_run
from archerfish2.logs.recording import Finding, Recording
from archerfish2.records.plant import PlantRecord

_OWN_LAGS, _LAGS, _SAMPLES_A_LAG, _MOST_SAMPLES = 8, 100, 20, 20_000  # of the regression that tests for a response
_FALSE_ALARM, _COHERENT = 1e-4, 0.5  # of its F test; median coherence that shows a response too
_SINE_SHARE, _FEWEST_PERIODS = 0.98, 3  # of the power near one line, from which an input is a single sine; in the log
_SAMPLES_A_PARAMETER = 10
_DEGREES, _TOLERANCE = 180 / np.pi, 1.15
_OPPOSITE = -1.4, -0.7  # gains of an angle that moves against its command
_SUSPECT, _GOOD, _WORTH = 60.0, 98.0, 2.0  # fits below which columns may be exchanged, above which not; least gain [%]


def log_findings(recordings: Sequence[Recording], order: int) -> list[Finding]:
    """Return why logs can't be identified, before a fit: too short, one frequency alone, or no response.

    A log without response beside others that have one is a warning.

    Args:
      recordings: of one axis.
      order: least number of poles that is considered.
    """
    first, samples, inputs = recordings[0], sum(map(len, recordings)), range(recordings[0].inputs.shape[1])
    needed = _SAMPLES_A_PARAMETER * (order + (order + 1) * (len(inputs) + len(recordings)))
    if samples < needed:
        message = f"{samples} samples are too few for order {order}, which needs {needed}"
        return [Finding("too-short", "refused", first.source, message, "record longer or lower the order")]
    sines = [_sine_hz(each.inputs[:, 0], each.period_s) if len(inputs) == 1 else 0.0 for each in recordings]
    if 0 < max(sines) < 1.05 * min(sines):
        message = f"the input is a single sine of {sines[0]:.4g} Hz, which gives two numbers: not gain, lag and delay"
        return [Finding("single-sine", "refused", first.source, message, "record a sweep or a step")]
    silent = [each for each in recordings if not any(_responds(each, channel) for channel in inputs)]
    message = f'"{first.output_names[0]}" does not respond to {", ".join(first.input_names)}'
    remedy = "check the columns, and that the axis was powered; command larger motions"
    every = len(silent) == len(recordings)
    return [Finding("no-response", "refused" if every else "warning", e.source, message, remedy) for e in silent]


def plant_findings(plant: PlantRecord, recordings: Sequence[Recording]) -> list[Finding]:
    """Return warnings from an identified plant: mixed units and an opposite sign.

    Args:
      plant: identified.
      recordings: from which.
    """
    first, found = recordings[0], list[tuple[str, str, str, str]]()
    output, units = first.output_names[0], ("degrees", "radians")
    for name, gain in zip(first.input_names, plant.dc_gain[0].tolist(), strict=True):
        for factor, (one, other) in ((_DEGREES, units), (1 / _DEGREES, units[::-1])):
            if factor / _TOLERANCE < abs(gain) < factor * _TOLERANCE:
                message = f'the steady gain from "{name}" is {gain:.3g}, as if "{output}" were in {one}, it in {other}'
                found.append(("degrees-radians", first.source, message, "log both in radians"))
        if _OPPOSITE[0] < gain < _OPPOSITE[1]:
            message = f'"{output}" moves against "{name}": the steady gain is {gain:.3g}'
            found.append(("sign-flip", first.source, message, "turn the sign of one of them"))
    ratios = [each.outputs[:, 0].std() / simulate(plant, each.inputs)[:, 0].std() for each in recordings]
    low, high = int(np.argmin(ratios)), int(np.argmax(ratios))
    if _DEGREES / _TOLERANCE < ratios[high] / ratios[low] < _DEGREES * _TOLERANCE:
        message = f"moves {_DEGREES:.1f} times as far for its input as {recordings[low].source}, as if in other units"
        found.append(("degrees-radians", recordings[high].source, message, "log all in radians"))
    return [Finding(code, "warning", *rest) for code, *rest in found]


def exchanged_columns(
    plant: PlantRecord, judged: Recording, recordings: Sequence[Recording], fit: Callable[..., PlantRecord]
) -> Finding | None:
    """Find that input and output are exchanged, by trying it where the plant has no delay or fits badly.

    Args:
      plant: identified.
      judged: the log by which plants are compared.
      recordings: from which plants are identified.
      fit: called with recordings and an order.
    """
    percent = float(free_run(plant, judged.inputs, judged.outputs).fit_percent[0])
    at_once = plant.delay_samples <= plant.D.any()
    if plant.D.shape != (1, 1) or percent > _GOOD or not (at_once or percent < _SUSPECT):
        return None
    logs, log = [_exchanged(each) for each in recordings], _exchanged(judged)
    best = max(float(free_run(fit(logs, order), log.inputs, log.outputs).fit_percent[0]) for order in (1, 2, 3))
    if best < percent + _WORTH:
        return None
    before, after = judged.input_names[0], judged.output_names[0]
    message = f'"{after}" comes before "{before}": exchanged, the fit is {best:.1f} % instead of {percent:.1f} %'
    remedy = f'take "{after}" as the input and "{before}" as the output'
    return Finding("swapped", "warning", judged.source, message, remedy)


def _exchanged(log: Recording) -> Recording:
    inputs, outputs = (log.outputs, log.output_names), (log.inputs, log.input_names)
    return replace(log, inputs=inputs[0], outputs=outputs[0], input_names=inputs[1], output_names=outputs[1])


def _sine_hz(signal: Array, period_s: float) -> float:
    """Return the frequency [Hz] of a signal that is one sine and nothing else, 0 if it is more."""
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2
    peak = int(power.argmax())
    single = peak >= _FEWEST_PERIODS and power[peak - 2 : peak + 3].sum() > _SINE_SHARE * power.sum()
    return single * peak / (len(signal) * period_s)


def _responds(log: Recording, channel: int) -> bool:
    """Whether past inputs improve the prediction of the output by its own past, or are coherent with it."""
    lags = min(_LAGS, min(len(log), _MOST_SAMPLES) // _SAMPLES_A_LAG)
    coherence = measured_response([log]).coherence[:, 0, channel]
    if lags <= _OWN_LAGS or (coherence.size and np.median(coherence) > _COHERENT):
        return True  # a log that is too short can't show that there is none
    # Held before the log, so that a response within its first samples counts.
    both = np.stack([log.outputs[:_MOST_SAMPLES, 0], log.inputs[:_MOST_SAMPLES, channel]])
    both = np.pad((both - both.mean(1, keepdims=True)) / both.std(1, keepdims=True), ((0, 0), (lags, 0)), "edge")
    y, u = np.lib.stride_tricks.sliding_window_view(both, lags + 1, axis=1)[..., ::-1]
    squares = [
        np.sum((y[:, 0] - x @ np.linalg.lstsq(x, y[:, 0], rcond=1e-9)[0]) ** 2)
        for x in (y[:, 1 : _OWN_LAGS + 1], np.hstack([y[:, 1 : _OWN_LAGS + 1], u]))
    ]
    freedom = len(y) - _OWN_LAGS - 2 * lags - 1
    ratio = (squares[0] - squares[1]) / max(float(squares[1]), 1e-300) * freedom / (lags + 1)
    return bool(ratio > fdtri(lags + 1, freedom, 1 - _FALSE_ALARM))
