"""Tune the classical baselines on draws that no evaluation uses: the tracker's noise and the lead, by grid.

Every controller gets about the same number of trials as the policy's settings had. The best settings are in
src/archerfish/paper/conditions.json; this prints how they compare, and writes benchmarks/results/tuning.json.
"""

from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records import storage
from archerfish.simulation.setting import make_world, paper_muzzle
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "tuning.json"
SEED = 0
ENGAGEMENTS = 300
ACCELERATIONS = (1.0, 3.0, 10.0, 30.0, 100.0)
LEADS_S = (0.0, 0.02, 0.04, 0.08, 0.14)


def rates(conditions: Conditions, name: str, command_limit: str = "box") -> list[float]:
    """Hit rates [%] of a classical controller in the eight cells, on the tuning's own draws."""
    plants, limits = printed_plants(), gate_limits()
    muzzle = paper_muzzle(conditions)
    world = make_world(plants["pitch"], plants["yaw"], muzzle, limits, command_limit, conditions)
    model = gimbal_model(plants["pitch"], plants["yaw"], conditions.control_period_s)
    named = named_limits(command_limit, limits, conditions.line_of_sight_lead)
    controller = make_controller(name, Workbench(model, muzzle_from_record(muzzle), named, conditions))
    suites = table_suites(conditions)
    trials = draw_trials(suites, ENGAGEMENTS, conditions.decisions, SEED, "tuning")
    hit = fight(world, controller, trials).hits(conditions.hit_radius)
    return [float(100 * each) for each in hit.reshape(len(suites), -1).mean(axis=1)]


def main() -> None:
    """Run the grid."""
    base, rows = assumed_conditions(), []
    for acceleration in ACCELERATIONS:
        for name, leads in (("kalman", LEADS_S), ("kalman-lq", (0.0,))):
            for lead in leads:
                tried = replace(base, kalman_acceleration_sd=acceleration, kalman_extra_lead_s=lead)
                cells = rates(tried, name)
                rows.append(
                    {"controller": name, "acceleration_sd": acceleration, "extra_lead_s": lead, "cells_percent": cells}
                )
    rows.sort(key=lambda row: (row["controller"], -sum(row["cells_percent"])))
    table = Table("controller", "q m/s²", "extra lead s", "mean %", "cells %", title="tuning, box")
    for row in rows:
        cells = row["cells_percent"]
        table.add_row(
            row["controller"],
            f"{row['acceleration_sd']:g}",
            f"{row['extra_lead_s']:g}",
            f"{sum(cells) / len(cells):.2f}",
            " ".join(f"{each:.1f}" for each in cells),
        )
    Console(width=140).print(table)
    conditions = {"seed": SEED, "stream": "tuning", "engagements": ENGAGEMENTS, "command_limit": "box"}
    storage.write_json(RESULT, {"machine": describe_machine(), "conditions": conditions, "trials": rows})


if __name__ == "__main__":
    main()
