"""The report: one self-contained page, made from results.json alone, and its figures as files beside it."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from archerfish.evaluation.comparison import cells_of, shares
from archerfish.evaluation.paper_results import LearningCurves
from archerfish.evaluation.report.contents import TITLES, contents
from archerfish.evaluation.report.headline import Headline, headline
from archerfish.evaluation.report.motion_section import MotionSection, motion_sections, of_paper
from archerfish.evaluation.report.rate_tables import (
    Column,
    RateTable,
    fired_shots_count,
    printed_column,
    rate_column,
    rate_table,
)
from archerfish.evaluation.report.robot_drawings import steps_drawing
from archerfish.evaluation.report.robot_facts import axes_table, facts_table, landing_view, steps_remark
from archerfish.evaluation.report.robot_headline import robot_headline, robot_sentence
from archerfish.evaluation.report.robot_section import robot_section
from archerfish.evaluation.report.sections import Section, limit_section
from archerfish.evaluation.report.wording import CONTROLLERS, LIMITS, condition_rows, own_controllers
from archerfish.evaluation.report.worlds import REAL, real_cells
from archerfish.evaluation.results import Results
from archerfish.figures.page import number, render_page
from archerfish.figures.step_response import StepPanel, step_responses
from archerfish.figures.style import svg_text
from archerfish.figures.training import learning_curves
from archerfish.paper.tables import hit_rate_table
from archerfish.records import storage

SIMULATED = ("II", "III")

_ERRATA = Path(__file__).parents[4] / "docs" / "errata.md"
"""Where a checkout has it; an installed package has not."""


class _Gallery:
    """Collects the figures of a page: each is rendered once, for the page and for its file."""

    def __init__(self) -> None:
        self.figures: dict[str, str] = {}

    def add(self, name: str, label: str, figure: Figure | None) -> str | None:
        """Return the figure as SVG text for the page, None for none."""
        if figure is None:
            return None
        self.figures[name] = svg_text(figure, prefix=name, label=label)
        return self.figures[name]


def write_report(results: Results, path: Path, folder: Path | None = None) -> None:
    """Write the page, and its figures as SVG files into the folder `figures` beside it.

    What the results don't hold is said to be missing.

    Args:
      results: of a run.
      path: of the page.
      folder: that both are moved to later, for links that leave it; that of `path` if not given.

    Raises:
      InputError: if the folder can't be written.
    """
    gallery = _Gallery()
    page = _page(results, gallery, folder or path.parent)
    for name, figure in gallery.figures.items():
        storage.write_text(path.parent / "figures" / f"{name}.svg", figure)
    storage.write_text(path, page)


def _page(results: Results, gallery: _Gallery, folder: Path) -> str:
    everything, motions = results, [_drawn(each, gallery) for each in motion_sections(results)]
    results = replace(results, cells=of_paper(results.cells), comparisons=of_paper(results.comparisons))
    settings = list(dict.fromkeys(cell.setting for cell in results.cells if cell.table in SIMULATED)) or ["paper"]
    main, paper = "paper" if "paper" in settings else settings[0], _paper_part(results, bool(motions))
    sections = [_drawn(each, gallery) for each in _sections(results, settings)] if paper else []
    robot = _robot(results, gallery)
    return render_page(
        "report.html",
        title="Archerfish: from logs to hit rates",
        titles=TITLES,
        contents=contents(
            [(each["anchor"], each["title"]) for each in (*sections, *motions)], paper=paper, robot=robot
        ),
        results=results,
        paper_part=paper,
        headline=_headline(results, main, gallery),
        sections=sections,
        motions=motions,
        dispersion=_dispersion(results, main),
        six_numbers=_six_numbers(results, main),
        robot=robot,
        printed_real=[hit_rate_table(name) for name in REAL],
        real_note=_real_note(),
        fig4=_fig4(results, gallery),
        axes=_identified_axes(results),
        learning=[
            ("static", _learning(results.figures.fig5, "fig5_static", "static", gallery)),
            ("dynamic", _learning(results.figures.fig6, "fig6_dynamic", "dynamic", gallery)),
        ],
        conditions=condition_rows(
            results.conditions,
            robot_alone=bool(robot["shots"]) and not paper,
            motions_alone=not paper and not robot["shots"],
        ),
        controllers=[
            *((words.name, words.meaning) for words in CONTROLLERS.values()),
            *(
                (name, "A controller of your own; config.json names its file.")
                for name in own_controllers(everything.cells)
            ),
        ],
        fired_shots=fired_shots_count(results.cells),
        **_reading(results.conditions),
        errata=Path(os.path.relpath(_ERRATA, folder)).as_posix() if _ERRATA.is_file() else None,
    )


def _paper_part(results: Results, motions: bool) -> bool:
    """Tell whether the page has the paper's simulation on it: all but where a robot or other motions alone were shot.

    Args:
      results: of targets in the paper's tables.
      motions: whether other targets were shot.
    """
    figures = results.figures
    simulated = any(cell.table in SIMULATED for cell in results.cells) or results.table1 or results.identification
    shown = simulated or figures.fig4 or figures.fig5 or figures.fig6
    return bool(shown) or not (real_cells(results) or results.robot or motions)


def _robot(results: Results, gallery: _Gallery) -> dict[str, Any]:
    """Return what the page says of the robot; what the results don't hold is None."""
    section, told = robot_section(results), results.robot
    figures = {
        "shots_figure": (section.drawing if section else None, "Hit rates in the simulator and with the robots"),
        "steps_figure": (steps_drawing(told.steps) if told else None, "Step responses of the robot and its model"),
    }
    names = {"shots_figure": "robot_hit_rates", "steps_figure": "robot_step_responses"}
    return {
        "shots": section,
        "told": told,
        "landings": landing_view(told.landings) if told else None,
        "steps_remark": steps_remark(told.steps) if told and told.steps else "",
        "tables": [each for each in (axes_table(told), facts_table(told)) if each] if told else [],
        **{key: gallery.add(names[key], label, figure) for key, (figure, label) in figures.items()},
    }


