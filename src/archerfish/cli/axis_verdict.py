"""The words of an identification: what is known of the axis, how sure that is, and what to do next."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.cli.axis_advice import Advice
from archerfish.cli.axis_evidence import AxisEvidence, HeldGain, LogEvidence, gain_words, steady_gains
from archerfish.cli.axis_usability import (
    DELAY_CERTAINTY,
    Shortfall,
    judged_fit,
    nonlinear_words,
    nonlinearity,
    shortfalls,
)
from archerfish.cli.sample_count import used_sentence, used_words
from archerfish.identification.validation.frequency import driven_band_hz

_GAP_LINES = 3.0
"""Spectral lines that may be empty at the bottom of every log before nothing is said to be known there."""
_LOOSE_DELAY = 2
"""Width of the delay's range [samples] beyond which sharper edges pay."""
_LEFT_SHARE = 0.05
"""Share of the residual's power that past inputs explain, beyond which another structure pays."""
_LOST_POINTS = 5.0
"""Points of fit that a held-back log may lose to the fitted ones."""

_DEGREES = 180 / np.pi
"""Degrees in a radian: the steady gain of an axis whose angle is logged in degrees and its command in radians."""
_UNIT_TOLERANCE = 1.1
"""Factor by which a gain may miss that of mixed units and still be taken for it."""


class Verdict(NamedTuple):
    """What a person should know of an identified axis."""

    headline: str
    """All in one line."""
    usable: bool
    """Whether the plant is good for anything."""
    known: tuple[str, ...]
    """What is known, each a sentence."""
    doubts: tuple[str, ...]
    """What suggests that the plant itself is of no use, each a sentence that says what to check."""
    next_steps: tuple[str, ...]
    """What to do, the most useful first, each a sentence."""
    reasons: tuple[str, ...] = ()
    """Codes of what makes the plant useless; empty if it is usable."""
    advice: tuple[Advice, ...] = ()
    """Options that were tried on the same logs and help, the most helpful first."""


def verdict(evidence: AxisEvidence, advice: Sequence[Advice] = ()) -> Verdict:
    """Judge an identified axis.

    Args:
      evidence: all that speaks for it and against it.
      advice: options that were tried and help.
    """
    missing = list(shortfalls(evidence))
    if any("input" in each.changes for each in advice):
        missing.insert(0, Shortfall("swapped", next(each.sentence for each in advice if "input" in each.changes)))
    doubts = tuple(dict.fromkeys([*(each.sentence for each in missing), *_doubts(evidence)]))
    gap = _unknown_below(evidence)
    headline = _headline(evidence)
    if evidence.samples.left_out:
        headline += f"; {used_words(evidence.samples)}"
    if gap:
        headline += f"; nothing is known below {gap:.3g} Hz: add a step log"
    for held in evidence.held_gains:
        if held.contradicted:
            headline += (
                f"; --dc-gain {held.asked:.4g} contradicts the logs, which say {gain_words(held.free, held.interval)}"
            )
    steps = tuple(dict.fromkeys([*(each.sentence for each in advice), *_next_steps(evidence, gap)]))
    return Verdict(
        headline=headline,
        usable=not missing,
        known=tuple(_known(evidence)),
        doubts=doubts,
        next_steps=tuple(each for each in steps if each not in doubts),
        reasons=tuple(dict.fromkeys(each.code for each in missing)),
        advice=tuple(advice),
    )


def _headline(evidence: AxisEvidence) -> str:
    plant, judged = evidence.result.plant, judged_fit(evidence)
    note = "" if judged.kind == "validation" else " (fitted, none held back)"
    fit = f"fit {judged.run.fit_percent:.1f} % on {_log_name(judged)}{note}"
    if judged.settled_percent > judged.run.fit_percent + _LOST_POINTS:
        fit += f", {judged.settled_percent:.1f} % of it once the delay is over, before which earlier inputs act"
    return f"{plant.axis}: {_ordinal(len(plant.A))} order, delay {delay_words(evidence)}, {fit}"


def _log_name(log: LogEvidence) -> str:
    """Name a log without its ending; a piece of one keeps its times."""
    return log.path.name if "[" in log.path.name else log.path.stem


def _ordinal(count: int) -> str:
    return f"{count}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(count, 'th') }"


def delay_words(evidence: AxisEvidence) -> str:
    """Write the delay with its range, in milliseconds."""
    plant = evidence.result.plant
    low, high = (1e3 * plant.sample_period_s * each for each in evidence.result.delay_range)
    delay = 1e3 * plant.sample_period_s * plant.delay_samples
    if low == high:
        return f"{delay:.3g} ms"
    if np.isclose(high - delay, delay - low):
        return f"{delay:.3g}±{high - delay:.2g} ms"
    return f"{delay:.3g} ms ({low:.3g}–{high:.3g} ms)"


def _unknown_below(evidence: AxisEvidence) -> float | None:
    """Return the lowest excited frequency [Hz] where no log reaches down to what its length resolves."""
    for log in evidence.of_kind("training"):
        length_s = len(log.recording) * log.recording.sample_period_s
        if driven_band_hz([log.recording])[0] <= _GAP_LINES / length_s:
            return None
    return evidence.result.excited_band_hz[0]


