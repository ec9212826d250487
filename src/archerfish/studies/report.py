"""The report of a study: one page with a headline, the paper's tables and figures, and the step to the robot."""

import functools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from archerfish.evaluation import tables
from archerfish.evaluation.comparison import CellDifference, default_comparisons
from archerfish.evaluation.hit_rate import paired_difference
from archerfish.evaluation.plots import hit_rates
from archerfish.evaluation.report import evaluation_report
from archerfish.evaluation.results import Cell
from archerfish.paper.conditions import assumed_conditions
from archerfish.reports.report import Report
from archerfish.reports.style import Figure, look, new_figure, plot_style
from archerfish.reports.table import Estimate, Table, entry_texts
from archerfish.studies.study import OURS, SIX_NUMBERS, LearningCurve, StepResponse, Study

INTRODUCED = {
    "policy": "ours: trained by analytic policy gradient; sees a tracker's memory, without sensing a few frames",
    "six-numbers": "PPO on the six numbers that the paper's policy sees, which have no speed in them",
    "kalman": "the paper's baseline, tuned: a Kalman filter, whose intercept is commanded",
    "kalman-paper": "kalman with the settings by which the paper's unprinted conditions were chosen",
    "kalman-lq": "the filter of kalman, with commands that account for the gimbal's lag (preview LQ)",
    "imm-lq": "interacting multiple models for targets that turn, preview LQ",
    "parabola-lq": "is given the targets' motion rule, eq (7); preview LQ",
    "no-lead": "aims where the target was seen, preview LQ",
    "oracle": "is given the target's path, so that lag and dispersion alone make it miss",
    "perfect": "no controller: the barrel is where it should be at each shot, so that dispersion alone makes it miss",
}
"""What each controller is, in a line."""
INFORMED = ("parabola-lq", "oracle", "perfect")
"""Controllers that are given what a robot can't measure: the motion rule or the path."""
_FITTED = {
    "speed_m_s": "muzzle speed {:.4g} m/s",
    "height_m": "height of the muzzle {:.4g} m",
    "drag_per_m": "drag {:.4g} per metre",
    "pitch_offset_deg": "pitch offset {:.4g}°",
}
"""How what was fitted to Table I is shown."""
_FAULTS = (
    "No plausible muzzle gives the printed d₂. Of other faults in print, four states have a B of five entries (eq 15), "
    "and no Kalman rate of Tables II–V is a whole number of 2,000 shots; docs/paper.md has them all."
)
QUICK = "A quick run: short trainings and few engagements. None of its figures is to be quoted."


def study_report(study: Study) -> Report:
    """Return the report of a study, which prints, and writes a page."""
    results, cells = study.results, _in_order(study)
    evaluated = evaluation_report(results.replace(cells=cells))
    pairs = [pair for pair in default_comparisons(cells) if pair.controller in (OURS, SIX_NUMBERS)]
    gated = [pair for pair in pairs if pair.command_limit == "gate"]
    controllers = tables.by_controller(cells)
    lost = drops(cells, study.robot, study.virtual)
    lost.sort(key=lambda pair: list(controllers).index(pair.controller))
    quick = (QUICK,) if study.quick else ()
    return Report(
        title=f"Archerfish: {f'the robot {study.robot}' if not study.landings else 'the paper, reproduced'}",
        headline=_headline(study, cells),
        known=(*dict.fromkeys(evaluated.known), *_shares(cells)),
        doubts=(*quick, *_unusable(study), *evaluated.doubts),
        tables=(
            Table(
                "Controllers", ("name", "what it is"), tuple((name, INTRODUCED.get(name, "")) for name in controllers)
            ),
            *tables.rate_tables([cell for cell in cells if cell.world == study.virtual], results.tasks),
            *_drop_table(lost, study),
            *tables.rate_tables([cell for cell in cells if cell.world != study.virtual], results.tasks),
            *tables.mean_difference_tables(gated or pairs),
            *_part_table(study),
            *_step_table(study.steps),
            *_landing_table(study),
            *([_conditions()] if study.landings else []),
        ),
        figures=(*_rate_figures(cells), *_step_figures(study.steps), *_curve_figures(study.curves)),
        provenance={**evaluated.provenance, "seconds": study.durations},
    )


def drops(cells: Iterable[Cell], simulator: str, robot: str) -> list[CellDifference]:
    """Return by how much each controller hits less on the robot than in its simulator, in the same engagements.

    Args:
      cells: of both worlds.
      simulator: name of its world.
      robot: name of its world.
    """

    def label(cell: Cell) -> tuple[object, ...]:
        return cell.command_limit, cell.length_s, cell.task, cell.motion, cell.range_m, cell.controller, cell.seed

    simulated = {label(cell): cell for cell in cells if cell.world == simulator}
    found = list[CellDifference]()
    for cell in cells:
        before = simulated.get(label(cell))
        if cell.world == robot and before and before.shot_at[1:] == cell.shot_at[1:]:
            pair = before.hits_by_engagement, cell.hits_by_engagement
            names = cell.controller, cell.seed, f"{cell.controller} on the robot", cell.seed
            difference = paired_difference(*pair, cell.decisions_each)
            found.append(CellDifference(*cell.place, cell.motion, cell.range_m, *names, *difference))
    return found


