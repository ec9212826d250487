"""`archerfish reproduce`: the whole paper, from logs to hit rates, and a page that lays it beside ours."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from archerfish.cli.progress import require_jax
from archerfish.cli.setting import Setting, SettingFiles, load_setting
from archerfish.learning.config import PpoConfig
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.provenance import code_commit, library_versions


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper: identify, train, evaluate, report.

    Logs sweeps and steps of the printed gimbal, identifies it from them (Fig. 4), trains policies (Figs 5 and 6),
    shoots Tables II and III under three command limits beside classical controllers, fits Table I, and writes
    report.html and results.json.
    """

    out: Path = Path("runs/reproduce")
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
    workers: int = 0
    """Processes to use. [one per core, at most 4]"""
    json: Path | None = None
    """Also write what is printed to this file."""


QUICK_STEPS = 200_000
QUICK_ENGAGEMENTS = 40


def run_reproduce(command: Reproduce) -> dict[str, Any]:
    """Run the whole pipeline, print the hit rates, and return what --json writes.

    Raises:
      InputError: if an option or the output folder can't be used.
    """
    require_jax("reproduce")
    if command.quick:
        command = _shortened(command)
    _check(command)
    from archerfish.cli.evaluate import print_cells  # noqa: PLC0415
    from archerfish.evaluation.report import write_report  # noqa: PLC0415
    from archerfish.evaluation.results import Results, write_results  # noqa: PLC0415

    setting = load_setting(SettingFiles())
    durations: dict[str, float] = {}
    parts = _run_stages(command, setting, durations)
    results = Results(
        seed=command.seed,
        commit=code_commit(),
        versions=library_versions(),
        durations=durations,
        quick=command.quick,
        conditions=asdict(setting.conditions),
        **parts,
    )
    write_results(command.out / "results.json", results)
    write_report(results, command.out / "report.html")
    print_cells(results.cells)
    _print_where(command.out, durations)
    return asdict(results)


def _shortened(command: Reproduce) -> Reproduce:
    ppo = PpoConfig(**{**asdict(command.ppo), "steps": min(QUICK_STEPS, command.ppo.steps)})
    changes = {"engagements": min(QUICK_ENGAGEMENTS, command.engagements), "curve_seeds": 1, "ppo": ppo}
    return Reproduce(**{**vars(command), **changes})


def _check(command: Reproduce) -> None:
    for name, smallest in (("engagements", 2), ("curve_seeds", 1), ("workers", 0)):
        if getattr(command, name) < smallest:
            raise InputError(f"--{name.replace('_', '-')} must be at least {smallest}, got {getattr(command, name)}")
    storage.check_writable(command.out)


def _run_stages(command: Reproduce, setting: Setting, durations: dict[str, float]) -> dict[str, Any]:
    from archerfish.cli.hit_rate_stage import evaluate_all, train_all  # noqa: PLC0415
    from archerfish.cli.identification_stage import identify_printed, landing_of_table1  # noqa: PLC0415
    from archerfish.evaluation.results import PaperFigures  # noqa: PLC0415
    from archerfish.paper.conditions import calibration  # noqa: PLC0415

    workers = command.workers or min(os.cpu_count() or 1, 4)
    with _timed(durations, "identification"):
        plants = {"pitch": setting.pitch, "yaw": setting.yaw}
        identification, responses = identify_printed(plants, command.out, command.seed)
        table1 = landing_of_table1()
    with _timed(durations, "training"):
        trained = train_all(setting, command.ppo, command.seed, command.curve_seeds, command.out, workers)
    with _timed(durations, "evaluation"):
        cells, comparisons = evaluate_all(setting, trained.policies, command.engagements, command.seed, workers)
    return {
        "identification": identification,
        "table1": table1,
        "figures": PaperFigures(fig4=responses, fig5=trained.static_curves, fig6=trained.dynamic_curves),
        "cells": tuple(cells),
        "comparisons": tuple(comparisons),
        "calibration": calibration(),
    }


@contextmanager
def _timed(durations: dict[str, float], stage: str) -> Iterator[None]:
    begun = time.monotonic()
    yield
    durations[stage] = round(time.monotonic() - begun, 2)


def _print_where(out: Path, durations: dict[str, float]) -> None:
    from rich.console import Console  # noqa: PLC0415

    took = ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in durations.items())
    Console().print(f"{took}\nopen {out / 'report.html'}; every figure is in {out / 'results.json'}")