def _known(evidence: AxisEvidence) -> Iterator[str]:
    result = evidence.result
    low, high = evidence.result.excited_band_hz
    yield f"The inputs excite {low:.3g}–{high:.3g} Hz; outside, the model is an extrapolation."
    yield f"The input delay is {delay_words(evidence)}."
    for name, gain, interval in zip(
        result.plant.input_names, steady_gains(result), result.dc_gain_interval, strict=True
    ):
        if not evidence.held_gains:
            yield f"The steady gain from {name} is {gain_words(gain, interval)}, 95 % interval."
    for held in evidence.held_gains:
        yield (
            f"The steady gain from {held.name} was held to {held.asked:.4g} (--dc-gain), not estimated; left free, the "
            f"logs say {gain_words(held.free, held.interval)}, 95 % interval."
        )
    yield used_sentence(evidence.samples)
    known = result.determined
    if not known.all():
        yield f"Of {known.size} poles these recordings determine {int(known.sum())}."


def _doubts(evidence: AxisEvidence) -> Iterator[str]:
    result = evidence.result
    for log in (log for log in evidence.of_kind("validation") if _shifted(log, evidence)):
        yield (
            f"{_log_name(log)} was held back and lies {log.shift:+.3g} beside the zero of the fitted logs: its fit is "
            f"{log.run.fit_percent:.1f} %, and {log.unshifted_percent:.1f} % without that shift. Look whether the "
            "encoder's zero has moved, or the steady gain is off."
        )
    for index, name in enumerate(result.plant.input_names):
        held = evidence.held_gains[index] if evidence.held_gains else None
        if held is not None and held.contradicted:
            yield _contradicted(held, evidence)
        # What was asked for tells nothing of the units; what the logs say does.
        yield from _angle_units(name, abs(held.free if held else steady_gains(result)[index]))


def _contradicted(held: HeldGain, evidence: AxisEvidence) -> str:
    judged = judged_fit(evidence)
    fit = judged.run.fit_percent
    free_fit = next(each for log, each in zip(evidence.logs, held.free_fits, strict=True) if log is judged)
    reach = (
        " The logs don't reach down to the steady state, so theirs is an extrapolation: a step decides."
        if _unknown_below(evidence)
        else ""
    )
    return (
        f"--dc-gain {held.asked:.4g} for {held.name} contradicts the logs: left free, the steady gain is "
        f"{gain_words(held.free, held.interval)}, and {_log_name(judged)} is fitted to {free_fit:.1f} % instead "
        f"of {fit:.1f} %.{reach} Check the unit and the sign of the gain and of the logged signals; leave --dc-gain "
        "out, or record a step that is held until the axis rests and measure both ends."
    )


def _angle_units(name: str, gain: float) -> Iterator[str]:
    for factor, output, command in ((_DEGREES, "degrees", "radians"), (1 / _DEGREES, "radians", "degrees")):
        if factor / _UNIT_TOLERANCE <= gain <= factor * _UNIT_TOLERANCE:
            yield (
                f"The steady gain from {name}, {gain:.3g}, is about {factor:.3g}: the output seems to be in {output} "
                f"and the input in {command}; log both in radians."
            )


def _next_steps(evidence: AxisEvidence, gap: float | None) -> Iterator[str]:
    if gap:
        yield (
            f"Add a log of a step that is held until the axis rests: nothing is known below {gap:.3g} Hz, the steady "
            "gain least of all."
        )
    if not evidence.of_kind("validation"):
        yield "No log was held back: pass --validate LOG to see how the plant does on one that it has not seen."
    yield from _lost_fit(evidence)
    yield from _left_in_residuals(evidence)
    low, high = evidence.result.delay_range
    known = evidence.result.delay_certainty() >= DELAY_CERTAINTY or evidence.of_kind("validation")
    if high - low > _LOOSE_DELAY and known:
        yield f"The delay may be {low} to {high} samples: add a log with sharp edges (steps or a binary sequence)."
    determined = evidence.result.determined
    if not determined.all():
        count = int((~determined).sum())
        yield (
            f"{count} of {determined.size} poles are not determined by these logs: excite higher frequencies if the "
            "robot uses them; else see whether a lower --order predicts a held-back log as well."
        )


def _shifted(log: LogEvidence, evidence: AxisEvidence) -> bool:
    """Tell whether a log's own zero would explain most of what its fit lacks against the fitted ones."""
    fitted = min(each.run.fit_percent for each in evidence.of_kind("training"))
    gained = log.unshifted_percent - log.run.fit_percent
    return gained > _LOST_POINTS and log.unshifted_percent > fitted - _LOST_POINTS


def _lost_fit(evidence: AxisEvidence) -> Iterator[str]:
    judged = judged_fit(evidence)
    fitted = min(log.run.fit_percent for log in evidence.of_kind("training"))
    if (
        judged.kind == "validation"
        and not _shifted(judged, evidence)
        and fitted - judged.run.fit_percent > _LOST_POINTS
    ):
        yield (
            f"{judged.path.name} is foretold {fitted - judged.run.fit_percent:.1f} points worse than the worst fitted "
            "log: fit a log of its kind too (same amplitude, same band), or lower --order."
        )


def _left_in_residuals(evidence: AxisEvidence) -> Iterator[str]:
    bend = nonlinearity(evidence)
    if bend is not None:
        yield f"{nonlinear_words(bend)}; the plant is that of motions like the logged ones."
        return
    tested = [(log.tests.explained_share, log) for log in evidence.logs if log.tests and not log.tests.independent]
    share, log = max(tested, key=lambda each: each[0], default=(0.0, None))
    if log and share > _LEFT_SHARE:
        yield (
            f"Past inputs still explain {100 * share:.0f} % of what the plant leaves of {log.path.name}, which no "
            "saturation, dead zone, rate limit or hysteresis accounts for: look at its picture."
        )
