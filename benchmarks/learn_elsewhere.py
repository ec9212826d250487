"""Whether others learn in our Gymnasium environments what we do: the same network, the same number of decisions.

Stable-Baselines3's PPO and a PPO in one file in the manner of CleanRL train beside ours, each in a process of its own,
by the same settings but for one learning rate where we have two. The policies at the end shoot in the same engagements,
on the tuning's draws, in all eight cells of Tables II and III. Writes benchmarks/results/learn_elsewhere.json; exits
with 1 if another's mean over the seeds is more than 3 points below ours in any cell.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.evaluation.suites import Suite, Trials, draw_trials, table_suites
from archerfish.learning.config import PpoConfig
from archerfish.learning.training import CHUNK
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from archerfish.simulation.environment import ShootingEnvironment
from machine import describe_machine
from peers.environments import version
from peers.roster import Tool
from peers.training_protocol import shooting_environment
from peers.training_roster import OURS, SB3
from peers.training_running import train
from training_peers import case_of, shares

RESULT = Path(__file__).parent / "results" / "learn_elsewhere.json"
CLEANRL = Tool("CleanRL style", "cleanrl_train.py", {}, "sb3.txt")
"""It needs no package but torch, which comes with Stable-Baselines3."""
ALLOWED_POINTS = 3.0
CONDITIONS = assumed_conditions()


class Extent(NamedTuple):
    """How much is measured."""

    iterations: int
    """Of each training; whole compiled calls of ours."""
    seeds: tuple[int, ...]
    """One training each."""
    engagements: int
    """Per cell, of 50 shots each."""


FULL, QUICK = Extent(59 * CHUNK, (0, 1, 2), 200), Extent(2 * CHUNK, (0,), 10)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few minutes, too little to learn, nothing written")
    parser.add_argument("--seeds", nargs="+", type=int, help="other seeds")
    options = parser.parse_args()
    extent = QUICK if options.quick else FULL
    extent = extent._replace(seeds=tuple(options.seeds)) if options.seeds else extent
    load, machine = os.getloadavg(), describe_machine()
    suites = table_suites(CONDITIONS)
    trials = draw_trials(suites, extent.engagements, CONDITIONS.decisions, 0, "tuning")
    environment = shooting_environment()
    with tempfile.TemporaryDirectory() as folder:
        tools = {tool.name: learned(tool, extent, environment, trials, Path(folder)) for tool in (OURS, SB3, CLEANRL)}
    gaps = {name: largest_gap(tools[OURS.name], found) for name, found in tools.items() if name != OURS.name}
    content = {
        "machine": machine,
        "load_before": load,
        "load_after": os.getloadavg(),
        "provenance": provenance(extent.seeds[0]),
        "conditions": {"command_limit": "box", "stream": "tuning", **extent._asdict()},
        "decisions": extent.iterations * PpoConfig().batch,
        "cells": [{"target": each.target, "range_m": list(each.range_m)} for each in suites],
        "tools": tools,
        "allowed_points": ALLOWED_POINTS,
        "largest_gap_points": gaps,
    }
    Console(width=140).print(rates_table(tools, suites, content["decisions"]))
    if not options.quick:
        write_json(RESULT, content)
    missed = [name for name, gap in gaps.items() if gap is None or gap > ALLOWED_POINTS]
    if missed and not options.quick:
        sys.exit(f"more than {ALLOWED_POINTS:g} points below ours, or not run: {', '.join(missed)}; {gaps}")


def learned(
    tool: Tool, extent: Extent, environment: ShootingEnvironment, trials: Trials, folder: Path
) -> dict[str, Any]:
    """Train by a tool with each seed, and judge the policies at the end.

    Args:
      tool: who.
      extent: how much.
      environment: where they shoot.
      trials: at whom.
      folder: for what the trainings leave.
    """
    config = PpoConfig()
    decisions = extent.iterations * config.batch
    # CleanRL's file and Stable-Baselines3 have one learning rate, the actor's.
    shared = {"steps": decisions, "checkpoint_every": decisions}
    rates, speeds = [], []
    for seed in extent.seeds:
        print(f"{tool.name}: seed {seed}", flush=True)
        found = train(tool, case_of(config, seed=seed, **shared), folder)
        if found.problem:
            return {"problem": found.problem}
        steps, path = found.policies[-1]
        if steps != decisions:
            return {"problem": f"trained for {steps} decisions, expected {decisions}"}
        rates.append(np.round(100 * shares(environment, path, trials), 2).tolist())
        speeds.append(round(found.steps_per_second))
    return {"version": version(tool), "hit_rates_percent": rates, "steps_per_second": speeds}


def largest_gap(ours: dict[str, Any], other: dict[str, Any]) -> float | None:
    """Return by how many points another's mean rates are below ours at most; None where one was not run."""
    if "problem" in ours or "problem" in other:
        return None
    return round(float(np.max(mean_rates(ours) - mean_rates(other))), 2)


def mean_rates(found: dict[str, Any]) -> NDArray[np.float64]:
    """Return the hit rates in percent, the mean over the seeds, shape (8,)."""
    return np.mean(found["hit_rates_percent"], axis=0)


def rates_table(tools: dict[str, Any], suites: tuple[Suite, ...], decisions: int) -> Table:
    """Lay the hit rates side by side."""
    table = Table(title=f"hit rates after {decisions:,} decisions, in percent (spread over seeds)")
    table.add_column("target, range")
    for name, found in tools.items():
        table.add_column(f"{name} (not run)" if "problem" in found else name, justify="right")
    for index, suite in enumerate(suites):
        cells = []
        for found in tools.values():
            each = [rates[index] for rates in found.get("hit_rates_percent", [])]
            cells.append(f"{np.mean(each):.1f} ({min(each):.1f}–{max(each):.1f})" if each else "–")
        table.add_row(f"{suite.target}, {suite.range_m[0]:g}–{suite.range_m[1]:g} m", *cells)
    return table


if __name__ == "__main__":
    main()
