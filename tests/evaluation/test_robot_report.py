import dataclasses
import re
from pathlib import Path

import pytest

from archerfish.evaluation.comparison import cells_of, comparisons_of, drops_of
from archerfish.evaluation.pooling import pooled_cells, pooled_differences
from archerfish.evaluation.report import write_report
from archerfish.evaluation.report.robot_facts import landing_view, steps_remark
from archerfish.evaluation.report.worlds import worlds
from archerfish.evaluation.results import Results
from archerfish.figures.page import percent, points
from archerfish.paper.tables import landing_table

from .outline import Outline, outline


def rendered(results: Results, folder: Path) -> Outline:
    write_report(results, folder / "report.html")
    return outline(folder / "report.html")


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory, robot_results: Results) -> Path:
    """The page of a run with a robot alone."""
    path = tmp_path_factory.mktemp("robot") / "report.html"
    write_report(robot_results, path)
    return path


@pytest.fixture(scope="module")
def page(alone: Path) -> Outline:
    return outline(alone)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory, synthetic_results: Results, robot_results: Results) -> Outline:
    """The page of a run with the paper's setting and a robot."""
    parts = {
        name: (*getattr(synthetic_results, name), *getattr(robot_results, name))
        for name in ("cells", "comparisons", "drops")
    }
    joined = dataclasses.replace(synthetic_results, robot=robot_results.robot, **parts)
    return rendered(joined, tmp_path_factory.mktemp("both"))


def headings(path: Path) -> list[tuple[str, str]]:
    """Anchor and text of each section's heading."""
    return re.findall(r'<section id="([^"]+)">\n<h2>(.+?)</h2>', path.read_text())


def listed(path: Path) -> list[tuple[str, str]]:
    """Anchor and text of each line of the contents."""
    return re.findall(r'<li><a href="#([^"]+)">(.+?)</a></li>', path.read_text())


def test_worlds_come_in_the_order_of_the_way(robot_results: Results) -> None:
    backwards = dataclasses.replace(robot_results, cells=robot_results.cells[::-1])
    for results in (robot_results, backwards):
        assert [(each.setting, each.role) for each in worlds(results)] == [
            ("identified-sentry", "simulator"),
            ("sentry", "robot"),
            ("rusty", "changed"),
        ]


def test_the_contents_are_the_sections(alone: Path, tmp_path: Path, synthetic_results: Results) -> None:
    assert headings(alone) == listed(alone)
    assert [anchor for anchor, _ in listed(alone)] == [
        "reading",
        "real",
        "robot-table1",
        "robot-fig4",
        "robot-told",
        "conditions",
        "making",
    ]
    write_report(synthetic_results, tmp_path / "report.html")
    assert headings(tmp_path / "report.html") == listed(tmp_path / "report.html")


def test_a_run_with_a_robot_alone_misses_nothing(page: Outline) -> None:
    for phrase in ("This run", "needs the virtual robot", "are not recorded", "the camera is perfect", "los-2deg: yaw"):
        assert phrase not in page.text


def test_links_lead_somewhere_and_ids_are_unique(page: Outline, both: Outline) -> None:
    for each in (page, both):
        assert len(each.ids) == len(set(each.ids))
        assert {target[1:] for target in each.targets if target.startswith("#")} <= set(each.ids)


def test_the_headline_is_of_the_robot(page: Outline, robot_results: Results) -> None:
    text = page.text[: page.text.index("How to read")]
    where = {"setting": "sentry", "command_limit": "gate"}
    for controller in ("history", "kalman", "oracle"):
        rate = pooled_cells(cells_of(robot_results.cells, controller=controller, **where).values())
        assert rate is not None
        assert f"{percent(rate.value)} % ({percent(rate.low)}–{percent(rate.high)})" in text
    pair = comparisons_of(robot_results.comparisons, controller="history", against="kalman", **where)
    difference = pooled_differences(pair.values())
    assert difference is not None
    assert f"ahead of the Kalman filter, {points(difference.value)} points" in text
    for robot in ("sentry", "rusty"):
        found = drops_of(robot_results.drops, settled=False, command_limit="gate", controller="history", setting=robot)
        drop = pooled_differences(found.values())
        assert drop is not None
        assert f"{points(drop.value)} points ({points(drop.low)} to {points(drop.high)}) to" in text
    assert "virtual" in text


def test_a_reproduction_says_how_it_went_on_the_robot_after_its_own_figures(both: Outline) -> None:
    text = both.text[: both.text.index("How to read")]
    assert text.index("of its shots, the policy of the paper’s six numbers") < text.index("with the robot “sentry”")
    assert "drops by" in text
    assert "Tables II and III, limit gate" in both.text
    assert "needs the virtual robot" not in both.text


