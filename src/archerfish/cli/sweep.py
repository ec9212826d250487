"""`archerfish sweep`: many trainings side by side, by seeds, settings and worlds, and which is best."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.options import Folder, JsonFile, Observation, PaperTarget
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.progress import progress_bar, require_jax
from archerfish.cli.run_folder import run_folder
from archerfish.cli.setting import RobotOptions, SettingFiles
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records import storage

if TYPE_CHECKING:
    from archerfish.cli.sweeping.axes import Axis
    from archerfish.cli.sweeping.executor import Executor
    from archerfish.cli.sweeping.folder import SweepFolder
    from archerfish.cli.writer import Writer

TABLES = ("results.csv", "summary.json", "sweep.svg")
"""What is made of the trials, each time that a sweep ends."""


@dataclass(frozen=True)
class Sweep:
    """Train many policies side by side, and rank them.

    A trial is one training with one seed, scored by its hit rate on the tuning's own engagements, never those of an
    evaluation. A configuration is one combination of what --vary names; every configuration is trained with every seed
    in every world. Trials run on Ray, one processor each: on this machine, or on a cluster (--address). A trial whose
    worker or machine is lost is run again; after the sweep itself was ended, --resume goes on with it.

    --vary NAME=A,B tries values, all combinations of them. With --trials N, Optuna chooses what to try instead, from
    lists and from ranges: NAME=LOW..HIGH, or NAME=LOW..HIGH:log for even steps of the logarithm.

    Names for how to train: ppo.actor-learning-rate and all else under ppo and gradient (below), trainer, target,
    observation, frames.

    Names for the world, which take lists only and are ranked apart: command-limit; records, each value a folder with
    pitch.json and yaw.json, and if there muzzle.json, sensing.json and limits.json, or the word paper;
    motion.max-lateral-speed (m/s), motion.max-lateral-offset and motion.armor-height (m), motion.parabola-curvature
    (1/m) and motion.parabola-rise (m).

    Writes results.csv (a row per trial), summary.json (the ranking), sweep.svg, results.jsonl (all that is known of
    each trial, as it finishes), sweep.json (the options), and trials/0000 and so on, run folders as train writes them.

    Examples:
      archerfish sweep --seeds 0 1 2 3
      archerfish sweep --vary ppo.discount=0.9,0.95 target=paper,dynamic --seeds 0 1 --out runs/discounts
      archerfish sweep --vary ppo.actor-learning-rate=3e-4..3e-3:log ppo.clip=0.1..0.3 --trials 20 --ppo.steps 500000
      archerfish sweep --vary trainer=ppo,gradient --seeds 0 1 2 3 4
      archerfish sweep --vary records=paper,runs/infantry command-limit=gate,box --seeds 0 1 2
      archerfish sweep my_sweep.toml --address 10.0.0.5:6379 --resume
    """

    file: Annotated[
        tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: none)")
    ] = None
    """TOML file with the options that say what is swept (docs/sweep.md); beside it only those that say how, and --plant
    for code of your own, which is not run if only a file names it."""
    seeds: Annotated[tuple[int, ...], tyro.conf.arg(metavar="SEED…")] = (0,)
    """Seeds that every configuration is trained with."""
    vary: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUES…", help_behavior_hint="")] = ()
    """What is varied, as said above."""
    trials: Annotated[int, tyro.conf.arg(help_behavior_hint="(default: the whole grid)")] = 0
    """Trials that Optuna may spend; rounded down to whole configurations, each with all seeds in all worlds."""
    batch: int = 4
    """Configurations that Optuna proposes at a time. It hears of them together and in order, whichever finished first;
    fewer learn faster, more keep more workers busy."""
    sampler: Literal["tpe", "random"] = "tpe"
    """How Optuna chooses: from what hit well so far, or blindly."""
    setting: RobotOptions = field(default_factory=SettingFiles)
    """The robot."""
    target: PaperTarget = "paper"
    """Who is shot at in training: targets of the paper's kind, of which half stand still (paper), all do (static), or
    none does (dynamic)."""
    observation: Annotated[
        Observation | None,
        tyro.conf.arg(help_behavior_hint="(default: tracked with --sensing, else history)"),
    ] = None
    """What the policy sees, as in train."""
    frames: int = 4
    """Frames that the history observation remembers."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked, as in train."""
    trainer: Literal["ppo", "gradient"] = "ppo"
    """How, as in train."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Settings of PPO."""
    gradient: GradientConfig = field(default_factory=GradientConfig)
    """Settings of training by gradients."""
    engagements: int = 64
    """Engagements per cell that score a trial, of 50 shots each; there are eight cells."""
    workers: Annotated[int, tyro.conf.arg(help_behavior_hint="(default: one per core)")] = 0
    """Trials side by side on this machine."""
    address: Annotated[str, tyro.conf.arg(metavar="HOST:PORT", help_behavior_hint="(default: a Ray of its own)")] = ""
    """Ray cluster to join; auto for the one on this machine. Every node needs this version of Archerfish, no files."""
    in_process: bool = False
    """One trial after the other in this process, without Ray."""
    resume: bool = False
    """Go on with the sweep in the folder: what is finished stays. --trials may be raised."""
    out: Folder = Path("runs/sweep")
    """Folder for everything that it makes."""
    seed: int = 0
    """Of Optuna's sampler, and of the engagements that score."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write the summary to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        files, trials = tuple(self.out / name for name in (*TABLES, "sweep.json")), self.out / "trials"
        kept = (self.out / "results.jsonl", self.out / ".lock")
        # A sweep that is resumed writes only the folders of trials that are not done: it looks at them one by one.
        return Outputs(files, kept=(*kept, trials)) if self.resume else Outputs(files, (trials,), kept=kept)


def run_sweep(command: Sweep) -> dict[str, Any]:
    """Run what is not done yet, write the tables, print the ranking, and return what --json writes.

    Raises:
      InputError: if an option or a file can't be used, or a trial can't be run anywhere.
    """
    require_jax("sweep")
    keep_compiled()
    from archerfish.cli.sweeping.folder import sweep_folder
    from archerfish.cli.sweeping.preparation import prepare
    from archerfish.cli.sweeping.run import run_rounds

    prepared = prepare(command)
    writer = make_writer(command)
    with sweep_folder(command.out, prepared.told, command.resume, writer) as folder:
        with progress_bar("sweep", prepared.trials, "trials") as advance, _executor(command) as executor:
            total = run_rounds(prepared.plan, prepared.proposer, folder, executor, advance)
            advance(prepared.trials, "")
        return write_sweep(folder, total, prepared.learning, writer)


@contextmanager
def _executor(command: Sweep) -> "Iterator[Executor]":
    if command.in_process:
        from archerfish.cli.sweeping.executor import in_process

        yield in_process
        return
    from archerfish.cli.sweeping.ray_executor import ray_executor

    with ray_executor(command.workers or _cores(), command.address) as executor:
        yield executor


def _cores() -> int:
    """Return the processors that this process may use, where the system says which."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def write_sweep(folder: "SweepFolder", total: int, learning: "tuple[Axis, ...]", writer: "Writer") -> dict[str, Any]:
    """Write results.csv, summary.json and the picture, print the ranking, and return the summary.

    Args:
      folder: with all trials.
      total: number of trials of the sweep.
      learning: what tells configurations apart.
      writer: whose files they are, and what they may not replace.
    """
    from archerfish.cli.sweeping.axes import Values
    from archerfish.cli.sweeping.ranking import rank
    from archerfish.cli.sweeping.results import results_table
    from archerfish.cli.sweeping.tables import draw_sweep, print_standings, summarise
    from archerfish.figures.style import save_figure

    varied = [axis.name for axis in learning if not (isinstance(axis, Values) and len(axis.values) == 1)]
    # A folder may hold more than was asked for: a sweep may be taken up with fewer trials than it was begun with.
    results = [folder.results[number] for number in sorted(folder.results) if number < total]
    standings = rank(results)
    summary = summarise(standings, results, str(folder.path))
    figure = draw_sweep(standings, results, varied)
    with run_folder(folder.path, writer) as unfinished:
        storage.write_text(unfinished / "results.csv", results_table(results))
        storage.write_json(unfinished / "summary.json", summary)
        if figure is not None:
            save_figure(unfinished / "sweep.svg", figure)
    print_standings(standings, varied)
    _print_end(folder.path, summary)
    return summary


def _print_end(out: Path, summary: dict[str, Any]) -> None:
    from rich.console import Console

    console = Console()
    failed = f", {summary['failed']} came to nothing (why: results.csv)" if summary["failed"] else ""
    lines = [f"\n{summary['trials']} trials{failed}; every one is in {out / 'results.csv'}"]
    lines += [f"best in {world}: {out / best['policy']}" for world, best in summary["best"].items()]
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
