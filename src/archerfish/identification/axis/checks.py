"""Findings about the relation of inputs and outputs: whether there is one, in which direction, and in which units.

`check_logs` refuses before a fit; all others look at what was fitted, and may fit single logs again.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtri

from archerfish.errors import InputError
from archerfish.identification.axis.fit import AxisFit, fit_axis
from archerfish.identification.frequency import measured_response
from archerfish.identification.simulation import TINY, Array, first_motion, free_run
from archerfish.logs.recording import Finding, Recording, Values
from archerfish.records.plant import PlantRecord

_OWN_LAGS, _LAGS, _SAMPLES_A_LAG, _MOST_SAMPLES = 8, 100, 20, 20_000  # of the regression that tests for a response
_LONGEST_DELAY = 8  # beyond the log's length over it no response is looked for
_FALSE_ALARM, _COHERENT = 1e-4, 0.5  # of its F test; median coherence that shows a response too
_FEWEST, _OTHER_UNIT = 100, 20.0
"""Samples of a log that is fitted alone; ratio of gains that one axis does not have."""
_SINE_SHARE, _FEWEST_PERIODS = 0.98, 3  # of the power near one line, from which an input is a single sine; in the log
_SAMPLES_A_PARAMETER, _DEPENDENT = 10, 1e6  # condition number from which inputs depend on each other
_SUSPECT = 60.0  # fit below which columns may be exchanged [%]
GOOD = 80.0
"""Fit from which a plant explains a log [%]."""
_EXCHANGED, _QUICK_S = 95.0, 0.1  # fit that an exchange reaches at least [%], and delay below which it stays [s]
_WORTH, _LEAST = 2.0, 0.01  # points that an exchange gains at least, or half of the rest if that is not too little
_MANY = 6  # poles
_EXACT, _COMPUTED = 99.9, 1e-8  # fit that noise does not reach [%]; share of an output's power that is rounding
_WIDTHS, _INPUTS, _RESIDUALS = (1, 2, 4, 8), 20, 4  # samples of a mean; past means that may make an input
_LOOP_ALARM, _PREDICTABLE = 2.5e-4, 1e-9  # of each test for a loop; share of an input's power that is rounding
_SIGN = "sign-flip", "change the sign of one of them, as with a minus: --output=-NAME"
_RADIANS = "log both in radians, or say which one is in degrees:"
_OUTPUT, _INPUT = (("degrees-radians", f"{_RADIANS} --{signal}-unit deg") for signal in ("output", "input"))
_GAINS = (
    (50.0, 66.0, "as if the output were in degrees and the input in radians", *_OUTPUT),
    (1 / 66.0, 1 / 50.0, "as if the output were in radians and the input in degrees", *_INPUT),
    (-1.4, -0.7, "so that it moves the other way", *_SIGN),
)
"""Steady gains that are suspicious, those of units of either sign."""


def check_logs(recordings: Sequence[Recording], order: int) -> None:
    """Refuse logs that can't determine a plant: too short, of one frequency, with inputs that are one.

    Args:
      recordings: of one axis.
      order: least number of poles that is considered.

    Raises:
      InputError: naming the first log, with a code.
    """
    first, samples, inputs = recordings[0], sum(map(len, recordings)), recordings[0].inputs.shape[1]
    needed = _SAMPLES_A_PARAMETER * (order + (order + 1) * (inputs + len(recordings)))
    if samples < needed:
        problem = f"{samples} samples are too few for order {order}, which needs {needed}"
        raise InputError(f"{first.source}: {problem}; record longer or lower the order", "too-short")
    if inputs > 1:
        centred = np.concatenate([log.inputs - log.inputs.mean(0) for log in recordings])
        if np.linalg.cond(centred / (np.linalg.norm(centred, axis=0) + TINY)) > _DEPENDENT:
            problem = f"of the inputs {', '.join(first.input_names)} one is a copy or a mixture of the others"
            raise InputError(f"{first.source}: {problem}; leave one out", "dependent-inputs")
        return
    for log in recordings:
        u, y = (signal[:, 0] - signal[:, 0].mean() for signal in (log.inputs, log.outputs))
        factor = float(u @ y) / max(float(u @ u), TINY)
        if factor and factor != 1 and np.sum((y - factor * u) ** 2) < _COMPUTED * (y @ y):
            copied = f'"{log.output_names[0]}" is "{log.input_names[0]}" times {factor:.4g} in every row'
            problem = f"{copied}, so that one was computed from the other"
            remedy = "log the angle that the encoder measures, and the command or the set point of the loop"
            raise InputError(f"{log.source}: {problem}; {remedy}", "same-signal")
    sines = [_sine_hz(log.inputs[:, 0], log.period_s) for log in recordings]
    if 0 < max(sines) < 1.05 * min(sines):
        problem = f"the input is a single sine of {sines[0]:.4g} Hz, which gives two numbers: not gain, lag and delay"
        raise InputError(f"{first.source}: {problem}; record a sweep or a step", "single-sine")


def fit_alone(log: Recording) -> PlantRecord | None:
    """Return the plant of second order of a log alone, if it explains the log well."""
    if len(log) < _FEWEST or not (np.ptp(log.inputs, axis=0).all() and np.ptp(log.outputs, axis=0).all()):
        return None
    plant = fit_axis([log], 2).plant
    return plant if free_run(plant, log.inputs, log.outputs).fit_percent[0] > GOOD else None


def silent_logs(recordings: Sequence[Recording]) -> list[Finding]:
    """Return a warning for each log whose output does not respond to its input.

    Args:
      recordings: of one axis.
    """
    silent = list[Finding]()
    for log in recordings:
        # Of one step from rest few samples show that it responds, but a plant follows it.
        if any(_responds(log, channel) for channel in range(log.inputs.shape[1])) or fit_alone(log) is not None:
            continue
        message = f'"{log.output_names[0]}" does not respond to {", ".join(log.input_names)}'
        remedy = "check the columns, and that the axis was powered; command larger motions"
        silent.append(Finding("no-response", "warning", log.source, message, remedy))
    return silent


def plant_findings(plant: PlantRecord, log: Recording) -> list[Finding]:
    """Return warnings from the steady gains of an identified plant: mixed units and an opposite sign.

    Args:
      plant: identified.
      log: one of those that it was identified from.
    """
    found = list[Finding]()
    for name, gain in zip(log.input_names, plant.dc_gain[0].tolist(), strict=True):
        for low, high, meaning, code, remedy in _GAINS:
            if low < (gain if low < 0 else abs(gain)) < high:
                message = f'the steady gain of "{log.output_names[0]}" from "{name}" is {gain:.3g}, {meaning}'
                found.append(Finding(code, "warning", log.source, message, remedy))
    return found


def contradictions(logs: Sequence[tuple[Recording, float]]) -> list[Finding]:
    """Find logs of another sign or unit than the others, where all together fit badly: each is fitted alone.

    Args:
      logs: recordings, and how well they are explained [%]; of one input and one output, or none is found.
    """
    first, _ = logs[0]
    if len(first.input_names) * len(first.output_names) > 1 or min(percent for _, percent in logs) >= GOOD:
        return []
    plants = [(log, fit_alone(log)) for log, _ in logs]
    gains = [(log, plant.dc_gain.item()) for log, plant in plants if plant is not None]
    sign = 1 if sum(np.sign(gain) for _, gain in gains) >= 0 else -1
    found = list[Finding]()
    for log, gain in gains if len(gains) > 1 else ():
        others = sign * float(np.median([abs(gain) for other, gain in gains if other is not log]))
        if not abs(others) / _OTHER_UNIT < sign * gain < abs(others) * _OTHER_UNIT:
            message = f"this log alone has a steady gain of {gain:.3g}, the others one of {others:.3g}"
            remedy = "bring all logs to one sign and unit, or leave this one out"
            found.append(Finding("contradiction", "warning", log.source, message, remedy))
    return found


def exchanged_columns(found: AxisFit, log: Recording, recordings: Sequence[Recording]) -> list[Finding]:
    """Find that input and output are exchanged, by trying it where the plant has no delay or fits badly.

    Args:
      found: the plant.
      log: the log by which plants are compared.
      recordings: from which plants are identified.
    """
    plant, drift = found.plant, found.structure.drift
    percent = float(free_run(plant, log.inputs, log.outputs, drift=drift).fit_percent[0])
    # The inverse of an axis leads, so that a plant of it has no delay, or many poles.
    odd = plant.dead_time_samples == 0 or len(plant.A) >= _MANY
    moving = [recording for recording in recordings if np.ptp(recording.inputs)]
    if plant.D.shape != (1, 1) or not (odd or percent < _SUSPECT) or not np.ptp(log.inputs):
        return []
    other, *logs = map(_exchanged, (log, *moving))
    plants = [fit_axis(logs, order).plant for order in (1, 2, 3)]
    quick = [plant for plant in plants if plant.dead_time_samples * plant.sample_period_s < _QUICK_S]
    runs = [free_run(each, other.inputs, other.outputs, drift=drift) for each in quick]
    best = max((float(run.fit_percent[0]) for run in runs), default=0.0)
    if best < max(_EXCHANGED, percent + max(_LEAST, min(_WORTH, (100 - percent) / 2))):
        return []
    message = f"the output comes before the input: exchanged, the fit is {best:.1f} % instead of {percent:.1f} %"
    remedy = f'take "{log.output_names[0]}" as the input and "{log.input_names[0]}" as the output'
    if best > _EXACT:
        remedy += f'; if a controller makes "{log.input_names[0]}" of "{log.output_names[0]}", log its set point'
    return [Finding("swapped", "warning", log.source, message, remedy)]


def _exchanged(log: Recording) -> Recording:
    names = {"input_names": log.output_names, "output_names": log.input_names}
    return Recording.from_arrays(log.outputs, log.inputs, log.period_s, **names)


def follows_output(log: Recording, residual: Array) -> bool:
    """Return whether the first input depends on earlier residuals beyond its own past, as an outer loop's command.

    The test is that of Granger (1969), on samples and on means of several: a slow disturbance shows little from sample
    to sample.

    Args:
      log: the log.
      residual: measured less simulated output, shape (N,).
    """
    for width in _WIDTHS:
        count = len(log) // width
        signals = (signal[: count * width].reshape(count, width).mean(1) for signal in (log.inputs[:, 0], residual))
        u, e = map(_normalised, signals)
        own, freedom = _past(u, 1, _INPUTS), count - 1 - _INPUTS - _RESIDUALS
        alone, both = (_left(u, columns) for columns in (own, np.hstack([own, _past(e, 1, _RESIDUALS)])))
        gained = (alone @ alone - both @ both) / max(float(both @ both), _PREDICTABLE * count)
        if freedom > _FEWEST and gained * freedom / _RESIDUALS > fdtri(_RESIDUALS, freedom, 1 - _LOOP_ALARM):
            return True
    return False


def _sine_hz(signal: Array, period_s: float) -> float:
    """Return the frequency [Hz] of a signal that is one sine and nothing else, 0 if it is more."""
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)))) ** 2
    peak = int(power.argmax())
    single = peak >= _FEWEST_PERIODS and power[peak - 2 : peak + 3].sum() > _SINE_SHARE * power.sum()
    return single * peak / (len(signal) * period_s)


def _responds(log: Recording, channel: int) -> bool:
    """Return whether past inputs improve the prediction of the output by its own past, or are coherent with it."""
    n, begins = min(len(log), _MOST_SAMPLES), first_motion(log.inputs[:, channel : channel + 1])
    lags, farthest = min(_LAGS, n // _SAMPLES_A_LAG), n // _LONGEST_DELAY
    coherence = measured_response([log]).coherence[:, 0, channel]
    if lags <= _OWN_LAGS or (coherence.size and np.median(coherence) > _COHERENT):
        return True  # a log that is too short can't show that there is none
    start = min(max(begins - _LAGS, 0), len(log) - n)  # a log may rest for longer than what is tested
    y, u = (_normalised(signal[start : start + n]) for signal in (log.outputs[:, 0], log.inputs[:, channel]))
    own = _past(y, 1, _OWN_LAGS)
    white_y, white_u = _left(y, own), _left(u, _past(u, 1, _OWN_LAGS))
    spectra = np.fft.rfft(white_y, 2 * n) * np.fft.rfft(white_u, 2 * n).conj()
    peak = np.argmax(np.abs(np.fft.irfft(spectra)[: farthest + 1]))
    freedom, searched = n - _OWN_LAGS - 2 * lags - 1, 1 + farthest // lags
    for first in {0, max(0, int(peak) - lags // 2)}:
        left = _left(y, np.hstack([own, _past(u, first, lags + 1)]))
        ratio = (white_y @ white_y - left @ left) / max(float(left @ left), TINY) * freedom / (lags + 1)
        if ratio > fdtri(lags + 1, freedom, 1 - _FALSE_ALARM / searched):
            return True
    return False


def _normalised(x: Values) -> Array:
    return np.asarray((x - x.mean()) / max(float(x.std()), TINY))


def _past(x: Array, first: int, count: int) -> Array:
    """Return the values of a signal `first` samples ago and before that, shape (N, count)."""
    # Held before the log, so that a response within its first samples counts.
    padded = np.pad(x, (first + count - 1, 0), "edge")
    return np.lib.stride_tricks.sliding_window_view(padded, count)[: len(x)]


def _left(x: Array, columns: Array) -> Array:
    """Return what a regression on columns leaves of a signal."""
    return np.asarray(x - columns @ np.linalg.lstsq(columns, x, rcond=1e-9)[0])