def test_every_drop_stands_on_the_page_with_its_interval(page: Outline, robot_results: Results) -> None:
    for each in robot_results.drops:
        assert f"{points(each.difference)} {points(each.low)} to {points(each.high)}" in page.text


def test_every_rate_of_every_world_stands_on_the_page_and_the_papers_beside(
    page: Outline, robot_results: Results
) -> None:
    for cell in robot_results.cells:
        assert f"{percent(cell.rate)} {percent(cell.low)}–{percent(cell.high)}" in page.text
        assert cell.paper is None or f"{cell.paper:.2f}" in page.text
    assert "±12.7 points" in page.text


def test_misses_are_split_over_all_ranges(page: Outline, robot_results: Results) -> None:
    here = [
        cell for cell in robot_results.cells if (cell.table, cell.setting, cell.controller) == ("V", "rusty", "kalman")
    ]
    shots = sum(cell.shots for cell in here)
    slewing, settled = (sum(getattr(cell, f"misses_{name}") for cell in here) for name in ("slewing", "settled"))
    assert f"{percent(slewing / shots)} + {percent(settled / shots)}" in page.text


def test_table_1_of_the_robot_has_the_papers_errors_beside_the_same_angles(robot_results: Results) -> None:
    assert robot_results.robot is not None
    view = landing_view(robot_results.robot.landings)
    assert view is not None
    sentence, table = view
    assert "less than 5 %" in sentence
    assert "at most 2.0 %, within that" in sentence
    errors = [row.entries[-1].text for row in table.groups[0].rows]
    assert errors == [f"{row.error_percent:.2f} %" for row in landing_table().rows]


def test_angles_that_the_paper_did_not_shoot_stand_alone(robot_results: Results) -> None:
    assert robot_results.robot is not None
    view = landing_view([dataclasses.replace(robot_results.robot.landings[0], pitch_deg=12.0, error_percent=7.5)])
    assert view is not None
    assert "not within that" in view[0]
    assert view[1].groups[0].rows[0].entries[-1].text == "–"


def test_large_steps_are_said_to_saturate_the_motor(page: Outline, robot_results: Results) -> None:
    assert "93 % of the 2° step in pitch" in page.text
    assert "only 33 % of the −15° step in pitch and 42 % of the 30° step in yaw" in page.text
    assert "because the motor saturates" in page.text
    assert robot_results.robot is not None
    small = [step for step in robot_results.robot.steps if step.size_deg == 2.0]
    assert steps_remark(small) == "The model fits 93 % of the 2° step in pitch and 96 % of the 2° step in yaw."


def test_what_the_logs_told_is_in_people_s_words(page: Outline) -> None:
    assert "DC gain1.0300 1.0210 to 1.0390" in page.text.replace(" 1.0300", "1.0300")
    assert re.search(r"Command latency ?–", page.text)
    assert re.search(r"frames lost ?3\b", page.text)
    assert re.search(r"lead beyond period and flight ?20\.0 ms", page.text)
    assert re.search(r"share of the velocity that is predicted ?0\.64", page.text)
    assert re.search(r"turns back, per second ?2\.0+ 1/s", page.text)
    assert re.search(r"Muzzle speed ?17\.850 m/s ?17\.810 to 17\.890", page.text)
    assert "interval" not in "".join(re.findall(r"speed m s \w+", page.text))


def test_the_conditions_say_what_an_engagement_with_a_robot_leaves_out(page: Outline, both: Outline) -> None:
    for each in (page, both):
        assert "in sight for 0.2 s" in each.text
        assert "rate of fire and heat are not enforced" in each.text


def test_the_robot_s_figures_are_written(alone: Path) -> None:
    written = {each.name for each in (alone.parent / "figures").iterdir()}
    assert written == {"headline.svg", "robot_hit_rates.svg", "robot_step_responses.svg"}


def test_a_robot_without_policy_or_drops_is_reported(tmp_path: Path, robot_results: Results) -> None:
    only = tuple(each for each in robot_results.cells if each.controller == "kalman" and each.setting == "sentry")
    text = rendered(dataclasses.replace(robot_results, cells=only, comparisons=(), drops=(), robot=None), tmp_path).text
    assert "so there is no headline" in text
    assert "With the robot “sentry”, limit gate" in text
    assert "The drop from the simulator" not in text
    assert "Fig. 4 on the robot" not in text


def test_several_trainings_show_the_one_with_the_lowest_seed(tmp_path: Path, robot_results: Results) -> None:
    more = tuple(
        dataclasses.replace(each, policy_seed=1, difference=0.9, high=0.95)
        for each in robot_results.drops
        if each.controller == "history"
    )
    text = rendered(dataclasses.replace(robot_results, drops=more + robot_results.drops), tmp_path).text
    assert "+90.0" not in text
