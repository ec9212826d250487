"""Tables IV and V with the robot: the worlds beside one another, each world by itself, and the drops between them."""

from collections.abc import Iterable, Mapping, Sequence

from archerfish.evaluation.comparison import CellKey, cells_of, comparisons_of, drops_of
from archerfish.evaluation.pooling import Estimate, pooled_cells, pooled_differences
from archerfish.evaluation.report.entry_tables import (
    NOTHING,
    Entry,
    EntryGroup,
    EntryRow,
    EntryTable,
    Heading,
    difference_entry,
    rate_entry,
)
from archerfish.evaluation.report.rate_tables import (
    Column,
    RateTable,
    cell_order,
    printed_column,
    rate_column,
    rate_table,
    target_of,
)
from archerfish.evaluation.report.wording import CONTROLLERS, controller_words
from archerfish.evaluation.report.worlds import REAL, World
from archerfish.evaluation.results import Cell, Comparison, Drop
from archerfish.figures.page import bins, percent
from archerfish.paper.tables import hit_rate_table

AGAINST = ("kalman", "kalman-lq", "parabola-lq", "oracle")
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
        EntryGroup("Paired differences of the history policy, points", _differences(pairs, tables, worlds, limit)),
    ]
    return EntryTable(
        "All ranges together, with 95 % intervals. The paper’s figures are those of its own robot, mean of its ranges.",
        "controller",
        [Heading(world.short) for _ in tables for world in worlds],
        [group for group in groups if group.rows],
        _spans(tables, len(worlds)),
    )


def _tables(cells: Iterable[Cell]) -> list[str]:
    found = {cell.table for cell in cells}
    return [table for table in REAL if table in found]


def _spans(tables: Sequence[str], width: int) -> list[tuple[str, int]]:
    return [(f"Table {table}, {target_of(table)} targets", width) for table in tables]


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
        _spans(tables, len(worlds)),
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
    shots = sum(cell.shots for cell in cells)
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
    return rate_table(columns, "Hit rates in percent with 95 % intervals.")


def world_differences(pairs: Sequence[Comparison], setting: str, limit: str) -> RateTable:
    """Lay the paired differences of the policies in one world side by side, a row per range."""

    def less(controller: str, against: str) -> Column:
        found = comparisons_of(pairs, setting=setting, command_limit=limit, controller=controller, against=against)
        name = "policy" if controller == "history" else "six-number policy"
        return Column(f"{name} less {controller_words(against).name}", "difference", found)

    columns = [*(less("history", name) for name in AGAINST), less("paper", "kalman")]
    return rate_table(columns, "Paired differences in points with 95 % intervals: above zero, the policy is better.")


def drops_overview(drops: Sequence[Drop], worlds: Sequence[World], limit: str) -> EntryTable | None:
    """Say how far each controller falls from the simulator to each robot, all ranges together; None without drops."""
    here = [each for each in drops if each.command_limit == limit]
    tables = [table for table in REAL if any(each.table == table for each in here)]
    columns = [(table, settled) for table in tables for settled in (False, True)]

    def row(name: str, world: World) -> EntryRow:
        style = "ours" if name == "history" else ""
        return EntryRow(
            controller_words(name).name,
            [difference_entry(_fall(here, world, limit, name, *each), style) for each in columns],
        )

    groups = [
        EntryGroup(f"From the simulator to “{world.short}”", [row(name, world) for name in _fallen(here, world)])
        for world in worlds
        if _fallen(here, world)
    ]
    if not groups:
        return None
    return EntryTable(
        "Hit rate in the simulator less that with a robot, in points, all ranges together, with 95 % intervals paired by "
        "engagement: above zero, shots are lost on the way.",
        "controller",
        [Heading("settled" if settled else "all shots") for _, settled in columns],
        groups,
        _spans(tables, 2),
    )


def _fallen(drops: Sequence[Drop], world: World) -> list[str]:
    found = {each.controller for each in drops if each.setting == world.setting}
    return [name for name in CONTROLLERS if name in found] + sorted(found - CONTROLLERS.keys())


def _fall(
    drops: Sequence[Drop], world: World, limit: str, controller: str, table: str, settled: bool
) -> Estimate | None:
    found = drops_of(drops, settled=settled, command_limit=limit, controller=controller, setting=world.setting)
    return pooled_differences([each for key, each in found.items() if key[0] == table])


def drop_table(drops: Sequence[Drop], world: World, limit: str) -> EntryTable | None:
    """Say how far each controller falls from the simulator to one robot, per range and all together; None without."""
    here = [each for each in drops if (each.setting, each.command_limit) == (world.setting, limit)]
    names = _fallen(here, world)
    picked = {
        (name, settled): drops_of(here, settled=settled, command_limit=limit, controller=name, setting=world.setting)
        for name in names
        for settled in (False, True)
    }
    keys = sorted({key for found in picked.values() for key in found}, key=cell_order)
    if not keys:
        return None
    groups = [_drop_group(table, [key for key in keys if key[0] == table], names, picked) for table in REAL]
    return EntryTable(
        f"Hit rate in the simulator less that with “{world.setting}”, by range, in points.",
        "range, shots",
        [Heading(controller_words(name).name) for name in names],
        [group for group in groups if group.rows],
    )


def _drop_group(
    table: str,
    keys: Sequence[CellKey],
    names: Sequence[str],
    picked: Mapping[tuple[str, bool], Mapping[CellKey, Drop]],
) -> EntryGroup:
    def entry(name: str, settled: bool, keys: Sequence[CellKey]) -> Entry:
        found = [picked[name, settled][key] for key in keys if key in picked[name, settled]]
        return difference_entry(pooled_differences(found), "ours" if name == "history" else "")

    wanted = [(f"{bins(key[1])} m", [key]) for key in keys] + ([("all ranges", list(keys))] if len(keys) > 1 else [])
    rows = [
        EntryRow(f"{title}, {shots}", [entry(name, settled, of) for name in names])
        for title, of in wanted
        for settled, shots in ((False, "all shots"), (True, "settled"))
    ]
    return EntryGroup(f"Table {table}, {target_of(table)} targets", rows)


def pooled_drop(drops: Sequence[Drop], setting: str, limit: str, controller: str) -> Estimate | None:
    """Return the mean drop of a controller over all cells and shots; None if it was not measured."""
    found = drops_of(drops, settled=False, command_limit=limit, controller=controller, setting=setting)
    return pooled_differences(found.values())
