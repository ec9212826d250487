"""Tables of hit rates and paired differences: controllers against ranges, or against motions where these are many."""

import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from archerfish2.evaluation.hit_rate import weighted_mean
from archerfish2.evaluation.published import conditions
from archerfish2.evaluation.results import Cell, Comparison
from archerfish2.reports.table import WIDTH, Entry, Estimate, Table, tables_text
from archerfish2.task import Task

if TYPE_CHECKING:
    from archerfish2.evaluation.results import Results

FEW = 2
"""So many motions have a table each, as in the paper; more of them share one, each the mean of its ranges."""

Item = TypeVar("Item", Cell, Comparison)
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
    found: dict[Any, list[Item]] = {}
    for each in items:
        found.setdefault(key(each), []).append(each)
    return found


def by_controller(cells: Iterable[Cell]) -> dict[str, list[Cell]]:
    """Group cells by the controller's name: policies, users' controllers, classical ones, perfect aim."""
    order = ("policy", "user", "classical", "perfect")
    return grouped(sorted(cells, key=lambda each: order.index(each.kind)), lambda each: each.controller)


def mean(found: Sequence[Cell] | Sequence[Comparison]) -> Estimate | None:
    """Average one controller's cells [%] or differences [points], None of none.

    Cells are independent and count by their decisions, differences count alike. Trainings share their engagements, so
    the ends of their intervals are averaged: the interval is that of these very trainings.
    """
    if not found:
        return None
    by_seed = grouped(list[Any](found), lambda each: each.seed).values()
    means = [weighted_mean(*zip(*map(_weighted, own), strict=True)) for own in by_seed]
    value, low, high = (math.fsum(ends) / len(means) for ends in zip(*(each[:3] for each in means), strict=True))
    return Estimate(value, low, high, means[0].unit)


def _weighted(each: Cell | Comparison) -> tuple[Estimate, float]:
    if isinstance(each, Cell):
        return Estimate(100 * each.rate, 100 * each.low, 100 * each.high, "%"), each.decisions
    return Estimate(100 * each.difference, 100 * each.low, 100 * each.high, "points"), 1.0


def rate_tables(cells: Iterable[Cell], robots: Mapping[str, Mapping[str, str]] | None = None) -> tuple[Table, ...]:
    """Return a table per world, command limit and length, and where motions are few per motion: rows are controllers.

    Below a controller are the spread of its trainings and its share of decisions without fire, where there are such;
    below all the paper's figures and the bounds.

    Args:
      cells: of any worlds.
      robots: of `Results`: conditions unlike the paper's stand in the heading.
    """
    usual, tables = conditions(Task()), []
    for title, part in _parts(cells):
        facts = usual | dict((robots or {}).get(part[0].world, {}))
        changed = [f"{name} {facts[name]}" for name in usual if facts[name] != usual[name]]
        tables.append(_rate_table(f"{title}; {', '.join(changed)}" if changed else title, part))
    return tuple(tables)


def _rate_table(title: str, cells: list[Cell]) -> Table:
    columns, row = _pivot(cells)
    rows = []
    for name, own in by_controller(cells).items():
        rows.append(row(controller_text(own), own, mean))
        rows += [row(f"{name} (seeds)", own, _seeds)] if len({each.seed for each in own}) > 1 else []
        rows += [row(f"{name} (no fire)", own, _withheld)] if any(each.withheld for each in own) else []
    for method, kind in (("PPO", "policy"), ("Kalman", "classical")):
        own = [cell for cell in cells if cell.kind == kind and cell.paper is not None]
        rows += [row(f"paper: {method} (printed)", own, _printed)] if own else []
    rows += [row(name, found, _bound) for name, found in bounds(cells).items()]
    engagements = sorted({each.engagements for each in cells})
    counted = " to ".join(f"{count:,}" for count in dict.fromkeys((engagements[0], engagements[-1])))
    return Table(title, ("controller", *columns), tuple(rows), f"{counted} engagements a cell.")


def difference_tables(comparisons: Iterable[Comparison]) -> tuple[Table, ...]:
    """Return the differences in points, laid out as the rates are: rows are pairs."""
    tables = []
    for title, part in _parts(comparisons):
        columns, row = _pivot(part)
        pairs = grouped(part, lambda each: (each.controller, each.against)).values()
        rows = tuple(row(f"{controller_text(own)} − {own[0].against}", own, mean) for own in pairs)
        tables.append(Table(f"Differences, {title}", ("controllers", *columns), rows))
    return tuple(tables)


def mean_difference_tables(comparisons: Iterable[Comparison]) -> tuple[Table, ...]:
    """Return one table per world, command limit and length: the mean difference of each pair, and in how many cells."""
    tables = []
    for place, part in grouped(comparisons, lambda each: each.place).items():
        motions = list(grouped(part, lambda each: each.motion))
        shown = motions if 1 < len(motions) <= FEW else []
        rows = []
        for own in grouped(part, lambda each: (each.controller, each.against)).values():
            means = [mean([each for each in own if each.motion == motion]) for motion in shown]
            better, worse = sum(each.low > 0 for each in own), sum(each.high < 0 for each in own)
            rows.append((f"{controller_text(own)} − {own[0].against}", *means, mean(own), better, worse, len(own)))
        columns = ("controllers", *shown, "all", "better", "worse", "cells")
        tables.append(Table(f"Paired differences in points: {place_text(*place)}", columns, tuple(rows)))
    return tuple(tables)


