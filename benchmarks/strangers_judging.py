"""What `archerfish identify gimbal` makes of a log of strangers, beside the truth."""

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.cli.axis_evidence import AxisEvidence, steady_gains
from archerfish.cli.axis_verdict import Verdict, judged_fit
from archerfish.cli.identify_gimbal import IdentifyGimbal, judge_logs
from archerfish.records.errors import InputError
from strangers_faults import BEYOND_USE
from strangers_logs import StrangersLog, make_log, write_log
from strangers_truth import judge_plant, oracle_usable, true_delay

GAINED_POINTS = 2.0
"""Points of the held-back fit by which an option must better the default."""
_SLOWEST = "--order auto"
_REASON = 160
"""Characters of a reason that are kept."""


class Job(NamedTuple):
    """One log to judge."""

    seed: int
    """Of all logs."""
    number: int
    """Number of the log."""
    with_options: bool
    """Whether the options are tried, too."""


@dataclass(frozen=True)
class Row:
    """One log, what was said of it, and what is true."""

    index: int
    """Number of the log."""
    rig: str
    """Family of the rig."""
    order: int
    """Its number of states."""
    fault: str
    """What is wrong, or "none"."""
    severity: float
    """Size of the fault."""
    excitation: str
    """How the axis was moved."""
    rate_hz: float
    """Sampling rate [Hz]."""
    samples: int
    """Samples in all files."""
    noise: float
    """Noise over clean output, standard deviations."""
    noise_kind: str
    """Kind of noise."""
    gain_true: float
    """True steady gain."""
    delay_true: float
    """True dead time [samples of the log]."""
    refused: bool
    """Whether it ended with an error."""
    usable_said: bool
    """Whether the plant was called usable."""
    usable_true: bool
    """Whether the plant is usable; False if there is none."""
    good: bool
    """Whether the log gives a usable plant: this one, or, if it was refused, that of a fit that knows the order."""
    good_clean: bool
    """The same with the noise taken away from a log that was refused."""
    reason: str
    """First doubt or the text of the error, "" without."""
    fit: float | None = None
    """Fit by which the plant was judged [%]."""
    gain: float | None = None
    """Steady gain of the plant."""
    interval: tuple[float, float] | None = None
    """Its 95 % interval."""
    delay: float | None = None
    """Delay of the plant [samples of the log]."""
    delay_range: tuple[float, float] | None = None
    """Delays that the log is said to leave open [samples of the log]."""
    feedthrough: bool | None = None
    """Whether the plant answers at once."""
    held_back_fit: float | None = None
    """Fit of the noise-free log that was held back [%]."""
    gain_right: bool = False
    """Whether the steady gain is within 5 %."""
    delay_right: bool = False
    """Whether the dead time is right."""
    rise_right: bool = False
    """Whether a step reaches half its height when it should."""
    advice: tuple[str, ...] = ()
    """Options that were advised, the first one first."""
    obeyed_fit: float | None = None
    """Held-back fit with the first of them [%]."""
    options: dict[str, float] = field(default_factory=dict)
    """Option → held-back fit [%]; empty where none was tried or could gain."""

    @property
    def right(self) -> bool:
        """Whether the verdict is right: for a refused log, that nothing good was refused."""
        return not self.good if self.refused else self.usable_said == self.usable_true

    @property
    def fit_floor(self) -> float:
        """Held-back fit, 0 where there is no plant or it is worse than none [%]."""
        return max(self.held_back_fit or 0.0, 0.0)

    @property
    def gaining(self) -> tuple[str, ...]:
        """Options that better the held-back fit."""
        return tuple(name for name, fit in self.options.items() if max(fit, 0.0) >= self.fit_floor + GAINED_POINTS)


def judge_log(job: Job, advance: Callable[[float, str], None]) -> dict[str, Any]:
    """Make a log, identify the axis from its files without any option, and return its `Row` as a dictionary."""
    log = make_log(job.seed, job.number)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        command = IdentifyGimbal(logs=write_log(log, Path(folder)))
        row, advice = _judged(log, command)
        if job.with_options:
            if advice:
                row = replace(row, obeyed_fit=_fit(log, replace(command, **advice[0].changes)))
            row = _with_options(log, command, row)
    advance(1.0, "")
    return asdict(row)


