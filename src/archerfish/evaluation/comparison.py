"""Our cells beside the paper's columns, the oracle and the other controllers."""

import math
from collections.abc import Iterable, Mapping
from typing import TypeAlias, TypeVar

from archerfish.evaluation.results import Cell, Comparison, Drop, Label

AnyLabel = TypeVar("AnyLabel", bound=Label)

CellKey: TypeAlias = tuple[str, tuple[float, float]]
"""Table and range: one of the cells that every controller is measured in."""


def policy_seeds(
    labels: Iterable[Label], *, command_limit: str, controller: str, setting: str = "paper"
) -> tuple[int | None, ...]:
    """Return the seeds of a controller's policies, lowest first; (None,) for one without training, () for none at all.

    Args:
      labels: cells or comparisons.
      command_limit: `box`, `gate` or `los-2deg`.
      controller: its name.
      setting: where it was measured.
    """
    wanted = (setting, command_limit, controller)
    found = {each.policy_seed for each in labels if (each.setting, each.command_limit, each.controller) == wanted}
    return tuple(sorted(found, key=lambda seed: -1 if seed is None else seed))


def cells_of(
    cells: Iterable[Cell],
    *,
    command_limit: str,
    controller: str,
    setting: str = "paper",
    policy_seed: int | None = None,
) -> dict[CellKey, Cell]:
    """Pick the cells of one controller.

    Args:
      cells: of results.json.
      command_limit: `box`, `gate` or `los-2deg`.
      controller: its name.
      setting: where it was measured.
      policy_seed: which of several policies; by default the one with the lowest seed, a choice that no result can sway.

    Returns:
      Table and range → cell, in the order of `cells`; empty if there are none.
    """
    return _picked(cells, policy_seed, command_limit=command_limit, controller=controller, setting=setting)


def comparisons_of(
    comparisons: Iterable[Comparison],
    *,
    against: str,
    command_limit: str,
    controller: str,
    setting: str = "paper",
    policy_seed: int | None = None,
) -> dict[CellKey, Comparison]:
    """Pick the paired differences of one controller to the controller named `against`; the rest as in `cells_of`."""
    pairs = [each for each in comparisons if each.against == against]
    return _picked(pairs, policy_seed, command_limit=command_limit, controller=controller, setting=setting)


def drops_of(
    drops: Iterable[Drop],
    *,
    settled: bool,
    command_limit: str,
    controller: str,
    setting: str,
    policy_seed: int | None = None,
) -> dict[CellKey, Drop]:
    """Pick how far one controller falls from the simulator to the robot `setting`; the rest as in `cells_of`.

    Args:
      drops: of results.json.
      settled: whether those of the settled shots alone, or of all shots.
      command_limit: `box`, `gate` or `los-2deg`.
      controller: its name.
      setting: the robot.
      policy_seed: which of several policies; by default the one with the lowest seed.
    """
    kept = [each for each in drops if each.settled == settled]
    return _picked(kept, policy_seed, command_limit=command_limit, controller=controller, setting=setting)


def _picked(labels: Iterable[AnyLabel], policy_seed: int | None, **where: str) -> dict[CellKey, AnyLabel]:
    labels = list(labels)
    if policy_seed is None:
        policy_seed = next(iter(policy_seeds(labels, **where)), None)
    wanted = (where["setting"], where["command_limit"], where["controller"], policy_seed)
    return {
        (each.table, each.range_m): each
        for each in labels
        if (each.setting, each.command_limit, each.controller, each.policy_seed) == wanted
    }


def rmse_to_paper(cells: Iterable[Cell]) -> float | None:
    """Return the root mean square difference to the paper's figures [percentage points], None where it prints none."""
    squares = [(100 * cell.rate - cell.paper) ** 2 for cell in cells if cell.paper is not None]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def shares(cells: Mapping[CellKey, Cell], oracle: Mapping[CellKey, Cell]) -> dict[CellKey, float]:
    """Return each hit rate as a share of the oracle's in the same cell.

    Cells without a shot, or without an oracle that hits, are left out.

    Args:
      cells: of one controller, by table and range.
      oracle: of the oracle under the same command limit.
    """
    hitting = {key: cell for key, cell in oracle.items() if cell.hits}
    return {key: cell.rate / hitting[key].rate for key, cell in cells.items() if cell.counted and key in hitting}


def bound_shares(cells: Mapping[CellKey, Cell]) -> dict[CellKey, float]:
    """Return each hit rate as a share of its bound; cells without one are left out."""
    return {key: cell.rate / cell.bound for key, cell in cells.items() if cell.bound}


def pooled_rate(cells: Iterable[Cell]) -> float | None:
    """Return the hits of all cells per shot of all cells that counts, None without any."""
    counts = [(cell.hits, cell.counted) for cell in cells]
    shots = sum(shots for _, shots in counts)
    return sum(hits for hits, _ in counts) / shots if shots else None


def clearly_above(comparisons: Iterable[Comparison]) -> int:
    """Count the cells in which the whole interval of the difference lies above zero."""
    return sum(each.low > 0 for each in comparisons)
