"""One policy against targets that move in any way, beside the classical controllers: the suite `motions`.

In the simulator identified from the robot's logs and on the virtual robot, under the command limit `gate`: eight
motions, four ranges, engagements of 1 s and of 3 s. Policies of three trainings for any target, and one that was
trained for the paper's targets alone, meet the classical controllers that know no rule of how targets move, each tuned
twice on a stream of its own: with one setting for all motions, and for each motion by itself (the best of them then
stands for that motion). Differences are paired, by engagement and dispersion draw. On the paper's targets the policies
meet the one that was trained for these.

Writes benchmarks/results/motions.json and docs/motions.svg; logs, records and policies lie in runs/motions, and what is
there already is not made again.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_evaluation, tuned_rate, tuning_ground
from archerfish.cli.lab_stage import record_robot
from archerfish.cli.robot_identification import identify_robot
from archerfish.cli.setting import Setting, SettingFiles, load_setting
from archerfish.cli.training_defaults import DRAWN_HIDDEN, DRAWN_STEPS
from archerfish.cli.training_run import TrainingTask, run_task, write_run
from archerfish.cli.transfer import ROBOT_STEPS
from archerfish.cli.transfer_stage import COMMAND_LIMIT, STILL_SHARE
from archerfish.cli.workers import Task, run_tasks
from archerfish.controllers.roster import Tuning
from archerfish.evaluation.evaluate import Ground, Outcome, cells, suite_difference, suite_label
from archerfish.evaluation.results import MOTION_TABLES, Cell, Comparison
from archerfish.evaluation.tuning import Tuned, tune
from archerfish.figures.hit_rates import RateCurve, RatePanel, hit_rate_figure
from archerfish.figures.style import save_figure
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records import storage
from archerfish.records.policy import PolicyRecord, read_policy
from archerfish.targets.drawn import ANY, WAYS
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "motions.json"
FIGURE = Path(__file__).parents[1] / "docs" / "motions.svg"
RUNS = Path("runs/motions")
ROBOT, SEED = "infantry", 0
TRAININGS = (0, 1, 2)
ENGAGEMENTS = {"simulator": 400, "robot": 200}
TUNING_ENGAGEMENTS = 16
CLASSICAL = ("kalman", "kalman-lq", "imm-lq")
ONE, EACH = "one setting", "tuned per motion"
"""Names of the rivals in comparisons: the best controller of one setting, and the best of each motion."""
SPECIALIST = "history"
"""Name of the policy that was trained for the paper's targets alone."""
WORKERS = 2
MOST_BEHIND, LOWEST_END = 0.5, 1.5
"""Points by which the policy may be behind in a cell, and its interval may reach below."""


def records(workers: int) -> Setting:
    """Return the robot as identified from its logs."""
    folder = RUNS / "records"
    if not (folder / "sensing.json").exists():
        record_robot(ROBOT, RUNS / "logs", SEED, workers)
        identify_robot(ROBOT, RUNS / "logs", folder, SEED, workers)
    names = ("pitch", "yaw", "muzzle", "sensing")
    return load_setting(SettingFiles(**{name: folder / f"{name}.json" for name in names}, robot=ROBOT))


def trainings(setting: Setting, seeds: tuple[int, ...], quick: bool) -> list[tuple[Path, TrainingTask]]:
    """Return what is trained: for any target, and for the paper's alone."""
    plain = TrainingTask(setting, STILL_SHARE, "tracked", 4, COMMAND_LIMIT, PpoConfig(), SEED, trainer="gradient")
    # As many decisions as each gets from the commands that users have.
    paper = replace(plain, gradient=GradientConfig(steps=8192 if quick else ROBOT_STEPS))
    config = GradientConfig(steps=8192 if quick else DRAWN_STEPS, hidden=DRAWN_HIDDEN)
    found = [replace(plain, observation="multimodel", target=ANY, gradient=config, seed=seed) for seed in seeds]
    return [(RUNS / "policies" / f"{each.target or 'paper'}-{each.seed}", each) for each in (*found, paper)]


def train(job: tuple[Path, TrainingTask], advance: Callable[[float, str], None]) -> float:
    """Train a policy, unless it is there, and return the seconds that took."""
    folder, task = job
    if not (folder / "policy.json").exists():
        result = run_task(task, advance)
        write_run(folder, result, task.facts() | {"seconds": round(result.seconds, 1)})
    return float(storage.read_json(folder / "config.json")["seconds"])


