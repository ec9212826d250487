"""What the report calls controllers, command limits and conditions."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from archerfish.evaluation.results import Cell
from archerfish.figures.page import bins, number, percent


class ControllerWords(NamedTuple):
    """How a controller appears in the report."""

    name: str
    """Name for tables and legends."""
    meaning: str
    """What it does, in a sentence."""
    style: int
    """Index into the palette of the figures."""


CONTROLLERS = {
    "history": ControllerWords(
        "History policy",
        "Trained in the simulator; sees more than one moment of target and gimbal, so it can tell velocities: in "
        "Tables II and III several frames, in Tables IV and V a tracker’s estimate and a long memory.",
        0,
    ),
    "policy": ControllerWords(
        "Policy of several trackers",
        "Trained in the simulator, by default on targets that stand still or move in any way; sees what several "
        "trackers side by side make of old and noisy sights, and the bearings of the last seconds.",
        5,
    ),
    "paper": ControllerWords("Six-number policy", "Trained by PPO; sees the paper’s six numbers.", 4),
    "kalman": ControllerWords(
        "Kalman filter",
        "The paper’s baseline: a constant-velocity Kalman filter leads the target by the pellet’s flight, "
        "and commands the angles that would meet it as if the gimbal followed at once.",
        1,
    ),
    "kalman-tuned": ControllerWords(
        "Kalman, tuned",
        "The same, but tuned for this gimbal and limit; the paper’s baseline has the settings that the assumed "
        "conditions were calibrated with.",
        1,
    ),
    "kalman-lq": ControllerWords(
        "Kalman + preview LQ",
        "The same filter, tuned, and commands that account for the gimbal’s identified dynamics: a strong classical "
        "baseline. What it gains over the Kalman filter, knowing the plant gains.",
        3,
    ),
    "imm-lq": ControllerWords(
        "IMM + preview LQ",
        "Interacting models, of a target that stands, drives on or turns back, in the place of the filter: the "
        "strongest classical controller that knows no rule of the target’s.",
        3,
    ),
    "parabola-lq": ControllerWords(
        "Parabola + preview LQ", "As before, but it knows the rule: that targets move on eq (7).", 5
    ),
    "no-lead": ControllerWords("No lead", "Preview LQ that aims at where the target is, not where it will be.", 6),
    "vertex": ControllerWords("Vertex aim", "Aims at the vertex of the target’s path and waits.", 6),
    "oracle": ControllerWords(
        "Oracle",
        "Knows the target’s path and the plant, and plans within the command limit. A strong yardstick, "
        "not a proven bound: the bounds stand beside it.",
        2,
    ),
    "perfect": ControllerWords("Perfect aim", "A way of scoring: the gimbal is always at the right angles.", 6),
}
"""In the order of the report's tables; the report shows controllers that are not here under their own names, last."""


class LimitWords(NamedTuple):
    """How a command limit appears in the report."""

    title: str
    """Heading of its section."""
    note: str
    """What it means for the figures under it."""
    opening: str
    """Beginning of the headline's sentence."""


LIMITS = {
    "gate": LimitWords(
        "what a real gimbal can do",
        "Commands keep the step and slew limits of a real gimbal’s motors, in training and evaluation alike. "
        "This is the limit under which to quote figures.",
        "Asked no more than a real gimbal can do",
    ),
    "box": LimitWords(
        "what the printed model allows",
        "Only the printed angle ranges limit a command. The printed axes are linear, without any limit on speed or "
        "torque, so a controller that knows them may overdrive them as no motor could follow. "
        "Read these figures as properties of the printed model, not of a robot.",
        "With no limit but the angle ranges",
    ),
    "los-2deg": LimitWords(
        "a guess at the paper’s own limit",
        "A yaw command may lie at most 2° from the line of sight. This limit is our assumption: the paper prints none. "
        "It was fitted to the paper’s PPO columns, after others, because a free command lets every controller that "
        "knows the plant do far better than the paper reports.",
        "Kept within 2° of the line of sight",
    ),
}
"""In the order of the report."""


class _ConditionWords(NamedTuple):
    label: str
    scale: float
    unit: str


_DEGREES = math.degrees(1.0)

