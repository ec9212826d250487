"""The promises on hit rates, held against the results of a run.

    python benchmarks/hit_rates.py [runs/reproduce/results.json]

Runs `archerfish reproduce` first where there is no such file. Prints one line per promise and writes
benchmarks/results/hit_rates.json; the exit status is 1 if one does not hold.
"""

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from archerfish.evaluation.comparison import cells_of, comparisons_of, rmse_to_paper
from archerfish.evaluation.results import Cell, Results, read_results
from archerfish.records import storage
from archerfish.records.provenance import code_commit
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "hit_rates.json"
DEFAULT = Path(__file__).parents[1] / "runs" / "reproduce" / "results.json"

ORACLE = (98.3, 99.3, 99.2, 97.4, 98.3, 99.3, 99.2, 97.4)
KALMAN_LQ = (98.0, 99.0, 99.0, 96.0, 97.5, 95.0, 90.0, 82.0)
HISTORY_SHARE = (98.0, 98.0, 97.0, 97.0, 98.0, 97.0, 96.0, 95.0)
PAPER_SHARE = (97.0, 97.0, 96.0, 95.0, 96.0, 91.0, 77.0, 61.0)
"""By cell: Table II at 1–2, 2–3, 3–4, 4–5 m, then Table III; percent, or percent of the oracle."""


class Promise(NamedTuple):
    """One promise and what was measured."""

    text: str
    holds: bool
    measured: str


def _rates(results: Results, controller: str, limit: str) -> list[float]:
    cells = cells_of(results.cells, command_limit=limit, controller=controller)
    return [100 * cells[key].rate for key in sorted(cells)]


def _cells(results: Results, controller: str, limit: str) -> list[Cell]:
    cells = cells_of(results.cells, command_limit=limit, controller=controller)
    return [cells[key] for key in sorted(cells)]


def _at_least(text: str, values: list[float], bars: tuple[float, ...] | list[float]) -> Promise:
    holds = len(values) == len(bars) and all(value >= bar for value, bar in zip(values, bars, strict=True))
    return Promise(text, holds, " ".join(f"{value:.1f}" for value in values))


def _share(results: Results, controller: str, limit: str) -> list[float]:
    ours, oracle = (_rates(results, name, limit) for name in (controller, "oracle"))
    return [100 * each / best for each, best in zip(ours, oracle, strict=True)]


def _differences(results: Results, against: str, limit: str) -> list[tuple[float, float]]:
    pairs = comparisons_of(results.comparisons, against=against, command_limit=limit, controller="history")
    return [(100 * pairs[key].difference, 100 * pairs[key].low) for key in sorted(pairs)]


def _above_kalman(results: Results, limit: str) -> Promise:
    differences = _differences(results, "kalman", limit)
    lows = [low for _, low in differences]
    return _at_least(f"{limit}: history above kalman, lower bound of the paired interval > 0", lows, [1e-9] * 8)


def _of_bound(results: Results, controller: str, limit: str) -> list[float]:
    return [100 * cell.rate / cell.bound for cell in _cells(results, controller, limit) if cell.bound]


def _above_bound(results: Results) -> list[float]:
    """By how many standard errors of the difference each rate lies above its bound."""
    bounded = [cell for cell in results.cells if cell.bound is not None]
    return [
        (cell.rate - (cell.bound or 0.0)) / math.hypot(cell.bound_error or 0.0, (cell.high - cell.low) / (2 * 1.97))
        for cell in bounded
    ]


def promises(results: Results) -> Iterator[Promise]:
    """Every promise on hit rates."""
    yield _at_least("box: oracle", _rates(results, "oracle", "box"), ORACLE)
    yield _at_least("box: kalman-lq", _rates(results, "kalman-lq", "box"), KALMAN_LQ)
    history = _cells(results, "history", "box")
    yield _at_least("box: history at or above the paper's PPO", _rates(results, "history", "box"),
                    [cell.paper or 101.0 for cell in history])  # fmt: skip
    yield _at_least("box: history, % of the oracle", _share(results, "history", "box"), HISTORY_SHARE)
    yield _above_kalman(results, "box")
    lq = [difference for difference, _ in _differences(results, "kalman-lq", "box")]
    yield _at_least("box: history less kalman-lq, never below −2 points", lq, [-2.0] * 8)
    above = [low for _, low in _differences(results, "kalman-lq", "box")][5:]
    yield _at_least("box: history above kalman-lq, dynamic 2–5 m, lower bound > 0", above, [1e-9] * 3)
    shots = min(cell.shots for cell in results.cells if cell.setting == "paper")
    yield Promise("every cell of the paper's setting: shots ≥ 25,000", shots >= 25_000, f"{shots}")
    yield _at_least("gate: history, % of the oracle", _share(results, "history", "gate"), [97.0] * 8)
    yield _above_kalman(results, "gate")
    yield _at_least("gate: oracle, % of the hindsight bound", _of_bound(results, "oracle", "gate"), [99.0] * 8)
    most = max(_above_bound(results))
    yield Promise("every rate at most 3 standard errors above its bound", most <= 3.0, f"{most:.2f}")
    asked = max(
        each.yaw_rad_s2 for each in results.accelerations if (each.setting, each.command_limit) == ("paper", "gate")
    )
    yield Promise("gate: asked of the yaw axis ≤ 67 rad/s², by any controller", asked <= 67.0, f"{asked:.4f}")
    rmse = rmse_to_paper(_cells(results, "history", "los-2deg"))
    yield Promise("los-2deg: history to the paper's PPO, RMSE ≤ 3.5 points", (rmse or 99) <= 3.5, f"{rmse:.2f}")
    yield _at_least("box: six numbers, % of the oracle", _share(results, "paper", "box"), PAPER_SHARE)
    calibration = results.calibration
    found = 99.0 if calibration is None else calibration.rmse_points
    yield Promise("calibration: Kalman to the paper's, RMSE ≤ 3.0 points", found <= 3.0, f"{found:.2f}")
    fits = [facts["step_fit_percent"] for facts in results.identification.values()]
    yield _at_least("Fig. 4: fit on the step ≥ 99 %", fits, [99.0] * 2)


def main() -> None:
    """Check a run."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT
    if not path.exists():
        subprocess.run([Path(sys.executable).with_name("archerfish"), "reproduce", "--out", path.parent], check=True)
    results = read_results(path)
    if results.quick:
        sys.exit(f"{path} is of a quick run; run `archerfish reproduce` without --quick")
    if results.commit != code_commit():
        sys.exit(f"{path} is of commit {results.commit}, the code is {code_commit()}; run `archerfish reproduce` anew")
    checked = list(promises(results))
    table = Table("promise", "measured", "holds", title=f"hit rates, seed {results.seed}")
    for promise in checked:
        table.add_row(promise.text, promise.measured, "yes" if promise.holds else "NO")
    Console(width=150).print(table)
    facts = {"seed": results.seed, "commit": results.commit, "durations": results.durations}
    rows = [promise._asdict() for promise in checked]
    storage.write_json(RESULT, {"machine": describe_machine(), "conditions": facts, "promises": rows})
    sys.exit(0 if all(promise.holds for promise in checked) else 1)


if __name__ == "__main__":
    main()
