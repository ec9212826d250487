"""Where the policy stands among the classical controllers, by paired differences; a part of other benchmarks.

Against those that know no rule of how targets move, the whole 95 % interval must lie above zero where targets move at
2–5 m, and the difference must not be below −0.5 points elsewhere. Against the one that is given eq (7) itself, no
difference may be below −1 point.
"""

from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Console
from rich.table import Table

from archerfish.evaluation.comparison import cells_of, comparisons_of, policy_seeds
from archerfish.evaluation.results import Cell, Comparison

WITHOUT_RULE = ("kalman", "kalman-tuned", "kalman-lq", "imm-lq")
WITH_RULE = "parabola-lq"
POLICY = "history"
CLEARLY_ABOVE_FROM_M = 2.0
"""Moving targets from this distance on must be hit more often."""
MOST_BEHIND, MOST_BEHIND_RULE = 0.5, 1.0
"""Points by which the policy may be behind elsewhere."""


def places(
    comparisons: Iterable[Comparison], cells: Iterable[Cell], setting: str, limit: str, slack: float = 0.0
) -> Iterator[dict[str, Any]]:
    """Judge each training by itself.

    Args:
      comparisons: of results.json.
      cells: of results.json.
      setting: where.
      limit: command limit.
      slack: points by which each bar is lower.

    Yields:
      Seed, hit rates [%], shares of the bound [%], differences and lower ends [points] by controller, and which bars
      are missed, in words.
    """
    comparisons, cells = list(comparisons), list(cells)
    where = {"setting": setting, "command_limit": limit, "controller": POLICY}
    for seed in policy_seeds(comparisons, **where):
        mine = list(cells_of(cells, **where, policy_seed=seed).values())
        differences: dict[str, list[float]] = {}
        lower: dict[str, list[float]] = {}
        missed: list[str] = []
        for against in (*WITHOUT_RULE, WITH_RULE):
            pairs = comparisons_of(comparisons, against=against, **where, policy_seed=seed)
            if pairs:
                differences[against] = [round(100 * each.difference, 2) for each in pairs.values()]
                lower[against] = [round(100 * each.low, 2) for each in pairs.values()]
                missed += [words for each in pairs.values() if (words := _missed(each, against, slack))]
        yield {
            "setting": setting,
            "command_limit": limit,
            "training_seed": seed,
            "percent": [round(100 * each.rate, 2) for each in mine],
            "percent_of_bound": [each.bound and round(100 * each.rate / each.bound, 2) for each in mine],
            "points_above": differences,
            "points_above_at_least": lower,
            "missed": missed,
        }


def show(rows: list[dict[str, Any]]) -> None:
    """Print a line per training.

    Args:
      rows: as `places` yields them.
    """
    table = Table("setting", "limit", "seed", "%", "% of the bound", "points above, at least", "missed")
    for row in rows:
        shares = " ".join("–" if each is None else f"{each:.1f}" for each in row["percent_of_bound"])
        above = "\n".join(f"{name}: {' '.join(map(str, each))}" for name, each in row["points_above_at_least"].items())
        rates = " ".join(f"{each:.1f}" for each in row["percent"])
        where = (row["setting"], row["command_limit"], str(row["training_seed"]))
        table.add_row(*where, rates, shares, above, "\n".join(row["missed"]) or "none")
    Console(width=200).print(table)


def _missed(pair: Comparison, against: str, slack: float) -> str:
    moving = pair.target == "dynamic" and pair.range_m[0] >= CLEARLY_ABOVE_FROM_M
    if against == WITH_RULE:
        found, bar = pair.difference, -MOST_BEHIND_RULE
    elif moving:
        found, bar = pair.low, 0.0
    else:
        found, bar = pair.difference, -MOST_BEHIND
    if 100 * found > bar - slack:
        return ""
    low, high = pair.range_m
    end = "lower end" if against != WITH_RULE and moving else "difference"
    return f"{against}, {pair.target} {low:g}–{high:g} m: {end} {100 * found:+.2f}, bar {bar - slack:+.1f}"