_CONDITIONS = {
    "hit_radius": _ConditionWords("Largest miss distance that hits (printed)", 100.0, "cm"),
    "parabola_curvature": _ConditionWords("Coefficient of the parabola, eq (7) (printed)", 1.0, "1/m"),
    "parabola_rise": _ConditionWords("A target turns back where x − X₀ reaches (printed)", 1.0, "m"),
    "control_period_s": _ConditionWords("One command and one pellet every", 1000.0, "ms"),
    "engagement_s": _ConditionWords("Length of an engagement", 1.0, "s"),
    "settled_after_s": _ConditionWords("A miss counts as settled from", 1.0, "s"),
    "start_pitch": _ConditionWords("Pitch of the resting gimbal at the start", _DEGREES, "°"),
    "start_yaw": _ConditionWords("Yaw of the resting gimbal at the start", _DEGREES, "°"),
    "max_lateral_offset": _ConditionWords("Lateral offset of the vertex, uniform up to ±", 1.0, "m"),
    "armor_height": _ConditionWords("Height of the armor above the muzzle", 1.0, "m"),
    "max_lateral_speed": _ConditionWords("Lateral speed of moving targets, uniform up to", 1.0, "m/s"),
    "muzzle_speed": _ConditionWords("Mean muzzle speed", 1.0, "m/s"),
    "muzzle_speed_sd": _ConditionWords("Standard deviation of the muzzle speed", 1.0, "m/s"),
    "dispersion": _ConditionWords("Standard deviation of the disturbance angles, eq (6)", _DEGREES, "°"),
    "drag": _ConditionWords("Quadratic drag coefficient", 1.0, "1/m"),
    "position_noise": _ConditionWords("Noise of the seen target position: none, the camera is perfect", 1000.0, "mm"),
    "line_of_sight_lead": _ConditionWords("Command limit los-2deg: yaw from the line of sight, at most", _DEGREES, "°"),
    "kalman_acceleration_sd": _ConditionWords("Kalman filter: process noise, as acceleration", 1.0, "m/s²"),
    "kalman_position_sd": _ConditionWords("Kalman filter: measurement noise", 1000.0, "mm"),
    "kalman_extra_lead_s": _ConditionWords("Kalman filter: lead beyond period and flight, tuned", 1000.0, "ms"),
}


def controller_words(controller: str) -> ControllerWords:
    """Return how a controller appears; one that the report does not know keeps its own name."""
    return CONTROLLERS.get(controller, ControllerWords(controller, "", 6))


def fallback_sentence(cells: Iterable[Cell]) -> str:
    """Say at how many decisions policies fell back on a Kalman filter; nothing where they never did."""
    cells = list(cells)
    said = []
    for name in dict.fromkeys(cell.controller for cell in cells if cell.fallbacks):
        own = [cell for cell in cells if cell.controller == name]
        share = sum(cell.fallbacks for cell in own) / sum(cell.shots + cell.withheld for cell in own)
        said.append(f"{controller_words(name).name} {percent(share)} %")
    return (
        f" Decisions that fell back on a Kalman filter, which had predicted better: {', '.join(said)}." if said else ""
    )


def own_controllers(cells: Iterable[Cell]) -> list[str]:
    """Return the names of the controllers that are not Archerfish's, in the order of the cells."""
    return [name for name in dict.fromkeys(cell.controller for cell in cells) if name not in CONTROLLERS]


_NOT_WITH_A_ROBOT = (
    "position_noise",
    "line_of_sight_lead",
    "kalman_acceleration_sd",
    "kalman_position_sd",
    "kalman_extra_lead_s",
)
"""Conditions that a robot's own camera, limits and tuned trackers take the place of."""


_OF_THE_PAPER_S_TARGETS = ("parabola_curvature", "parabola_rise", "max_lateral_speed", "engagement_s")
"""Conditions that do not hold of other motions."""


def condition_rows(
    conditions: dict[str, Any], *, robot_alone: bool = False, motions_alone: bool = False
) -> list[tuple[str, str]]:
    """Return label and value of each condition, in the units that people use; unknown ones as they are.

    Args:
      conditions: of results.json.
      robot_alone: whether they are of a robot only, and not of the paper's simulation.
      motions_alone: whether no target moved as the paper's do.
    """
    hidden = (*(_NOT_WITH_A_ROBOT if robot_alone else ()), *(_OF_THE_PAPER_S_TARGETS if motions_alone else ()))
    return [_condition_row(name, value) for name, value in conditions.items() if name not in hidden]


def _condition_row(name: str, value: Any) -> tuple[str, str]:
    if name == "range_bins":
        return "Ranges, uniform within each (printed)", ", ".join(bins(each) for each in value) + " m"
    words = _CONDITIONS.get(name)
    if words is None or not isinstance(value, int | float):
        return name, str(value)
    return words.label, f"{_tidy(words.scale * value)} {words.unit}"


def _tidy(value: float) -> str:
    text = number(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text else text
