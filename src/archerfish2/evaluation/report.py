"""The report of an evaluation: headline, tables beside the paper's, paired differences, bounds and figures."""

import functools
import math
from collections.abc import Callable, Sequence

from archerfish2.evaluation import tables
from archerfish2.evaluation.plots import hit_rates
from archerfish2.evaluation.results import Cell, Results
from archerfish2.records.json_files import plain
from archerfish2.reports.report import Report
from archerfish2.reports.table import Table, entry_texts

_PROVENANCE = ("seed", "commit", "versions", "robots", "tuning")
_LIMITS = {
    "box": "Limit box: only the angle ranges limit commands. The printed axes have no limit of speed or torque, so "
    "these figures are properties of the printed model, not of a robot.",
    "los-2deg": "Limit los-2deg: a yaw command is at most 2° from the line of sight. The paper prints no limit; this "
    "one is fitted to its PPO columns.",
}


def evaluation_report(results: Results) -> Report:
    """Return the report of an evaluation."""
    cells, pairs = results.cells, results.comparisons
    places = tables.grouped(cells, lambda each: each.place)
    names = tuple(tables.by_controller(cells))
    limits = {each.command_limit for each in cells}
    return Report(
        title="Hit rates: " + ", ".join(dict.fromkeys(each.world for each in cells)),
        headline=_headline(results),
        known=tuple(tables.notes(results)),
        doubts=(*results.remarks, *(_LIMITS[limit] for limit in _LIMITS if limit in limits), *_single_trainings(cells)),
        tables=(
            *tables.rate_tables(cells, results.robots),
            *tables.mean_difference_tables(pairs),
            *tables.difference_tables(pairs),
            *_by_place("Distance to the paper's figures, root mean square [points]", cells, _to_paper),
            *_by_place("Largest mean acceleration of the yaw axis over a period [rad/s²]", cells, _acceleration),
        ),
        figures=tuple(
            (f"Hit rate against range: {tables.place_text(*place)}", functools.partial(hit_rates, own, names=names))
            for place, own in places.items()
        ),
        provenance={name: plain(getattr(results, name)) for name in _PROVENANCE} | {"seconds": results.durations},
    )


def _headline(results: Results) -> str:
    """Say how the first policy, or else the first controller, does under `gate`, if that is there."""
    places = tables.grouped(results.cells, lambda each: each.place)
    if not places:
        return "No controller was evaluated."
    place = min(places, key=lambda each: each[1] != "gate")
    name, own = next(iter(tables.by_controller(places[place]).items()))
    pairs = [each for each in results.comparisons if (each.place, each.controller) == (place, name)]
    differences = [
        f"{' ('.join(entry_texts(tables.mean(found)))}) to {against}"
        for against, found in tables.grouped(pairs, lambda each: each.against).items()
    ]
    shares = [each.rate / each.bound for each in own if each.bound]
    rate, interval = entry_texts(tables.mean(own))
    said = [
        f"{tables.controller_text(own)}: {rate}\u00a0% ({interval}) of all decisions hit ({tables.place_text(*place)})"
    ]
    said += [f"differences in points: {', '.join(differences)}"] if differences else []
    said += [f"in every cell at least {100 * min(shares):.1f}\u00a0% of the bound"] if shares else []
    return "; ".join(said) + "."


def _single_trainings(cells: Sequence[Cell]) -> list[str]:
    policies = tables.by_controller([each for each in cells if each.kind == "policy"])
    seeds = {name: {each.seed for each in own} for name, own in policies.items()}
    return [
        f"{name}: one training, seed {found.pop()}; its intervals are over engagements, not over trainings."
        for name, found in seeds.items()
        if len(found) == 1
    ]


def _by_place(title: str, cells: Sequence[Cell], value: Callable[[list[Cell]], float | None]) -> list[Table]:
    """Return a table of controllers against worlds, command limits and lengths; none without any value."""
    places = list(tables.grouped(cells, lambda each: each.place))
    rows = [
        (name, *(value([each for each in own if each.place == at]) for at in places))
        for name, own in tables.by_controller(cells).items()
    ]
    kept = tuple(row for row in rows if any(each is not None for each in row[1:]))
    return [Table(title, ("controller", *(tables.place_text(*each) for each in places)), kept)] if kept else []


def _to_paper(cells: list[Cell]) -> float | None:
    squares = [(100 * each.rate - each.paper) ** 2 for each in cells if each.paper is not None]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def _acceleration(cells: list[Cell]) -> float | None:
    return max((each.yaw_rad_s2 for each in cells if each.yaw_rad_s2 is not None), default=None)
