"""`archerfish evaluate`: hit rates of policies and classical controllers on the cells of Tables II and III."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.hit_rate_table import print_hit_rates, print_where
from archerfish.cli.options import DrawnTarget, Folder, JsonFile, OwnMotionName
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.policy_check import check_policy
from archerfish.cli.progress import note, progress_bar, require_jax
from archerfish.cli.run_folder import run_folder
from archerfish.cli.setting import RobotOptions, Setting, SettingFiles, configuration, load_setting
from archerfish.cli.setting_remarks import policy_remarks, setting_remarks
from archerfish.controllers.roster import find_controller
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord, read_policy
from archerfish.records.provenance import code_commit, library_versions
from archerfish.virtual_robot.description_file import load_robot

if TYPE_CHECKING:
    from archerfish.cli.evaluation_run import EvaluationTask
    from archerfish.evaluation.evaluate import Outcome
    from archerfish.evaluation.results import Results


@dataclass(frozen=True)
class Evaluate:
    """Count the hits of policies and classical controllers.

    All of them fight the same engagements with the same dispersion draws: still and moving targets at 1–5 m, the cells
    of Tables II and III, or with --target other motions at the same ranges, for engagements of 1 s and of 3 s. Give the
    robot's files and the command limit that the policies were trained with.

    Writes results.json, report.html, figures and config.json, and prints hit rates with their 95 % intervals, which
    count engagements, not shots, as independent.

    Examples:
      archerfish evaluate runs/train/policy.json
      archerfish evaluate --controllers kalman parabola-lq oracle --command-limit box
      archerfish evaluate --controllers kalman-lq ./mine.py:TwoFrames --motion ./mine.py:Departure
      archerfish evaluate runs/train/policy.json --target any --controllers kalman-lq imm-lq
      archerfish evaluate policy.json --pitch pitch.json --yaw yaw.json --robot infantry
      archerfish evaluate policy.json --pitch pitch.json --yaw yaw.json --sensing sensing.json --robot me --on worn
    """

    policies: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="POLICY…", help_behavior_hint="")
    ] = ()
    """Policy records (policy.json), as train writes them; none evaluates the classical controllers alone."""
    controllers: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME…")] = ("kalman", "kalman-lq", "oracle")
    """Controllers beside them: kalman, kalman-tuned, kalman-lq, imm-lq, parabola-lq, no-lead, vertex, oracle, or your
    own, ./FILE.py:NAME or MODULE:NAME (docs/adding.md)."""
    target: Literal["paper"] | DrawnTarget = "paper"
    """Who is shot at: the paper's still and moving targets (paper), each motion of docs/targets.md (any), or one."""
    motion: OwnMotionName = ""
    """How the paper's moving targets move, in the place of eq (7): your own as ./FILE.py:NAME or MODULE:NAME."""
    setting: RobotOptions = field(default_factory=SettingFiles)
    """The robot."""
    on: Annotated[str, tyro.conf.arg(metavar="NAME|FILE", help_behavior_hint="(default: in the simulator)")] = ""
    """Shoot with this virtual robot (docs/virtual_robot.md), with --sensing for what its program knows of camera and
    link: of the paper's targets the cells of Tables IV and V."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked: angle ranges (box), also rate and acceleration (gate), or at most 2° ahead of the
    target."""
    engagements: int = 500
    """Engagements per cell, of 50 shots each; of 150 where they last 3 s."""
    out: Folder = Path("runs/evaluate")
    """Folder for the results."""
    seed: int = 0
    """Of engagements and dispersion; never that of a tuning."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        files = tuple(self.out / name for name in ("config.json", "results.json", "report.html"))
        return Outputs(files, (self.out / "figures",))


def run_evaluate(command: Evaluate) -> dict[str, Any]:
    """Evaluate, write the results, print a table, and return what --json writes.

    Raises:
      InputError: if a file can't be used, a controller is unknown, or a policy does not fit the setting.
    """
    _check(command)
    require_jax("evaluate")
    keep_compiled()
    from archerfish.cli.evaluation_run import (  # needs JAX
        EvaluationTask,
        is_stored,
        run_evaluations,
        try_own_code,
        untuned,
        with_tuning,
    )
    from archerfish.evaluation.report import write_report
    from archerfish.evaluation.results import write_results

    setting = load_setting(command.setting)
    period_s = setting.conditions.control_period_s
    policies = tuple(_policy(path, period_s, command.command_limit) for path in command.policies)
    _check_distinct(policies, command)
    _remark(command, setting, policies)
    task = EvaluationTask(
        setting,
        command.command_limit,
        command.engagements,
        command.seed,
        command.controllers,
        policies,
        motion=command.motion,
        target=command.target,
    )
    if command.on:
        task = replace(task, robot=command.on, tables=("IV", "V"))
    else:
        task = replace(task, controllers=("perfect", *command.controllers))
    tasks = _tasks(task, command.target)
    for each in tasks:
        try_own_code(each)
    with run_folder(command.out, make_writer(command)) as folder:
        begun = time.monotonic()
        if untuned(task) and not is_stored(task):
            with progress_bar("tuning", len(untuned(task)), "controllers") as advance:
                task = with_tuning(task, advance)
                tasks = tuple(replace(each, tuning=task.tuning) for each in tasks)
        entrants = len(command.controllers) + len(policies)
        with progress_bar("evaluating", len(tasks) * entrants, "controllers") as advance:
            outcomes = run_evaluations(tasks, advance)
        results = _results(tasks, outcomes, time.monotonic() - begun)
        storage.write_json(folder / "config.json", configuration(command, setting, _read(command)))
        write_results(folder / "results.json", results)
        write_report(results, folder / "report.html", command.out)
    print_hit_rates(results.cells)
    print_where(command.out, results.durations)
    return asdict(results)


def _tasks(task: "EvaluationTask", target: str) -> "tuple[EvaluationTask, ...]":
    """Return the evaluations of a command: one for each length of engagements, where targets are not the paper's."""
    from archerfish.evaluation.results import MOTION_TABLES

    return (task,) if target == "paper" else tuple(replace(task, seconds=each) for each in MOTION_TABLES)