def _in_order(study: Study) -> tuple[Cell, ...]:
    """Return the cells: those of the virtual robot first, then its simulator, then the paper's robot."""
    worlds = [study.virtual, study.robot]
    rank = {world: place for place, world in enumerate(worlds) if world}
    return tuple(sorted(study.results.cells, key=lambda cell: rank.get(cell.world, len(worlds))))


def _headline(study: Study, cells: Sequence[Cell]) -> str:
    """Say how the policy does on moving targets, on the virtual robot if there is one, against the best others."""
    world = study.virtual or cells[0].world
    own = [cell for cell in cells if cell.world == world and cell.command_limit == "gate" and cell.motion == "dynamic"]
    by_name = tables.by_controller(own)
    if OURS not in by_name:
        return evaluation_report(study.results).headline
    rate, interval = entry_texts(tables.mean(by_name[OURS]))
    said = [f"On {world} the policy hits with {rate}\u00a0% ({interval}) of all shots at moving targets"]
    differences: dict[str, Estimate | None] = {}
    for (name, against), found in tables.by_pair(default_comparisons(own)).items():
        if name == OURS:
            differences[against] = tables.mean(found)
    measured = [name for name in differences if name not in INFORMED]
    if measured:
        name = min(measured, key=lambda name: _value(differences[name]))
        difference, interval = entry_texts(differences[name])
        said.append(f"{difference} ({interval}) points against {name}, the best controller that has only measurements")
    if "parabola-lq" in differences:
        difference, interval = entry_texts(differences["parabola-lq"])
        said.append(f"{difference} ({interval}) points against parabola-lq, which is given the targets' motion rule")
    return "; ".join(said) + "."


def _shares(cells: Sequence[Cell]) -> Iterator[str]:
    """Say of each place with bounds which share of them the policy has at least."""
    bounded = [cell for cell in cells if cell.controller == OURS and cell.bound]
    for place, own in tables.grouped(bounded, lambda cell: cell.place).items():
        least = min(100.0 * cell.rate / (cell.bound or 1.0) for cell in own)
        yield f"The policy has at least {least:.1f}\u00a0% of the bound in every cell ({tables.place_text(*place)})."


def _value(estimate: Estimate | None) -> float:
    return estimate.value if estimate else float("inf")


def _unusable(study: Study) -> list[str]:
    """Say of each part that its identification found not usable that it was used all the same."""
    judged = study.parts.items()
    return [f"{part} was used, though not usable: {verdict.headline}" for part, verdict in judged if not verdict.usable]


def _drop_table(lost: Sequence[CellDifference], study: Study) -> list[Table]:
    if not lost:
        return []
    motions = list(tables.grouped(lost, lambda pair: pair.motion))
    rows = []
    for own in tables.by_pair(lost).values():
        means = [tables.mean([pair for pair in own if pair.motion == motion]) for motion in motions]
        largest = max((pair.estimate for pair in own), key=lambda estimate: estimate.value)
        rows.append((tables.controller_text(own), *means, tables.mean(own), largest))
    title = f"Drop in points: hit rate in the simulator {study.robot} less that on {study.virtual}"
    return [Table(title, ("controller", *motions, "all", "largest of a cell"), tuple(rows))]


def _part_table(study: Study) -> list[Table]:
    rows = []
    for part, verdict in study.parts.items():
        rows.append((part, "usable" if verdict.usable else "not usable", verdict.headline))
    return [Table(f"What was identified of {study.robot}", ("part", "verdict", "result"), tuple(rows))] if rows else []


def _step_table(steps: Sequence[StepResponse]) -> list[Table]:
    names = {"paper": "Fig. 4: the printed axes, identified from noisy logs", "robot": "Steps that no fit has used"}
    made = []
    for source, own in tables.grouped(steps, lambda step: step.source).items():
        rows = tuple((f"{step.axis}, {_degrees(step.size_deg)}", _alone(step.fit_percent, "%")) for step in own)
        note = "" if source == "paper" else "Large steps reach the motor's limits, which a linear model lacks."
        made.append(Table(names[source], ("step", "fit [%]"), rows, note))
    return made


def _landing_table(study: Study) -> list[Table]:
    rows, errors = [], []
    for point in study.landings:
        errors.append(100.0 * (point.model_m / point.measured_m - 1.0))
        shown = point.printed_model_m, point.measured_m, point.model_m, _alone(errors[-1], "points")
        rows.append((f"{_degrees(point.pitch_deg)}, {_degrees(point.yaw_deg)}", *shown))
    if not rows:
        return []
    fitted = ", ".join(_FITTED[name].format(value) for name, value in study.muzzle.items())
    rms = float(np.sqrt(np.mean(np.square(errors))))
    note = f"Errors of {rms:.2f} % rms, {max(map(abs, errors)):.1f} % at most. Fitted: {fitted}."
    columns = ("α, β", "d₁ (printed) [m]", "d₂ (printed) [m]", "model [m]", "error [%]")
    return [Table("Table I: landing points", columns, tuple(rows), f"{note} {_FAULTS}")]


