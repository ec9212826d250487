"""What the report opens with: the policies, the classical controllers and what is possible."""

from collections.abc import Mapping
from typing import NamedTuple

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import (
    CellKey,
    bound_shares,
    cells_of,
    clearly_above,
    comparisons_of,
    pooled_rate,
    shares,
)
from archerfish.evaluation.report.rate_drawings import rates_drawing
from archerfish.evaluation.report.rate_tables import fired_shots_count
from archerfish.evaluation.report.wording import LIMITS, controller_words, fallback_sentence
from archerfish.evaluation.results import Cell, Comparison, Results
from archerfish.figures.page import percent, points


class Headline(NamedTuple):
    """What the page opens with."""

    sentence: str
    """The finding, with its figures."""
    caption: str
    """What the figure shows."""
    drawing: Figure
    """The policy, the Kalman filter without and with the plant, and the oracle."""


def headline(results: Results, setting: str) -> Headline | None:
    """Say how the policy does beside the other controllers and the bound, under `gate` if it was shot there.

    Returns:
      None if neither a history policy nor one for any target was evaluated.
    """
    simulated = [each for each in results.cells if each.setting == setting and each.table in {"II", "III"}]
    # The policy for the paper's targets, or where there is none, that for any.
    mine = next((name for name in ("history", "policy") if any(each.controller == name for each in simulated)), "")
    shot = {each.command_limit for each in simulated if each.controller == mine}
    limits = [limit for limit in LIMITS if limit in shot]
    if not limits:
        return None
    limit = limits[0]
    cells = [each for each in simulated if each.command_limit == limit]
    picked = {
        name: cells_of(cells, setting=setting, command_limit=limit, controller=name)
        for name in (mine, "paper", "kalman", "oracle")
    }
    differences = comparisons_of(
        results.comparisons, setting=setting, command_limit=limit, controller=mine, against="kalman"
    )
    informed = [
        (
            name,
            comparisons_of(results.comparisons, setting=setting, command_limit=limit, controller=mine, against=name),
        )
        for name in ("kalman-tuned", "kalman-lq", "imm-lq", "parabola-lq")
    ]
    sentence = (
        f"{LIMITS[limit].opening}, {_rates_sentence(picked, mine)}{withheld_sentence(picked)}"
        f"{fallback_sentence(picked[mine].values())}"
        f"{_margin_sentence(picked, differences, mine)}"
        f"{''.join(_informed_sentence(name, pairs) for name, pairs in informed if pairs)}"
    )
    return Headline(
        sentence=sentence.replace(" %", "\u00a0%"),
        caption=f"Command limit {limit}, {min(cell.engagements for cell in cells)} engagements a cell.",
        drawing=rates_drawing(cells, (mine, "kalman", "kalman-lq", "oracle"), printed=False),
    )


def _rates_sentence(picked: Mapping[str, Mapping[CellKey, Cell]], mine: str) -> str:
    phrases = {
        mine: "the trained policy hits {} % of its shots",
        "paper": "the policy of the paper’s six numbers {} %",
        "kalman": "the Kalman filter {} %",
        "oracle": "an oracle that knows path and plant {} %",
    }
    rates = {name: pooled_rate(cells.values()) for name, cells in picked.items()}
    said = [phrases[name].format(percent(rate)) for name, rate in rates.items() if rate is not None]
    return ", ".join(said) + f" (all {len(picked[mine])} cells together)."


def withheld_sentence(picked: Mapping[str, Mapping[CellKey, Cell]]) -> str:
    """Say how many decisions stand behind rates of fired shots; nothing where every decision counts.

    Args:
      picked: controller → its cells.
    """
    if not any(fired_shots_count(cells.values()) for cells in picked.values()):
        return ""
    said = []
    for name, cells in picked.items():
        shots, withheld = (sum(getattr(cell, each) for cell in cells.values()) for each in ("shots", "withheld"))
        if shots + withheld:
            said.append(f"{controller_words(name).name} {percent(withheld / (shots + withheld))} %")
    return f" Withheld were, of all decisions: {', '.join(said)}."


def _informed_sentence(against: str, differences: Mapping[CellKey, Comparison]) -> str:
    """Say how the policy does against one of the stronger classical controllers."""
    ahead, behind = clearly_above(differences.values()), sum(each.high < 0 for each in differences.values())
    ends = sorted(each.difference for each in differences.values())
    return (
        f" Against {controller_words(against).name} it is clearly ahead in {ahead} cells "
        f"and clearly behind in {behind} ({points(ends[0])} to {points(ends[-1])} points)."
    )


def _margin_sentence(
    picked: Mapping[str, Mapping[CellKey, Cell]], differences: Mapping[CellKey, Comparison], mine: str
) -> str:
    sentence = ""
    if differences:
        least = min(differences.values(), key=lambda each: each.difference)
        sentence += (
            f" It is above the Kalman filter in {clearly_above(differences.values())} of {len(differences)} cells with "
            f"the paired interval clear of zero; the smallest difference is {points(least.difference)} points "
            f"({points(least.low)} to {points(least.high)})."
        )
    portions = shares(picked[mine], picked["oracle"])
    if portions:
        sentence += f" In every cell it reaches at least {percent(min(portions.values()))} % of the oracle’s rate"
        of_bound = bound_shares(picked[mine])
        sentence += f", and {percent(min(of_bound.values()))} % of what is proven possible." if of_bound else "."
    return sentence