def _judged(log: StrangersLog, command: IdentifyGimbal) -> tuple[Row, tuple[Any, ...]]:
    """Return the row of a log and the advice that came with the verdict or the error."""
    row = _described(log)
    try:
        evidence, verdict = judge_logs(command)
    except InputError as error:
        advice = tuple(getattr(error, "advice", ()))
        row = replace(row, reason=_short(str(error).replace(str(command.logs[0].parent), "")))
        return replace(_refused(log, row), advice=_options_of(advice)), advice
    advice = tuple(getattr(verdict, "advice", ()))
    return replace(_fitted(log, row, evidence, verdict), advice=_options_of(advice)), advice


def _refused(log: StrangersLog, row: Row) -> Row:
    honest = log.fault not in BEYOND_USE
    good, clean = (honest and oracle_usable(log, clean) for clean in (False, True))
    return replace(row, good=good, good_clean=clean)


def _fitted(log: StrangersLog, row: Row, evidence: AxisEvidence, verdict: Verdict) -> Row:
    plant, result = evidence.result.plant, evidence.result
    truth = judge_plant(log, plant)
    ratio = plant.sample_period_s / log.period_s
    low, high = result.delay_range
    return replace(
        row,
        refused=False,
        usable_said=verdict.usable,
        usable_true=truth.usable,
        good=truth.usable,
        good_clean=truth.usable,
        reason=_short(next(iter(verdict.doubts), "")),
        fit=judged_fit(evidence).run.fit_percent,
        gain=float(steady_gains(result)[0]),
        interval=result.dc_gain_interval[0],
        delay=plant.delay_samples * ratio,
        delay_range=(low * ratio, high * ratio),
        feedthrough=bool(np.any(plant.D)),
        held_back_fit=truth.fit_percent,
        gain_right=truth.gain_right,
        delay_right=truth.delay_right,
        rise_right=truth.rise_right,
    )


def _described(log: StrangersLog) -> Row:
    rig = log.rig
    facts = (log.index, rig.family, rig.order, log.fault, log.severity, log.excitation, round(1 / log.period_s, 6))
    recorded = (log.samples, log.noise, log.noise_kind, rig.gain, true_delay(log))
    return Row(
        *facts, *recorded, refused=True, usable_said=False, usable_true=False, good=False, good_clean=False, reason=""
    )


def _options_of(advice: tuple[Any, ...]) -> tuple[str, ...]:
    return tuple(str(each.option) for each in advice)


def _short(text: str) -> str:
    return " ".join(text.split())[:_REASON]


def _with_options(log: StrangersLog, command: IdentifyGimbal, row: Row) -> Row:
    # Nothing gains two points on a fit of 98 %, and nothing is gained where the axis does not answer.
    if row.fit_floor > 100 - GAINED_POINTS or not log.rig.responsive:
        return row
    for name, each in _options(log, command).items():
        # All orders take longer than all other options together: they are left out where another one is known to gain.
        if name != _SLOWEST or not row.gaining:
            row = replace(row, options=row.options | {name: _fit(log, each)})
    return row


def _options(log: StrangersLog, command: IdentifyGimbal) -> dict[str, IdentifyGimbal]:
    """Return the command with each of the options that a person might try."""
    between = float(np.median(np.diff(log.files[0].stamps)))
    changes: dict[str, dict[str, Any]] = {
        "--order 2": {"order": 2},
        "--max-delay 100": {"max_delay": 100},
        "--no-feedthrough": {"feedthrough": False},
        "--sample-period-s": {"sample_period_s": between},
        "--input y --output u": {"input": (("y",),), "output": "u"},
    }
    if log.fault == "milliseconds":
        changes["--sample-period-s, of milliseconds"] = {"sample_period_s": between / 1000}
    changes[_SLOWEST] = {"order": "auto"}
    return {name: replace(command, **each) for name, each in changes.items()}


def _fit(log: StrangersLog, command: IdentifyGimbal) -> float:
    """Return the held-back fit of what a command gives [%], 0 where it refuses."""
    try:
        truth = judge_plant(log, judge_logs(command)[0].result.plant)
    except InputError:
        return 0.0
    return truth.fit_percent
