"""Report of an identified robot: its parts, what is assumed, and what to do next."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from archerfish2.identification.simulation import Array
from archerfish2.reports.report import Report
from archerfish2.reports.style import look, new_figure, plot_style
from archerfish2.reports.table import Estimate, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.identification.robot import IdentifiedRobot


class Landing(NamedTuple):
    """Landing points at one pitch."""

    pitch_deg: float  # of the barrel [°]
    measured: Estimate  # mean distance [m]
    shots: int  # how many
    predicted: float  # distance of a pellet of mean speed [m]


class LargeStep(NamedTuple):
    """A step of another size than those that were fitted, and what the plant makes of it."""

    axis: str  # "pitch" or "yaw"
    size_deg: int  # of the step, as the file is called [°]
    time: Array  # since the step [s], (N,)
    measured: Array  # angle since before the step [rad], (N,)
    simulated: Array  # the same of the plant [rad], (N,)
    fit_percent: float  # from the step on [%]


_RECORD = {
    "pitch": "pitch_sweep.csv and pitch_step.csv (archerfish2 excite pitch)",
    "yaw": "yaw_sweep.csv and yaw_step.csv (archerfish2 excite yaw)",
    "muzzle": "shots.csv: hits on a plate, with speeds",
    "sensing": "timing_sweep.csv and timing_plate.csv",
    "limits": "limits.json, or [limits] in logs.toml",
}


def robot_report(found: "IdentifiedRobot") -> Report:
    """Report an identified robot."""
    robot = found.robot
    bad = [part for part, each in robot.parts.items() if not each.usable]
    assumed = f"; assumed: {', '.join(robot.assumed)}" if robot.assumed else ""
    rows = [(f"{name}: {e.headline}", "usable" if e.usable else "not usable") for name, e in robot.parts.items()]
    absent = {part: "immediate and perfect" if part == "sensing" else "the paper's" for part in robot.assumed}
    rows += [(f"{part}: {each}", "assumed") for part, each in absent.items()]
    pages = ", ".join(each.page for each in robot.parts.values())
    tables = [Table("Parts", ("part", ""), tuple(rows), f"Their pages: {pages}.")]
    if found.landings:
        errors = [100 * (each.predicted / each.measured.value - 1) for each in found.landings]
        pairs = zip(found.landings, errors, strict=True)
        landings = tuple((f"{e.pitch_deg:.2f}°", e.shots, e.measured, e.predicted, error) for e, error in pairs)
        columns = ("pitch", "shots", "measured [m]", "predicted [m]", "error [%]")
        tables.append(Table("Landing points, which no fit has seen", columns, landings))
    if found.steps:
        steps = tuple((each.axis, each.size_deg, each.fit_percent) for each in found.steps)
        note = "Large steps reach the motor's limits, which a linear plant lacks; the limits of commands avoid them."
        tables.append(
            Table("Steps of other sizes, which no fit has seen", ("axis", "size [°]", "fit [%]"), steps, note)
        )
    return Report(
        title=f"{robot.name}: what the logs say",
        headline=", ".join(bad or robot.parts) + assumed,
        usable=not bad,
        reasons=tuple(f"{part}: {reason}" for part in bad for reason in robot.parts[part].reasons),
        known=tuple(f"{part}: {each}" for part, report in _reports(found) for each in report.known[:2]),
        doubts=tuple(f"{part}: {each}" for part, report in _reports(found) for each in report.doubts),
        next_steps=tuple(_next_steps(found)),
        tables=tuple(tables),
        figures=tuple(_figures(found)),
        findings=tuple(each for _, report in _reports(found) for each in report.findings),
    )


def _reports(found: "IdentifiedRobot") -> Iterator[tuple[str, Report]]:
    for part, result in {**found.axes, "muzzle": found.muzzle, "sensing": found.sensing}.items():
        if result is not None:
            yield part, result.report


def _next_steps(found: "IdentifiedRobot") -> Iterator[str]:
    for part, report in _reports(found):
        yield from (f"{part}: {each}" for each in report.next_steps[:2])
    for part in found.robot.assumed:
        yield f"{part}: record {_RECORD[part]}."
    if all(each.usable for each in found.robot.parts.values()):
        yield "Train a policy (archerfish2 train ROBOT), and compare it (archerfish2 evaluate ROBOT)."


def _figures(found: "IdentifiedRobot") -> Iterator[tuple[str, Callable[[], "Figure"]]]:
    if found.steps:
        yield "Steps of other sizes, measured and as the plants have them.", lambda: step_sizes_plot(found.steps)


def step_sizes_plot(steps: tuple[LargeStep, ...], *, title: str = "") -> "Figure":
    """Draw steps over their size, measured and simulated, one panel an axis."""
    axes = sorted({each.axis for each in steps})
    with plot_style():
        figure, panels = new_figure(1, len(axes), height=3.2, sharey=True)
        for axis, panel in zip(axes, panels[0], strict=True):
            for index, each in enumerate(each for each in steps if each.axis == axis):
                color, size = look(index)["color"], np.copysign(np.radians(each.size_deg), each.simulated[-1])
                panel.plot(each.time, each.measured / size, color=color, label=f"{each.size_deg}°")
                panel.plot(each.time, each.simulated / size, color=color, linestyle="--")
            panel.set(title=title or axis, xlabel="time since the step [s]", xlim=(-0.05, 0.6))
            panel.legend(title="measured; dashed: plant", loc="lower right")
        panels[0, 0].set_ylabel("angle over the step's size")
    return figure
