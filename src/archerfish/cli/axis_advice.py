"""Advice that has been tried: options with which the same logs give a better plant, and what each gains."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from archerfish.cli.axis_evidence import AxisEvidence
from archerfish.cli.axis_usability import judged_fit, spoiled_delay
from archerfish.identification.axis.order_choice import choose_order
from archerfish.identification.validation.free_run import common_offset, free_run
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

WORTH_POINTS = 2.0
"""Points of fit that an option must gain to be advised."""
_GOOD_FIT = 98.0
"""Fit from which the columns are certainly not swapped [%]."""
_POOR_FIT = 60.0
"""Fit below which they may be, wherever the response seems to begin [%]."""
_EXCHANGED_ORDERS = (1, 2, 3)
_HIGHER = (5, 6, 7, 8)
_LEFT_SHARE = 0.05
"""Share of the residual's power that past inputs explain, from which higher orders are tried."""
_SECONDS_A_MILLISECOND = 1e-3


@dataclass(frozen=True)
class Advice:
    """An option that was tried."""

    option: str
    """As it is typed."""
    changes: Mapping[str, Any] = field(repr=False)
    """Field of `identify gimbal` → value."""
    gained: float
    """Points of fit that it gains on the log by which the plant is judged."""
    sentence: str
    """What it is for and what it gains."""


def tried_advice(evidence: AxisEvidence, time_column: str | None) -> tuple[Advice, ...]:
    """Try options where something suggests them, and return those that help, the most helpful first.

    Args:
      evidence: of the axis.
      time_column: that was read; None if a sampling period was given.
    """
    found = [*_exchanged(evidence), *_milliseconds(evidence, time_column), *_higher_order(evidence)]
    return tuple(sorted(found, key=lambda each: -each.gained))


def _exchanged(evidence: AxisEvidence) -> Iterator[Advice]:
    judged, plant = judged_fit(evidence), evidence.result.plant
    fit = judged.run.fit_percent
    suspected = spoiled_delay(evidence) or fit < _POOR_FIT or any(each.code == "swapped" for each in evidence.findings)
    if plant.D.shape != (1, 1) or not suspected or fit > _GOOD_FIT:
        return
    logs = [log.recording for log in evidence.of_kind("training")]
    gained = _fit(logs, judged.recording, _swapped, _EXCHANGED_ORDERS) - fit
    if gained > WORTH_POINTS:
        before, after = plant.input_names[0], plant.output_names[0]
        yield Advice(
            f"--input {after} --output {before}",
            {"input": ((after,),), "output": before},
            gained,
            f"{after} comes before {before}, as if they were swapped: with --input {after} --output {before} the fit "
            f"is {fit + gained:.1f} % instead of {fit:.1f} %.",
        )


def _swapped(recording: Recording) -> Recording:
    return replace(
        recording,
        inputs=recording.outputs,
        outputs=recording.inputs,
        input_names=recording.output_names,
        output_names=recording.input_names,
        input_units=recording.output_units,
        output_units=recording.input_units,
    )


def _fit(
    logs: Sequence[Recording], judged: Recording, change: Callable[[Recording], Recording], orders: Sequence[int]
) -> float:
    """Return the fit of a log by a plant that is identified from changed logs [%]."""
    plant = choose_order([change(each) for each in logs], orders=orders).result.plant
    log = change(judged)
    return float(free_run(plant, log, common_offset(plant, [log])).fit_percent[0])


def _milliseconds(evidence: AxisEvidence, time_column: str | None) -> Iterator[Advice]:
    if time_column is None or not any(
        each.code == "time-unit" and each.severity == "warning" for each in evidence.findings
    ):
        return
    period = float(f"{evidence.result.plant.sample_period_s * _SECONDS_A_MILLISECOND:.6g}")
    delay = 1e3 * period * evidence.result.plant.delay_samples
    yield Advice(
        f"--sample-period-s {period:g}",
        {"sample_period_s": period},
        0.0,
        f"{time_column} seems to be in milliseconds: with --sample-period-s {period:g}, or a column called "
        f"{time_column.removesuffix('_s')}_ms, the delay is {delay:.3g} ms at the same fit.",
    )


def _higher_order(evidence: AxisEvidence) -> Iterator[Advice]:
    judged = judged_fit(evidence)
    if not evidence.trials or len(evidence.result.plant.A) < max(each.order for each in evidence.trials):
        return
    shares = [log.tests.explained_share for log in evidence.logs if log.tests and not log.tests.independent]
    if max(shares, default=0.0) < _LEFT_SHARE or judged.kind == "validation":
        return
    logs = [log.recording for log in evidence.of_kind("training")]
    try:
        choice = choose_order(logs, orders=_HIGHER)
    except InputError:
        return  # too short for any of them
    plant, fit = choice.result.plant, judged.run.fit_percent
    order = len(plant.A)
    gained = float(free_run(plant, judged.recording, common_offset(plant, [judged.recording])).fit_percent[0]) - fit
    if gained > WORTH_POINTS:
        yield Advice(
            f"--order {order}",
            {"order": order},
            gained,
            f"Past inputs still explain {100 * max(shares):.0f} % of the residual: with --order {order} the fit is "
            f"{fit + gained:.1f} % instead of {fit:.1f} %; hold a log back (--validate) to see whether that is real.",
        )
