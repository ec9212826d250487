"""Write tests2/outcomes: every hit of the first edition's controllers in some evaluations, and their tuned settings.

    python tests2/against_first/write_outcomes.py [tuning | SETTING …]

Beside the hits stands how many shots of each cell come out otherwise where the first edition itself has the engagements
in smaller batches: rounding alone, which is the measure of what "equal" can mean. Takes half an hour; `tuning`, which
is read by the others, takes as long again.
"""

import base64
import sys
import time
from dataclasses import replace

import numpy as np
from write_infantry import RECORDS, ROOT

from archerfish.cli.evaluation_run import EvaluationTask, classical_entrant, make_ground, tune_controllers
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.controllers.roster import Tuning
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.evaluation.evaluate import Ground
from archerfish.evaluation.trial import fight, perfect_shots
from archerfish.evaluation.tuning import GRIDS, starting_point
from archerfish.paper.tuning import paper_settings
from archerfish2.records.json_files import plain, read_json, write_json

FOLDER = ROOT / "tests2" / "outcomes"
SLOW = ("parabola-lq",)  # in the first edition, with sensing
PAPER = ("kalman", "kalman-tuned", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle", "perfect")
INFANTRY = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle")
ANY = ("kalman", "kalman-lq", "imm-lq", "oracle")
NAMES = {"kalman": "kalman-paper", "kalman-tuned": "kalman"}  # of the paper's robot, in the second edition
SETTINGS = {
    "paper-gate": ("paper", "gate", "paper", 1.0, 100, PAPER),
    "paper-box": ("paper", "box", "paper", 1.0, 100, PAPER),
    "infantry": ("infantry", "gate", "paper", 1.0, 100, INFANTRY),
    "any-1s": ("infantry", "gate", "any", 1.0, 10, ANY),
    "any-3s": ("infantry", "gate", "any", 3.0, 10, ANY),
}
"""Name → robot, command limit, targets, length [s], engagements per cell, controllers."""


def evaluation(robot: str, limit: str, target: str = "paper", seconds: float = 1.0, count: int = 100) -> EvaluationTask:
    files = SettingFiles()
    if robot == "infantry":
        parts = {name: RECORDS / f"{name}.json" for name in ("muzzle", "sensing", "limits")}
        files = SettingFiles(plant=str(RECORDS), robot=robot, **parts)
    return EvaluationTask(load_setting(files), limit, count, 0, target=target, seconds=seconds)


def tunings(robot: str, limit: str, target: str) -> dict[str, Tuning]:
    """Return the settings by controller; what is not among them has none, or those of the conditions."""
    if target == "any":
        return {name: starting_point(name) for name in ANY if name in GRIDS}
    if robot == "paper":
        return {name: Tuning(**values) for name, values in paper_settings(limit).items()}
    return {name: Tuning(**each["tuning"]) for name, each in read_json(FOLDER / "tuning.json").items()}


def hits(ground: Ground, controller: object, rows: np.ndarray | None = None) -> np.ndarray:
    """Return which decisions hit; of some rows of the engagements."""
    trials = ground.trials
    if rows is not None:
        engagements = map_arrays(lambda each: each[rows], trials.engagements)
        trials = replace(trials, engagements=engagements, draws=trials.draws[rows])
    shots = fight(ground.world, controller, trials) if controller else perfect_shots(ground.world, trials)
    return shots.hits(ground.conditions.hit_radius)


def write_setting(name: str) -> None:
    robot, limit, target, seconds, count, controllers = SETTINGS[name]
    settings = tunings(robot, limit, target)
    task = replace(evaluation(robot, limit, target, seconds, count), tuning=settings)
    ground, found = make_ground(task), {}
    cells = len(ground.trials.suites)
    places = np.arange(cells * count).reshape(cells, count)
    halves, each_cell = np.split(places, 2, axis=1), list(places)
    for spec in controllers:
        controller = None if spec == "perfect" else classical_entrant(task, spec).controller
        begun, differ = time.process_time(), np.zeros(cells, int)
        hit = hits(ground, controller)
        for batches in (halves,) if robot == "infantry" and spec in SLOW else (halves, each_cell):
            other = np.empty_like(hit)
            for rows in batches:
                other[rows.ravel()] = hits(ground, controller, rows.ravel())
            differ = np.maximum(differ, (hit != other).reshape(cells, -1).sum(axis=1))
        tuning = settings.get(spec)
        found[NAMES.get(spec, spec) if robot == "paper" else spec] = {
            "tuning": tuning and tuning._asdict(),
            "hits": base64.b64encode(np.packbits(hit)).decode(),
            "differ": differ.tolist(),
        }
        seen = hit.reshape(cells, -1).sum(axis=1)
        print(name, spec, seen, differ, f"{time.process_time() - begun:.0f} s", flush=True)  # noqa: T201
    where = {"robot": robot, "task": target, "length_s": seconds, "command_limit": limit, "seed": 0}
    shape = (cells, count, hit.shape[-1])  # cells, engagements, decisions
    write_json(FOLDER / f"{name}.json", {"setting": {**where, "shape": shape}, **plain(found)})


def write_tuning() -> None:
    controllers = tuple(name for name in INFANTRY if name in GRIDS)
    tuned = tune_controllers(replace(evaluation("infantry", "gate"), controllers=controllers))
    content = {
        each.controller: {
            "tuning": each.tuning._asdict(),
            "hit_rate": each.hit_rate,
            "tried": [[tuning._asdict(), rate] for tuning, rate in each.tried],
        }
        for each in tuned
    }
    write_json(FOLDER / "tuning.json", content)


if __name__ == "__main__":
    for asked in sys.argv[1:] or SETTINGS:
        if asked == "tuning":
            write_tuning()
        else:
            write_setting(asked)
