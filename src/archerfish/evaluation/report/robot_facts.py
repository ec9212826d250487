"""What a robot's logs told, for the report: axes, sensing, muzzle and trackers, Table I and Fig. 4 proper."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from archerfish.evaluation.report.entry_tables import Entry, EntryGroup, EntryRow, EntryTable, Heading
from archerfish.evaluation.report.wording import controller_words
from archerfish.evaluation.robot_results import LandingRow, RobotIdentification, RobotStep
from archerfish.figures.page import MISSING, number, points
from archerfish.paper.tables import landing_table


class _Fact(NamedTuple):
    label: str
    unit: str
    scale: float = 1.0


_AXIS = {
    "order": _Fact("order of the model", ""),
    "delay_ms": _Fact("delay", "ms"),
    "dc_gain": _Fact("DC gain", ""),
    "held_back_sweep_fit_percent": _Fact("fit, held-back sweep", "%"),
    "held_back_step_fit_percent": _Fact("fit, held-back steps", "%"),
}

_FACTS = {
    "camera_time_offset_ms": _Fact("From a frame’s stamp to its exposure, on the robot’s clock", "ms"),
    "camera_latency_ms": _Fact("Camera latency, exposure to detection", "ms"),
    "command_latency_ms": _Fact("Command latency", "ms"),
    "command_latency_jitter_ms": _Fact("Jitter of the command latency", "ms"),
    "feedback_latency_ms": _Fact("Feedback latency", "ms"),
    "bearing_sd_mrad": _Fact("Noise of a seen bearing, standard deviation", "mrad"),
    "speed_m_s": _Fact("Muzzle speed", "m/s"),
    "speed_sd_m_s": _Fact("Standard deviation of the muzzle speed", "m/s"),
    "pitch_offset_deg": _Fact("Barrel above the reported pitch by", "°"),
    "yaw_offset_deg": _Fact("Barrel left of the reported yaw by", "°"),
    "pitch_sd_deg": _Fact("Scatter in pitch, standard deviation", "°"),
    "yaw_sd_deg": _Fact("Scatter in yaw, standard deviation", "°"),
    "acceleration_sd_m_s2": _Fact("process noise, as acceleration", "m/s²"),
    "extra_lead_s": _Fact("lead beyond period and flight", "ms", 1e3),
    "initial_speed_m_s": _Fact("speed at first sight, standard deviation", "m/s"),
    "velocity_decay": _Fact("share of the velocity that is predicted", ""),
    "turn_rate_1_s": _Fact("turns back, per second", "1/s"),
    "smoothing": _Fact("weight of the command’s changes", ""),
}

_PARTS = {"sensing": "Camera and link", "muzzle": "Muzzle"}


def axes_table(robot: RobotIdentification) -> EntryTable | None:
    """Lay the axes side by side, a row per fact; None without axes."""
    names = list(dict.fromkeys(name for facts in robot.axes.values() for name in facts))
    if not names:
        return None
    rows = [
        EntryRow(_label(_AXIS, name), [_axis_entry(facts, name) for facts in robot.axes.values()])
        for name in names
        if not name.endswith("_interval")
    ]
    return EntryTable(
        "The linear model of each axis. Held-back logs were recorded apart and not fitted. Where steps come to rest, "
        "the DC gain is held to the level that they reach; its 95 % interval then tells of the noise alone.",
        "",
        [Heading(axis) for axis in robot.axes],
        [EntryGroup("", rows)],
    )


def _axis_entry(facts: dict[str, Any], name: str) -> Entry:
    interval = facts.get(f"{name}_interval")
    small = f"{_fixed(interval[0])} to {_fixed(interval[1])}" if interval else ""
    if interval and isinstance(facts.get(name), int | float):
        return Entry(_fixed(facts[name]), small)
    return Entry(_value(_AXIS, facts, name), small)


def _fixed(value: float) -> str:
    return f"{value:.4f}".replace("-", "−")


def facts_table(robot: RobotIdentification) -> EntryTable | None:
    """List what was told of camera, link and muzzle, and how the trackers were tuned; None if nothing was."""
    groups = [
        EntryGroup(title, [EntryRow(_label(_FACTS, name), [_fact_entry(facts, name)]) for name in _named(facts)])
        for title, facts in _grouped(robot)
        if facts
    ]
    told = any(name.endswith("_interval") for facts in robot.facts.values() for name in facts)
    caption = "Small: 95 % intervals, where the logs tell them." if told else ""
    return EntryTable(caption, "", [Heading("value")], groups) if groups else None


def _named(facts: dict[str, Any]) -> list[str]:
    return [name for name in facts if not name.endswith("_interval")]


def _fact_entry(facts: dict[str, Any], name: str) -> Entry:
    value, interval, fact = facts.get(name), facts.get(f"{name}_interval"), _FACTS.get(name, _Fact("", ""))
    if value is None or not interval or not interval[0] < interval[1]:
        return Entry(_value(_FACTS, facts, name))
    low, high = (fact.scale * end for end in interval)
    # As many digits as tell the ends apart.
    digits = max(0, 1 - math.floor(math.log10(high - low)))
    shown = [f"{each:.{digits}f}".replace("-", "−") for each in (fact.scale * value, low, high)]
    return Entry(f"{shown[0]} {fact.unit}".rstrip(), f"{shown[1]} to {shown[2]}")


def _grouped(robot: RobotIdentification) -> list[tuple[str, dict[str, Any]]]:
    measured = [(title, robot.facts.get(part, {})) for part, title in _PARTS.items()]
    tuned = [
        (f"{controller_words(name).name}, tuned in the simulator", facts)
        for name, facts in robot.facts.items()
        if name not in _PARTS
    ]
    return measured + tuned


def _label(known: dict[str, _Fact], name: str) -> str:
    return known[name].label if name in known else name.replace("_", " ")


def _value(known: dict[str, _Fact], facts: dict[str, Any], name: str) -> str:
    value, fact = facts.get(name), known.get(name, _Fact("", ""))
    if value is None:
        return MISSING
    if isinstance(value, str):
        return value
    return f"{number(value if isinstance(value, int) else fact.scale * value)} {fact.unit}".rstrip()


def landing_view(rows: Sequence[LandingRow]) -> tuple[str, EntryTable] | None:
    """Say how far the identified muzzle foretells where pellets fall, and list it; None without falling points."""
    if not rows:
        return None
    paper = landing_table()
    printed = {(row.pitch_deg, -row.yaw_deg): row.error_percent for row in paper.rows}
    worst = max(abs(row.error_percent) for row in rows)
    held = sum(row.robot_low_m <= row.model_m <= row.robot_high_m for row in rows)
    within = "within" if worst < paper.claimed_error_percent else "not within"
    sentence = (
        f"The paper claims less than {paper.claimed_error_percent:g} % between model and measurement; ours misses by "
        f"at most {worst:.1f} %, {within} that. In {held} of {len(rows)} rows the model lies inside the interval of "
        "the robot’s mean falling point."
    )
    return sentence, EntryTable(
        "Distance of the falling point: the robot’s mean with its 95 % interval, and the identified model. "
        "Error: model less robot. The paper’s robot is another, so only its errors compare, printed without sign.",
        "pitch, yaw (left positive)",
        [Heading(text) for text in ("shots", "robot, mean", "model", "error")] + [Heading("paper, error", "paper")],
        [EntryGroup("", [_landing_row(row, printed) for row in rows])],
    )


def _landing_row(row: LandingRow, printed: dict[tuple[float, float], float]) -> EntryRow:
    """Find the printed row by the commanded angles: whole degrees near the reported ones."""
    near = min(printed, key=lambda each: abs(each[0] - row.pitch_deg) + abs(each[1] - row.yaw_deg))
    matches = max(abs(near[0] - row.pitch_deg), abs(near[1] - row.yaw_deg)) < 1.0
    angles = f"{row.pitch_deg + 0.0:.2f}°, {row.yaw_deg + 0.0:.2f}°".replace("-", "−")
    return EntryRow(
        angles,
        [
            Entry(str(row.shots)),
            Entry(f"{row.robot_m:.3f} m", f"{row.robot_low_m:.3f}–{row.robot_high_m:.3f}"),
            Entry(f"{row.model_m:.3f} m", "", "ours"),
            Entry(f"{points(row.error_percent / 100)} %"),
            Entry(f"{printed[near]:.2f} %" if matches else MISSING, "", "paper"),
        ],
    )


def steps_remark(steps: Sequence[RobotStep]) -> str:
    """Say how well the model follows small and large steps, and why not the large ones."""
    small, large = [], []
    for axis in dict.fromkeys(step.axis for step in steps):
        mine = sorted((step for step in steps if step.axis == axis), key=lambda step: abs(step.size_deg))
        small.append(_fit_words(mine[0]))
        large += [_fit_words(mine[-1])] if mine[-1].fit_percent < mine[0].fit_percent else []
    if not large:
        return f"The model fits {_joined(small)}."
    return (
        f"The model fits {_joined(small)}, but only {_joined(large)}. A linear model stops being right for large "
        "steps, because the motor saturates: the model answers a step of any size in the same time, but the motor "
        "has no more than its largest torque and speed. The steps were commanded at once; in the tables, the command "
        "limit keeps controllers from asking for such jumps."
    )


def _fit_words(step: RobotStep) -> str:
    size = f"{step.size_deg:g}°".replace("-", "−")
    return f"{step.fit_percent:.0f} % of the {size} step in {step.axis}"


def _joined(words: Sequence[str]) -> str:
    return " and ".join(words)
