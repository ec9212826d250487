"""The sections of the report and their list."""

from collections.abc import Mapping, Sequence
from typing import Any

TITLES = {
    "reading": "How to read this page",
    "dispersion": "What dispersion alone leaves",
    "six-numbers": "The paper’s six numbers, and why they can’t lead",
    "table1": "Table I: where pellets fall",
    "fig4": "Fig. 4: the identified gimbal",
    "fig56": "Figs. 5 and 6: learning",
    "real": "Tables IV and V: on the robot",
    "robot-table1": "Table I on the robot",
    "robot-fig4": "Fig. 4 on the robot",
    "robot-told": "What the robot’s logs told",
    "conditions": "The conditions that we assume",
    "making": "How this page was made",
}
"""Anchor → heading; the sections of the command limits stand after the first."""

_PAPER = ("dispersion", "six-numbers", "table1", "fig4", "fig56")


def contents(limits: Sequence[tuple[str, str]], *, paper: bool, robot: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List anchor and heading of the sections that the page has, in its order.

    Args:
      limits: anchor and heading of the sections of the command limits.
      paper: whether the page has the paper's simulation on it.
      robot: what it says of the robot.
    """
    has = {
        "robot-table1": robot["landings"],
        "robot-fig4": robot["steps_figure"],
        "robot-told": robot["tables"],
        "real": paper or robot["shots"],
        **dict.fromkeys(_PAPER, paper),
    }
    found = [(anchor, title) for anchor, title in TITLES.items() if has.get(anchor, True)]
    return [found[0], *limits, *found[1:]]
