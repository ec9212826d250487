"""The report's part about targets that move in other ways than the paper's: a section per length of engagements."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import AnyLabel
from archerfish.evaluation.pooling import pooled_cells, pooled_differences
from archerfish.evaluation.report.entry_tables import (
    EntryGroup,
    EntryRow,
    EntryTable,
    Heading,
    difference_entry,
    rate_entry,
)
from archerfish.evaluation.report.rate_drawings import motions_drawing
from archerfish.evaluation.report.robot_tables import present
from archerfish.evaluation.report.sections import anchor_of
from archerfish.evaluation.report.wording import LIMITS, controller_words, fallback_sentence, own_controllers
from archerfish.evaluation.results import MOTION_TABLES, Cell, Comparison, Results
from archerfish.figures.page import bins

PLOTTED = ("policy", "history", "paper", "kalman", "kalman-lq", "imm-lq", "oracle")
"""Controllers of a section's figure; the table below it has them all."""
NOTE = (
    "Targets stand still or move in one of the ways that docs/targets.md lists, each with parameters of its own. No "
    "column of the paper stands beside them, and no bound: bounds are computed for eq (7) alone."
)


class MotionSection(NamedTuple):
    """One length of engagements in one setting under one command limit."""

    anchor: str
    """Name of the section within the page."""
    title: str
    """Heading."""
    note: str
    """What the targets are."""
    drawing: Figure
    """Hit rate against range, a panel per motion."""
    tables: Sequence[EntryTable]
    """Hit rates, and paired differences if there are any: a row per motion and controller, a column per range."""


def of_paper(labels: Iterable[AnyLabel]) -> tuple[AnyLabel, ...]:
    """Return what was found of targets in the paper's tables, those with a motion of the user's own among them."""
    return tuple(each for each in labels if each.table not in MOTION_TABLES.values())


def motion_sections(results: Results) -> list[MotionSection]:
    """Gather what was shot at targets that don't move as the paper's do; empty if nothing was."""
    cells = [cell for cell in results.cells if cell.table in MOTION_TABLES.values()]
    places = dict.fromkeys((cell.setting, cell.command_limit, cell.table) for cell in cells)
    return [_section(cells, results.comparisons, *place) for place in places]


def _section(cells: Sequence[Cell], pairs: Iterable[Comparison], setting: str, limit: str, table: str) -> MotionSection:
    shot = _under(cells, setting, limit, table)
    length = next(seconds for seconds, name in MOTION_TABLES.items() if name == table)
    where = "" if setting == "paper" else f" on {setting}"
    differences = _difference_table(_under(pairs, setting, limit, table))
    note = f"{NOTE} {LIMITS[limit].note}" if limit in LIMITS else NOTE
    return MotionSection(
        anchor=anchor_of(f"{setting}-{limit}-motions-{length:g}s"),
        title=f"Other motions{where}, engagements of {length:g} s, limit {limit}",
        note=note + fallback_sentence(shot),
        drawing=motions_drawing(shot, (*PLOTTED, *own_controllers(shot))),
        tables=[_rate_table(shot), *([differences] if differences else [])],
    )


def _under(labels: Iterable[AnyLabel], setting: str, limit: str, table: str) -> list[AnyLabel]:
    return [each for each in labels if (each.setting, each.command_limit, each.table) == (setting, limit, table)]


def _rate_table(cells: Sequence[Cell]) -> EntryTable:
    ranges = sorted({cell.range_m for cell in cells})
    groups = []
    for motion in dict.fromkeys(cell.motion for cell in cells):
        shot = [cell for cell in cells if cell.motion == motion]
        entrants = dict.fromkeys(
            (name, cell.policy_seed) for name in present(shot) for cell in shot if cell.controller == name
        )
        rows = []
        for entrant in entrants:
            own = {cell.range_m: cell for cell in shot if (cell.controller, cell.policy_seed) == entrant}
            style = "" if entrant[1] is None else "ours"
            together = rate_entry(pooled_cells(own.values()), style)
            rows.append(EntryRow(_name(*entrant), [*(rate_entry(own.get(each), style) for each in ranges), together]))
        groups.append(EntryGroup(str(motion), rows))
    return _table("Hit rates in percent, with 95 % intervals.", ranges, groups)


def _difference_table(pairs: Sequence[Comparison]) -> EntryTable | None:
    ranges = sorted({each.range_m for each in pairs})
    groups = []
    for motion in dict.fromkeys(each.motion for each in pairs):
        found = [each for each in pairs if each.motion == motion]
        rows = []
        for pair in dict.fromkeys((each.controller, each.policy_seed, each.against) for each in found):
            own = {each.range_m: each for each in found if (each.controller, each.policy_seed, each.against) == pair}
            entries = [difference_entry(pooled_differences([own[each]] if each in own else [])) for each in ranges]
            together = difference_entry(pooled_differences(own.values()))
            rows.append(EntryRow(f"{_name(*pair[:2])} less {controller_words(pair[2]).name}", [*entries, together]))
        groups.append(EntryGroup(str(motion), rows))
    caption = "Paired differences in points, with 95 % intervals."
    return _table(caption, ranges, groups) if groups else None


def _table(caption: str, ranges: Sequence[tuple[float, float]], groups: Sequence[EntryGroup]) -> EntryTable:
    return EntryTable(caption, "controller", [*(Heading(f"{bins(each)} m") for each in ranges), Heading("all")], groups)


def _name(controller: str, seed: int | None) -> str:
    name = controller_words(controller).name
    return name if seed is None else f"{name} (seed {seed})"
