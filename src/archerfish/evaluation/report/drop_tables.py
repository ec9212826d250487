"""How far controllers fall from the simulator to a robot: all ranges together, and by range."""

from collections.abc import Mapping, Sequence

from archerfish.evaluation.comparison import CellKey, drops_of
from archerfish.evaluation.pooling import Estimate, pooled_differences
from archerfish.evaluation.report.entry_tables import (
    Entry,
    EntryGroup,
    EntryRow,
    EntryTable,
    Heading,
    difference_entry,
)
from archerfish.evaluation.report.rate_tables import cell_order, title_of
from archerfish.evaluation.report.robot_tables import spans
from archerfish.evaluation.report.wording import CONTROLLERS, controller_words
from archerfish.evaluation.report.worlds import REAL, World
from archerfish.evaluation.results import Drop
from archerfish.figures.page import bins


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
        "Hit rate in the simulator less that with a robot, in points, all ranges together, with 95 % intervals paired "
        "by engagement: above zero, shots are lost on the way.",
        "controller",
        [Heading("settled" if settled else "all shots") for _, settled in columns],
        groups,
        spans(tables, 2, drops),
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
    return EntryGroup(
        title_of(table, (drop for of in picked.values() for key, drop in of.items() if key[0] == table)), rows
    )


def pooled_drop(drops: Sequence[Drop], setting: str, limit: str, controller: str) -> Estimate | None:
    """Return the mean drop of a controller over all cells and shots; None if it was not measured."""
    found = drops_of(drops, settled=False, command_limit=limit, controller=controller, setting=setting)
    return pooled_differences(found.values())
