"""Proven bounds on the hit rates of Tables II–V (docs/bounds.md): what no controller can exceed.

    python benchmarks/bounds.py [--setting paper] [--limit gate box] [--stride 3]
    python benchmarks/bounds.py --publish

Without options, every engagement of `archerfish reproduce` at seed 0 in both settings: some 25 minutes on two quiet
cores. --stride 3 takes every third engagement, with the reach bound of all as a control variate. Writes
benchmarks/results/bounds.json, where parts of other runs stay. --publish computes nothing, but takes what is there into
the library, which gives it beside the hit rates of these engagements, and into docs/bounds.md.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from archerfish.cli.evaluation_run import EvaluationTask, make_ground
from archerfish.cli.reproduce import Reproduce
from archerfish.cli.setting import Setting, SettingFiles, load_setting
from archerfish.cli.transfer_stage import TABLES, Rehearsal, record_and_identify
from archerfish.cli.workers import run_tasks
from archerfish.evaluation.bounds.engagement_bounds import EngagementBounds, engagement_bounds
from archerfish.evaluation.bounds.published import PublishedBounds, PublishedCell, camera_means, write_published
from archerfish.evaluation.bounds.trajectory import TIME_LIMIT_S
from archerfish.evaluation.evaluate import Ground
from archerfish.records import storage
from bounds_tables import write_tables
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "bounds.json"
PAPER, INFANTRY = "paper", "identified-infantry"
PARTS = ((PAPER, "gate"), (INFANTRY, "gate"), (PAPER, "box"), (PAPER, "los-2deg"))
"""Setting and command limit, as `reproduce` shoots them."""
SHOTS = {(PAPER, "gate"): 22, (PAPER, "box"): 14, (PAPER, "los-2deg"): 22, (INFANTRY, "gate"): 18}
"""The first shots of an engagement, which share a trajectory: later ones can all be reached."""


@dataclass(frozen=True)
class Options:
    """What to bound."""

    setting: tuple[str, ...] = (PAPER, INFANTRY)
    """Settings: paper, identified-infantry."""
    limit: tuple[str, ...] = ("gate", "box", "los-2deg")
    """Command limits."""
    stride: int = 1
    """Every how many-th engagement gets the costly bounds."""
    engagements: int = 0
    """Per cell; as many as `reproduce` takes if not given."""
    seed: int = 0
    """Of the engagements."""
    robot: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder of a run with the infantry's logs and records (runs/reproduce/robot); made if not given."""
    workers: int = 2
    """Processes."""
    publish: bool = False
    """Compute nothing; take the results of earlier runs into the library."""


@dataclass(frozen=True)
class _Job:
    """One cell of one part."""

    task: EvaluationTask
    index: int
    shots: int
    stride: int


def _bound_cell(job: _Job, advance: Callable[[float, str], None]) -> tuple[EngagementBounds, float]:
    ground, begun = make_ground(job.task), time.process_time()
    # HiGHS reports on a heuristic of its own that failed, past Python's streams.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    found = engagement_bounds(
        ground.world,
        ground.trials,
        job.index,
        ground.conditions.hit_radius,
        job.shots,
        job.stride,
        lambda done: advance(done, f"{ground.setting} {job.task.command_limit} {job.index + 1}/8"),
    )
    return found, time.process_time() - begun


def _infantry(options: Options) -> Setting:
    if options.robot is not None:
        records = options.robot / "records"
        files = {"muzzle": records / "muzzle.json", "sensing": records / "sensing.json"}
        limits = options.robot / "logs" / "limits.json"
        return load_setting(SettingFiles(plant=str(records), limits=limits, robot="infantry", **files))
    with tempfile.TemporaryDirectory() as folder:
        command, folders = Reproduce(), Path(folder)
        trainings = (command.robot_gradient, command.robot_ppo)
        rehearsal = Rehearsal("infantry", (), *trainings, (options.seed,), 2, folders, options.workers)
        return record_and_identify(rehearsal).setting


def _tasks(options: Options) -> list[EvaluationTask]:
    command, tasks = Reproduce(), []
    for name, limit in PARTS:
        if name in options.setting and limit in options.limit:
            setting = load_setting(SettingFiles()) if name == PAPER else _infantry(options)
            usual = command.engagements if name == PAPER else command.robot_engagements
            tables = ("II", "III") if name == PAPER else TABLES
            tasks.append(EvaluationTask(setting, limit, options.engagements or usual, options.seed, tables=tables))
    return tasks


