"""The report's part about the robot: Tables IV and V in all worlds."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.figure import Figure

from archerfish.evaluation.report.drop_tables import drop_table, drops_overview
from archerfish.evaluation.report.entry_tables import EntryTable
from archerfish.evaluation.report.rate_tables import Group, RateTable
from archerfish.evaluation.report.robot_drawings import transfer_drawing
from archerfish.evaluation.report.robot_tables import (
    misses_table,
    overview_table,
    world_differences,
    world_rates,
)
from archerfish.evaluation.report.sections import asked, every_controller, seed_remarks, under
from archerfish.evaluation.report.wording import LIMITS
from archerfish.evaluation.report.worlds import REAL, World, real_cells, shown_limit, worlds
from archerfish.evaluation.results import Results

JITTER = (
    "The motion may exceed what the commands were limited to: a link that is late with one and early with the next "
    "leaves the gimbal less than a decision period between them."
)


class WorldPart(NamedTuple):
    """One world under one command limit."""

    anchor: str
    """Name of the part within the page."""
    title: str
    """Heading."""
    note: str
    """What the world is."""
    rates: RateTable
    """Hit rates by range."""
    differences: RateTable
    """Paired differences by range."""
    remarks: Sequence[str]
    """Sentences below the tables."""
    groups: Sequence[Group]
    """Every controller, by cell."""


class RobotSection(NamedTuple):
    """Tables IV and V."""

    worlds: Sequence[World]
    """Where shots were fired."""
    limit: str
    """Command limit of what stands side by side."""
    limit_note: str
    """What it means."""
    engagements: int
    """Fewest per cell."""
    drawing: Figure | None
    """From world to world; None for a single one."""
    overview: EntryTable
    """All ranges together, worlds side by side."""
    misses: EntryTable
    """The same of the misses."""
    drop: EntryTable | None
    """From the simulator to every robot, all ranges together; None if that was not measured."""
    drops: Sequence[EntryTable]
    """The same by range, one per robot."""
    parts: Sequence[WorldPart]
    """One per world and limit."""


def robot_section(results: Results) -> RobotSection | None:
    """Gather Tables IV and V in the simulator, with the robot and with changed robots; None if none was shot."""
    cells = real_cells(results)
    if not cells:
        return None
    places, limit = worlds(results), shown_limit(cells)
    side_by_side = [cell for cell in cells if cell.command_limit == limit]
    pairs = [each for each in results.comparisons if each.table in REAL]
    tables = (drop_table(results.drops, world, limit) for world in places)
    return RobotSection(
        worlds=places,
        limit=limit,
        limit_note=LIMITS[limit].note if limit in LIMITS else "",
        engagements=min(cell.engagements for cell in side_by_side),
        drawing=transfer_drawing(side_by_side, places, limit),
        overview=overview_table(side_by_side, pairs, places, limit),
        misses=misses_table(side_by_side, places, limit),
        drop=drops_overview(results.drops, places, limit),
        drops=[table for table in tables if table is not None],
        parts=[
            _part(results, world, each)
            for world in places
            for each in (*LIMITS, *({cell.command_limit for cell in cells} - LIMITS.keys()))
            if under(cells, world.setting, each, REAL)
        ],
    )


def _part(results: Results, world: World, limit: str) -> WorldPart:
    cells = under(results.cells, world.setting, limit, REAL)
    pairs = under(results.comparisons, world.setting, limit, REAL)
    return WorldPart(
        anchor=f"{world.setting}-{limit}-{'-'.join(REAL)}",
        title=f"{world.title}, limit {limit}",
        note=world.meaning,
        rates=world_rates(cells, world.setting, limit),
        differences=world_differences(pairs, world.setting, limit),
        remarks=[
            *seed_remarks(cells, world.setting, limit),
            *asked(results.accelerations, world.setting, limit),
            *([JITTER] if limit == "gate" else []),
        ],
        groups=every_controller(cells, pairs),
    )
