"""Tables of hit rates and paired differences: controllers against ranges, or against motions where these are many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from archerfish.evaluation.hit_rate import weighted_mean
from archerfish.paper.tables import printed_rate
from archerfish.reports.report import Report
from archerfish.reports.table import Entry, Estimate, Table, entry_texts, number
from archerfish.task import Task

if TYPE_CHECKING:
    from archerfish.evaluation.comparison import CellDifference
    from archerfish.evaluation.results import Cell

FEW = 2
"""So many motions have a table each, as in the paper; more of them share one, each the mean of its ranges."""

Item = TypeVar("Item")
Show: TypeAlias = Callable[[list[Any]], Entry]

INTERVAL = "In parentheses or below: the 95 % interval, over engagements; all: the mean."
RATES = f"Rates are hits of all decisions in %; a decision without fire is a miss. {INTERVAL}"
SEEDS = "Of several seeds the mean of the trainings, in the row (seeds) the lowest and the highest."
PRINTED = "(printed): the paper's figure; the paper names no limit of commands."
DIFFERENCES = (
    "Differences are paired: same engagements, same dispersion draws. A cell is better or worse where the whole "
    "interval is above or below zero."
)
BOUNDS = "Bound: no controller exceeds it in the mean of these engagements, but by chance; ± its standard error."


def grouped(items: Iterable[Item], key: Callable[[Item], Any]) -> dict[Any, list[Item]]:
    """Group items by a key, in the order in which the keys come first."""
    groups: dict[Any, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def by_controller(cells: Iterable[Cell]) -> dict[str, list[Cell]]:
    """Group cells by the controller's name: policies, users' controllers, classical ones, perfect aim."""
    order = ("policy", "user", "classical", "perfect")
    return grouped(sorted(cells, key=lambda cell: order.index(cell.kind)), lambda cell: cell.controller)


def by_pair(pairs: Iterable[CellDifference]) -> dict[Any, list[CellDifference]]:
    """Group differences by the names of the two controllers."""
    return grouped(pairs, lambda pair: (pair.controller, pair.against))


def mean(items: Sequence[Cell] | Sequence[CellDifference]) -> Estimate | None:
    """Average one controller's cells [%] or differences [points], None of none.

    Cells are independent and count by their decisions, differences count alike. Trainings share their engagements, so
    the ends of their intervals are averaged: the interval is that of these very trainings.
    """
    if not items:
        return None
    means = []
    for own in grouped(list[Any](items), lambda item: (item.seed, getattr(item, "against_seed", None))).values():
        weights = [getattr(item, "decisions", 1.0) for item in own]
        means.append(weighted_mean([item.estimate for item in own], weights))
    value, low, high = (math.fsum(ends) / len(means) for ends in zip(*(each[:3] for each in means), strict=True))
    return Estimate(value, low, high, means[0].unit)


def rate_tables(cells: Iterable[Cell], tasks: Iterable[Task] = ()) -> tuple[Table, ...]:
    """Return a table per world, command limit, length and task, and where motions are few per motion.

    Rows are controllers. Below one are the spread of its trainings and its share of decisions without fire, where there
    are such; below all the paper's figures and the bounds.

    Args:
      cells: of any worlds.
      tasks: whose fields that are not as usual stand in the heading.
    """
    usual, changes, tables = Task().conditions(), dict[str, list[str]](), []
    for task in tasks:
        changes[task.name] = [f"{name} {value}" for name, value in task.conditions().items() if value != usual[name]]
    for title, part in _parts(cells):
        changed = changes.get(part[0].task)
        tables.append(_rate_table(f"{title}; {', '.join(changed)}" if changed else title, part))
    return tuple(tables)


def _rate_table(title: str, cells: list[Cell]) -> Table:
    columns, row = _pivot(cells)
    rows, controllers = [], by_controller(cells)
    for name, own in controllers.items():
        rows.append(row(controller_text(own), own, mean))
        rows += [row(f"{name} (seeds)", own, _seeds)] if len({cell.seed for cell in own}) > 1 else []
        rows += [row(f"{name} (no fire)", own, _withheld)] if any(cell.withheld for cell in own) else []
    if all(cell.table for cell in cells):
        any_own = next(iter(controllers.values()))
        rows.append(row("paper: PPO (printed)", any_own, lambda own: _printed(own, is_policy=True)))
        rows.append(row("paper: Kalman (printed)", any_own, lambda own: _printed(own, is_policy=False)))
    rows += [row(name, own, _bound) for name, own in bounds(cells).items()]
    engagements = sorted({cell.engagements for cell in cells})
    counted = " to ".join(f"{count:,}" for count in dict.fromkeys((engagements[0], engagements[-1])))
    moved = {name: max(cell.yaw_rad_s2 or 0.0 for cell in own) for name, own in controllers.items()}
    largest = ", ".join(f"{name} {number(value, 3)}" for name, value in moved.items() if value)
    note = f"{counted} engagements a cell."
    note += f" Largest acceleration of the yaw axis [rad/s²]: {largest}." if largest else ""
    return Table(title, ("controller", *columns), tuple(rows), note)


def mean_difference_tables(pairs: Iterable[CellDifference]) -> tuple[Table, ...]:
    """Return a table per world, command limit, length and task: mean difference of each pair, and in how many cells."""
    tables = []
    for place, part in grouped(pairs, lambda pair: pair.place).items():
        motions = list(grouped(part, lambda pair: pair.motion))
        shown = motions if 1 < len(motions) <= FEW else []
        rows = []
        for own in by_pair(part).values():
            means = [mean([pair for pair in own if pair.motion == motion]) for motion in shown]
            better, worse = sum(pair.low > 0 for pair in own), sum(pair.high < 0 for pair in own)
            rows.append((pair_text(own), *means, mean(own), better, worse, len(own)))
        columns = ("controllers", *shown, "all", "better", "worse", "cells")
        tables.append(Table(f"Paired differences in points: {place_text(*place)}", columns, tuple(rows)))
    return tuple(tables)


def bounds(cells: Iterable[Cell]) -> dict[str, list[Cell]]:
    """Return the bounds that differ: name → cells of one controller with it; that of most controllers is "bound"."""
    bounded = [cell for cell in cells if cell.bound is not None]
    alike: dict[Any, list[list[Cell]]] = {}
    for own in grouped(bounded, lambda cell: (cell.controller, cell.seed)).values():
        alike.setdefault(frozenset((cell.motion, cell.range_m, cell.bound) for cell in own), []).append(own)
    most = sorted(alike.values(), key=len, reverse=True)
    return {f"bound of {own[0][0].controller}" if place else "bound": own[0] for place, own in enumerate(most)}


def comparison_report(pairs: Sequence[CellDifference]) -> Report:
    """Return what is shown of one pair: its mean, and a table per place with a row per motion."""
    tables = []
    for place, part in grouped(pairs, lambda pair: pair.place).items():
        columns, row = _pivot(part, by_range=True)
        motions = grouped(part, lambda pair: pair.motion)
        rows = [row(motion, own, mean) for motion, own in motions.items()]
        rows += [row("all", part, mean)] if len(motions) > 1 else []
        tables.append(Table(f"{pair_text(part)} in points: {place_text(*place)}", ("targets", *columns), tuple(rows)))
    means = []
    # Cells of other lengths and limits have engagements in common, so there is no interval of their mean.
    for place, part in grouped(pairs, lambda pair: pair.place).items():
        interval = " (".join(entry_texts(mean(part)))
        means.append(f"{interval}) points in the mean of {len(part)} cells ({place_text(*place)})")
    headline = f"{pair_text(pairs)}: {'; '.join(means)}."
    return Report("Paired differences", headline, known=(INTERVAL, DIFFERENCES), tables=tuple(tables))


def _parts(cells: Iterable[Cell]) -> list[tuple[str, list[Cell]]]:
    """Split by world, command limit, length and task, and where motions are few by motion: title and cells."""
    parts: list[tuple[str, list[Cell]]] = []
    for place, found in grouped(cells, lambda cell: cell.place).items():
        motions = grouped(found, lambda cell: cell.motion)
        if len(motions) > FEW:
            parts.append((f"{len(motions)} motions, each the mean of its ranges: {place_text(*place)}", found))
            continue
        for motion, own in motions.items():
            table = f"Table {own[0].table}, " if all(cell.table for cell in own) else ""
            parts.append((f"{table}{motion} targets: {place_text(*place)}", own))
    return parts


def place_text(world: str, limit: str, length_s: float, task: str) -> str:
    """Write a world, command limit, length, and the name of a task whose conditions are not the usual ones."""
    return f"{world}, {f'task {task}, ' if task else ''}limit {limit}, engagements of {length_s:g} s"


def range_text(range_m: tuple[float, float]) -> str:
    """Write a range of distances."""
    return f"{range_m[0]:g}–{range_m[1]:g} m"


def _pivot(items: Sequence[Any], by_range: bool = False) -> tuple[tuple[str, ...], Callable[..., Any]]:
    """Return headings, and a function (name, items, show) that makes a row: a column per range or motion, and all."""
    by_range = by_range or len({item.motion for item in items}) <= FEW
    ranges = sorted({item.range_m for item in items})
    motions = list(dict.fromkeys(item.motion for item in items))
    keys: list[Any] = ranges if by_range else motions
    headings = [range_text(range_m) for range_m in ranges] if by_range else motions

    def row(name: str, own: list[Any], show: Show) -> tuple[Entry, ...]:
        entries: list[Entry] = [name]
        for key in keys:
            part = [item for item in own if (item.range_m if by_range else item.motion) == key]
            entries.append(show(part) if part else None)
        return (*entries, show(own)) if len(keys) > 1 else tuple(entries)

    return (*headings, *(["all"] if len(keys) > 1 else [])), row


def controller_text(own: Sequence[Cell] | Sequence[CellDifference]) -> str:
    """Return a controller's name, with the number of its trainings where there are several."""
    seeds = len({item.seed for item in own})
    return f"{own[0].controller}, {seeds} seeds" if seeds > 1 else own[0].controller


def pair_text(own: Sequence[CellDifference]) -> str:
    """Return the names of a pair."""
    return f"{controller_text(own)} − {own[0].against}"


def _seeds(own: list[Cell]) -> str:
    means = [mean(part) for part in grouped(own, lambda cell: cell.seed).values()]
    values = [estimate.value for estimate in means if estimate]
    return f"{min(values):.1f}–{max(values):.1f}"


def _withheld(own: list[Cell]) -> str:
    return f"{100 * sum(cell.withheld for cell in own) / sum(cell.decisions for cell in own):.1f}"


def _printed(own: list[Cell], *, is_policy: bool) -> str:
    rates = [printed_rate(cell.table or "", cell.range_m, "kalman-paper", is_policy=is_policy) for cell in own]
    return f"{sum(rate or 0.0 for rate in rates) / len(rates):.2f}"


def _bound(own: list[Cell]) -> str:
    error = 100 * math.hypot(*(cell.bound_error or 0.0 for cell in own)) / len(own)
    value = 100 * sum(cell.bound or 0.0 for cell in own) / len(own)
    return f"{value:.1f}" + (f" ±{error:.1f}" if error >= 0.05 else "")