def _reading(conditions: dict[str, Any]) -> dict[str, str]:
    radius, settled = conditions.get("hit_radius"), conditions.get("settled_after_s")
    return {
        "hit_radius": "the hit radius" if radius is None else f"{number(100 * radius, 1)} cm",
        "settled_after": "early in the engagement" if settled is None else f"the first {number(settled, 1)} s",
    }


def _headline(results: Results, setting: str, gallery: _Gallery) -> dict[str, Any] | None:
    found = headline(results, setting)
    if found is not None:
        return _opening(found, robot_sentence(results), gallery)
    alone = robot_headline(results)
    return None if alone is None else _opening(alone, "", gallery)


def _opening(found: Headline, robot: str, gallery: _Gallery) -> dict[str, Any]:
    label = "Hit rate against range of the policy, the Kalman filter and the oracle"
    return {**found._asdict(), "robot": robot, "figure": gallery.add("headline", label, found.drawing)}


def _sections(results: Results, settings: Sequence[str]) -> list[Section]:
    """Return a section per setting and limit: for the paper's setting all limits, for others those that were shot."""
    shot = {(cell.setting, cell.command_limit) for cell in results.cells if cell.table in SIMULATED}
    wanted = [(setting, limit) for setting in settings for limit in LIMITS]
    return [
        limit_section(results, setting, limit, SIMULATED)
        for setting, limit in wanted
        if setting == "paper" or (setting, limit) in shot
    ]


def _drawn(section: Section | MotionSection, gallery: _Gallery) -> dict[str, Any]:
    label = f"Hit rate against range: {section.title}"
    return {**section._asdict(), "figure": gallery.add(f"hit_rates_{section.anchor}", label, section.drawing)}


