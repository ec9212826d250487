"""How often the verdict of `identify_axis` is right on logs as strangers record them, without options.

`python benchmarks/strangers.py` identifies the 2,010 logs of stranger_logs.py, each from its files alone, and writes
results/strangers.json, a row for each log; about 30 minutes with `--workers 2`. `--logs 201` runs the first ones, and
`--only 3 17` prints these alone; neither writes.

A verdict is right if it says of the plant what is true of it: usable means a fit of at least 80 % of a noise-free log
of the rig that was held back, and a steady gain right within 5 %. A log that is refused is right if release 0.1 found
no usable plant of it either, also with the order known (results/strangers_truth.json).
"""

import argparse
import json
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from archerfish.errors import InputError
from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.axis.report import USABLE_FIT, shortfalls
from archerfish.reports.table import Table
from bars import RESULTS, Bar, finish, run, share
from stranger_logs import NONE, judge, make_log, write_log

SEED, LOGS = 2026, 2010
TRUTH = json.loads((RESULTS / "strangers_truth.json").read_text())
KINDS = {
    "swapped columns": "swapped columns",
    "milliseconds": "milliseconds",
    "mixed units": "degrees",
    "single sine": "single sine",
    "no response": "no response",
}
"""Fault → its name in the figures."""


@dataclass(frozen=True)
class Row:
    """One log, the verdict on it, and the truth."""

    index: int
    rig: str
    fault: str
    excitation: str
    noise_kind: str
    verdict: str  # "usable", "unusable", "refused", or "failed" with an error that is none of the library's
    right: bool
    good: bool  # whether the log gives a usable plant
    fit: float | None = None  # by the report [%]
    held_back: float | None = None  # of the noise-free log [%]
    gain_right: bool | None = None
    gain_true: float = 0.0
    gain: float | None = None
    gain_low: float | None = None
    gain_high: float | None = None
    delay_true: float = 0.0  # in samples of the log, as below
    delay: float | None = None
    delay_low: float | None = None
    delay_high: float | None = None
    order: int | None = None
    codes: str = ""  # of the findings
    shortfall: str = ""  # code of what makes the plant useless
    reason: str = ""  # first of the verdict, or the text of the error
    seconds: float = 0.0  # of processor time


def identified(seed: int, index: int) -> Row:
    """Make a log, identify the axis from its files, and compare verdict and plant with the truth."""
    log = make_log(seed, index)
    delay_true = round(log.rig.delay_s / log.period_s, 9)
    good = seed == SEED and TRUTH["usable"][index : index + 1] == "1"
    row = Row(index, log.rig.family, log.fault, log.excitation, log.noise_kind, "refused", not good, good)
    row = replace(row, gain_true=log.rig.gain, delay_true=delay_true)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        paths, begun = write_log(log, Path(folder)), time.process_time()
        try:
            result = identify_axis(paths)
        except InputError as error:
            reason = _short(str(error).replace(f"{folder}/", ""))
            return replace(row, codes=error.code or "", reason=reason, seconds=time.process_time() - begun)
        except Exception:
            return replace(row, verdict="failed", right=False, reason=_short(traceback.format_exc(-1)))
        seconds = time.process_time() - begun
    plant, report = result.record, result.report
    held_back, gain_right = judge(log, plant)
    usable, ratio = held_back >= USABLE_FIT and gain_right, plant.sample_period_s / log.period_s
    gain, delay = result.dc_gain[0], result.dead_time_samples
    return replace(
        row,
        verdict="usable" if report.usable else "unusable",
        right=bool(report.usable) == usable,
        good=usable,
        fit=result.judged.fit_percent,
        held_back=held_back,
        gain_right=gain_right,
        gain=gain.value,
        gain_low=gain.low,
        gain_high=gain.high,
        delay=delay.value * ratio,
        delay_low=delay.low * ratio,
        delay_high=delay.high * ratio,
        order=len(plant.A),
        codes=" ".join(sorted({each.code for each in result.findings})),
        shortfall=next((each.code for each in shortfalls(result)), ""),
        reason=_short(next(iter(report.reasons), "")).replace(f"{folder}/", ""),
        seconds=seconds,
    )


def _short(text: str) -> str:
    return " ".join(text.split())[:160]


