"""Figures of hit rates for the report: controllers over the ranges, static and dynamic side by side."""

import math
from collections.abc import Sequence

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import cells_of
from archerfish.evaluation.report.rate_tables import fired_shots_count
from archerfish.evaluation.report.wording import controller_words
from archerfish.evaluation.results import TARGETS, Cell
from archerfish.figures.hit_rates import RateCurve, RatePanel, hit_rate_figure
from archerfish.figures.page import bins


def rates_drawing(cells: Sequence[Cell], controllers: Sequence[str], *, printed: bool = True) -> Figure:
    """Draw hit rate against range, static and dynamic targets side by side.

    Args:
      cells: of one setting and command limit, at least one.
      controllers: those to draw, where they were measured.
      printed: whether to draw the paper's columns beside them.
    """
    targets = [target for target in TARGETS if any(cell.target == target for cell in cells)]
    own = {cell.target: cell.motion for cell in cells if cell.motion}
    return hit_rate_figure(
        [
            _panel(
                [cell for cell in cells if cell.target == each], controllers, printed, own.get(each, each.capitalize())
            )
            for each in targets
        ]
    )


def motions_drawing(cells: Sequence[Cell], controllers: Sequence[str]) -> Figure:
    """Draw hit rate against range, a panel per motion.

    Args:
      cells: of one setting, command limit and length of engagements, at least one; of targets with a motion by name.
      controllers: those to draw, where they were measured.
    """
    motions = list(dict.fromkeys(cell.motion for cell in cells))
    panels = [
        _panel([cell for cell in cells if cell.motion == each], controllers, False, str(each).capitalize())
        for each in motions
    ]
    across = min(_ACROSS, len(panels))
    return hit_rate_figure(panels, height=1.2 + 2.5 * -(-len(panels) // across), columns=across)


_ACROSS = 4
"""Panels side by side at most."""


def _panel(cells: Sequence[Cell], controllers: Sequence[str], printed: bool, target: str) -> RatePanel:
    ranges = sorted({cell.range_m for cell in cells})
    setting, limit = cells[0].setting, cells[0].command_limit
    curves = []
    for controller in controllers:
        picked = cells_of(cells, setting=setting, command_limit=limit, controller=controller)
        by_range = {cell.range_m: cell for cell in picked.values()}
        curves += [_curve(controller, [by_range.get(each) for each in ranges])] if by_range else []
    for controller, name in (("history", "Paper, PPO"), ("kalman", "Paper, Kalman")) if printed else ():
        papers = {
            cell.range_m: cell.paper for cell in cells if cell.controller == controller and cell.paper is not None
        }
        if papers:
            values = [papers.get(each, math.nan) for each in ranges]
            curves.append(RateCurve(name, controller_words(controller).style, values))
    counted = ", per fired shot" if fired_shots_count(cells) else ""
    return RatePanel(f"{target} targets{counted}", [bins(each) for each in ranges], curves)


def _curve(controller: str, cells: Sequence[Cell | None]) -> RateCurve:
    def scaled(name: str) -> list[float]:
        return [math.nan if cell is None else 100 * float(getattr(cell, name)) for cell in cells]

    words = controller_words(controller)
    return RateCurve(words.name, words.style, scaled("rate"), scaled("low"), scaled("high"))