def _remark(command: Evaluate, setting: Setting, policies: tuple[PolicyRecord, ...]) -> None:
    for remark in setting_remarks(command.setting, setting):
        note(remark)
    for path, policy in zip(command.policies, policies, strict=True):
        for remark in policy_remarks(path, policy, setting):
            note(remark)


def _check_distinct(policies: tuple[PolicyRecord, ...], command: Evaluate) -> None:
    """Results tell entrants apart by name and training seed."""
    from archerfish.cli.evaluation_run import policy_label  # needs JAX

    labels = [*(find_controller(each).name for each in command.controllers), *map(policy_label, policies)]
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        name = twice if isinstance(twice, str) else f"{twice[0]} policy of seed {twice[1]}"
        raise InputError(f"{name} is given twice; give each controller once, and policies of different training seeds")


def _check(command: Evaluate) -> None:
    for name in command.controllers:
        find_controller(name)
    if command.motion and command.target != "paper":
        raise InputError(
            f"--motion takes the place of eq (7), by which --target {command.target} does not move; leave one of the "
            "two out"
        )
    if command.engagements < 2:
        raise InputError(f"--engagements must be at least 2, got {command.engagements}; intervals need several")
    if command.on:
        load_robot(command.on)
        if command.setting.sensing is None:
            raise InputError("--on needs --sensing, as identify sensing writes it: what a program knows of the camera")


def _results(tasks: "Sequence[EvaluationTask]", outcomes: "Sequence[list[Outcome]]", seconds: float) -> "Results":
    from archerfish.cli.evaluation_run import make_ground, task_bounds
    from archerfish.evaluation.evaluate import accelerations, cells, comparisons, hardest
    from archerfish.evaluation.results import Results

    task, grounds = tasks[0], [make_ground(each) for each in tasks]
    found = list(zip(tasks, grounds, outcomes, strict=True))
    against = [find_controller(name).name for name in task.controllers if name != "perfect"]
    return Results(
        seed=task.seed,
        commit=code_commit(),
        versions=library_versions(),
        durations={"evaluation": round(seconds, 2)},
        conditions=asdict(task.setting.conditions),
        cells=tuple(cell for of, ground, done in found for cell in cells(ground, done, task_bounds(of, ground))),
        accelerations=hardest(each for _, ground, done in found for each in accelerations(ground, done)),
        comparisons=tuple(
            each for _, ground, done in found for name in against for each in comparisons(ground, done, name)
        ),
    )


def _read(command: Evaluate) -> list[Path]:
    """Return the files that the evaluation was made with, beside those of the setting."""
    from archerfish.targets.own_motion import find_motion  # needs JAX

    own = [find_controller(each).extension for each in command.controllers]
    own += [find_motion(command.motion).extension] if command.motion else []
    files = [each.file for each in own if each is not None and each.file is not None]
    return [*command.policies, *dict.fromkeys(files)]


def _policy(path: Path, period_s: float, command_limit: str) -> PolicyRecord:
    policy = read_policy(path)
    check_policy(path, policy, period_s, command_limit)
    return policy
