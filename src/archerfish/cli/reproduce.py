"""`archerfish reproduce`: the whole paper, from logs to hit rates, and a page that lays it beside ours."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.hit_rate_table import print_hit_rates, print_where
from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.progress import require_jax
from archerfish.cli.run_folder import run_folder
from archerfish.cli.setting import Setting, SettingFiles, configuration, load_setting
from archerfish.cli.transfer import ROBOT_DISCOUNT, ROBOT_STEPS, others
from archerfish.learning.config import PpoConfig
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.provenance import code_commit, library_versions

CHANGED = ("worn",)
"""Robots that shoot with the policies of another one too."""


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper in simulation, then with a robot: identify, train, shoot.

    Logs sweeps and steps of the printed gimbal, identifies it from them (Fig. 4), trains policies (Figs 5 and 6),
    shoots Tables II and III under three command limits beside classical controllers, and fits Table I. Then the virtual
    robot is recorded, identified from its logs, and shoots Tables IV and V with policies trained in the simulator made
    from them, as archerfish transfer does.

    Writes report.html (start there), results.json (every figure of it), policies, plants, logs, figures and
    config.json.

    Examples:
      archerfish reproduce
      archerfish reproduce --quick --out runs/quick
      archerfish reproduce --seed 1 --workers 2 --json results.json
    """

    out: Folder = Path("runs/reproduce")
    """Folder for everything that it makes."""
    seed: int = 0
    """Of everything random; evaluations use streams of their own."""
    quick: bool = False
    """A minute instead of several: short trainings, few engagements; its figures are not to be quoted."""
    engagements: int = 500
    """Engagements per cell, of 50 shots each."""
    curve_seeds: int = 3
    """Trainings per curve of Figs 5 and 6."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Settings of PPO."""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "infantry"
    """Robot of Tables IV and V: infantry, worn, or a TOML file (docs/virtual_robot.md)."""
    robot_ppo: PpoConfig = field(default_factory=lambda: PpoConfig(steps=ROBOT_STEPS, discount=ROBOT_DISCOUNT))
    """Settings of PPO for the robot's policies."""
    robot_engagements: int = 250
    """Engagements per cell of Tables IV and V; archerfish transfer takes 400."""
    workers: Annotated[int, tyro.conf.arg(help_behavior_hint="(default: one per core, at most 4)")] = 0
    """Processes to use."""
    json: JsonFile = None
    """Also write what is printed to this file."""


QUICK_STEPS = 200_000
QUICK_ENGAGEMENTS = 40
QUICK_ROBOT_ENGAGEMENTS = 10
"""The virtual robot takes a thousand ticks where the simulator takes fifty steps."""


def run_reproduce(command: Reproduce) -> dict[str, Any]:
    """Run the whole pipeline, print the hit rates, and return what --json writes.

    Raises:
      InputError: if an option or the output folder can't be used.
    """
    require_jax("reproduce")
    keep_compiled()
    if command.quick:
        command = _shortened(command)
    _check(command)
    from archerfish.evaluation.report import write_report
    from archerfish.evaluation.results import Results, write_results

    setting = load_setting(SettingFiles())
    durations: dict[str, float] = {}
    with run_folder(command.out) as folder:
        parts = _run_stages(command, setting, folder, durations)
        with _timed(durations, "robot"):
            parts = _joined(parts, _rehearsed(command, folder))
        results = Results(
            seed=command.seed,
            commit=code_commit(),
            versions=library_versions(),
            durations=durations,
            quick=command.quick,
            conditions=asdict(setting.conditions),
            **parts,
        )
        storage.write_json(folder / "config.json", configuration(command, setting))
        write_results(folder / "results.json", results)
    write_report(results, command.out / "report.html")
    print_hit_rates(results.cells)
    print_where(command.out, durations)
    return asdict(results)


def _shortened(command: Reproduce) -> Reproduce:
    return replace(
        command,
        engagements=min(QUICK_ENGAGEMENTS, command.engagements),
        curve_seeds=1,
        ppo=replace(command.ppo, steps=min(QUICK_STEPS, command.ppo.steps)),
        robot_ppo=replace(command.robot_ppo, steps=min(QUICK_STEPS, command.robot_ppo.steps)),
        robot_engagements=min(QUICK_ROBOT_ENGAGEMENTS, command.robot_engagements),
    )


def _check(command: Reproduce) -> None:
    others(command.robot, CHANGED)
    for name, smallest in (("engagements", 2), ("robot_engagements", 2), ("curve_seeds", 1), ("workers", 0)):
        if getattr(command, name) < smallest:
            raise InputError(f"--{name.replace('_', '-')} must be at least {smallest}, got {getattr(command, name)}")


def _run_stages(command: Reproduce, setting: Setting, folder: Path, durations: dict[str, float]) -> dict[str, Any]:
    from archerfish.cli.hit_rate_stage import evaluate_all, train_all
    from archerfish.cli.identification_stage import identify_all
    from archerfish.evaluation.paper_results import PaperFigures
    from archerfish.paper.conditions import calibration

    workers = command.workers or min(os.cpu_count() or 1, 4)
    with _timed(durations, "identification"):
        plants = {"pitch": setting.pitch, "yaw": setting.yaw}
        identified = identify_all(plants, folder, command.seed, workers)
    with _timed(durations, "training"):
        trained = train_all(setting, command.ppo, command.seed, command.curve_seeds, folder, workers)
    with _timed(durations, "evaluation"):
        shot = evaluate_all(setting, trained.policies, command.engagements, command.seed, workers, quick=command.quick)
    return {
        "identification": identified.facts,
        "table1": identified.table1,
        "figures": PaperFigures(fig4=identified.responses, fig5=trained.static_curves, fig6=trained.dynamic_curves),
        **shot,
        "calibration": calibration(),
    }


def _rehearsed(command: Reproduce, folder: Path) -> dict[str, Any]:
    """Take the robot from logs to Tables IV and V."""
    from archerfish.cli.transfer_stage import Rehearsal, rehearse

    rehearsal = Rehearsal(
        robot=command.robot,
        changed=others(command.robot, CHANGED),
        ppo=command.robot_ppo,
        seeds=(command.seed,),
        engagements=command.robot_engagements,
        folder=folder / "robot",
        workers=command.workers or min(os.cpu_count() or 1, 4),
    )
    return rehearse(rehearsal)[1]


def _joined(simulated: dict[str, Any], rehearsed: dict[str, Any]) -> dict[str, Any]:
    """Join the parts of the results; those that both have are sequences."""
    both = {name: (*simulated[name], *rehearsed[name]) for name in simulated.keys() & rehearsed.keys()}
    return {**simulated, **rehearsed, **both}


@contextmanager
def _timed(durations: dict[str, float], stage: str) -> Iterator[None]:
    begun = time.monotonic()
    yield
    durations[stage] = round(time.monotonic() - begun, 2)
