"""`archerfish evaluate`: hit rates of policies and classical controllers on the cells of Tables II and III."""

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import tyro

from archerfish.cli.progress import progress_bar, require_jax
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.controllers.roster import CONTROLLERS
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord, read_policy
from archerfish.records.provenance import code_commit, library_versions


@dataclass(frozen=True)
class Evaluate:
    """Let policies and classical controllers fight the same engagements, and count their hits.

    Writes results.json and report.html; prints hit rates with their 95 % intervals, clustered by engagement.
    """

    policies: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Policy records, as `train` writes them."""
    controllers: tuple[str, ...] = ("kalman", "kalman-lq", "oracle")
    """Classical controllers beside them: kalman, kalman-lq, parabola-lq, no-lead, vertex, oracle."""
    setting: SettingFiles = field(default_factory=SettingFiles)
    """The robot."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked."""
    engagements: int = 500
    """Engagements per cell, of 50 shots each."""
    out: Path = Path("runs/evaluate")
    """Folder for results.json and report.html."""
    seed: int = 0
    """Of engagements and dispersion; never that of a tuning."""
    json: Path | None = None
    """Also write what is printed to this file."""


def run_evaluate(command: Evaluate) -> dict[str, Any]:
    """Evaluate, write the results, print a table, and return what --json writes.

    Raises:
      InputError: if a file can't be used, a controller is unknown, or a policy does not fit the setting.
    """
    unknown = [name for name in command.controllers if name not in CONTROLLERS]
    if unknown:
        raise InputError(f"--controllers must be of {', '.join(CONTROLLERS)}, got {unknown[0]!r}")
    if command.engagements < 2:
        raise InputError(f"--engagements must be at least 2, got {command.engagements}; intervals need several")
    require_jax("evaluate")
    from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_evaluation  # noqa: PLC0415  needs JAX
    from archerfish.evaluation.evaluate import cells, comparisons  # noqa: PLC0415
    from archerfish.evaluation.report import write_report  # noqa: PLC0415
    from archerfish.evaluation.results import Results, write_results  # noqa: PLC0415

    setting = load_setting(command.setting)
    policies = tuple(_policy(path, setting.conditions.control_period_s) for path in command.policies)
    storage.check_writable(command.out)
    names = ("perfect", *command.controllers)
    task = EvaluationTask(setting, command.command_limit, command.engagements, command.seed, names, policies)
    begun = time.monotonic()
    with progress_bar("evaluating", len(command.controllers) + len(policies), "controllers") as advance:
        outcomes = run_evaluation(task, advance)
    ground = make_ground(task)
    results = Results(
        seed=command.seed,
        commit=code_commit(),
        versions=library_versions(),
        durations={"evaluation": round(time.monotonic() - begun, 2)},
        conditions=asdict(setting.conditions),
        cells=tuple(cells(ground, outcomes)),
        comparisons=tuple(each for name in command.controllers for each in comparisons(ground, outcomes, name)),
    )
    write_results(command.out / "results.json", results)
    write_report(results, command.out / "report.html")
    print_cells(results.cells)
    return asdict(results)


def _policy(path: Path, period_s: float) -> PolicyRecord:
    policy = read_policy(path)
    if abs(policy.period_s - period_s) > 1e-9:
        raise InputError(
            f"{path}: trained for decisions every {policy.period_s} s, the setting has {period_s} s; train it anew"
        )
    return policy


def print_cells(cells: Any) -> None:
    """Print hit rates, a column per controller and a row per cell."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    entrants = list(dict.fromkeys((cell.controller, cell.policy_seed) for cell in cells))
    rows = dict.fromkeys((cell.command_limit, cell.target, tuple(cell.range_m)) for cell in cells)
    found = {
        (cell.command_limit, cell.target, tuple(cell.range_m), cell.controller, cell.policy_seed): cell
        for cell in cells
    }
    table = Table(title="hit rate in % with the 95 % interval")
    for heading in ("limit", "target", "range"):
        table.add_column(heading)
    for name, seed in entrants:
        table.add_column(name if seed is None else f"{name} (seed {seed})", justify="right")
    for limit, target, (low, high) in rows:
        cells_of_row = [found.get((limit, target, (low, high), *entrant)) for entrant in entrants]
        table.add_row(limit, target, f"{low:g}–{high:g} m", *(_rate(cell) for cell in cells_of_row))
    Console().print(table)


def _rate(cell: Any) -> str:
    if cell is None:
        return ""
    return f"{100 * cell.hits / cell.shots:.1f} [{100 * cell.low:.1f}, {100 * cell.high:.1f}]"
