"""What a closed form of the pellet's flight costs off-axis, and why flat fire is the default instead of eq (5).

For each model an aim is solved for an armor's centre, and a pellet of that aim is flown under 3-D quadratic drag, the
corrected eq (4): where it lands is the model's error. Perfect aim by the model is then fired with the dispersion of the
paper's conditions. Prints both and writes benchmarks/results/ballistics.json.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.dynamics.muzzle import DRAWS, Muzzle, direction, muzzle_from_record, pellet_at_muzzle
from archerfish.dynamics.pellet import CrossingModel, flat_fire_crossing, printed_crossing, quadratic_crossing
from archerfish.paper.conditions import assumed_conditions
from archerfish.records import storage
from archerfish.simulation.setting import paper_muzzle
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "ballistics.json"
SEED = 0
SHOTS = 20_000
DISTANCES_M = (1.0, 2.0, 3.0, 4.0, 5.0)
OFF_AXIS_DEG = (0.0, 15.0, 30.0, 45.0)
MODELS: dict[str, CrossingModel] = {
    "eq 5": printed_crossing,
    "flat fire": flat_fire_crossing,
    "3-D drag": quadratic_crossing,
}

Array = NDArray[np.float64]


class Cell(NamedTuple):
    """One model at one place of the armor."""

    model: str
    distance_m: float
    off_axis_deg: float
    lateral_mm: float
    vertical_mm: float
    hits: int
    shots: int


def aim_by(model: CrossingModel, point: Array, muzzle: Muzzle) -> Array:
    """Solve for the pitch and yaw at which a flight model takes the mean pellet through a point."""
    distance = float(np.linalg.norm(point))
    angle = np.array([math.asin(point[2] / distance), math.atan2(point[1], point[0])])
    for _ in range(60):
        crossing = model(np.zeros(3), muzzle.speed * direction(angle), point[0], muzzle.drag)
        # A turn in yaw moves the crossing by more than the arc, as the plane stands at a slant.
        angle = (
            angle
            + np.array([point[2] - crossing.height, (point[1] - crossing.lateral) * point[0] / distance]) / distance
        )
    return angle


def measure(name: str, distance: float, off_axis_deg: float, muzzle: Muzzle, draws: Array, hit_radius: float) -> Cell:
    """Aim by a model and fly the pellets under 3-D drag."""
    yaw = math.radians(off_axis_deg)
    point = np.array([distance * math.cos(yaw), distance * math.sin(yaw), 0.0])
    angle = aim_by(MODELS[name], point, muzzle)
    mean = quadratic_crossing(np.zeros(3), muzzle.speed * direction(angle), point[0], muzzle.drag)
    position, velocity = pellet_at_muzzle(muzzle, np.tile(angle, (len(draws), 1)), np.zeros((len(draws), 2)), draws)
    flown = quadratic_crossing(position, velocity, np.full(len(draws), point[0]), muzzle.drag)
    hits = np.hypot(flown.lateral - point[1], flown.height - point[2]) <= hit_radius
    error = 1e3 * np.array([mean.lateral - point[1], mean.height - point[2]])
    return Cell(name, distance, off_axis_deg, *(round(float(each), 3) for each in error), int(hits.sum()), len(draws))


def table_of(cells: list[Cell], name: str) -> Table:
    """Lateral and vertical error [mm] and hit rate of one model."""
    table = Table(
        "off-axis",
        *(f"{distance:g} m" for distance in DISTANCES_M),
        title=f"{name}: lateral and vertical error in mm; hits",
    )
    for off_axis in OFF_AXIS_DEG:
        row = [cell for cell in cells if cell.model == name and cell.off_axis_deg == off_axis]
        texts = (f"{c.lateral_mm:+.2f}, {c.vertical_mm:+.2f}; {100 * c.hits / c.shots:.2f} %" for c in row)
        table.add_row(f"{off_axis:g}°", *texts)
    return table


def main() -> None:
    """Measure, print and write."""
    conditions = assumed_conditions()
    muzzle = muzzle_from_record(paper_muzzle(conditions))
    # The same pellets everywhere: the differences are the models'.
    draws = np.random.default_rng(SEED).standard_normal((SHOTS, DRAWS))
    cells = [
        measure(name, distance, off_axis, muzzle, draws, conditions.hit_radius)
        for name in MODELS
        for off_axis in OFF_AXIS_DEG
        for distance in DISTANCES_M
    ]
    console = Console(width=140)
    for name in MODELS:
        console.print(table_of(cells, name))
    told: dict[str, Any] = {
        "seed": SEED,
        "muzzle_speed_m_s": conditions.muzzle_speed,
        "muzzle_speed_sd_m_s": conditions.muzzle_speed_sd,
        "dispersion_deg": round(math.degrees(conditions.dispersion), 6),
        "drag_per_m": conditions.drag,
        "hit_radius_m": conditions.hit_radius,
        "flown_with": "3-D quadratic drag",
    }
    content = {"machine": describe_machine(), "conditions": told, "cells": [cell._asdict() for cell in cells]}
    storage.write_json(RESULT, content)


if __name__ == "__main__":
    main()
