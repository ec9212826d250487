"""Proven bounds on hit rates in the paper's cells: what no controller can exceed.

`python benchmarks/bounds.py [ROBOT] --limits gate --engagements 500` bounds every engagement of an evaluation with
seed 0, of the paper's robot if no folder is given; some 0.2 s of a quiet core each. `--stride 3` takes every third
engagement, with the reach bound of all as a control variate. `--publish` writes what is found into
src/archerfish/evaluation/published.json, which evaluations of these very engagements show.
"""

import argparse
import contextlib
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.evaluation.draws import draw
from archerfish.protocols import Engagement
from archerfish.records.json_files import plain, read_json, write_json
from archerfish.reports.table import Estimate, Table, tables_text
from archerfish.simulation.world import SimulatedWorld, make_world
from archerfish.task import TaskCell
from bars import run
from bounds_information import Detections, Prior, aim_chances, detections, make_prior
from bounds_problem import AimProblem, Array, aim_problem
from bounds_reach import Interval, reach, reach_chances
from bounds_trajectory import combined_bound, hindsight_bound

PUBLISHED = ROOT / "src" / af.__name__ / "evaluation" / "published.json"
SHOTS = {("paper", "gate"): 22, ("paper", "box"): 14, ("paper", "los-2deg"): 22}
"""The first shots of an engagement, which share a trajectory: later ones can all be reached."""
OTHER_SHOTS = 18
"""Of another robot than the paper's."""


class Part(NamedTuple):
    """What is bounded."""

    robot: Path | None  # its folder; None: the paper's
    limit: str  # of the commands
    engagements: int  # a cell
    stride: int  # every how many-th engagement gets the costly bounds
    seed: int  # of the engagements

    @property
    def setting(self) -> tuple[af.Robot, af.Task]:
        """Robot and task."""
        robot = af.Robot.paper() if self.robot is None else af.Robot.load(self.robot)
        return robot, af.Task.load("paper").replace(command_limit=self.limit)

    @property
    def name(self) -> str:
        """By which the robot is published."""
        return "paper" if self.robot is None else self.setting[0].digest()


def cell_bounds(index: int, part: Part) -> dict[str, Any]:
    """Bound the hit rate of one cell, 0…1: mean and standard error with the path known, and by what is seen."""
    robot, task = part.setting
    world, cell = make_world(robot, task), task.cells()[index]
    engagements, draws = draw([cell], part.engagements, part.seed, "evaluation", world.normals, world.plants)
    problem = aim_problem(world, engagements, draws, task.hit_radius_m)
    interval = reach(problem)
    best = np.sum(reach_chances(problem, interval), axis=-1)
    known, shots = _known(world, cell, engagements, draws), SHOTS.get((part.name, part.limit), OTHER_SHOTS)
    chosen, rows = np.arange(0, len(best), part.stride), []
    for engagement in chosen.tolist():
        one = problem.pick(slice(engagement, engagement + 1))
        within = interval if len(interval.low) == 1 else Interval(*(end[engagement, None] for end in interval))
        with _quiet():
            hindsight, _ = hindsight_bound(one, within, shots)
            # Both are of one known path, so the smaller one bounds this very engagement.
            hindsight = min(hindsight, best[engagement])
            rows.append((hindsight, _informed(one, within, shots, known, engagement) if known else hindsight))
    hindsights, combined = np.array(rows).T / draws.shape[1]
    best = best / draws.shape[1]
    left_out = _error(best[chosen] - hindsights) * np.sqrt(max(1.0 - len(chosen) / len(best), 0.0))
    mean, luck = np.mean(best) - np.mean(best[chosen] - hindsights), _error(hindsights - combined)
    found = [float(mean), float(left_out)]
    informed = [float(np.mean(best) - np.mean(best[chosen] - combined)), float(np.hypot(left_out, luck))]
    # Both hold of the mean of a cell, so the smaller one does.
    causal = informed if known and informed[0] < found[0] else found
    return {"motion": cell.motion, "range_m": cell.range_m, "reach": best.mean(), "hindsight": found, "causal": causal}


def _error(values: Array) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hide what HiGHS reports, past Python's streams, of a heuristic of its own that failed."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


def _known(
    world: SimulatedWorld, cell: TaskCell, engagements: Engagement, draws: Any
) -> tuple[Detections, Prior] | None:
    """Return what is seen and what is known beforehand; None where the filter of eq (7) says nothing more."""
    seen = detections(world, engagements, draws)
    # At another height than the pivot's, the elevation would show the distance too.
    if seen is None or float(cell.scenario.height) != 0.0:
        return None
    prior = make_prior(cell.scenario)
    # One exact detection of a target that stands still shows all there is to know.
    return None if len(prior.speed) == 1 and seen.fresh.shape[1] == 1 else (seen, prior)


def _informed(
    problem: AimProblem, interval: Interval, shots: int, known: tuple[Detections, Prior], engagement: int
) -> float:
    """Return the smaller of the information bound and the combined bound, both of what is seen in an engagement."""
    seen, prior = known
    chances = aim_chances(problem, seen.pick(engagement), prior)
    combined, _ = combined_bound(problem, interval, chances, shots, prior.x[1] - prior.x[0] + prior.rise)
    return min(combined, float(np.sum(np.max(chances.chance, axis=-1))))


def publish(part: Part, cells: list[dict[str, Any]]) -> None:
    """Write the bounds into the library, in the place of those of the same engagements."""
    key = {"robot": part.name, "command_limit": part.limit, "seed": part.seed, "engagements": part.engagements}
    entry: dict[str, Any] = key | {"static": [], "dynamic": []}
    for cell in cells:
        entry[cell["motion"]].append([list(cell["range_m"]), cell["causal"], cell["hindsight"]])
    content = read_json(PUBLISHED)
    others = [known for known in content["bounds"] if any(known[name] != value for name, value in key.items())]
    content["bounds"] = sorted([*others, entry], key=lambda each: tuple(each[name] for name in key))
    write_json(PUBLISHED, plain(content))


def main() -> None:
    """Bound, print and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", type=Path, nargs="?", help="folder of a robot; the paper's if not given")
    parser.add_argument("--limits", nargs="+", choices=("gate", "box", "los-2deg"), default=["gate"])
    parser.add_argument("--engagements", type=int, default=500, help="of each cell")
    parser.add_argument("--stride", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--publish", action="store_true")
    options = parser.parse_args()
    for limit in options.limits:
        part = Part(options.robot, limit, options.engagements, options.stride, options.seed)
        cells = list(run(partial(cell_bounds, part=part), range(len(part.setting[1].cells())), options.workers))
        rows = []
        for cell in cells:
            intervals = []
            for mean, error in (cell["hindsight"], cell["causal"]):
                half = 1.96 * error
                intervals.append(Estimate(100 * mean, 100 * (mean - half), 100 * (mean + half), "%"))
            low, high = cell["range_m"]
            rows.append((f"{cell['motion']}, {low:g}–{high:g} m", 100 * cell["reach"], *intervals))
        title = f"{part.name[:8]}, {limit}: bounds of {part.engagements} engagements a cell, seed {part.seed}"
        print(tables_text([Table(title, ("cell", "reach, %", "path known", "by what is seen"), tuple(rows))]))
        if options.publish:
            publish(part, cells)


if __name__ == "__main__":
    main()