def _degrees(angle_deg: float) -> str:
    return f"{angle_deg:g}°".replace("-", "−")


def _alone(value: float, unit: str) -> Estimate:
    """Return an estimate without an interval."""
    return Estimate(value, float("nan"), float("nan"), unit)


def _conditions() -> Table:
    """Return what was assumed, as docs/paper.md gives reasons for."""
    c = assumed_conditions()
    rows = (
        ("decision period [s]", f"{c.control_period_s:g}"),
        ("engagement [s]", f"{c.engagement_s:g}"),
        ("gimbal at the start, pitch and yaw [°]", f"{np.degrees(c.start_pitch):g}, {np.degrees(c.start_yaw):g}"),
        ("lateral offset of targets, up to [m]", f"{c.max_lateral_offset:g}"),
        ("lateral speed of targets, up to [m/s]", f"{c.max_lateral_speed:g}"),
        ("height of targets above the muzzle [m]", f"{c.armor_height:g}"),
        ("muzzle speed, and its spread [m/s]", f"{c.muzzle_speed:g}, {c.muzzle_speed_sd:g}"),
        ("dispersion in pitch and yaw [°]", f"{np.degrees(c.dispersion):g}"),
        ("drag [1/m]", f"{c.drag:g}"),
    )
    note = (
        "The paper doesn't print these. They were chosen so that a Kalman filter with fixed settings (kalman-paper) "
        "has about the printed Kalman rates; docs/paper.md has the reasons, and what is wrong in print."
    )
    return Table("Assumed conditions of Tables II and III", ("quantity", "value"), rows, note)


def _rate_figures(cells: Sequence[Cell]) -> list[tuple[str, functools.partial[Figure]]]:
    names = tuple(tables.by_controller(cells))
    figures = []
    for place, own in tables.grouped(cells, lambda cell: cell.place).items():
        draw = functools.partial(hit_rates, own, names=names)
        figures.append((f"Hit rate against range: {tables.place_text(*place)}", draw))
    return figures


def _step_figures(steps: Sequence[StepResponse]) -> list[tuple[str, functools.partial[Figure]]]:
    captions = {
        "paper": "Fig. 4: steps of the printed axes, and of the axes identified from their logs",
        "robot": "Steps of the robot that no fit has used, and of its identified axes",
    }
    groups = tables.grouped(steps, lambda step: step.source).items()
    return [(captions[source], functools.partial(draw_steps, own)) for source, own in groups]


def _curve_figures(curves: Sequence[LearningCurve]) -> list[tuple[str, functools.partial[Figure]]]:
    numbers = {"static": "Fig. 5", "dynamic": "Fig. 6"}
    groups = tables.grouped(curves, lambda curve: curve.targets)
    return [
        (f"{number}: reward in training, {targets} targets", functools.partial(draw_curves, groups[targets]))
        for targets, number in numbers.items()
        if targets in groups
    ]


def draw_steps(steps: Sequence[StepResponse]) -> Figure:
    """Draw steps and those of the models: a row per axis, a column per size."""
    axes = tables.grouped(steps, lambda step: step.axis)
    across = max(len(own) for own in axes.values())
    with plot_style():
        figure, panels = new_figure(len(axes), across, width=7.2, height=0.6 + 2.1 * len(axes), sharex=True)
        for row, own in zip(panels, axes.values(), strict=True):
            row[0].set_ylabel("angle [°]")
            for panel, step in zip(row, own, strict=False):
                panel.plot(step.time_s, step.measured_deg, **{**look(0), "marker": ""}, label="gimbal")
                panel.plot(step.time_s, step.model_deg, **{**look(1), "marker": ""}, label="identified model")
                panel.set_title(f"{step.axis}, {_degrees(step.size_deg)}: fit {step.fit_percent:.1f} %")
            for unused in row[len(own) :]:
                unused.set_visible(False)
        for panel in panels[-1]:
            panel.set_xlabel("time since the step [s]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def draw_curves(curves: Sequence[LearningCurve]) -> Figure:
    """Draw the reward of some trainings against their decisions."""
    with plot_style():
        figure, [[axes]] = new_figure(height=3.0)
        for place, curve in enumerate(curves):
            decisions = np.asarray(curve.decisions) / 1e6
            axes.plot(decisions, curve.mean_reward, **{**look(place), "marker": ""}, label=f"seed {curve.seed}")
        axes.set(xlabel="decisions [million]", ylabel="mean reward, eq (8) [m]")
        axes.legend(ncols=len(curves))
    return figure
