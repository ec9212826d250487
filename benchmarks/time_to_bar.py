"""How long it takes from a cold process to a policy that meets a bar: PPO and gradients, beside Stable-Baselines3.

Trains from short to long, three seeds each, until all three policies meet the bar in all eight cells of Tables II and
III under `box`; what counts is the median time from the start of the process to its end, compiled programs being kept
and nothing evaluated in it. Ours runs as `archerfish train` does it, files and curve included. Writes
benchmarks/results/time_to_bar.json and exits with 1 if a target is missed; they are meant for two cores with nothing
else to do.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.controllers.roster import make_controller
from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.learning.config import PpoConfig
from archerfish.records.policy import read_policy
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from machine import describe_machine
from peers.environments import NotRunError, version
from peers.training_roster import SB3
from peers.training_running import train
from training import BAR_PERCENT, CONDITIONS, build_environment, hit_rates, workbench
from training_peers import case_of, printed_bar, shares

RESULT = Path(__file__).parent / "results" / "time_to_bar.json"
SEEDS = (0, 1, 2)
ENGAGEMENTS = 200
LENGTHS = (51_200, 102_400, 153_600, 204_800, 307_200, 512_000, 716_800, 1_024_000, 1_536_000)
"""Decisions that are asked for; a trainer rounds them to whole calls of its own."""
PAPER, ORACLE = "the paper's PPO column", "95 to 98 % of the oracle"
TARGETS = {"PPO": 12.0, "gradient": 6.0}
"""Trainer → most seconds to the paper's column."""
OVER_SB3 = 5.0
"""How much sooner than Stable-Baselines3 the sooner of ours is to be."""


class Attempt(NamedTuple):
    """What one training came to."""

    seconds: float
    """From the start of its process to its end."""
    decisions: int
    """That it was trained for."""
    cells: NDArray[np.float64]
    """Hit rates, 0…1, shape (8,)."""


Way = Callable[[int, int], Attempt]
"""Decisions and seed → what came of it."""


def ours(trainer: str, trials: Trials, folder: Path, decisions: int, seed: int) -> Attempt:
    """Train by the command, in a process of its own."""
    out, environment = folder / "run", build_environment()
    length = f"--{trainer.lower()}.steps"
    words = ["train", "--trainer", trainer.lower(), "--command-limit", "box", length, str(decisions)]
    start = "import sys; from archerfish.cli.main import main; sys.exit(main())"
    begun = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", start, *words, "--seed", str(seed), "--out", str(out)],
        check=True,
        env={**os.environ, "ARCHERFISH_CACHE": str(folder / "cache")},
        stdout=subprocess.DEVNULL,
    )
    seconds = time.perf_counter() - begun
    policy = controller_from_record(read_policy(out / "policy.json"))
    trained = int(json.loads((out / "log.jsonl").read_text().splitlines()[-1])["steps"])
    return Attempt(seconds, trained, hit_rates(environment.world, policy, trials))


def stable_baselines(trials: Trials, folder: Path, decisions: int, seed: int) -> Attempt:
    """Train by Stable-Baselines3 with one thread, which it is fastest with."""
    case = case_of(PpoConfig(steps=decisions), checkpoint_every=decisions)._replace(seed=seed)
    begun = time.perf_counter()
    done = train(SB3, case, folder, folder / "cache_sb3")
    seconds = time.perf_counter() - begun
    if done.problem:
        raise NotRunError(done.problem)
    return Attempt(seconds, done.policies[-1][0], shares(build_environment(), done.policies[-1][1], trials))


def climb(way: Way, bars: dict[str, NDArray[np.float64]], seeds: Sequence[int]) -> dict[str, Any]:
    """Train from short to long until every bar is met with every seed.

    Returns:
      Bar → decisions, seconds of each seed, their median and the hit rates; bars that stayed out of reach are left
      out.
    """
    way(LENGTHS[0], seeds[0])  # fills the cache of compiled programs
    reached: dict[str, Any] = {}
    for decisions in LENGTHS:
        attempts = [way(decisions, seed) for seed in seeds]
        for name, bar in bars.items():
            if name not in reached and all(np.all(each.cells >= bar) for each in attempts):
                reached[name] = {
                    "decisions": attempts[0].decisions,
                    "median_seconds": round(statistics.median(each.seconds for each in attempts), 2),
                    "seconds": [round(each.seconds, 2) for each in attempts],
                    "cells_percent": [np.round(100 * each.cells, 2).tolist() for each in attempts],
                }
        if len(reached) == len(bars):
            break
    return reached


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one seed, few engagements, nothing written")
    quick = parser.parse_args().quick
    trials = draw_trials(table_suites(CONDITIONS), 20 if quick else ENGAGEMENTS, CONDITIONS.decisions, 0, "tuning")
    world = build_environment().world
    oracle = make_controller("oracle", workbench())
    most = hit_rates(world, oracle, trials)
    bars = {PAPER: printed_bar(), ORACLE: np.array(BAR_PERCENT) / 100 * most}
    load = os.getloadavg()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ways: dict[str, Way] = {each: partial(ours, each, trials, folder) for each in TARGETS}
        ways[SB3.name] = partial(stable_baselines, trials, folder)
        found = {}
        for each, way in ways.items():
            print(each, flush=True)
            found[each] = climb(way, bars, SEEDS[:1] if quick else SEEDS)
    Console(width=120).print(table(found, bars))
    reached = targets(found)
    if not quick:
        facts = {"machine": describe_machine(), "load_before": load, "provenance": provenance(SEEDS[0])}
        conditions = {"stream": "tuning", "engagements": ENGAGEMENTS, "command_limit": "box", "seeds": SEEDS}
        rates = {each: np.round(100 * bar, 2).tolist() for each, bar in bars.items()}
        measured = {"bars_percent": rates, "peer": version(SB3), "found": found, "targets": reached}
        write_json(RESULT, {**facts, "conditions": conditions, **measured})
    missed = [f"{each}: {value:.1f}, asked {asked}" for each, (asked, value, met) in reached.items() if not met]
    if missed:
        sys.exit(f"missed: {'; '.join(missed)}")


def targets(found: dict[str, Any]) -> dict[str, tuple[float, float, bool]]:
    """Return what was asked, what was measured, and whether that will do, for the paper's column."""
    seconds = {each: bars[PAPER]["median_seconds"] for each, bars in found.items() if PAPER in bars}
    judged = {
        f"{each}, seconds": (most, seconds.get(each, np.inf), seconds.get(each, np.inf) <= most)
        for each, most in TARGETS.items()
    }
    sooner = seconds.get(SB3.name, np.inf) / min(seconds.get(each, np.inf) for each in TARGETS)
    return judged | {f"times as soon as {SB3.name}": (OVER_SB3, sooner, bool(sooner >= OVER_SB3))}


def table(found: dict[str, Any], bars: dict[str, Any]) -> Table:
    """Show what each way needed for each bar."""
    shown = Table("way", "bar", "decisions", "seconds", "median s", title="from a cold process, box")
    for way, reached in found.items():
        for name in bars:
            if name not in reached:
                shown.add_row(way, name, f"more than {LENGTHS[-1]:,}", "—", "—")
                continue
            each = reached[name]
            listed = " ".join(f"{one:.1f}" for one in each["seconds"])
            shown.add_row(way, name, f"{each['decisions']:,}", listed, f"{each['median_seconds']:.1f}")
    return shown


if __name__ == "__main__":
    main()
