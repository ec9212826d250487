"""Whether an identified axis is good for anything: several facts, each with its own bar and its own remedy.

A fit alone says little. A plant whose steady gain or delay the logs leave open can match them perfectly, and so can
one that was fitted to swapped columns or to stamps in another unit.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from archerfish.cli.axis_evidence import AxisEvidence, LogEvidence, gain_words, steady_gains
from archerfish.identification.axis.nonlinearity import NonlinearFit
from archerfish.records.plant import USABLE_FIT_PERCENT

GAIN_SHARE = 0.05
"""Half width of the steady gain's 95 % interval over the gain, up to which the gain is known."""
DELAY_CERTAINTY = 0.6
"""Probability, by the weights of all structures, from which a delay within a sample or a tenth counts as known."""
_MOVING = 0.3
"""Deviation of an output over that of the liveliest log, from which the log is one to judge by."""
_CLEAR = 15.0
"""Twice the log likelihood that a nonlinear operator must gain to be named."""
_SEEN_SHARE = 0.97
"""Power of its residual over the linear plant's, up to which it is named."""
_NOISE_SHARE = 0.1
"""Share of the residual's power that past inputs explain, up to which a low fit is the noise's fault."""
_NOISY_FIT = 55.0
"""Fit below which noise is no excuse: too little of the output is the response [%]."""
_SPOILING = {
    "swapped": "exchange --input and --output",
    "time-unit": "name the column after its unit (…_ms), or pass --sample-period-s",
    "feedback": "name the loop's set point as --input",
}
"""Findings of the logs' examination that make a plant useless, with the remedy."""


class Shortfall(NamedTuple):
    """A fact that makes a plant useless."""

    code: str
    """Short, stable name."""
    sentence: str
    """What it is and what to do."""


def judged_fit(evidence: AxisEvidence) -> LogEvidence:
    """Return the recording by which the plant is judged: the worst that was held back, else the worst fitted.

    A piece in which the axis hardly moves says nothing.
    """
    logs = evidence.of_kind("validation") or list(evidence.logs)
    spreads = [float(np.std(log.run.measured)) for log in logs]
    moving = [log for log, spread in zip(logs, spreads, strict=True) if spread >= _MOVING * max(spreads)]
    return min(moving, key=lambda log: log.run.fit_percent)


def nonlinearity(evidence: AxisEvidence) -> NonlinearFit | None:
    """Return the nonlinear operator that explains the logs clearly better, if there is one."""
    if not evidence.nonlinear:
        return None
    best = evidence.nonlinear[0]
    return best if best.gained > _CLEAR and best.residual_share < _SEEN_SHARE else None


def shortfalls(evidence: AxisEvidence) -> Iterator[Shortfall]:
    """Yield what makes a plant useless, the gravest first; nothing if it is usable."""
    yield from _wrong_columns(evidence)
    yield from _low_fit(evidence)
    yield from _open_gain(evidence)
    yield from _open_delay(evidence)
    yield from _bent(evidence)


def _wrong_columns(evidence: AxisEvidence) -> Iterator[Shortfall]:
    for code in _SPOILING:
        for finding in evidence.findings:
            if finding.code == code and finding.severity == "warning":
                yield Shortfall(code, f"{finding.place}: {finding.message}: {finding.remedy}.")
                break
    for log in evidence.logs:
        if log.tests is not None and log.tests.feedback:
            yield Shortfall(
                "feedback",
                f"In {log.path.name} the input follows the output: {_SPOILING['feedback']}, not the controller's "
                "output.",
            )
            break
    if evidence.result.integrating:
        name = evidence.result.plant.input_names[0]
        yield Shortfall(
            "integrates",
            f"The output runs on under a steady {name}, so there is no steady gain: name the output's rate as "
            "--output, or a command that the output comes to rest at as --input.",
        )


def _low_fit(evidence: AxisEvidence) -> Iterator[Shortfall]:
    judged = judged_fit(evidence)
    fit = max(judged.run.fit_percent, judged.unshifted_percent, judged.settled_percent)
    if fit >= USABLE_FIT_PERCENT or (fit >= _NOISY_FIT and _is_noise(judged, evidence)):
        return
    bend = nonlinearity(evidence)
    share = "less than a constant would" if fit <= 0 else f"{fit:.1f} %"
    if bend is not None:
        reason = f"{nonlinear_words(bend)}: {_REMEDY[bend.name]}"
    elif _is_noise(judged, evidence):
        reason = (
            "what is left does not depend on the input, so it is noise or a disturbance: command larger motions, or "
            "average repeated runs"
        )
    else:
        reason = (
            "what is left depends on the input, and no plant of these orders, saturation, dead zone, rate limit or "
            "hysteresis accounts for it: check the columns, and whether another input moves the axis"
        )
    yield Shortfall(
        "fit", f"The plant explains {share} of {_name(judged)}, where {USABLE_FIT_PERCENT:g} % is the least; {reason}."
    )