def _dispersion(results: Results, setting: str) -> RateTable:
    """Return perfect aim beside the oracle and the policy under the first limit that has it."""
    for limit in LIMITS:
        picked = {
            name: cells_of(results.cells, setting=setting, command_limit=limit, controller=name)
            for name in ("perfect", "oracle", "history")
        }
        if picked["perfect"]:
            columns = [rate_column(cells, name, ours=name == "perfect") for name, cells in picked.items()]
            return rate_table(columns, f"Hit rates in percent with 95 % intervals, command limit {limit}.")
    return RateTable("", (), ())


def _six_numbers(results: Results, setting: str) -> RateTable:
    """Return the six-number policy beside no-lead aiming and the history policy under the first limit that has it."""
    for limit in ("box", *LIMITS):
        picked = {
            name: cells_of(results.cells, setting=setting, command_limit=limit, controller=name)
            for name in ("paper", "no-lead", "history", "oracle")
        }
        if picked["paper"]:
            columns = [
                printed_column(picked["paper"], "paper, PPO"),
                *(rate_column(picked[name], name, ours=name == "paper") for name in ("paper", "no-lead", "history")),
                Column("six-number policy, share of oracle", "share", shares(picked["paper"], picked["oracle"])),
            ]
            return rate_table(columns, f"Hit rates in percent with 95 % intervals, command limit {limit}.")
    return RateTable("", (), ())


def _real_note() -> str:
    """Say how far the printed differences carry, and how they come out."""
    tables = [hit_rate_table(name) for name in REAL]
    shots = tables[0].shots
    half_width = 100 * 1.96 * math.sqrt(0.7 * 0.3 / shots)
    largest = max(abs(row.ppo_percent - row.kalman_percent) for table in tables for row in table.rows)
    behind = " and at ".join(
        f"{sum(row.ppo_percent < row.kalman_percent for row in table.rows)} of {len(table.rows)} ranges of "
        f"Table {table.name}"
        for table in tables
    )
    return (
        f"The paper fired {shots} shots a cell: at 70 % that is a noise of ±{half_width:.1f} points, where its columns "
        f"differ by at most {largest:.1f}. Its method is behind the Kalman filter at {behind}."
    )


def _fig4(results: Results, gallery: _Gallery) -> str | None:
    panels = [
        StepPanel(
            f"{axis.capitalize()}: fit {response.fit_percent:.2f} %",
            response.time_s,
            response.true_deg,
            response.identified_deg,
        )
        for axis, response in results.figures.fig4.items()
    ]
    label = "Step responses of the true and the identified plant"
    return gallery.add("fig4_step_responses", label, step_responses(panels) if panels else None)


def _learning(curves: LearningCurves | None, name: str, target: str, gallery: _Gallery) -> str | None:
    if curves is None or not curves.runs:
        return None
    returns = {f"seed {run.policy_seed}": run.mean_return for run in curves.runs}
    figure = learning_curves(curves.steps, returns, title=f"Training against {target} targets")
    return gallery.add(name, f"Mean return against environment steps, {target} targets", figure)


def _identified_axes(results: Results) -> dict[str, Any] | None:
    """Return the numbers of each identified axis as a table, and what the identification remarked."""
    if not results.identification:
        return None
    facts = {axis: dict(_plain_numbers(found)) for axis, found in results.identification.items()}
    names = list(dict.fromkeys(name for found in facts.values() for name in found))
    return {
        "names": [name.replace("_", " ").replace("percent", "%") for name in names],
        "rows": [(axis, [number(found.get(name), 4) for name in names]) for axis, found in facts.items()],
        "remarks": [
            f"{axis.capitalize()}: {remark}"
            for axis, found in results.identification.items()
            for remark in found.get("remarks", ())
        ],
    }


def _plain_numbers(facts: dict[str, Any]) -> list[tuple[str, float]]:
    validations = [(f"{Path(each['file']).stem} fit %", each["fit_percent"]) for each in facts.get("validation", ())]
    plain = [(name, value) for name, value in facts.items() if isinstance(value, int | float)]
    return plain + validations
