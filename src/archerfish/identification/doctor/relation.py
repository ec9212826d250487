"""The log doctor on what input and output have to do with each other: response, feedback, swapped columns, units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import chdtri, fdtri

from archerfish.identification.axis.rest_start import rest_samples
from archerfish.identification.validation.frequency import MeasuredResponse, measured_response
from archerfish.identification.validation.surprises import surprises
from archerfish.records.findings import Finding, Severity
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_LAGS = 8
_FUTURE = 12
_SAMPLES_A_LAG = 20
"""Samples for each lag that is looked at; shorter recordings are looked at with fewer."""
_FEWEST_LAGS = 2
_MOST_SAMPLES = 20_000
_FALSE_ALARM = 1e-4
_FEEDBACK_SHARE = 0.035
"""Share of the output's innovations that surprises of the input foretell, from which there is feedback. Recorded loops
have 4 % and more; limits, friction, backlash and modes come to more in 2 % of simulated open-loop logs."""
_SWAPPED_SHARE = 0.1
_NOISELESS = 1e-9  # of the output's variance: rounding alone can look like anything
_SCATTERED = 6.0  # standard deviations; the largest of thousands of chance correlations stays below

_DEGREES = 180 / np.pi
_UNIT_TOLERANCE = 1.15
_FLIPPED = (0.7, 1.4)


class _Causality(NamedTuple):
    responds: bool  # past inputs foretell the output
    foretold_share: float  # of the output's innovations by future inputs; 0 if chance explains it


def relation_findings(recording: Recording, max_delay: int) -> list[Finding]:
    """Return what the input and the output of a recording show together.

    The output's innovations (what neither its past nor the past inputs foretell) must be unrelated to the inputs that
    follow, as far as those inputs' own past does not foretell them. Where they are related, the input was made from the
    output: feedback, or the columns are swapped. Söderström and
    Stoica, System Identification, 1989, section 11.8, test the same by the residuals' correlation at negative lags.

    Args:
      recording: one output.
      max_delay: longest delay that is looked for [samples].

    Returns:
      Findings; "no-response" is one that refuses.
    """
    lags, depth = _lags_and_depth(min(len(recording), _MOST_SAMPLES), max_delay)
    # Before a recording from rest there was rest; a response within its first samples would be lost otherwise.
    rest = depth if rest_samples(recording) else 0
    y = _standard(_after_rest(recording.outputs[:_MOST_SAMPLES, 0], rest))
    inputs = [_standard(_after_rest(signal, rest)) for signal in recording.inputs[:_MOST_SAMPLES].T]
    if lags < _FEWEST_LAGS or min(y.std(), *(u.std() for u in inputs)) == 0:
        return []
    found = [_causality(u, y, lags, depth) for u in inputs]
    swapped = len(inputs) == 1 and not found[0].responds and found[0].foretold_share > _SWAPPED_SHARE
    if swapped or (len(inputs) == 1 and _leads(recording)):
        message = f'"{recording.output_names[0]}" comes before "{recording.input_names[0]}", as if they were swapped'
        return [_finding("swapped", "warning", recording, message, "exchange --input and --output")]
    if not any(each.responds for each in found):
        # Too short to be sure of so much: the fit will tell.
        return [] if depth < _LAGS + max_delay else _silent(recording, inputs, y, max_delay)
    loop = [
        _feedback(recording, name)
        for name, each in zip(recording.input_names, found, strict=True)
        if each.foretold_share
    ]
    # In a loop the ratio of output to input tells the controller as much as the plant.
    return loop or _gains(recording)


def _lags_and_depth(count: int, max_delay: int) -> tuple[int, int]:
    """Return how many lags a recording bears, and how far back its inputs are looked at [samples]."""
    depth = min(_LAGS + max_delay, count // _SAMPLES_A_LAG)
    return min(_LAGS, depth // 2), depth


def _after_rest(signal: Array, count: int) -> Array:
    return np.concatenate([np.full(count, signal[0]), signal])


def _standard(signal: Array) -> Array:
    deviation = float(signal.std())
    return np.asarray((signal - signal.mean()) / (deviation or 1.0))


def _causality(u: Array, y: Array, lags: int, depth: int) -> _Causality:
    past_y = _lagged(y, range(1, lags + 1), depth)
    past_u = _lagged(u, range(depth + 1), depth)
    target = y[depth:]
    own, both = _rest(past_y, target), _rest(np.hstack([past_y, past_u]), target)
    freedom = len(target) - past_y.shape[1] - past_u.shape[1] - 1
    gain = (own @ own - both @ both) / max(float(both @ both), 1e-300) * freedom / past_u.shape[1]
    responds = bool(gain > fdtri(past_u.shape[1], freedom, 1 - _FALSE_ALARM))
    innovation = surprises(u)[depth:]
    if not innovation.any() or both.var() < _NOISELESS:
        return _Causality(responds, 0.0)
    e, w = both / both.std(), innovation / innovation.std()
    count = len(e) - _FUTURE
    correlation = np.array([e[:count] @ w[lag : lag + count] for lag in range(1, _FUTURE + 1)]) / count
    share = float(correlation @ correlation)
    significant = share > _FEEDBACK_SHARE and count * share > chdtri(_FUTURE, _FALSE_ALARM)
    return _Causality(responds, share if significant else 0.0)


def _lagged(signal: Array, lags: range, depth: int) -> Array:
    return np.column_stack([signal[depth - lag : len(signal) - lag] for lag in lags])


def _rest(regressors: Array, target: Array) -> Array:
    """Return what a linear regression with a constant leaves of a signal."""
    columns = np.hstack([regressors, np.ones((len(target), 1))])
    # Normal equations with a trace of ridge: ten times faster than orthogonalising, and smooth inputs stay solvable.
    gram = columns.T @ columns
    gram[np.diag_indices_from(gram)] += 1e-9 * len(target)
    return np.asarray(target - columns @ np.linalg.solve(gram, columns.T @ target))


def _leads(recording: Recording) -> bool:
    """Tell whether the output leads a smooth input (a sweep) all over its band: the phase rises with the frequency."""
    response = measured_response([recording])
    if response is None:
        return False
    sure = response.coherence > 0.9
    if sure.sum() < 10:
        return False
    frequency, phase = response.frequency_hz[sure], np.unwrap(np.angle(response.response[sure]))
    slope = np.polyfit(frequency, phase, 1)[0]
    gains = np.abs(response.response[sure])
    # A swapped low-pass both leads and grows, by more than a quarter turn.
    third = max(1, gains.size // 3)
    return bool(
        slope > 0
        and phase[-third:].mean() - phase[:third].mean() > np.pi / 4
        and gains[-third:].mean() > 1.5 * gains[:third].mean()
        and -np.pi / 4 < phase[0] < np.pi / 2
    )


def _silent(recording: Recording, inputs: Sequence[Array], y: Array, max_delay: int) -> list[Finding]:
    """Look for a response that comes late or shows only in the spectrum; else there is none."""
    lag = max((_late_response(u, y) for u in inputs), default=0)
    if lag > max_delay:
        message = f"the output answers {lag} samples ({lag * recording.sample_period_s:.3g} s) after the input"
        return [_finding("long-delay", "warning", recording, message, f"pass --max-delay {int(1.2 * lag)}")]
    if lag or any(_coherent(recording, channel) for channel in range(len(inputs))):
        return []
    message = f'"{recording.output_names[0]}" does not answer to {", ".join(recording.input_names)}'
    remedy = "check the columns, and that the axis was powered; command larger motions"
    return [_finding("no-response", "refused", recording, message, remedy)]


def _late_response(u: Array, y: Array) -> int:
    """Return the lag of the largest correlation of the whitened signals, 0 if chance explains it."""
    whitened = [_standard(_rest(_lagged(each, range(1, _LAGS + 1), _LAGS), each[_LAGS:])) for each in (y, u)]
    count = len(whitened[0])
    size = next_fast_len(2 * count, real=True)  # room for the whole correlation: nothing wraps around
    output, command = (rfft(each, size) for each in whitened)
    causal = irfft(output * np.conj(command), size)[: min(len(y) // 4 + 1, count)] / count
    peak = int(np.abs(causal).argmax())
    return 0 if abs(causal[peak]) * np.sqrt(count) < _SCATTERED else peak


def _coherent(recording: Recording, channel: int) -> bool:
    response = measured_response([recording], channel)
    return response is not None and bool(np.median(response.coherence) > 0.5)


def _feedback(recording: Recording, name: str) -> Finding:
    message = f'"{name}" answers to "{recording.output_names[0]}": it was made in a loop'
    remedy = "take the loop's reference as the input, or expect a biased plant where noise drove the loop"
    return _finding("feedback", "warning", recording, message, remedy)


def _gains(recording: Recording) -> list[Finding]:
    """Warn where the gain at low frequencies tells mixed units or a flipped sign."""
    findings = []
    for channel, name in enumerate(recording.input_names):
        response = measured_response([recording], channel)
        gain = None if response is None else _low_gain(response)
        if gain is None:
            continue
        for factor, output, command in ((_DEGREES, "degrees", "radians"), (1 / _DEGREES, "radians", "degrees")):
            if factor / _UNIT_TOLERANCE < abs(gain) < factor * _UNIT_TOLERANCE:
                message = f'the gain from "{name}" is {abs(gain):.3g}: output in {output} and command in {command}?'
                findings.append(_finding("degrees-radians", "warning", recording, message, "log both in radians"))
        if _FLIPPED[0] < abs(gain) < _FLIPPED[1] and np.cos(np.angle(gain)) < -0.85:
            message = f'the output moves against "{name}": the gain is {gain.real:.2f}'
            findings.append(_finding("sign-flip", "warning", recording, message, "turn the sign of one of them"))
    return findings


def _low_gain(response: MeasuredResponse) -> complex | None:
    """Return the gain at the lowest frequency where the output follows the input beyond doubt."""
    sure = np.flatnonzero(response.coherence > 0.8)
    return complex(response.response[sure[0]]) if sure.size else None


def _finding(code: str, severity: Severity, recording: Recording, message: str, remedy: str) -> Finding:
    return Finding(code, severity, recording.source, message, remedy)