def _cell(ground: Ground, index: int, found: EngagementBounds) -> dict[str, Any]:
    """Mean bounds of a cell and their standard errors; the reach bound of all engagements is the control variate."""
    suite = ground.trials.suites[index]
    count, share = len(found.chosen), len(found.chosen) / len(found.reach)

    def error(values: Any) -> float:
        return float(np.std(values, ddof=1) / np.sqrt(count)) if count > 1 else 0.0

    reach, chosen = float(np.mean(found.reach)), found.reach[found.chosen]
    left_out = error(chosen - found.hindsight) * np.sqrt(max(1.0 - share, 0.0))
    luck = error(found.hindsight - found.combined)
    known = bool(np.isfinite(found.combined).all())
    return {
        "target": suite.target,
        "range_m": list(suite.range_m),
        "reach": reach,
        "hindsight": reach - float(np.mean(chosen - found.hindsight)),
        "hindsight_error": float(left_out),
        "information": float(np.mean(found.information)) if known else None,
        "information_error": error(found.information) if known else None,
        "information_achieved": float(np.mean(found.achieved)) if known else None,
        "combined": reach - float(np.mean(chosen - found.combined)) if known else None,
        "combined_error": float(np.hypot(left_out, luck)) if known else None,
        "chosen": count,
        "without_dual_bound": found.unsolved,
    }


def _part(
    task: EvaluationTask, options: Options, found: list[tuple[EngagementBounds, float]], machine: dict[str, Any]
) -> dict[str, Any]:
    ground = make_ground(task)
    return {
        "setting": ground.setting,
        "command_limit": task.command_limit,
        "seed": task.seed,
        "engagements": task.engagements,
        "stride": options.stride,
        "shots_on_one_trajectory": SHOTS[ground.setting, task.command_limit],
        "processor_s": round(sum(seconds for _, seconds in found), 1),
        "camera": camera_means(ground.world),
        "cells": [_cell(ground, index, each) for index, (each, _) in enumerate(found)],
        **machine,
    }


def _print(parts: list[dict[str, Any]]) -> None:
    for part in parts:
        title = (
            f"{part['setting']}, {part['command_limit']}: {part['engagements']} engagements a cell, seed {part['seed']}"
        )
        table = Table("cell", "reach", "hindsight", "information", "its aims hit", "combined", title=title)
        for cell in part["cells"]:
            low, high = cell["range_m"]
            figures = [
                f"{100 * cell['reach']:.2f}",
                f"{100 * cell['hindsight']:.2f} ± {100 * cell['hindsight_error']:.2f}",
            ]
            if cell["combined"] is not None:
                figures += [
                    f"{100 * cell['information']:.2f} ± {100 * cell['information_error']:.2f}",
                    f"{100 * cell['information_achieved']:.2f}",
                    f"{100 * cell['combined']:.2f} ± {100 * cell['combined_error']:.2f}",
                ]
            table.add_row(f"{cell['target']} {low:g}–{high:g} m", *figures)
        Console(width=110).print(table)


def _key(part: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(part[name] for name in ("setting", "command_limit", "seed", "engagements"))


def _publish(parts: list[dict[str, Any]]) -> None:
    names = [each.name for each in fields(PublishedCell)]
    write_published(
        [
            PublishedBounds(
                *_key(part),
                camera=part["camera"],
                cells=tuple(
                    PublishedCell(**{name: cell[name] for name in names} | {"range_m": tuple(cell["range_m"])})
                    for cell in part["cells"]
                ),
            )
            for part in parts
        ]
    )


def main() -> None:
    """Bound the cells that the options name."""
    options = tyro.cli(Options, description=__doc__)
    known = storage.read_json(RESULT)["parts"] if RESULT.exists() else []
    if options.publish:
        _publish(known)
        write_tables()
        return
    machine = describe_machine()  # before the long run, in which the code may change
    tasks = _tasks(options)
    if not tasks:
        sys.exit(f"nothing to bound; known are {', '.join(' '.join(each) for each in PARTS)}")
    jobs = [
        _Job(task, index, SHOTS[task.setting.name, task.command_limit], options.stride)
        for task in tasks
        for index in range(8)
    ]
    work = [float(-(-job.task.engagements // options.stride)) for job in jobs]
    found = run_tasks(
        "bounding", "engagements", [(_bound_cell, *each) for each in zip(jobs, work, strict=True)], options.workers
    )
    parts = [_part(task, options, found[8 * index : 8 * index + 8], machine) for index, task in enumerate(tasks)]
    _print(parts)
    merged = {_key(part): part for part in (*known, *parts)}
    storage.write_json(RESULT, {"time_limit_s": TIME_LIMIT_S, "parts": [merged[key] for key in sorted(merged)]})


if __name__ == "__main__":
    main()
