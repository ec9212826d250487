"""One section of the report for each setting and command limit."""

import hashlib
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import (
    AnyLabel,
    CellKey,
    bound_shares,
    cells_of,
    comparisons_of,
    policy_seeds,
    pooled_rate,
    rmse_to_paper,
    shares,
)
from archerfish.evaluation.report.rate_drawings import rates_drawing
from archerfish.evaluation.report.rate_tables import (
    Column,
    Group,
    RateTable,
    bound_columns,
    cell_order,
    printed_column,
    rate_column,
    rate_table,
    title_of,
)
from archerfish.evaluation.report.wording import CONTROLLERS, LIMITS, controller_words, own_controllers
from archerfish.evaluation.results import Acceleration, Cell, Comparison, Results
from archerfish.figures.page import bins, percent

PLOTTED = ("history", "policy", "paper", "kalman", "kalman-lq", "oracle")
"""Controllers of a section's figure; the table below it has them all."""


class ControllerRow(NamedTuple):
    """One controller in one cell."""

    name: str
    """Name, with the policy's seed."""
    cell: Cell
    """Its hits."""
    difference: Comparison | None
    """Paired difference to the Kalman filter."""


class Section(NamedTuple):
    """Everything under one setting and command limit."""

    anchor: str
    """Name of the section within the page."""
    title: str
    """Heading."""
    note: str
    """What the limit means."""
    drawing: Figure | None
    """Hit rate against range; None if nothing was shot."""
    table: RateTable | None
    """The main figures."""
    remarks: Sequence[str]
    """Sentences below the table."""
    groups: Sequence[Group]
    """Every controller, by cell."""


def limit_section(results: Results, setting: str, limit: str, tables: Sequence[str]) -> Section:
    """Gather the cells under a setting and a command limit, some of the paper's tables only."""
    cells = under(results.cells, setting, limit, tables)
    pairs = under(results.comparisons, setting, limit, tables)
    where = "" if setting == "paper" else f" on {setting}"
    name = f"Tables {' and '.join(tables)}{where}, limit {limit}"
    return Section(
        anchor=anchor_of(f"{setting}-{limit}-{'-'.join(tables)}"),
        title=f"{name}: {LIMITS[limit].title}",
        note=LIMITS[limit].note,
        drawing=rates_drawing(cells, (*PLOTTED, *own_controllers(cells))) if cells else None,
        table=_main_table(cells, pairs, setting, limit) if cells else None,
        remarks=_remarks(cells, setting, limit) + asked(results.accelerations, setting, limit),
        groups=every_controller(cells, pairs),
    )


def anchor_of(name: str) -> str:
    """Return a name that is safe in names of files and ids of the page: results may hold any text for a setting."""
    safe = re.sub(r"[^\w.-]", "_", name)
    return safe if safe == name else f"{safe}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def under(labels: Iterable[AnyLabel], setting: str, limit: str, tables: Sequence[str]) -> list[AnyLabel]:
    """Pick what was found in a setting under a command limit, for some of the paper's tables."""
    return [each for each in labels if (each.setting, each.command_limit) == (setting, limit) and each.table in tables]


def _main_table(cells: list[Cell], pairs: list[Comparison], setting: str, limit: str) -> RateTable:
    def of(controller: str) -> dict[CellKey, Cell]:
        return cells_of(cells, setting=setting, command_limit=limit, controller=controller)

    # The policy that the table is about: for the paper's targets, or where there is none, for any.
    mine = "history" if of("history") else "policy"

    def less(against: str) -> Column:
        differences = comparisons_of(pairs, setting=setting, command_limit=limit, controller=mine, against=against)
        return Column(f"policy less {controller_words(against).name}", "difference", differences)

    columns = [
        printed_column(of("history"), "paper, PPO"),
        rate_column(of("history"), "history", ours=True),
        rate_column(of("policy"), "policy", ours=True),
        rate_column(of("paper"), "paper"),
        printed_column(of("kalman"), "paper, Kalman"),
        rate_column(of("kalman"), "kalman"),
        less("kalman"),
        rate_column(of("kalman-tuned"), "kalman-tuned"),
        less("kalman-tuned"),
        rate_column(of("kalman-lq"), "kalman-lq"),
        less("kalman-lq"),
        rate_column(of("imm-lq"), "imm-lq"),
        less("imm-lq"),
        rate_column(of("parabola-lq"), "parabola-lq"),
        less("parabola-lq"),
        rate_column(of("oracle"), "oracle"),
        *(rate_column(of(name), name) for name in own_controllers(cells)),
        *bound_columns(of("oracle"), of(mine) or of("kalman") or of("kalman-lq")),
        Column("policy, share of oracle", "share", shares(of(mine), of("oracle"))),
        Column("policy, share of bound", "share", bound_shares(of(mine))),
    ]
    return rate_table(columns, "Hit rates in percent, differences in points, with 95 % intervals.")


