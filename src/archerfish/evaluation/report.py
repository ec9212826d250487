"""The report of an evaluation: headline, tables beside the paper's, paired differences, bounds and figures."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

from archerfish.evaluation import tables
from archerfish.evaluation.comparison import default_comparisons
from archerfish.evaluation.plots import hit_rates
from archerfish.records.json_files import plain
from archerfish.reports.report import Report
from archerfish.reports.table import entry_texts
from archerfish.task import DRAWN, Task

if TYPE_CHECKING:
    from archerfish.evaluation.comparison import CellDifference
    from archerfish.evaluation.results import Cell, Results

_PROVENANCE = ("seed", "commit", "versions", "robots", "motions", "tuning")
_LIMITS = {
    "box": "Limit box: only the angle ranges limit commands. The printed axes have no limit of speed or torque, so "
    "these figures are properties of the printed model, not of a robot.",
    "los-2deg": "Limit los-2deg: a yaw command is at most 2° from the line of sight. The paper prints no limit; this "
    "one is fitted to its PPO columns.",
}


def evaluation_report(results: Results) -> Report:
    """Return the report of an evaluation."""
    cells, pairs = results.cells, default_comparisons(results.cells)
    places = tables.grouped(cells, lambda cell: cell.place)
    names = tuple(tables.by_controller(cells))
    limits = {cell.command_limit for cell in cells}
    return Report(
        title="Hit rates: " + ", ".join(dict.fromkeys(cell.world for cell in cells)),
        headline=_headline(cells, pairs),
        known=(f"Seed {results.seed}, commit {results.commit}, {len(cells)} cells.", *_known(results, pairs)),
        doubts=(*results.remarks, *(_LIMITS[limit] for limit in _LIMITS if limit in limits), *_single_trainings(cells)),
        tables=(
            *tables.rate_tables(cells, results.tasks),
            *tables.mean_difference_tables(pairs),
        ),
        figures=tuple(
            (f"Hit rate against range: {tables.place_text(*place)}", functools.partial(hit_rates, own, names=names))
            for place, own in places.items()
        ),
        provenance={name: plain(getattr(results, name)) for name in _PROVENANCE} | {"seconds": results.durations},
    )


def _known(results: Results, pairs: Sequence[CellDifference]) -> list[str]:
    """Return what the figures of results mean, as far as there are such."""
    cells = results.cells
    several = any(len({cell.seed for cell in own}) > 1 for own in tables.by_controller(cells).values())
    said = [tables.RATES]
    said += [tables.SEEDS] if several else []
    said += [tables.PRINTED] if any(cell.table for cell in cells) else []
    said += [tables.DIFFERENCES, "results.compare(a, b) has those of any two controllers by cell."] if pairs else []
    said += [tables.BOUNDS] if any(cell.bound is not None for cell in cells) else []
    for name, facts in results.robots.items():
        whose = f"that controllers assume on {name}" if facts.get("world") else f"of {name}"
        said += [f"Muzzle {whose}: {facts['muzzle']}."] if facts.get("muzzle") else []
        said += [f"Assumed of {name}, not identified: {facts['assumed']}."] if facts.get("assumed") else []
    return said + [_conditions(task) for task in results.tasks]


def _conditions(task: Task) -> str:
    """Return what figures of a task depend on, and no table says."""
    said = f"Task {task.name}: a decision every {task.period_s:g} s, a hit within {task.hit_radius_m:g} m"
    is_at_our_speed = task.motion not in DRAWN
    return f"{said}, targets up to {task.max_speed_m_s:g} m/s." if is_at_our_speed else f"{said}."


def _headline(cells: Sequence[Cell], pairs: Sequence[CellDifference]) -> str:
    """Say how the first policy, or else the first controller, does under `gate`, if that is there."""
    places = tables.grouped(cells, lambda cell: cell.place)
    if not places:
        return "No controller was evaluated."
    place = min(places, key=lambda place: place[1] != "gate")
    name, own = next(iter(tables.by_controller(places[place]).items()))
    differences = []
    for (one, against), found in tables.by_pair(pair for pair in pairs if pair.place == place).items():
        if one == name:
            differences.append(f"{' ('.join(entry_texts(tables.mean(found)))}) to {against}")
    shares = [cell.rate / cell.bound for cell in own if cell.bound]
    rate, interval = entry_texts(tables.mean(own))
    controller, where = tables.controller_text(own), tables.place_text(*place)
    said = [f"{controller}: {rate}\u00a0% ({interval}) of all decisions hit ({where})"]
    said += [f"differences in points: {', '.join(differences)}"] if differences else []
    said += [f"in every cell at least {100 * min(shares):.1f}\u00a0% of the bound"] if shares else []
    return "; ".join(said) + "."


def _single_trainings(cells: Sequence[Cell]) -> list[str]:
    seeds: dict[str, set[int | None]] = {}
    for cell in cells:
        if cell.kind == "policy":
            seeds.setdefault(cell.controller, set()).add(cell.seed)
    note = "its intervals are over engagements, not over trainings."
    return [f"{name}: one training, seed {own.pop()}; {note}" for name, own in seeds.items() if len(own) == 1]
