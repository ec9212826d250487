"""How long training by gradients takes to meet the paper's PPO column under `box`, from a cold process.

Runs `archerfish train --trainer gradient` with its default settings in processes of their own, the first to fill the
cache of compiled programs, and shoots with each policy on the tuning's own draws. Writes
benchmarks/results/gradient.json; exits with 1 if a policy is below the paper in any cell, or the median takes longer
than the bar, which is meant for two cores with nothing else to do.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from archerfish.controllers.policy import policy_from_record
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.paper.tables import printed_rate
from archerfish.records.policy import read_policy
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from machine import describe_machine
from training import CONDITIONS, build_environment, hit_rates

RESULT = Path(__file__).parent / "results" / "gradient.json"
SEEDS = (0, 1, 2)
ENGAGEMENTS = 200
BAR_SECONDS = 6.0
"""From the start of the process to the policy on disk, compiled programs being kept; two quiet cores."""


def train(seed: int, out: Path, cache: Path) -> float:
    """Train in a process of its own and return the seconds from its start to its end."""
    words = ["train", "--trainer", "gradient", "--command-limit", "box", "--seed", str(seed), "--out", str(out)]
    start = "import sys; from archerfish.cli.main import main; sys.exit(main())"
    begun = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", start, *words],
        check=True,
        env={**os.environ, "ARCHERFISH_CACHE": str(cache)},
        stdout=subprocess.DEVNULL,
    )
    return time.perf_counter() - begun


def main() -> None:
    """Measure, print and write."""
    suites = table_suites(CONDITIONS)
    trials = draw_trials(suites, ENGAGEMENTS, CONDITIONS.decisions, 0, "tuning")
    paper = [printed_rate(suite.table, suite.range_m, "history") or 100.0 for suite in suites]
    world, runs = build_environment().world, []
    with tempfile.TemporaryDirectory() as folder:
        out, cache = Path(folder) / "run", Path(folder) / "cache"
        cold = train(SEEDS[0], out, cache)
        for seed in SEEDS:
            seconds = train(seed, out, cache)
            policy = policy_from_record(read_policy(out / "policy.json"))
            cells = [round(100.0 * float(rate), 2) for rate in hit_rates(world, policy, trials)]
            runs.append({"seed": seed, "seconds": round(seconds, 2), "cells_percent": cells})
    median = statistics.median(run["seconds"] for run in runs)
    table = Table("seed", "seconds", "cells %", title=f"box; the paper {paper}; with an empty cache {cold:.1f} s")
    for run in runs:
        table.add_row(
            str(run["seed"]), f"{run['seconds']:.1f}", " ".join(f"{each:.1f}" for each in run["cells_percent"])
        )
    Console(width=120).print(table)
    conditions = {"stream": "tuning", "engagements": ENGAGEMENTS, "command_limit": "box", "bar_seconds": BAR_SECONDS}
    facts = {"machine": describe_machine(), "conditions": conditions, "provenance": provenance(SEEDS[0])}
    measured = {"seconds_with_empty_cache": round(cold, 2), "median_seconds": median, "paper_percent": paper}
    write_json(RESULT, {**facts, **measured, "runs": runs})
    above = all(ours >= theirs for run in runs for ours, theirs in zip(run["cells_percent"], paper, strict=True))
    if not above or median > BAR_SECONDS:
        sys.exit(f"above the paper in every cell: {above}; median {median:.1f} s, the bar is {BAR_SECONDS} s")


if __name__ == "__main__":
    main()
