"""How often the verdict of `archerfish identify gimbal` is right on logs as strangers record them, without options.

Simulated rigs of known truth (first to fourth order, the printed pitch loop, dead time), recorded at any rate, length,
amplitude, excitation and noise; half of the logs carry a fault, from exchanged columns to friction. A plant is usable
if its free run fits a noise-free log of the same rig to 80 %, its steady gain is right within 5 %, and its dead time
within a sample or 10 %.

Writes benchmarks/results/strangers.json, a row for each log.
"""

import argparse
import json
import sys
import time
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.cli.workers import run_tasks
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_bytes
from machine import describe_machine
from strangers_judging import Job, Row, judge_log
from strangers_logs import make_log, write_log
from strangers_tables import Count, count_table, counts, fits, group_table, option_table, row_line

RESULT = Path(__file__).parent / "results" / "strangers.json"
SEED = 2026
LOGS = 2010
"""A multiple of the block in which faults are dealt out."""
OPTIONS_EVERY = 10
"""The options are tried on the first of every so many logs."""


def main() -> None:
    """Judge all logs, write the results and print them; exit with 1 if a bar is missed."""
    arguments = _arguments()
    if arguments.keep is not None:
        for index in arguments.only or range(arguments.logs):
            print(*write_log(make_log(arguments.seed, index), arguments.keep))
    begun = time.perf_counter()
    jobs = [Job(arguments.seed, index, _tried(index, arguments)) for index in arguments.only or range(arguments.logs)]
    tasks = [(judge_log, job, 1.0) for job in jobs]
    rows = [Row(**found) for found in run_tasks("judging logs", "logs", tasks, arguments.workers)]
    seconds = time.perf_counter() - begun
    found = counts(rows)
    out = arguments.out or (RESULT if _complete(arguments) else None)
    if out is not None:
        _write(out, arguments, rows, found, seconds)
    if not arguments.only:
        _print(rows, found, seconds)
    if arguments.only or arguments.misses:
        print("\n".join(row_line(row) for row in rows if arguments.only or not row.right))
    if arguments.only:
        return
    if missed := [each.name for each in found if each.missed]:
        sys.exit(f"beyond the bars: {', '.join(missed)}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--logs", type=int, default=LOGS, help="only the first so many; nothing is then written")
    parser.add_argument("--only", type=int, nargs="+", help="only the logs of these numbers; nothing is then written")
    parser.add_argument("--keep", type=Path, help="also write the files of the logs into this folder")
    parser.add_argument("--seed", type=int, default=SEED, help="with another one nothing is written")
    parser.add_argument("--options-every", type=int, default=OPTIONS_EVERY, help="0 to try no options")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--misses", action="store_true", help="print each wrong verdict")
    parser.add_argument("--out", type=Path, help="write the results to this file, whatever was run")
    return parser.parse_args()


def _tried(index: int, arguments: argparse.Namespace) -> bool:
    return bool(arguments.options_every) and (bool(arguments.only) or index % arguments.options_every == 0)


def _complete(arguments: argparse.Namespace) -> bool:
    return (
        arguments.logs == LOGS
        and arguments.seed == SEED
        and not arguments.only
        and arguments.options_every == OPTIONS_EVERY
    )


def _print(rows: list[Row], found: list[Count], seconds: float) -> None:
    print(f"{len(rows)} logs in {seconds:.0f} s")
    for name in ("fault", "excitation", "rig", "rate_hz"):
        print(f"\n{group_table(rows, name)}")
    median, low = fits(rows)
    print(f"\n{option_table(rows)}")
    print(f"\n{count_table(found)}\n\nheld-back fit: median {median:.2f} %, 5 % quantile {low:.2f} %\n")


def _write(path: Path, arguments: argparse.Namespace, rows: list[Row], found: list[Count], seconds: float) -> None:
    """Write the results, each row in one line: a field per line would make a file of tens of thousands."""
    names = [each.name for each in fields(Row)]
    content = {
        "conditions": {"seed": arguments.seed, "logs": len(rows), "options_every": arguments.options_every},
        "machine": describe_machine(),
        "provenance": provenance(arguments.seed),
        "seconds": round(seconds, 1),
        "held_back_fit": dict(zip(("median", "quantile_05"), fits(rows), strict=True)),
        "counts": [asdict(each) for each in found],
        "fields": names,
    }
    lines = ",\n    ".join(json.dumps([_rounded(getattr(row, name)) for name in names]) for row in rows)
    text = json.dumps(content, indent=2, ensure_ascii=False)
    write_bytes(path, f'{text[:-2]},\n  "rows": [\n    {lines}\n  ]\n}}\n'.encode())


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.5g}") if np.isfinite(value) else None
    if isinstance(value, tuple | list):
        return [_rounded(each) for each in value]
    return {name: _rounded(each) for name, each in value.items()} if isinstance(value, dict) else value


if __name__ == "__main__":
    main()