@dataclass(frozen=True)
class TuningJob:
    """A controller to tune for some targets."""

    setting: Setting
    controller: str
    targets: tuple[str, ...]
    """Each by itself."""
    engagements: int


class Settled(NamedTuple):
    """What tuning found for one controller and target."""

    tuning: Tuning
    """The settings."""
    hit_rate: float
    """With them, on the draws of the tuning, 0…1."""


def tune_all(job: TuningJob, advance: Callable[[float, str], None]) -> dict[str, Tuned]:
    """Tune a controller for each target, on engagements of both lengths."""
    found = {}
    for done, target in enumerate(job.targets):
        tasks = [
            EvaluationTask(job.setting, COMMAND_LIMIT, 1, SEED, target=target, seconds=seconds)
            for seconds in MOTION_TABLES
        ]
        grounds = [(task, tuning_ground(task, job.engagements)) for task in tasks]

        def rate(tuning: Tuning, grounds: list[tuple[EvaluationTask, Ground]] = grounds) -> float:
            return float(np.mean([tuned_rate(task, ground, job.controller, tuning) for task, ground in grounds]))

        found[target] = tune(job.controller, rate)
        advance(done + 1.0, f"{job.controller} {target}")
    return found


def tuned(setting: Setting, engagements: int) -> dict[str, dict[str, Tuned]]:
    """Return controller → target → settings."""
    targets = (ANY, *WAYS)
    jobs = [(name, part) for part in (targets[:1], targets[1:]) for name in CLASSICAL]
    tasks: list[Task] = [
        (tune_all, TuningJob(setting, name, part, engagements), 10.0 * len(part)) for name, part in jobs
    ]
    done = run_tasks("tuning", "settings", tasks, WORKERS)
    merged: dict[str, dict[str, Tuned]] = {name: {} for name in CLASSICAL}
    for (name, _), found in zip(jobs, done, strict=True):
        merged[name] |= found
    return merged


def kept_settings(setting: Setting, engagements: int) -> dict[str, dict[str, Settled]]:
    """Return controller → target → settings: as tuned before, or tuned now and kept."""
    path = RUNS / f"settings-{engagements}.json"
    if not path.exists():
        facts = {
            name: {
                target: {"tuning": each.tuning._asdict(), "hit_rate": each.hit_rate} for target, each in found.items()
            }
            for name, found in tuned(setting, engagements).items()
        }
        storage.write_json(path, facts)
    return {
        name: {target: Settled(Tuning(**each["tuning"]), each["hit_rate"]) for target, each in found.items()}
        for name, found in storage.read_json(path).items()
    }


@dataclass(frozen=True)
class World:
    """Where the suite is shot."""

    robot: str
    """Name of the virtual robot, or empty for the identified simulator."""
    seconds: float
    """Length of the engagements [s]."""
    engagements: int
    """Per cell."""

    def task(self, setting: Setting, target: str = ANY) -> EvaluationTask:
        """Return its evaluation, of nobody yet."""
        return EvaluationTask(
            setting, COMMAND_LIMIT, self.engagements, SEED, robot=self.robot, target=target, seconds=self.seconds
        )


def shoot(
    worlds: list[World], setting: Setting, policies: list[PolicyRecord], settings: dict[str, dict[str, Settled]]
) -> list[list[Outcome]]:
    """Shoot all cells: per world the outcomes of one setting, of policies, and of the best per motion."""
    best = {
        motion: max(CLASSICAL, key=lambda name, motion=motion: settings[name][motion].hit_rate)  # type: ignore[misc]
        for motion in WAYS
    }
    jobs: list[Task] = []
    for world in worlds:
        everything = world.task(setting)
        one = {name: settings[name][ANY].tuning for name in CLASSICAL}
        jobs += [(run_evaluation, replace(everything, controllers=(name,), tuning=one), 8.0) for name in CLASSICAL]
        jobs += [(run_evaluation, replace(everything, policies=(policy,)), 8.0) for policy in policies]
        for motion, name in best.items():
            own = {name: settings[name][motion].tuning}
            jobs.append((run_evaluation, replace(world.task(setting, motion), controllers=(name,), tuning=own), 1.0))
    found = [each[0] for each in run_tasks("shooting", "controllers", jobs, WORKERS)]
    whole, per_world = len(CLASSICAL) + len(policies), len(jobs) // len(worlds)
    outcomes = []
    for first in range(0, len(found), per_world):
        part = found[first : first + per_world]
        outcomes.append([*part[:whole], joined(part[whole:])])
    return outcomes


