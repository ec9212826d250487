"""Identification against its peers on recorded logs, and against the truth on the printed axes, order 4.

Every tool gets the same arrays and one core; each runs in an environment of its own, which the first run makes, and is
scored here, the same way for all. Writes benchmarks/results/identification.json and exits with 1 if a bar is missed.
Needs the recorded logs in ../shared/data, beside the repository, and fails without them.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from identification_bars import Bar, printed_bars, real_bars, speed_bars
from identification_cases import DATA, real_cases
from identification_printed import SweepAlone, SweepAndStep, sweep_alone, sweep_and_step
from identification_tables import bars_table, fits_markdown, fits_table, seconds_table
from machine import describe_machine
from peers.environments import NotRunError, version
from peers.roster import NOT_RUN, OURS, PEERS, Tool
from peers.running import ORDER, Score, score_tool

RESULT = Path(__file__).parent / "results" / "identification.json"
NOISES = (0.01, 0.05)
SEEDS = range(20)
SEEDS_WITH_STEP = range(3)
SEEDS_QUICK = range(2)


def main() -> None:
    """Run all cases, write the results and print them; exit with 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two noise seeds, no peers, nothing written")
    parser.add_argument("--markdown", action="store_true", help="run nothing; print the last results for the docs")
    options = parser.parse_args()
    if options.markdown:
        print(_markdown())
        return
    if not DATA.is_dir():
        sys.exit(f"{DATA}: no such folder; the recorded logs belong in ../shared/data, beside the repository")
    quick = options.quick
    scores = _scores((OURS,) if quick else (OURS, *PEERS))
    alone = [each for noise in NOISES for each in sweep_alone(noise, SEEDS_QUICK if quick else SEEDS)]
    with_step = list(sweep_and_step(NOISES[0], SEEDS_QUICK if quick else SEEDS_WITH_STEP))
    bars = [*real_bars(scores), *speed_bars(scores), *printed_bars(alone, with_step)]
    if not quick:
        _write(scores, alone, with_step, bars)
    console = Console(width=160)
    console.print(fits_table(scores), seconds_table(scores), bars_table(bars))
    missed = [bar.name for bar in bars if not bar.met]
    if missed:
        sys.exit(f"missed: {'; '.join(missed)}")


def _scores(tools: Iterable[Tool]) -> list[Score]:
    scores = []
    for case in real_cases():
        for tool in tools:
            print(f"{case.name}: {tool.name}", flush=True)
            scores.extend(score_tool(tool, case))
    return scores


def _write(scores: list[Score], alone: list[SweepAlone], with_step: list[SweepAndStep], bars: list[Bar]) -> None:
    content = {
        "conditions": {
            "order": ORDER,
            "cases": {case.name: case.log for case in real_cases()},
            "signals": "inputs and outputs less their training means",
            "fit": "100 (1 − ‖y − ŷ‖ / ‖y − mean‖) of a free run, its initial state by least squares on the record",
            "constant": "a model keeps the constant that its tool estimated from the training part, if any",
            "seconds": "processor time of the fit alone, on one core, after imports: the first, and the best later one",
            "noises": NOISES,
            "seeds": list(SEEDS),
            "seeds_with_step": list(SEEDS_WITH_STEP),
        },
        "tools": {tool.name: _version(tool) for tool in (OURS, *PEERS)},
        "not_run": NOT_RUN,
        "machine": describe_machine(),
        "provenance": provenance(),
        "rows": [score._asdict() for score in scores],
        "sweep_alone": [each._asdict() for each in alone],
        "sweep_and_step": [each._asdict() for each in with_step],
        "bars": [bar._asdict() | {"met": bar.met} for bar in bars],
    }
    write_json(RESULT, content)


def _markdown() -> str:
    scores = [Score(**row) for row in json.loads(RESULT.read_text())["rows"]]
    return fits_markdown(scores, [case.name for case in real_cases() if case.test_bar_percent is not None])


def _version(tool: Tool) -> str:
    try:
        return version(tool)
    except NotRunError as error:
        return f"not run: {error}"


if __name__ == "__main__":
    main()