def bounds(cells: Iterable[Cell]) -> dict[str, list[Cell]]:
    """Return the bounds that differ: name → cells of one controller with it; that of most controllers is "bound"."""
    bounded = (each for each in cells if each.bound is not None)
    alike: dict[Any, list[list[Cell]]] = {}
    for own in grouped(bounded, lambda each: (each.controller, each.seed)).values():
        alike.setdefault(frozenset((each.motion, each.range_m, each.bound) for each in own), []).append(own)
    most = sorted(alike.values(), key=len, reverse=True)
    return {f"bound of {own[0][0].controller}" if place else "bound": own[0] for place, own in enumerate(most)}


def results_text(results: "Results") -> str:
    """Return what is printed of results: rates, mean differences of what isn't classical, and what they mean."""
    learned = {each.controller for each in results.cells if each.kind in ("policy", "user")}
    pairs = [each for each in results.comparisons if not learned or each.controller in learned]
    head = f"Results: seed {results.seed}, commit {results.commit}, {len(results.cells)} cells"
    tables = tables_text((*rate_tables(results.cells, results.robots), *mean_difference_tables(pairs)))
    last = [*notes(results), *(["results.compare(a, b) has the differences by cell."] if pairs else [])]
    remarks = (textwrap.fill(remark, WIDTH) for remark in results.remarks)
    return "\n\n".join(part for part in (head, tables, *remarks, textwrap.fill(" ".join(last), WIDTH)) if part)


def notes(results: "Results") -> list[str]:
    """Return what the figures of results mean, as far as there are such."""
    seeds = any(len({each.seed for each in own}) > 1 for own in by_controller(results.cells).values())
    said = {
        RATES: True,
        SEEDS: seeds,
        PRINTED: any(each.paper is not None for each in results.cells),
        DIFFERENCES: bool(results.comparisons),
        BOUNDS: any(each.bound is not None for each in results.cells),
    }
    assumed = [
        f"Assumed of {n}, not identified: {f['assumed']}." for n, f in results.robots.items() if f.get("assumed")
    ]
    return [text for text, is_there in said.items() if is_there] + assumed


def comparisons_text(comparisons: Iterable[Comparison]) -> str:
    """Return what is printed of one pair: a table per world, command limit and length, with a row per motion."""
    tables = []
    for place, part in grouped(comparisons, lambda each: each.place).items():
        columns, row = _pivot(part, by_range=True)
        motions = grouped(part, lambda each: each.motion)
        rows = [row(motion, own, mean) for motion, own in motions.items()]
        rows += [row("all", part, mean)] if len(motions) > 1 else []
        title = f"{controller_text(part)} − {part[0].against} in points: {place_text(*place)}"
        tables.append(Table(title, ("targets", *columns), tuple(rows)))
    return "\n\n".join([tables_text(tables), textwrap.fill(f"{INTERVAL} {DIFFERENCES}", WIDTH)])


def _parts(items: Iterable[Item]) -> list[tuple[str, list[Item]]]:
    """Split by world, command limit and length, and where motions are few by motion: title and items."""
    parts: list[tuple[str, list[Item]]] = []
    for place, found in grouped(items, lambda each: each.place).items():
        motions = grouped(found, lambda each: f"{each.motion} targets")
        if len(motions) > FEW:
            motions = {f"{len(motions)} motions, each the mean of its ranges": found}
        for name, own in motions.items():
            tables = {each.table if isinstance(each, Cell) else None for each in own}
            table = tables.pop() if len(tables) == 1 else None
            parts.append((f"{f'Table {table}, ' if table else ''}{name}: {place_text(*place)}", own))
    return parts


def place_text(world: str, limit: str, length_s: float) -> str:
    """Write a world, command limit and length."""
    return f"{world}, limit {limit}, engagements of {length_s:g} s"


def range_text(range_m: tuple[float, float]) -> str:
    """Write a range of distances."""
    return f"{range_m[0]:g}–{range_m[1]:g} m"


def _pivot(
    items: Sequence[Cell] | Sequence[Comparison], by_range: bool = False
) -> tuple[tuple[str, ...], Callable[..., Any]]:
    """Return headings, and a function (name, items, show) that makes a row: a column per range or motion, and all."""
    by_range = by_range or len({each.motion for each in items}) <= FEW
    keys = sorted({each.range_m for each in items}) if by_range else list(dict.fromkeys(each.motion for each in items))

    def row(name: str, own: list[Any], show: Show) -> tuple[Entry, ...]:
        parts = [[each for each in own if (each.range_m if by_range else each.motion) == key] for key in keys]
        return (name, *(show(part) if part else None for part in parts), *([show(own)] if len(keys) > 1 else []))

    headings = [range_text(key) if isinstance(key, tuple) else key for key in keys]
    return (*headings, *(["all"] if len(keys) > 1 else [])), row


def controller_text(own: Sequence[Cell] | Sequence[Comparison]) -> str:
    """Return a controller's name, with the number of its trainings where there are several."""
    seeds = len({each.seed for each in own})
    return own[0].controller + (f", {seeds} seeds" if seeds > 1 else "")


def _seeds(own: list[Cell]) -> str:
    values = [found.value for part in grouped(own, lambda each: each.seed).values() if (found := mean(part))]
    return f"{min(values):.1f}–{max(values):.1f}"


def _withheld(own: list[Cell]) -> str:
    return f"{100 * sum(each.withheld for each in own) / sum(each.decisions for each in own):.1f}"


def _printed(own: list[Cell]) -> str:
    return f"{sum(cell.paper or 0.0 for cell in own) / len(own):.2f}"


def _bound(own: list[Cell]) -> str:
    error = 100 * math.hypot(*(each.bound_error or 0.0 for each in own)) / len(own)
    value = 100 * sum(each.bound or 0.0 for each in own) / len(own)
    return f"{value:.1f}" + (f" ±{error:.1f}" if error >= 0.05 else "")