def _is_noise(log: LogEvidence, evidence: AxisEvidence) -> bool:
    """Tell whether what a plant leaves of a log does not depend on the input."""
    if log.tests is None:
        return False
    return nonlinearity(evidence) is None and log.tests.explained_share < _NOISE_SHARE


def _open_gain(evidence: AxisEvidence) -> Iterator[Shortfall]:
    result = evidence.result
    if evidence.held_gains or result.integrating:
        return
    gains = zip(result.plant.input_names, steady_gains(result), result.dc_gain_interval, strict=True)
    for name, gain, interval in gains:
        if not interval[1] - interval[0] <= 2 * GAIN_SHARE * abs(gain):
            yield Shortfall(
                "gain",
                f"The steady gain from {name} is not known to {GAIN_SHARE:.0%}: {gain_words(gain, interval)}. Add a "
                "log of a step from rest that is held until the axis rests, or pass --dc-gain if it is known.",
            )


def _open_delay(evidence: AxisEvidence) -> Iterator[Shortfall]:
    result = evidence.result
    if result.later_delay is not None:
        yield Shortfall(
            "late",
            f"A delay of about {result.later_delay} samples explains the logs clearly better than any of the up to "
            f"{result.longest_delay} that were tried; {_longer(evidence)}.",
        )
        return
    if result.plant.delay_samples >= result.longest_delay > 0:
        yield Shortfall(
            "late",
            f"The delay found, {result.plant.delay_samples} samples, is the longest that was tried, and the true one "
            f"may be longer; {_longer(evidence)}.",
        )
        return
    # A plant that predicts what was held back may share a delay between its dead time and its poles as it likes.
    if result.delay_certainty() < DELAY_CERTAINTY and not evidence.of_kind("validation"):
        low, high = result.delay_range
        yield Shortfall(
            "delay",
            f"The delay is not known to a sample or a tenth: {low} to {high} samples explain the logs about as well. "
            "Add a log with sharp edges (steps from rest, or a binary sequence), larger or longer.",
        )


def _longer(evidence: AxisEvidence) -> str:
    shortest = min(len(log.recording) for log in evidence.of_kind("training"))
    if evidence.result.longest_delay >= shortest // 10:
        return f"a log of {shortest} samples bears no longer one: record longer"
    return "leave --max-delay out"


def _bent(evidence: AxisEvidence) -> Iterator[Shortfall]:
    """Yield a nonlinearity that makes the gain, the delay or the response of the linear plant wrong."""
    bend, result = nonlinearity(evidence), evidence.result
    if bend is None:
        return
    away = abs(bend.delay - result.plant.delay_samples)
    reasons = []
    if abs(bend.gain_ratio - 1) > GAIN_SHARE:
        reasons.append(f"its steady gain is {abs(bend.gain_ratio):.3g} times that of the linear plant")
    if bend.agreement_percent < USABLE_FIT_PERCENT:
        reasons.append(
            f"on other motions of the same size the linear plant follows only to {max(bend.agreement_percent, 0):.0f} %"
        )
    if away > max(1.0, 0.1 * bend.delay) and not evidence.of_kind("validation"):
        reasons.append(f"its delay is {bend.delay} samples, not {result.plant.delay_samples}")
    if reasons:
        remedy = _REMEDY[bend.name].capitalize()
        yield Shortfall(bend.name.replace(" ", "-"), f"{nonlinear_words(bend)}; {'; '.join(reasons)}. {remedy}.")


_REMEDY = {
    "saturation": "record with a smaller command",
    "dead zone": "record with a larger command, or take the dead zone out in the controller",
    "rate limit": "record slower motions, or smaller ones",
    "hysteresis": "tighten the drive, or record larger motions",
}


def nonlinear_words(bend: NonlinearFit) -> str:
    """Name a nonlinearity with its level and what it explains."""
    explained = f"explains {100 * (1 - bend.residual_share):.0f} % of what the linear plant leaves"
    if bend.name == "rate limit":
        return f"A rate limit of {bend.level:.3g} per second {explained}"
    if bend.name == "saturation":
        return f"A saturation of the command at ±{bend.level:.3g} {explained}"
    if bend.name == "dead zone":
        return f"A dead zone of ±{bend.level:.3g} in the command {explained}"
    return f"Backlash or friction of ±{bend.level:.3g} of the command {explained}"


def _name(log: LogEvidence) -> str:
    """Name a log without its ending; a piece of one keeps its times."""
    return log.path.name if "[" in log.path.name else log.path.stem


def spoiled_delay(evidence: AxisEvidence) -> bool:
    """Tell whether the plant answers at once or earlier, as it does where the columns are swapped."""
    result = evidence.result
    return bool(result.plant.delay_samples - int(np.any(result.plant.D)) <= 0)
