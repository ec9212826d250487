"""Figures of the robot for the report: hit rates from the simulator to the robot, and step responses."""

import math
from collections.abc import Sequence

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import cells_of
from archerfish.evaluation.report.rate_tables import title_of
from archerfish.evaluation.report.robot_tables import present
from archerfish.evaluation.report.wording import controller_words
from archerfish.evaluation.report.worlds import REAL, World
from archerfish.evaluation.results import Cell
from archerfish.evaluation.robot_results import RobotStep
from archerfish.figures.page import bins
from archerfish.figures.step_response import MeasuredStep, measured_steps
from archerfish.figures.transfer import Slope, SlopePanel, transfer_figure


def transfer_drawing(cells: Sequence[Cell], worlds: Sequence[World], limit: str) -> Figure | None:
    """Draw the hit rates of every controller from world to world, static above dynamic targets; None for one world."""
    if len(worlds) < 2:
        return None
    tables = [table for table in REAL if any(cell.table == table for cell in cells)]
    return transfer_figure(
        [_panel([cell for cell in cells if cell.table == table], table, worlds, limit) for table in tables],
        ["sim." if world.role == "simulator" else world.short for world in worlds],
    )


def _panel(cells: Sequence[Cell], table: str, worlds: Sequence[World], limit: str) -> SlopePanel:
    ranges = sorted({cell.range_m for cell in cells})
    slopes = []
    for name in present(cells):
        picked = [cells_of(cells, setting=each.setting, command_limit=limit, controller=name) for each in worlds]
        grid = [[found.get((table, each)) for found in picked] for each in ranges]
        words = controller_words(name)
        rate, low, high = ([[_percent(cell, part) for cell in row] for row in grid] for part in ("rate", "low", "high"))
        slopes.append(Slope(words.name, words.style, rate, low, high))
    return SlopePanel(
        title_of(table, cells),
        [bins(each) for each in ranges],
        slopes,
    )


def _percent(cell: Cell | None, name: str) -> float:
    return math.nan if cell is None else 100 * float(getattr(cell, name))


def steps_drawing(steps: Sequence[RobotStep]) -> Figure | None:
    """Draw the steps of a robot beside those of its model, a row per axis, small steps first; None without steps."""
    rows = [
        [_step(step) for step in sorted(steps, key=lambda step: abs(step.size_deg)) if step.axis == axis]
        for axis in dict.fromkeys(step.axis for step in steps)
    ]
    return measured_steps(rows) if rows else None


def _step(step: RobotStep) -> MeasuredStep:
    size = f"{step.size_deg:g}°".replace("-", "−")
    title = f"{step.axis.capitalize()}, {size}: fit {step.fit_percent:.1f} %".replace("-", "−")
    return MeasuredStep(title, step.time_s, step.measured_deg, step.model_deg)
