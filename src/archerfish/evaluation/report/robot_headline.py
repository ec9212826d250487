"""What the report says first about the robot: the policy beside Kalman and the oracle there, and the drop to it."""

from archerfish.evaluation.comparison import CellKey, cells_of, comparisons_of
from archerfish.evaluation.pooling import Estimate, pooled_cells, pooled_differences
from archerfish.evaluation.report.drop_tables import pooled_drop
from archerfish.evaluation.report.headline import Headline, withheld_sentence
from archerfish.evaluation.report.rate_drawings import rates_drawing
from archerfish.evaluation.report.wording import LIMITS, controller_words
from archerfish.evaluation.report.worlds import World, real_cells, shown_limit, worlds
from archerfish.evaluation.results import Cell, Results
from archerfish.figures.page import percent, points

_NAMES = {
    "history": "the trained policy hits {} of its shots with the robot “{}”",
    "paper": "the policy of the paper’s six numbers {}",
    "kalman": "the Kalman filter {}",
    "oracle": "an oracle that knows the target’s path {}",
}


def robot_headline(results: Results) -> Headline | None:
    """Open the page of a run that shot with a robot; None if no policy did."""
    found = _robot(results)
    if found is None:
        return None
    world, limit = found
    cells = [cell for cell in real_cells(results) if (cell.setting, cell.command_limit) == (world.setting, limit)]
    opening = LIMITS[limit].opening if limit in LIMITS else f"Under the limit {limit}"
    sentence = (
        f"{opening}, {_rates(results, world, limit)} (95 % intervals; all {_count(results, world, limit)} cells "
        f"together).{withheld_sentence(_picked(results, world, limit))}{_differences(results, world, limit)}"
        f"{_drops(results, limit)} "
        "The robot is a virtual one, which stands in for a real one."
    )
    return Headline(
        sentence=_unbroken(sentence),
        caption=f"With the robot “{world.setting}”, command limit {limit}, "
        f"{min(cell.engagements for cell in cells)} engagements a cell.",
        drawing=rates_drawing(cells, ("history", "kalman", "kalman-lq", "oracle"), printed=False),
    )


def robot_sentence(results: Results) -> str:
    """Say in two sentences, after what the paper's setting showed, how it went on the robot; nothing if it didn't."""
    found = _robot(results)
    if found is None:
        return ""
    world, limit = found
    return _unbroken(
        f"Known by its logs alone, a virtual robot stands in for the real one: {_rates(results, world, limit)}."
        f"{withheld_sentence(_picked(results, world, limit))}{_drops(results, limit)}"
    )


def _robot(results: Results) -> tuple[World, str] | None:
    """Return the robot that is not a changed one, and the limit, if a history policy shot with it."""
    world = next((each for each in worlds(results) if each.role == "robot"), None)
    if world is None:
        return None
    shot = [cell for cell in real_cells(results) if (cell.setting, cell.controller) == (world.setting, "history")]
    return (world, shown_limit(shot)) if shot else None


def _count(results: Results, world: World, limit: str) -> int:
    return len(cells_of(real_cells(results), setting=world.setting, command_limit=limit, controller="history"))


def _rates(results: Results, world: World, limit: str) -> str:
    said = []
    for name, picked in _picked(results, world, limit).items():
        rate = pooled_cells(picked.values())
        if rate is not None:
            hits = f"{percent(rate.value)} % ({percent(rate.low)}–{percent(rate.high)})"
            said.append(_NAMES[name].format(hits, world.setting))
    return ", ".join(said)


def _picked(results: Results, world: World, limit: str) -> dict[str, dict[CellKey, Cell]]:
    return {
        name: cells_of(real_cells(results), setting=world.setting, command_limit=limit, controller=name)
        for name in _NAMES
    }


def _differences(results: Results, world: World, limit: str) -> str:
    said = []
    for against in ("kalman", "kalman-lq", "imm-lq", "parabola-lq"):
        picked = comparisons_of(
            results.comparisons, setting=world.setting, command_limit=limit, controller="history", against=against
        )
        found = pooled_differences([each for key, each in picked.items() if key[0] in {"IV", "V"}])
        if found is not None:
            said.append(f"{_verdict(found)} {_against(against)}, {_interval(found)}")
    return f" In the same engagements the policy is {'; '.join(said)}." if said else ""


def _against(controller: str) -> str:
    return "the Kalman filter" if controller == "kalman" else controller_words(controller).name


def _verdict(found: Estimate) -> str:
    if found.low > 0:
        return "ahead of"
    return "behind" if found.high < 0 else "not to be distinguished from"


def _drops(results: Results, limit: str) -> str:
    """Say how far the policy falls from the simulator to every robot."""
    words = {"robot": "to the robot", "changed": "to “{}”, a robot that has changed since"}
    said = [
        f"{_interval(found)} {words[world.role].format(world.setting)}"
        for world in worlds(results)
        if world.role in words and (found := pooled_drop(results.drops, world.setting, limit, "history")) is not None
    ]
    return f" From the simulator made from its logs the policy’s rate drops by {' and by '.join(said)}." if said else ""


def _interval(found: Estimate) -> str:
    return f"{points(found.value)} points ({points(found.low)} to {points(found.high)})"


def _unbroken(sentence: str) -> str:
    return sentence.replace(" %", "\u00a0%")
