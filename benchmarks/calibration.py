"""Find unprinted conditions that bring our Kalman baseline to the paper's Kalman columns, and how unique they are.

Tries a grid of round numbers with the tuned baseline, on draws that neither tuning nor evaluation uses, and measures
the chosen set (src/archerfish/paper/conditions.json) with many engagements. Writes benchmarks/results/calibration.json,
whose field `calibration` is what conditions.json carries.
"""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.command_limits import box_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.suites import Suite, draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.paper.tables import printed_rate
from archerfish.records import storage
from archerfish.simulation.setting import make_world, paper_muzzle
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "calibration.json"
SEED = 0
SEARCH_ENGAGEMENTS = 150
PROMISING = 4.0
RESCORE_ENGAGEMENTS = 1000
FINAL_ENGAGEMENTS = 3000
GRID: dict[str, tuple[float, ...]] = {
    "max_lateral_offset": (0.5, 0.6, 0.7, 0.8),
    "max_lateral_speed": (0.2, 0.25, 0.3, 0.35, 0.4, 0.5),
    "muzzle_speed": (15.0, 18.0, 22.0, 25.0),
    "dispersion": tuple(math.radians(degrees) for degrees in (0.1, 0.2, 0.3)),
    "engagement_s": (0.8, 1.0, 1.2),
}


def kalman_cells(conditions: Conditions, engagements: int, seed: int) -> list[tuple[Suite, float]]:
    """Hit rates [%] of the Kalman baseline under `box` in the eight cells."""
    plants, limits = printed_plants(), gate_limits()
    muzzle = paper_muzzle(conditions)
    world = make_world(plants["pitch"], plants["yaw"], muzzle, limits, "box", conditions)
    model = gimbal_model(plants["pitch"], plants["yaw"], conditions.control_period_s)
    bench = Workbench(model, muzzle_from_record(muzzle), box_limits(limits), conditions)
    suites = table_suites(conditions)
    trials = draw_trials(suites, engagements, conditions.decisions, seed, "calibration")
    hit = fight(world, make_controller("kalman", bench), trials).hits(conditions.hit_radius)
    rates = 100 * hit.reshape(len(suites), -1).mean(axis=1)
    return [(suite, float(rate)) for suite, rate in zip(suites, rates, strict=True)]


def residuals(cells: list[tuple[Suite, float]]) -> list[float]:
    """Ours less the paper's [percentage points]."""
    found = []
    for suite, rate in cells:
        printed = printed_rate(suite.table, suite.range_m, "kalman")
        assert printed is not None
        found.append(rate - printed)
    return found


def rmse(values: list[float]) -> float:
    """Root mean square."""
    return math.sqrt(sum(value**2 for value in values) / len(values))


def search(base: Conditions) -> list[dict[str, Any]]:
    """Try the whole grid."""
    tried = []
    for values in track(list(itertools.product(*GRID.values())), "calibrating"):
        chosen = dict(zip(GRID, values, strict=True))
        cells = kalman_cells(replace(base, **chosen), SEARCH_ENGAGEMENTS, SEED)
        tried.append({**chosen, "rmse_points": rmse(residuals(cells))})
    tried.sort(key=lambda row: row["rmse_points"])
    return tried


def rescore(base: Conditions, tried: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Measure the promising sets again on other draws: the search's few engagements flatter some and wrong others."""
    promising = [row for row in tried if row["rmse_points"] < PROMISING]
    for row in track(promising, "measuring again"):
        chosen = {name: row[name] for name in GRID}
        row["rmse_points"] = rmse(residuals(kalman_cells(replace(base, **chosen), RESCORE_ENGAGEMENTS, SEED + 2)))
    return sorted(promising, key=lambda row: row["rmse_points"])


def final(base: Conditions, promising: list[dict[str, Any]], tried: int) -> dict[str, Any]:
    """Measure the chosen set, as the field `calibration` of conditions.json."""
    cells = kalman_cells(base, FINAL_ENGAGEMENTS, SEED + 1)
    missed = residuals(cells)
    within = [row for row in promising if row["rmse_points"] < 3.0]
    spans = {name: sorted({row[name] for row in within}) for name in GRID}
    told = "; ".join(f"{name.replace('_', ' ')} {_span(name, values)}" for name, values in spans.items() if values)
    return {
        "cells": [
            {
                "table": suite.table,
                "range_m": list(suite.range_m),
                "ours_percent": round(rate, 2),
                "residual_points": round(residual, 2),
            }
            for (suite, rate), residual in zip(cells, missed, strict=True)
        ],
        "rmse_points": round(rmse(missed), 2),
        "engagements": FINAL_ENGAGEMENTS,
        "sets_tried": tried,
        "sets_within_3_points": len(within),
        "note": (
            f"Not unique: among the sets within 3 points are {told}; the best comes to "
            f"{promising[0]['rmse_points']:.1f} points. The chosen one is round, not the best."
        ),
    }


def _span(name: str, values: list[float]) -> str:
    low, high = (math.degrees(each) if name == "dispersion" else each for each in (values[0], values[-1]))
    unit = {"muzzle_speed": "m/s", "max_lateral_speed": "m/s", "dispersion": "°", "engagement_s": "s"}.get(name, "m")
    return f"{low:.3g}–{high:.3g} {unit}"


def main() -> None:
    """Search, measure, print and write."""
    base = assumed_conditions()
    tried = search(base)
    promising = rescore(base, tried)
    calibration = final(base, promising, len(tried))
    table = Table(*GRID, "RMSE points", title=f"best sets, {RESCORE_ENGAGEMENTS} engagements a cell")
    for row in promising[:15]:
        table.add_row(*(f"{row[name]:.4g}" for name in (*GRID, "rmse_points")))
    console = Console(width=140)
    console.print(table)
    console.print(calibration)
    conditions = {"seed": SEED, "stream": "calibration", "search_engagements": SEARCH_ENGAGEMENTS}
    content = {"machine": describe_machine(), "conditions": conditions, "calibration": calibration, "sets": promising}
    storage.write_json(RESULT, content)


if __name__ == "__main__":
    main()