def _remarks(cells: list[Cell], setting: str, limit: str) -> list[str]:
    remarks = []
    for controller, column in (("history", "PPO"), ("kalman", "Kalman")):
        picked = cells_of(cells, setting=setting, command_limit=limit, controller=controller)
        rmse = rmse_to_paper(picked.values())
        if rmse is not None:
            name = controller_words(controller).name
            remarks.append(f"{name} against the paper’s {column} columns: {rmse:.1f} points RMSE.")
    return remarks + seed_remarks(cells, setting, limit)


def asked(accelerations: Iterable[Acceleration], setting: str, limit: str) -> list[str]:
    """Say how hard each controller drove the yaw axis at most, of all its trainings."""
    largest: dict[str, float] = {}
    for each in accelerations:
        if (each.setting, each.command_limit) == (setting, limit):
            largest[each.controller] = max(each.yaw_rad_s2, largest.get(each.controller, 0.0))
    told = ", ".join(f"{controller_words(name).name} {value:.0f}" for name, value in largest.items())
    return [f"Largest acceleration of the yaw axis, of its commands or its motion, in rad/s²: {told}."] if told else []


def seed_remarks(cells: list[Cell], setting: str, limit: str) -> list[str]:
    """Say how many trainings stand behind the policies' figures, and how they differ."""
    remarks = []
    for controller in ("history", "policy", "paper"):
        seeds = policy_seeds(cells, setting=setting, command_limit=limit, controller=controller)
        of_controller = [cell for cell in cells if cell.controller == controller]
        rates = [pooled_rate(cell for cell in of_controller if cell.policy_seed == seed) or 0.0 for seed in seeds]
        if seeds and seeds != (None,) and len(seeds) == 1:
            remarks.append(
                f"{controller_words(controller).name}: one training, seed {seeds[0]}; "
                "the intervals are over engagements, not over trainings."
            )
        if len(seeds) > 1:
            remarks.append(
                f"{controller_words(controller).name}: {len(seeds)} trainings; shown is the one with the lowest seed, "
                f"{seeds[0]}. All cells together, they hit {percent(min(rates))} to {percent(max(rates))} %."
            )
    return remarks


def every_controller(cells: list[Cell], pairs: list[Comparison]) -> list[Group]:
    """List every controller of every cell, with its difference to the Kalman filter."""
    to_kalman = {_identity(each): each for each in pairs if each.against == "kalman"}
    known = list(CONTROLLERS)
    keys = sorted({(cell.table, cell.range_m) for cell in cells}, key=cell_order)
    return [
        Group(
            f"{title_of(table, (cell for cell in cells if cell.table == table))}, {bins(range_m)} m",
            [
                ControllerRow(_full_name(cell), cell, to_kalman.get(_identity(cell)))
                for cell in sorted(cells, key=lambda cell: _rank(known, cell))
                if (cell.table, cell.range_m) == (table, range_m)
            ],
        )
        for table, range_m in keys
    ]


def _identity(each: Cell | Comparison) -> tuple[Any, ...]:
    return each.table, each.range_m, each.controller, each.policy_seed


def _rank(known: list[str], cell: Cell) -> tuple[int, str, int]:
    place = known.index(cell.controller) if cell.controller in known else len(known)
    return place, cell.controller, -1 if cell.policy_seed is None else cell.policy_seed


def _full_name(cell: Cell) -> str:
    name = controller_words(cell.controller).name
    return name if cell.policy_seed is None else f"{name} (seed {cell.policy_seed})"
