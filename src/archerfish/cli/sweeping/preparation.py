"""From the options of a sweep to a sweep that may begin: files read, and found now what no training could do."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archerfish.cli.setting import SettingFiles, configuration, load_setting, plant_code, setting_world
from archerfish.cli.sweeping.axes import Axis, Values, corners, grid, parse_vary, told
from archerfish.cli.sweeping.parameters import PARAMETERS, Base, load_records, make_task
from archerfish.cli.sweeping.proposals import Configuration, Proposer, proposed_grid, proposed_samples, require_optuna
from archerfish.cli.sweeping.ray_executor import require_ray
from archerfish.cli.sweeping.run import Plan
from archerfish.cli.sweeping.sweep_file import read_sweep_file
from archerfish.plugins import not_run, same_code_name
from archerfish.records import storage
from archerfish.records.errors import InputError

if TYPE_CHECKING:
    from archerfish.cli.sweep import Sweep

HOW_IT_RUNS = ("file", "workers", "address", "in_process", "resume", "out", "json")
"""Options that don't change what a sweep finds."""


@dataclass(frozen=True)
class Prepared:
    """A sweep that has been checked and may begin."""

    command: "Sweep"
    """Its options, those of the file among them."""
    plan: Plan
    """What every configuration goes through."""
    learning: tuple[Axis, ...]
    """What tells configurations apart."""
    proposer: Proposer
    """Who proposes them."""
    trials: int
    """Trials that come of it, at most."""
    told: dict[str, Any]
    """The options that say what is swept, as sweep.json holds them."""


def prepare(command: "Sweep") -> Prepared:
    """Read the files of a sweep and find now what no training could do.

    Raises:
      InputError: if an option or a file can't be used.
    """
    command = _with_file(command)
    _check(command)
    axes = parse_vary(command.vary)
    learning = tuple(axis for axis in axes if not PARAMETERS[axis.name].world)
    worlds = tuple(grid([axis for axis in axes if PARAMETERS[axis.name].world]))
    plan = _plan(command, axes, worlds)
    proposer, count = _proposer(command, learning, len(worlds) * len(command.seeds))
    _check_trainings(plan, corners(learning) if command.trials else grid(learning))
    settings = (plan.base.setting, *plan.settings.values())
    records = {str(path): storage.file_hash(path) for each in settings for path in each.inputs}
    told = {**configuration(command, plan.base.setting), "records": dict(sorted(records.items()))}
    kept = {name: each for name, each in told.items() if name not in HOW_IT_RUNS}
    return Prepared(command, plan, learning, proposer, count, kept)


def _with_file(command: "Sweep") -> "Sweep":
    if command.file is None:
        return command
    kind = type(command)
    untouched = kind()
    for each in fields(kind):
        if each.name not in (*HOW_IT_RUNS, "setting") and getattr(command, each.name) != getattr(untouched, each.name):
            raise _beside(each.name, command.file)
    said = read_sweep_file(command.file, kind)
    kept = {name: getattr(command, name) for name in HOW_IT_RUNS}
    return replace(said, setting=_with_code(command.file, said.setting, command.setting), **kept)


def _with_code(path: Path, said: SettingFiles, typed: SettingFiles) -> SettingFiles:
    """Return the files of a robot that a sweep file names, with the code that the command line names.

    Args:
      path: the sweep file.
      said: what it names.
      typed: what stands beside it.

    Raises:
      InputError: if the file names code that the command line does not, or the command line gives something else.
    """
    code = plant_code(typed)
    for name in (each for each, value in vars(typed).items() if value != getattr(SettingFiles(), each)):
        there = str(getattr(said, name) or "")
        if name not in code or (there and not same_code_name(there, code[name])):
            raise _beside(name, path)
    unnamed = {f"--{name}": spec for name, spec in plant_code(said).items() if name not in code}
    if unnamed:
        raise not_run(path, unnamed, {})
    return replace(said, **{name: getattr(typed, name) for name in code})


def _beside(name: str, path: Path) -> InputError:
    return InputError(f"--{name.replace('_', '-')} stands beside {path}; write it into the file")


def _check(command: "Sweep") -> None:
    for name, least, why in (
        ("engagements", 2, "; intervals need several"),
        ("trials", 0, ""),
        ("batch", 1, ""),
        ("workers", 0, ""),
    ):
        if getattr(command, name) < least:
            raise InputError(f"--{name} must be at least {least}, got {getattr(command, name)}{why}")
    if not command.seeds or len(set(command.seeds)) < len(command.seeds):
        raise InputError(f"--seeds must be at least one, none twice, got {' '.join(map(str, command.seeds)) or 'none'}")
    for seed in command.seeds:
        if seed not in range(2**32):
            raise InputError(f"--seeds must be within 0…{2**32 - 1}, got {seed}")
    if not command.in_process:
        require_ray()
    elif command.address:
        raise InputError("--in-process and --address don't go together; choose one")


def _plan(command: "Sweep", axes: tuple[Axis, ...], worlds: tuple[dict[str, Any], ...]) -> Plan:
    unusable = command.setting.accept_unusable
    base = Base(
        setting=load_setting(command.setting),
        **{each.name: getattr(command, each.name) for each in fields(Base) if each.name != "setting"},
    )
    folders = [
        str(value) for axis in axes if axis.name == "records" and isinstance(axis, Values) for value in axis.values
    ]
    settings = {folder: load_records(folder, unusable) for folder in folders}
    names = [each.name for each in settings.values()]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"--vary records: two folders hold a robot named {name}; rename one, the ranking tells by name"
            )
    return Plan(base, worlds, command.seeds, command.engagements, command.seed, settings)


def _proposer(command: "Sweep", learning: tuple[Axis, ...], cases: int) -> tuple[Proposer, int]:
    """Return who proposes, and the number of trials that come of it at most."""
    if not command.trials:
        return proposed_grid(learning), len(grid(learning)) * cases
    require_optuna()
    if not learning:
        raise InputError("--trials has nothing to choose from; --vary how to train, or leave --trials out")
    count = command.trials // cases
    if not count:
        raise InputError(
            f"--trials {command.trials} is not one configuration, which takes {cases}: its seeds and worlds"
        )
    return proposed_samples(learning, count, command.batch, command.sampler, command.seed), count * cases


def _check_trainings(plan: Plan, configurations: list[Configuration]) -> None:
    """Find now, not in the middle of a sweep, what no training can do."""
    for world in plan.worlds:
        for values in configurations:
            together = {**values, **world}
            try:
                task = make_task(plan.base, together, plan.seeds[0], plan.settings)
            except InputError as error:
                raise InputError(f"--vary: {told(together)} can't be trained: {error}") from error
        setting_world(task.setting, task.command_limit)