def joined(parts: list[Outcome]) -> Outcome:
    """Join outcomes of single motions to one of all."""
    hit, fired = (np.concatenate([getattr(each, name) for each in parts]) for name in ("hit", "fired"))
    accelerations = [each.yaw_acceleration for each in parts if each.yaw_acceleration is not None]
    return replace(parts[0], name=EACH, hit=hit, fired=fired, yaw_acceleration=max(accelerations))


def compared(ground: Ground, outcomes: list[Outcome], rival: str) -> list[Comparison]:
    """Compare every policy with the rivals, and with the policy for the paper's targets, in every cell."""
    others = {ONE: rival, EACH: EACH, SPECIALIST: SPECIALIST}
    by_name = {each.name: each for each in outcomes}
    return [pair for against, name in others.items() for pair in paired(ground, outcomes, against, by_name[name])]


def paired(ground: Ground, outcomes: list[Outcome], against: str, other: Outcome) -> list[Comparison]:
    """Compare every policy for any target with one outcome, in every cell."""
    return [
        Comparison(
            **vars(suite_label(ground, suite, outcome)),
            against=against,
            **suite_difference(suite, outcome, other, index)._asdict(),
        )
        for outcome in outcomes
        if outcome.name == "policy"
        for index, suite in enumerate(ground.trials.suites)
    ]


def shoot_eq7(setting: Setting, policies: list[PolicyRecord], engagements: dict[str, int]) -> dict[str, list[Any]]:
    """Shoot at the paper's targets: how far a policy for any is behind the one that was trained for these alone."""
    tasks = [
        EvaluationTask(setting, COMMAND_LIMIT, engagements["simulator"], SEED),
        EvaluationTask(setting, COMMAND_LIMIT, engagements["robot"], SEED, robot=ROBOT, tables=("IV", "V")),
    ]
    jobs: list[Task] = [
        (run_evaluation, replace(task, policies=(policy,)), 1.0) for task in tasks for policy in policies
    ]
    found = [each[0] for each in run_tasks("shooting at eq (7)", "policies", jobs, WORKERS)]
    rows: list[Cell] = []
    pairs: list[Comparison] = []
    for index, task in enumerate(tasks):
        ground, outcomes = make_ground(task), found[index * len(policies) : (index + 1) * len(policies)]
        rows += cells(ground, outcomes)
        special = next(each for each in outcomes if each.name == SPECIALIST)
        pairs += paired(ground, outcomes, SPECIALIST, special)
    return {"cells": [asdict(each) for each in rows], "comparisons": [asdict(each) for each in pairs]}


def verdict(found: list[Comparison], setting: str, seed: int | None) -> dict[str, Any]:
    """Judge one training in one world by the bars."""
    mine = [each for each in found if each.setting == setting and each.policy_seed == seed]
    rows: dict[str, Any] = {"setting": setting, "training_seed": seed}
    for against in (ONE, EACH):
        pairs = [each for each in mine if each.against == against]
        moving = [each for each in pairs if each.target == "dynamic"]
        rows[against] = {
            "mean_points": round(100 * float(np.mean([each.difference for each in pairs])), 2),
            "least_points": round(100 * min(each.difference for each in pairs), 2),
            "least_lower_end": round(100 * min(each.low for each in pairs), 2),
            "moving_cells_clear_of_zero": f"{sum(each.low > 0 for each in moving)} of {len(moving)}",
            "missed": [
                f"{each.motion} {each.range_m[0]:g}–{each.range_m[1]:g} m, {each.table.split(', ')[1]}: "
                f"{100 * each.difference:+.2f}, lower end {100 * each.low:+.2f}"
                for each in pairs
                if 100 * each.difference < -MOST_BEHIND or 100 * each.low < -LOWEST_END
            ],
        }
    return rows


def panels(found: list[Cell], setting: str, table: str) -> list[RatePanel]:
    """Return a panel per motion."""
    names = {"policy": "policy", SPECIALIST: "policy for eq (7)", ONE: "classical, one setting"}
    names |= {EACH: "classical, per motion"}
    ranges = sorted({each.range_m for each in found})

    def curve(name: str, style: int, motion: str) -> RateCurve:
        chosen = [each for each in found if (each.setting, each.table, each.motion) == (setting, table, motion)]
        named = {each.range_m: each for each in chosen if each.controller == name and each.policy_seed in (None, SEED)}
        rate, low, high = ([100 * getattr(named[each], field) for each in ranges] for field in ("rate", "low", "high"))
        return RateCurve(names[name], style, rate, low, high)

    return [
        RatePanel(
            motion,
            [f"{low:g}–{high:g}" for low, high in ranges],
            [curve(name, style, motion) for style, name in enumerate(names)],
        )
        for motion in WAYS
    ]


