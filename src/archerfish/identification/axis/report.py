"""Verdict and report of an identified axis.

A plant is usable if it explains what was held back and its steady gain is known. Its delay is reported with a range,
and refuses nothing: a plant may share it between dead time and poles.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.checks import follows_output
from archerfish.identification.axis.nonlinearity import Nonlinearity
from archerfish.identification.axis.plots import correlation_plot, run_plot, step_plot
from archerfish.identification.axis.result import AxisEstimates
from archerfish.identification.axis.sections import Structure
from archerfish.identification.axis.spectrum import mostly_held
from archerfish.identification.frequency import frequency_response
from archerfish.reports.report import Report
from archerfish.reports.style import Figure
from archerfish.reports.table import Entry, Estimate, Table, entry_texts

USABLE_FIT = 80.0
"""Fit from which a plant is usable [%]."""
_NOISY_FIT, _NOISE_SHARE = 55.0, 0.1  # a fit of noise's fault: at least, and share that the inputs explain of the rest
_GAIN_WIDTH = 0.05  # of a steady gain, within which it must be known
_GAIN_SHARE = 0.85  # of the draws within that, from which it is
_RUNS = 4  # that are drawn
_DEPENDENT = 0.05  # share of the residual that past inputs explain, from which it is worth a word
_RUNS_ON = 0.5  # what is left of a state after the longest recording, from which the axis may integrate
_CLEARLY = 0.5  # the same beside feedback
_NAMED = 0.7  # share of the residual that a nonlinearity leaves, up to which it may make a plant useless

_USELESS = "swapped", "contradiction", "early-output", "changed-delay", "half-angle", "rate-output"  # codes of findings

_LINEAR = {
    "saturation": "record with a smaller command",
    "dead zone": "record with a larger command, or remove it in the controller",
    "rate limit": "record slower or smaller motions",
    "hysteresis": "tighten the drive, or record larger motions",
}


class Shortfall(NamedTuple):
    """What makes a plant useless."""

    code: str  # short, stable name
    sentence: str  # what it is, and what to do


def shortfalls(result: AxisEstimates) -> list[Shortfall]:
    """Return what makes a plant useless, the gravest first; nothing if it is usable."""
    wrong = [finding for finding in result.findings if finding.code in _USELESS]
    if wrong:  # what else is found follows from it
        return [Shortfall(found.code, f"{found.place}: {found.message}: {found.remedy}.") for found in wrong]
    given = result.given_gain
    if given is not None and given.source == "given" and given.contradicted:
        gain = ", ".join(f"{estimate.value:.4g}" for estimate in result.dc_gain)
        by_logs = ", ".join(f"{value:.4g}" for value in given.by_logs.flat)
        sentence = f"The gain that was given, {gain}, contradicts the logs, which have {by_logs}"
        return [Shortfall("gain", f"{sentence}: check its unit and sign, or leave it out.")]
    low_fit = list(_low_fit(result))
    if any(shortfall.code == "feedback" for shortfall in low_fit):  # which makes the gain of the logs that of a loop
        return low_fit
    return [*low_fit, *_unknown_gain(result), *(() if low_fit else _nonlinear(result))]


def _low_fit(result: AxisEstimates) -> Iterator[Shortfall]:
    worst, found = result.judged, result.nonlinearity
    if worst.fit_percent >= USABLE_FIT:
        return
    rest = worst.tests is not None and worst.tests.explained_share < _NOISE_SHARE
    loop = rest and follows_output(worst.recording, worst.residual)
    if worst.fit_percent >= _NOISY_FIT and rest and found is None and not loop:
        return
    code = "fit"
    why = "the rest depends on the input: check the columns, and whether something else moves the axis"
    if loop:
        code = "feedback"
        why = "the input follows the output: switch the outer loop off, or log its set point as the input"
    elif found is not None and found.residual_share <= _NAMED:
        why = f"{_nonlinear_words(found)}: {_LINEAR[found.name]}"
    elif rest:
        why = "the rest does not depend on the input, so it is noise: command larger motions, or average repeated runs"
    share = f"{worst.fit_percent:.1f} %" if worst.fit_percent > 0 else "less than a constant would"
    yield Shortfall(code, f"The plant explains {share} of {worst.recording.source}, expected {USABLE_FIT:g} %; {why}.")


def _unknown_gain(result: AxisEstimates) -> Iterator[Shortfall]:
    plant = result.record
    gain, drawn = plant.dc_gain[0], frequency_response(plant, np.zeros(1), draws=True)[:, 0, 0].real
    known = np.mean(np.abs(drawn - gain) <= _GAIN_WIDTH * np.abs(gain), axis=0) >= _GAIN_SHARE
    if result.given_gain is not None and result.given_gain.source == "given":
        return
    slowest = np.abs(np.linalg.eigvals(plant.A)).max() ** max(len(fit.recording) for fit in result.fits)
    remedy = "The output runs on under a steady input: log its rate as the output, or an input at which it rests"
    remedy += ', or take the gain of steps that rest (dc_gain="plateaus").'
    if slowest < _RUNS_ON:
        step = f"Record a step from rest that is held until it rests (archerfish excite {plant.axis} --kinds step)"
        given = "dc_gain in logs.toml, or archerfish identify axis --dc-gain"
        remedy = f"{step}, or give the gain if it is known ({given})."
    for place in np.flatnonzero(~known).tolist():
        unknown = f"The steady gain {_named(result, place)}is not known within {_GAIN_WIDTH:.0%}"
        yield Shortfall("gain", f"{unknown}: {_words(result.dc_gain[place])}. {remedy}")


def _nonlinear(result: AxisEstimates) -> Iterator[Shortfall]:
    """Yield a nonlinearity that makes the gain or the response of the linear plant wrong."""
    found = result.nonlinearity
    # What a loop commands after a disturbance, a hysteresis explains in part.
    feedback = any(fit.tests is not None and fit.tests.feedback for fit in result.fits)
    if found is None or found.residual_share > (_CLEARLY if feedback else _NAMED):
        return
    wrong, agreement = [], max(found.agreement_percent, 0)
    if abs(found.gain_ratio - 1) > _GAIN_WIDTH:
        wrong.append(f"its steady gain is {found.gain_ratio:.3g} times that of the linear plant")
    if agreement < USABLE_FIT:
        wrong.append(f"on other motions of the same size the linear plant follows to {agreement:.0f} % only")
    if wrong:
        sentence = f"{_nonlinear_words(found).capitalize()}; {'; '.join(wrong)}: {_LINEAR[found.name]}."
        yield Shortfall(found.name.replace(" ", "-"), sentence)


def _nonlinear_words(found: Nonlinearity) -> str:
    size = f"{found.level:.3g} per second" if found.name == "rate limit" else f"±{found.level:.3g} of the command"
    return f"a {found.name} of {size} explains {1 - found.residual_share:.0%} of what the linear plant leaves"


def axis_report(result: AxisEstimates) -> Report:
    """Report an identified axis."""
    missing, plant, worst = shortfalls(result), result.record, result.judged
    name = f"{worst.recording.source} ({'held back' if worst.held_back else 'fitted, none held back'})"
    dead_time, period_ms = result.dead_time_samples, 1e3 * plant.sample_period_s
    delay = Estimate(period_ms * dead_time.value, period_ms * dead_time.low, period_ms * dead_time.high, "ms")
    return Report(
        title=f"{plant.axis}: what the logs say",
        headline=f"order {len(plant.A)}, delay {_words(delay)}, fit {worst.fit_percent:.1f} % of {name}",
        usable=not missing,
        reasons=tuple(shortfall.sentence for shortfall in missing),
        known=tuple(_known(result, delay)),
        doubts=tuple(_doubts(result)),
        next_steps=(*["Do what the reasons above say, and identify again."] * bool(missing), *_next_steps(result)),
        tables=tuple(_tables(result, delay)),
        figures=tuple(_figures(result)),
        findings=result.findings,
        provenance=plant.provenance,
    )


def _known(result: AxisEstimates, delay: Estimate) -> Iterator[str]:
    for place, gain in enumerate(result.dc_gain):
        yield f"The steady gain {_named(result, place)}is {_words(gain)}, 95 % interval."
        if given := result.given_gain:
            measured = "is the slope of the levels at which steps come to rest"
            source = "was given" if given.source == "given" else measured
            yield f"It {source}; a fit of the whole logs has {given.by_logs.flat[place]:.4g}."
    low, high = result.excited_hz
    yield f"The inputs excite {low:.3g} to {high:.3g} Hz; outside, the plant is an extrapolation."
    yield f"The delay is {_words(delay)}; a plant may share it between dead time and poles."
    determined, count = sum(pole.determined for pole in result.poles), len(result.poles)
    share = f"{determined} of {count}" if determined < count else "all"
    yield f"The logs determine {share} of its poles, a pair counted as one."


def _doubts(result: AxisEstimates) -> Iterator[str]:
    for fit in result.fits:
        name, tests = fit.recording.source, fit.tests
        if tests is None:
            continue
        # What an output that comes too early leaves correlates with later inputs, too.
        early = any(finding.code in ("early-output", "changed-delay") for finding in result.findings)
        if tests.feedback and not early:
            wrong = f"In {name} the input follows the output's disturbances, or the output was smoothed both ways"
            yield f"{wrong}: log the set point of the loop as the input, and the output as measured."
        if not tests.independent and tests.explained_share > _DEPENDENT:
            share = f"{tests.explained_share:.0%} of what the plant leaves of {name}"
            yield f"Past inputs still explain {share}: look at its plot."

    for finding in result.findings:
        if finding.code == "angle-error" and finding.severity == "warning":
            yield f"The steady gain is in doubt: {finding.message}. {finding.remedy[0].upper()}{finding.remedy[1:]}."
    for pole in result.poles:
        if pole.light:
            mode = f"The mode of {pole.frequency_hz.value:.3g} Hz with a damping of {pole.damping.value:.2g}"
            yield f"{mode} moves the output by less than 1 %, and may be a disturbance: see whether other logs have it."


def _next_steps(result: AxisEstimates) -> Iterator[str]:
    for finding in result.findings:
        if finding.code in ("degrees-radians", "sign-flip"):
            yield f"{finding.remedy[0].upper()}{finding.remedy[1:]}."
    if not any(fit.held_back for fit in result.fits):
        file = f"{result.record.axis}_step_validation.csv"
        yield f"Hold a log back ({file}, in Python validate=, or archerfish identify axis --validate) to see its fit."
    low, high = result.dead_time_samples.low, result.dead_time_samples.high
    if high - low > 2:
        remedy = f"add a log with sharp edges (archerfish excite {result.record.axis} --kinds step)"
        yield f"The delay may be {low:g} to {high:g} samples: {remedy}."
    fitted = [fit.recording for fit in result.fits if not fit.held_back]
    if not any(mostly_held(np.asarray(recording.inputs)) for recording in fitted):
        remedy = f"record a step from rest that is held (archerfish excite {result.record.axis} --kinds step)"
        yield f"No log holds its input, so the steady gain is that of slow motions: {remedy}."
    if any(not pole.determined and pole.frequency_hz.value > result.excited_hz[1] for pole in result.poles):
        yield "Some poles are not determined: excite higher frequencies if the robot uses them."


def _tables(result: AxisEstimates, delay: Estimate) -> Iterator[Table]:
    rows: list[tuple[Entry, ...]] = [("delay", delay)]
    rows += [(f"steady gain {_named(result, place)}".strip(), gain) for place, gain in enumerate(result.dc_gain)]
    for pole in result.poles:
        kind = "pole" if pole.determined else "pole, not determined"
        rows += [(f"{kind}: natural frequency", pole.frequency_hz), ("    its damping", pole.damping)]
    yield Table("The plant", ("quantity", "estimate (95 % interval)"), tuple(rows))
    fits = [(fit.recording.source, "held back" if fit.held_back else "fitted", fit.fit_percent) for fit in result.fits]
    yield Table("Fit of a free run [%]", ("recording", "", "fit"), tuple(fits), "100 is all of the output's deviation.")
    orders = [candidate for candidate in sorted(result.candidates) if candidate.fit_percent is not None]
    least = min(candidate.bic for candidate in result.candidates)
    tried = list[tuple[Entry, ...]]()
    for candidate in orders:
        chosen = " *" * (candidate.order == len(result.record.A))
        figures = candidate.bic - least, candidate.fit_percent, candidate.held_back_percent
        tried.append((f"{candidate.order}{chosen}", Structure(*candidate[:4]).dead_time, *figures))
    rule = "by the fit of what was held back, less 0.2 points a state" if result.fits[0].held_back else "by the BIC"
    columns = ("order", "delay [samples]", "BIC less the best", "fit [%]", "fit held back [%]")
    yield Table("The likeliest structure of each order", columns, tuple(tried), f"* chosen: {rule}.")


def _figures(result: AxisEstimates) -> Iterator[tuple[str, Callable[[], Figure]]]:
    for fit in result.fits[:_RUNS]:
        role = "held back: simulated from its input alone" if fit.held_back else "fitted"
        draw = partial(run_plot, fit.recording, fit.run, unit=result.unit)
        yield f"{fit.recording.source}, {role}: the whole log, and the part of the largest residual.", draw
    yield "Frequency response, with the 95 % band of the draws.", result.bode
    yield "Response to a unit step.", partial(step_plot, result.record)
    first = result.fits[0]
    if first.tests is not None:
        caption = f"Correlation of the residual of {first.recording.source} with the input; noise stays in the band."
        yield caption, partial(correlation_plot, first.tests)


def _named(result: AxisEstimates, place: int) -> str:
    inputs, outputs = result.record.input_names, result.record.output_names
    named = f"from {inputs[place % len(inputs)]} to {outputs[place // len(inputs)]} "
    return named * (len(inputs) * len(outputs) > 1)


def _words(estimate: Estimate) -> str:
    value, interval = entry_texts(estimate)
    return f"{value} ({interval})" if interval and estimate.low < estimate.high else value
