"""Tables IV and V with the robot: the worlds beside one another, and each world by itself."""

from collections.abc import Iterable, Sequence

from archerfish.evaluation.comparison import CellKey, bound_shares, cells_of, comparisons_of
from archerfish.evaluation.pooling import pooled_cells, pooled_differences
from archerfish.evaluation.report.entry_tables import (
    NOTHING,
    Entry,
    EntryGroup,
    EntryRow,
    EntryTable,
    Heading,
    difference_entry,
    fired_entry,
    rate_entry,
)
from archerfish.evaluation.report.rate_tables import (
    Column,
    RateTable,
    bound_columns,
    fired_shots_count,
    printed_column,
    rate_column,
    rate_table,
    title_of,
)
from archerfish.evaluation.report.wording import CONTROLLERS, controller_words
from archerfish.evaluation.report.worlds import REAL, World
from archerfish.evaluation.results import Cell, Comparison, Drop
from archerfish.figures.page import percent
from archerfish.paper.tables import hit_rate_table

AGAINST = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "oracle")
"""Whom the policies are compared with."""


def present(cells: Iterable[Cell]) -> list[str]:
    """Return the controllers of some cells in the order of the report."""
    found = list(dict.fromkeys(cell.controller for cell in cells))
    return [name for name in CONTROLLERS if name in found] + [name for name in found if name not in CONTROLLERS]


def overview_table(
    cells: Sequence[Cell], pairs: Sequence[Comparison], worlds: Sequence[World], limit: str
) -> EntryTable:
    """Lay the worlds side by side: all ranges together, a row per controller, the paper's columns on top."""
    tables = _tables(cells)
    printed = [
        EntryRow(f"paper, {name}", [_printed_mean(table, column, world) for table in tables for world in worlds])
        for name, column in (("PPO", "ppo_percent"), ("Kalman", "kalman_percent"))
    ]
    rates = [
        EntryRow(
            controller_words(name).name,
            [
                rate_entry(pooled_cells(each), "ours" if name == "history" else "")
                for each in _by_table_and_world(cells, tables, worlds, limit, name)
            ],
        )
        for name in present(cells)
    ]
    groups = [
        EntryGroup("Hit rates, %", [*printed, *rates]),
        EntryGroup("Hits of fired shots, and withheld ones", _fired(cells, tables, worlds, limit)),
        EntryGroup("Paired differences of the history policy, points", _differences(pairs, tables, worlds, limit)),
    ]
    return EntryTable(
        "All ranges together, with 95 % intervals. The paper’s figures are those of its own robot, mean of its ranges.",
        "controller",
        [Heading(world.short) for _ in tables for world in worlds],
        [group for group in groups if group.rows],
        spans(tables, len(worlds), cells),
    )


def _fired(cells: Sequence[Cell], tables: Sequence[str], worlds: Sequence[World], limit: str) -> list[EntryRow]:
    """Say how many shots stand behind the rates; nothing where no cell counts fired shots alone."""
    if not fired_shots_count(cells):
        return []
    return [
        EntryRow(
            controller_words(name).name,
            [fired_entry(each) for each in _by_table_and_world(cells, tables, worlds, limit, name)],
        )
        for name in present(cells)
    ]


def _tables(cells: Iterable[Cell]) -> list[str]:
    found = {cell.table for cell in cells}
    return [table for table in REAL if table in found]


def spans(tables: Sequence[str], width: int, found: Sequence[Cell | Drop]) -> list[tuple[str, int]]:
    """Head the columns of several of the paper's tables, so many columns each.

    Args:
      tables: "IV" and "V", say.
      width: columns of each.
      found: cells or drops, which know of motions.
    """
    return [(title_of(table, (each for each in found if each.table == table)), width) for table in tables]


def _differences(
    pairs: Sequence[Comparison], tables: Sequence[str], worlds: Sequence[World], limit: str
) -> list[EntryRow]:
    rows = []
    for against in AGAINST:
        picked = [
            comparisons_of(pairs, setting=each.setting, command_limit=limit, controller="history", against=against)
            for each in worlds
        ]
        found = [
            pooled_differences([each for key, each in pair.items() if key[0] == table])
            for table in tables
            for pair in picked
        ]
        if any(found):
            rows.append(EntryRow(f"less {controller_words(against).name}", [difference_entry(each) for each in found]))
    return rows


def misses_table(cells: Sequence[Cell], worlds: Sequence[World], limit: str) -> EntryTable:
    """Split the misses of every controller and world, as shares of all shots, all ranges together."""
    tables = _tables(cells)
    rows = [
        EntryRow(
            controller_words(name).name,
            [_misses(each) for each in _by_table_and_world(cells, tables, worlds, limit, name)],
        )
        for name in present(cells)
    ]
    return EntryTable(
        "Misses in percent of all shots: while still slewing to the target (acquisition) + settled.",
        "controller",
        [Heading(world.short) for _ in tables for world in worlds],
        [EntryGroup("", rows)],
        spans(tables, len(worlds), cells),
    )


def _by_table_and_world(
    cells: Sequence[Cell], tables: Sequence[str], worlds: Sequence[World], limit: str, controller: str
) -> list[list[Cell]]:
    picked = [cells_of(cells, setting=world.setting, command_limit=limit, controller=controller) for world in worlds]
    return [[cell for key, cell in found.items() if key[0] == table] for table in tables for found in picked]


def _printed_mean(table: str, column: str, world: World) -> Entry:
    """Write the paper's mean once, with the robot."""
    if world.role != "robot":
        return NOTHING._replace(style="paper")
    rows = hit_rate_table(table).rows
    return Entry(f"{sum(getattr(row, column) for row in rows) / len(rows):.1f}", "", "paper")


def _misses(cells: Sequence[Cell]) -> Entry:
    shots = sum(cell.counted for cell in cells)
    if not shots:
        return NOTHING
    slewing, settled = (sum(getattr(cell, f"misses_{name}") for cell in cells) for name in ("slewing", "settled"))
    return Entry(f"{percent(slewing / shots)} + {percent(settled / shots)}")


def world_rates(cells: Sequence[Cell], setting: str, limit: str) -> RateTable:
    """Lay the hit rates of all controllers in one world side by side, a row per range."""

    def of(controller: str) -> dict[CellKey, Cell]:
        return cells_of(cells, setting=setting, command_limit=limit, controller=controller)

    columns = [printed_column(of("history"), "paper, PPO"), printed_column(of("kalman"), "paper, Kalman")]
    columns += [rate_column(of(name), name, ours=name == "history") for name in present(cells)]
    columns += bound_columns(of("oracle"), of("history") or of("kalman") or of("kalman-lq"))
    columns += [Column("policy, share of bound", "share", bound_shares(of("history")))]
    return rate_table(columns, "Hit rates in percent with 95 % intervals.")


def world_differences(pairs: Sequence[Comparison], setting: str, limit: str) -> RateTable:
    """Lay the paired differences of the policies in one world side by side, a row per range."""

    def less(controller: str, against: str) -> Column:
        found = comparisons_of(pairs, setting=setting, command_limit=limit, controller=controller, against=against)
        name = "policy" if controller == "history" else "six-number policy"
        return Column(f"{name} less {controller_words(against).name}", "difference", found)

    columns = [*(less("history", name) for name in AGAINST), less("paper", "kalman")]
    return rate_table(columns, "Paired differences in points with 95 % intervals: above zero, the policy is better.")