def show(verdicts: list[dict[str, Any]]) -> None:
    """Print a line per training, world and rival."""
    table = Table("setting", "seed", "against", "mean", "least", "lower end ≥", "clear of zero", "missed")
    for row in verdicts:
        for against in (ONE, EACH):
            each = row[against]
            numbers = (each[name] for name in ("mean_points", "least_points", "least_lower_end"))
            table.add_row(
                row["setting"], str(row["training_seed"]), against, *(f"{value:+.2f}" for value in numbers),
                each["moving_cells_clear_of_zero"], "\n".join(each["missed"]) or "none",
            )  # fmt: skip
    Console(width=180).print(table)


def show_eq7(found: list[dict[str, Any]]) -> None:
    """Print how far the policies are behind the one for the paper's targets, on these."""
    table = Table("eq (7) in", "seed", f"against {SPECIALIST}: mean", "least", "lower end ≥")
    for setting, seed in dict.fromkeys((each["setting"], each["policy_seed"]) for each in found):
        mine = [each for each in found if (each["setting"], each["policy_seed"]) == (setting, seed)]
        numbers = (
            np.mean([each["difference"] for each in mine]),
            min(each["difference"] for each in mine),
            min(each["low"] for each in mine),
        )
        table.add_row(setting, str(seed), *(f"{100 * each:+.2f}" for each in numbers))
    Console(width=180).print(table)


def main() -> None:
    """Run everything; `--quick` with too little to be quoted, and without a file."""
    quick, begun = "--quick" in sys.argv[1:], time.monotonic()
    keep_compiled()
    setting = records(WORKERS)
    planned = trainings(setting, TRAININGS[:1] if quick else TRAININGS, quick)
    jobs: list[Task] = [(train, job, float(job[1].decisions)) for job in planned]
    seconds = run_tasks("training", "decisions", jobs, WORKERS)
    policies = [read_policy(folder / "policy.json") for folder, _ in planned]
    settings = kept_settings(setting, 2 if quick else TUNING_ENGAGEMENTS)
    rival = max(CLASSICAL, key=lambda name: settings[name][ANY].hit_rate)
    worlds = [
        World(robot, length, 4 if quick else count)
        for robot, count in (("", ENGAGEMENTS["simulator"]), (ROBOT, ENGAGEMENTS["robot"]))
        for length in MOTION_TABLES
    ]
    outcomes = shoot(worlds, setting, policies, settings)
    grounds = [make_ground(world.task(setting)) for world in worlds]
    rows, pairs = [], []
    for ground, shot in zip(grounds, outcomes, strict=True):
        by_name = {each.name: each for each in shot}
        rows += cells(ground, [*shot, replace(by_name[rival], name=ONE)])
        pairs += compared(ground, shot, rival)
    eq7 = shoot_eq7(setting, policies, dict.fromkeys(ENGAGEMENTS, 4) if quick else ENGAGEMENTS)
    verdicts = [
        verdict(pairs, name, seed)
        for name in dict.fromkeys(each.setting for each in grounds)
        for seed in dict.fromkeys(each.policy_seed for each in pairs)
    ]
    show(verdicts)
    show_eq7(eq7["comparisons"])
    if quick:
        return
    conditions = {
        **describe_machine(), "engagements_per_cell": ENGAGEMENTS, "seed": SEED, "training_seeds": TRAININGS,
        "training_seconds": seconds, "whole_minutes": round((time.monotonic() - begun) / 60, 1),
        "one_setting_rival": rival,
    }  # fmt: skip
    tunings = {
        name: {target: {**each.tuning._asdict(), "hit_rate": each.hit_rate} for target, each in found.items()}
        for name, found in settings.items()
    }
    storage.write_json(
        RESULT,
        {
            "conditions": conditions,
            "verdicts": verdicts,
            "tuning": tunings,
            "cells": [asdict(each) for each in rows],
            "comparisons": [asdict(each) for each in pairs],
            "eq7": eq7,
        },
    )
    drawn = panels(rows, grounds[-1].setting, MOTION_TABLES[3.0])
    save_figure(FIGURE, hit_rate_figure(drawn, height=6.0, columns=4))
    sys.exit(any(row[against]["missed"] for row in verdicts for against in (ONE, EACH)))


if __name__ == "__main__":
    main()
