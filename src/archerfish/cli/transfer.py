"""`archerfish transfer`: from a robot's logs to a policy on the robot, and what the step from the simulator costs."""

import os
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.hit_rate_table import print_hit_rates, print_where
from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.progress import require_jax
from archerfish.cli.run_folder import run_folder
from archerfish.cli.setting import configuration
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.virtual_robot.description_file import load_robot

ROBOT_STEPS = 8_000_000
"""Decisions that a policy for a robot trains for."""
SIX_NUMBERS_STEPS = 1_200_000
"""Decisions after which the six-number policy, which sees no speed, has learned what it can."""
ROBOT_DISCOUNT = 0.9
"""γ of the robot's six-number policy: a shot is decided within a few tenths of a second."""
QUICK_STEPS, QUICK_ENGAGEMENTS = 300_000, 20


@dataclass(frozen=True)
class Transfer:
    """Take a virtual robot from logs to a policy that shoots with it.

    Records sweeps, steps and shots of the robot, identifies gimbal, camera, link and muzzle from the logs alone, trains
    policies in the simulator made from them, and shoots Tables IV and V there and with the robot, beside classical
    controllers tuned in the same simulator. Nothing after the recording reads the robot's description.

    Writes report.html (start there), results.json, the logs with the robot's description as it was then, the records,
    the policies and config.json.

    Examples:
      archerfish transfer
      archerfish transfer --robot my_robot.toml --changed --out runs/my-robot
      archerfish transfer --seeds 0 1 2 --engagements 400
    """

    robot: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "infantry"
    """Robot: infantry, worn, or a TOML file (docs/virtual_robot.md)."""
    changed: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME|FILE…")] = ("worn",)
    """Robots that the same policies shoot with too, after a burst at a plate to correct speed and boresight by; none
    after a bare --changed."""
    engagements: int = 400
    """Engagements per cell, of 50 shots each."""
    seeds: tuple[int, ...] = (0,)
    """Of the trainings; the first one also that of the noise and of the engagements."""
    gradient: GradientConfig = field(default_factory=lambda: GradientConfig(steps=ROBOT_STEPS))
    """Settings of training by gradients, for the policies."""
    ppo: PpoConfig = field(default_factory=lambda: PpoConfig(steps=SIX_NUMBERS_STEPS, discount=ROBOT_DISCOUNT))
    """Settings of PPO, for the six-number policy."""
    quick: bool = False
    """A minute or two: short trainings, few engagements; its figures are not to be quoted."""
    workers: Annotated[int, tyro.conf.arg(help_behavior_hint="(default: one per core, at most 4)")] = 0
    """Processes to use."""
    out: Folder = Path("runs/transfer")
    """Folder for everything that it makes."""
    seed: int = 0
    """Added to every one of --seeds."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        files = tuple(self.out / name for name in ("config.json", "results.json", "report.html"))
        return Outputs(files, tuple(self.out / name for name in ("figures", "logs", "records", "policies")))


def run_transfer(command: Transfer) -> dict[str, Any]:
    """Rehearse, write the results and the report, print the hit rates, and return what --json writes.

    Raises:
      InputError: if an option, a robot's file or the output folder can't be used.
    """
    _check(command)
    require_jax("transfer")
    keep_compiled()
    from archerfish.cli.transfer_stage import Rehearsal, rehearse
    from archerfish.evaluation.report import write_report
    from archerfish.evaluation.results import new_results, write_results

    if command.quick:
        command = shortened(command)
    begun = time.monotonic()
    with run_folder(command.out, make_writer(command)) as folder:
        rehearsal = Rehearsal(
            robot=command.robot,
            changed=others(command.robot, command.changed),
            gradient=command.gradient,
            ppo=command.ppo,
            seeds=tuple(command.seed + each for each in command.seeds),
            engagements=command.engagements,
            folder=folder,
            workers=command.workers or min(os.cpu_count() or 1, 4),
        )
        identified, parts = rehearse(rehearsal)
        results = new_results(
            seed=rehearsal.seeds[0],
            conditions=identified.setting.conditions,
            quick=command.quick,
            durations={"transfer": round(time.monotonic() - begun, 2)},
            **parts,
        )
        storage.write_json(folder / "config.json", configuration(command, identified.setting))
        write_results(folder / "results.json", results)
        write_report(results, folder / "report.html", command.out)
    print_hit_rates(results.cells)
    print_where(command.out, results.durations)
    return asdict(results)


def shortened(command: Transfer) -> Transfer:
    """Return what a quick run does, so that its config.json tells no more than was done.

    Args:
      command: as given.
    """
    return replace(
        command,
        gradient=replace(command.gradient, steps=min(QUICK_STEPS, command.gradient.steps)),
        ppo=replace(command.ppo, steps=min(QUICK_STEPS, command.ppo.steps)),
        engagements=min(QUICK_ENGAGEMENTS, command.engagements),
    )


def others(robot: str, changed: tuple[str, ...]) -> tuple[str, ...]:
    """Return the changed robots less the robot itself, which has not changed.

    Args:
      robot: name or file.
      changed: names or files.

    Raises:
      InputError: if a file can't be used, or two robots have one name, by which results tell them apart.
    """
    known = {load_robot(robot)}
    found = []
    for each in changed:
        description = load_robot(each)
        if description in known:
            continue
        if description.schema.name in {other.schema.name for other in known}:
            raise InputError(f"{each}: another robot is called {description.schema.name} too; give it another name")
        known.add(description)
        found.append(each)
    return tuple(found)


def _check(command: Transfer) -> None:
    others(command.robot, command.changed)
    if command.engagements < 2:
        raise InputError(f"--engagements must be at least 2, got {command.engagements}")
    if not command.seeds or len(set(command.seeds)) < len(command.seeds) or min(command.seeds) < 0:
        raise InputError(f"--seeds must be one or more different numbers ≥ 0, got {list(command.seeds)}")
    if command.workers < 0:
        raise InputError(f"--workers must be at least 0, got {command.workers}")