def figures(rows: list[Row]) -> list[Bar]:
    """Return the figures with their limits."""
    plants = [row for row in rows if row.gain is not None]
    known = [row for row in plants if row.fault == NONE]
    good = [row for row in rows if row.good]
    bars = [
        share("verdict right, %", (row.right for row in rows), least=94.0),
        share("falsely usable, %", (row.verdict == "usable" and not row.good for row in rows), most=1.7),
        share("good ones refused or called unusable, %", (row.verdict != "usable" for row in good), most=5.5),
        share("plant usable by the truth, %", (row.good and row.gain is not None for row in rows), 100 * 1400 / LOGS),
        share("and called so, %", (row.good and row.verdict == "usable" for row in rows), 100 * 1340 / LOGS),
        share("steady gain inside its interval, no fault, %", map(_gain_inside, known), 90.0, 98.0),
        share("delay inside its range, no fault, %", map(_delay_inside, known)),
        share("ended with another error, %", (row.verdict == "failed" for row in rows), most=0.0),
    ]
    for kind, name in KINDS.items():
        bars.append(share(f"{name}: verdict right, %", (row.right for row in rows if row.fault == kind), least=92.0))
    return bars


def _gain_inside(row: Row) -> bool:
    return row.gain_low is not None and row.gain_high is not None and row.gain_low <= row.gain_true <= row.gain_high


def _delay_inside(row: Row) -> bool:
    """Whether the range contains the delay, or of one between samples those on its two sides."""
    if row.delay_low is None or row.delay_high is None:
        return False
    slack = 1.0 if row.delay_true % 1 else 1e-3 * row.delay_true + 1e-6
    return row.delay_low - slack <= row.delay_true <= row.delay_high + slack


def tables(rows: list[Row]) -> list[Table]:
    """Return the shares by fault with the reference, and the wrong verdicts by their cause."""
    by_fault = []
    for fault in sorted({row.fault for row in rows}):
        some = [row for row in rows if row.fault == fault]
        codes = Counter(code for row in some for code in row.codes.split()).most_common(2)
        verdicts = Counter(row.verdict for row in some)
        right = 100 * sum(row.right for row in some) / len(some)
        reference = TRUTH["reference"]["right_by_fault"].get(fault)
        found = ", ".join(f"{code} {count}" for code, count in codes)
        counted = (verdicts["usable"], sum(row.good for row in some), verdicts["refused"])
        by_fault.append((fault, len(some), right, reference, *counted, found))
    causes = Counter(cause(row) for row in rows if not row.right)
    headings = ("fault", "logs", "right, %", "reference", "usable", "truly", "refused", "findings")
    wrong = tuple((name, count) for name, count in causes.most_common())
    return [Table("by fault", headings, tuple(by_fault)), Table("wrong verdicts", ("class", "logs"), wrong)]


def cause(row: Row) -> str:
    """Name the class of a wrong verdict: what is wrong with a plant that was called usable, or what was said of one."""
    if row.verdict != "usable":
        return f"{row.verdict} but good: {row.shortfall or row.codes or row.reason[:60]}"
    wrong = ["gain"] * (not row.gain_right) + ["fit"] * ((row.held_back or 0) < USABLE_FIT)
    return f"falsely usable, {row.fault}: {' and '.join(wrong)} wrong"


def line(row: Row) -> str:
    """Describe a log and its verdict in one line."""
    facts = f"{row.index:5} {row.verdict}, {row.rig}, {row.fault}, {row.excitation}, {row.noise_kind}"
    if row.gain is None or row.held_back is None or row.fit is None:
        return f"{facts}: {row.reason}"
    gain = f"gain {row.gain:.4g} ({row.gain_low:.4g} to {row.gain_high:.4g}) for {row.gain_true:.4g}"
    delay = f"delay {row.delay:g} ({row.delay_low:g} to {row.delay_high:g}) for {row.delay_true:g}"
    return f"{facts}: fit {row.fit:.1f}, held back {row.held_back:.1f}, {gain}, {delay}; {row.reason}"


def main() -> None:
    """Judge the logs, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=LOGS, help="only the first so many; nothing is then written")
    parser.add_argument("--only", type=int, nargs="+", help="the logs of these numbers; nothing is written")
    parser.add_argument(
        "--seed", type=int, default=SEED, help="with another one refusals count as right, and nothing is written"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--misses", action="store_true", help="print each wrong verdict as well")
    options = parser.parse_args()
    begun = time.perf_counter()
    rows = []
    for row in run(partial(identified, options.seed), options.only or range(options.logs), options.workers):
        rows.append(row)
        if options.only:
            print("\n".join(f"{name:12} {value}" for name, value in asdict(row).items()), end="\n\n", flush=True)
    if options.only:
        return
    if options.misses:
        print("\n".join(line(row) for row in rows if not row.right))
    spent = {"seconds": round(time.perf_counter() - begun), "workers": options.workers}
    conditions = {"seed": options.seed, "logs": len(rows), **spent}
    causes = dict(Counter(cause(row) for row in rows if not row.right))
    written = (options.logs, options.seed) == (LOGS, SEED)
    values = [asdict(row) for row in rows]
    finish("strangers", figures(rows), tables(rows), conditions, values, written, wrong_verdicts=causes)


if __name__ == "__main__":
    main()
