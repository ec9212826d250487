"""The worlds of Tables IV and V: the simulator made from a robot's logs, the robot, and robots that have changed."""

from collections.abc import Iterable
from typing import NamedTuple

from archerfish.evaluation.report.wording import LIMITS
from archerfish.evaluation.results import Cell, Results

REAL = ("IV", "V")
"""The paper's tables of the real robot."""


class World(NamedTuple):
    """Where the shots of Tables IV and V were fired."""

    setting: str
    """Its name in the results."""
    role: str
    """`simulator`, `robot` or `changed`."""
    short: str
    """Name for columns and axes."""
    title: str
    """Name for headings."""
    meaning: str
    """What it is, in a sentence."""


def real_cells(results: Results) -> list[Cell]:
    """Return the cells of Tables IV and V."""
    return [cell for cell in results.cells if cell.table in REAL]


def shown_limit(cells: Iterable[Cell]) -> str:
    """Return the command limit that some cells are shown under: the first of the report's order that was shot."""
    shot = {cell.command_limit for cell in cells}
    return next((limit for limit in LIMITS if limit in shot), min(shot))


def worlds(results: Results) -> list[World]:
    """Return the worlds that Tables IV and V were shot in: simulator, robot, robots that have changed."""
    settings = list(dict.fromkeys(cell.setting for cell in real_cells(results)))
    simulators = [each for each in settings if each == "paper" or each.startswith("identified-")]
    robots = [each for each in settings if each not in simulators]
    main = results.robot.robot if results.robot and results.robot.robot in robots else next(iter(robots), "")
    return [
        *(_simulator(each) for each in simulators),
        *(_robot(each, changed=each != main) for each in sorted(robots, key=lambda each: each != main)),
    ]


def _simulator(setting: str) -> World:
    robot = setting.removeprefix("identified-")
    return World(
        setting,
        "simulator",
        "simulator",
        f"In the simulator made from the logs of “{robot}”",
        f"What the logs of the robot “{robot}” told, as a simulator ({setting}): linear axes, camera, link and muzzle "
        "as identified. The policies were trained in it, and the classical controllers tuned.",
    )


def _robot(setting: str, *, changed: bool) -> World:
    if changed:
        meaning = (
            f"The robot “{setting}” differs from the one whose logs were identified. The same policies and controllers "
            "shoot with it; only muzzle speed, scatter and boresight were set anew, from a burst at a plate."
        )
        return World(setting, "changed", setting, f"With “{setting}”, a robot that has changed since", meaning)
    meaning = (
        f"The robot “{setting}” itself. It is a virtual one, which stands in for a real one: MuJoCo physics, motors "
        "that saturate, its own firmware, camera, link and muzzle. Identification and training know it by its logs."
    )
    return World(setting, "robot", setting, f"With the robot “{setting}”", meaning)
