import dataclasses
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from archerfish.evaluation.paper_results import PaperFigures
from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import MOTION_TABLES, Cell, Comparison, Results, read_results, write_results
from archerfish.figures.page import count, duration, number, percent, points
from archerfish.paper.tables import hit_rate_table
from archerfish.records.errors import InputError

from .outline import Outline, outline


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, synthetic_results: Results) -> Path:
    path = tmp_path_factory.mktemp("run") / "report.html"
    write_report(synthetic_results, path)
    return path


@pytest.fixture(scope="module")
def page(whole: Path) -> Outline:
    return outline(whole)


@pytest.fixture(scope="module")
def small(synthetic_results: Results) -> Results:
    """One limit, two ranges, nothing drawn but hit rates: quick to render."""
    cells, comparisons = (
        tuple(each for each in group if each.command_limit == "box" and each.range_m[0] < 3)
        for group in (synthetic_results.cells, synthetic_results.comparisons)
    )
    return dataclasses.replace(synthetic_results, cells=cells, comparisons=comparisons, figures=PaperFigures())


def report_text(results: Results, folder: Path) -> str:
    write_report(results, folder / "report.html")
    return outline(folder / "report.html").text


def test_page_needs_nothing_but_itself(page: Outline) -> None:
    outside = [each for each in page.targets if not each.startswith("#") and not each.endswith("docs/errata.md")]
    assert outside == []
    assert not page.tags & {"script", "link", "img", "iframe"}


def test_every_link_within_the_page_has_a_target_and_no_id_occurs_twice(page: Outline) -> None:
    assert len(page.ids) == len(set(page.ids))
    assert {each[1:] for each in page.targets if each.startswith("#")} <= set(page.ids)


def test_limits_come_in_order_with_the_honest_one_first(page: Outline) -> None:
    titles = [page.text.rindex(f"Tables II and III, limit {limit}") for limit in ("gate", "box", "los-2deg")]
    assert titles == sorted(titles)
    assert "This limit is our assumption" in page.text


def test_headline_gives_the_rates_under_the_gate(page: Outline, synthetic_results: Results) -> None:
    for controller in ("history", "kalman", "oracle"):
        cells = [
            each for each in synthetic_results.cells if (each.command_limit, each.controller) == ("gate", controller)
        ]
        rate = 100 * sum(each.hits for each in cells) / sum(each.shots for each in cells)
        assert f"{rate:.1f} %" in page.text[: page.text.index("How to read")]
    assert "in 8 of 8 cells" in page.text


def test_every_printed_rate_stands_on_the_page(page: Outline) -> None:
    for name in ("II", "III", "IV", "V"):
        for row in hit_rate_table(name).rows:
            assert f"{row.ppo_percent:.2f}" in page.text
            assert f"{row.kalman_percent:.2f}" in page.text


def test_every_cell_stands_on_the_page_with_its_counts(page: Outline, synthetic_results: Results) -> None:
    for cell in synthetic_results.cells:
        counts = f"{count(cell.hits)} / {count(cell.shots)}"
        assert re.sub(r"\s+", " ", counts) in page.text


def test_the_bounds_stand_beside_the_oracle_with_kind_and_error(page: Outline) -> None:
    gate, box, near = (page.text.rindex(f"Tables II and III, limit {limit}") for limit in ("gate", "box", "los-2deg"))
    for first, last, known, unknown in ((gate, box, "96.9", "96.7"), (box, near, "99.9", "99.7")):
        section = page.text[first:last]
        assert "bound, path known" in section
        assert "policy, share of bound" in section
        assert re.search(rf"{known} ?hindsight", section)
        assert re.search(rf"{unknown} ?combined, ± 0\.2", section)
    # Where one bound holds of all, there is one column.
    assert "bound, path known" not in page.text[near:]
    assert re.search(r"95\.1 ?reach", page.text[near:])


def test_the_headline_gives_the_least_share_of_what_is_possible(page: Outline, synthetic_results: Results) -> None:
    rates = [
        each.hits / each.shots
        for each in synthetic_results.cells
        if (each.command_limit, each.controller) == ("gate", "history")
    ]
    share = f"{100 * min(rates) / 0.9665:.1f} % of what is proven possible"
    assert share in page.text[: page.text.index("How to read")].replace("\u00a0", " ")


def test_the_robot_s_tables_say_what_they_wait_for(page: Outline) -> None:
    assert "needs the virtual robot" in page.text
    assert "behind the Kalman filter at 4 of 4 ranges" in page.text


def test_conditions_appear_in_people_s_units_and_unknown_ones_as_they_are(page: Outline) -> None:
    assert "within 6 cm of its centre" in page.text
    assert re.search(r"disturbance angles, eq \(6\) ?0\.2 °", page.text)
    assert re.search(r"mood ?fair", page.text)
    assert "The choice is not unique: of 4 338 sets" in page.text


def test_figures_are_written_beside_the_page_as_whole_drawings(whole: Path) -> None:
    written = {each.name: ElementTree.parse(each).getroot().tag for each in (whole.parent / "figures").iterdir()}
    assert set(written.values()) == {"{http://www.w3.org/2000/svg}svg"}
    assert {"headline.svg", "fig4_step_responses.svg", "fig5_static.svg", "fig6_dynamic.svg"} <= written.keys()
    assert {f"hit_rates_paper-{limit}-II-III.svg" for limit in ("gate", "box", "los-2deg")} <= written.keys()


def test_the_page_comes_from_the_file_alone(tmp_path: Path, whole: Path, synthetic_results: Results) -> None:
    write_results(tmp_path / "results.json", synthetic_results)
    # Beside the first one, so that the relative link is the same.
    again = whole.with_name("again.html")
    write_report(read_results(tmp_path / "results.json"), again)
    assert again.read_bytes() == whole.read_bytes()


def test_an_empty_run_says_what_is_missing(tmp_path: Path) -> None:
    text = report_text(Results(seed=0, commit="unknown", versions={}), tmp_path)
    assert text.count("This run did not evaluate under this limit.") == 3
    for phrase in ("so there is no headline", "identified no gimbal", "no training against static", "to Table I"):
        assert phrase in text
    assert "needs the virtual robot" in text


def test_an_evaluation_without_policy_or_oracle_is_reported(tmp_path: Path, small: Results) -> None:
    only = tuple(each for each in small.cells if each.controller == "kalman")
    text = report_text(dataclasses.replace(small, cells=only, comparisons=()), tmp_path)
    assert "so there is no headline" in text
    assert text.count("This run did not evaluate under this limit.") == 2
    assert "Kalman filter against the paper’s Kalman columns" in text


def test_without_the_gate_the_headline_names_the_limit_it_has(tmp_path: Path, small: Results) -> None:
    assert "With no limit but the angle ranges, the trained policy hits" in report_text(small, tmp_path)


def test_cells_of_a_robot_get_sections_of_their_own(tmp_path: Path, small: Results) -> None:
    robot = tuple(
        dataclasses.replace(each, table={"II": "IV", "III": "V"}[each.table], setting="sentry", paper=None)
        for each in small.cells
    )
    text = report_text(dataclasses.replace(small, cells=robot, comparisons=()), tmp_path)
    assert "With the robot “sentry”, limit box" in text
    assert "needs the virtual robot" not in text


def test_several_policies_are_named_with_their_spread(tmp_path: Path, small: Results) -> None:
    more = tuple(dataclasses.replace(each, policy_seed=1) for each in small.cells if each.controller == "history")
    text = report_text(dataclasses.replace(small, cells=small.cells + more), tmp_path)
    assert "History policy: 2 trainings; shown is the one with the lowest seed, 0." in text
    assert "History policy (seed 1)" in text


def test_a_quick_run_warns_before_its_figures(tmp_path: Path, small: Results) -> None:
    text = report_text(dataclasses.replace(small, quick=True), tmp_path)
    assert text.index("A quick run.") < text.index("the trained policy hits")


def test_text_from_the_file_is_escaped(tmp_path: Path, small: Results) -> None:
    hostile = dataclasses.replace(small, commit="<script>alert(1)</script>", cells=(), comparisons=())
    write_report(hostile, tmp_path / "report.html")
    assert "<script" not in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("name", ['a"><script>alert(1)</script>', "a/../../../elsewhere/a"])
def test_the_name_of_a_setting_leaves_neither_its_attribute_nor_the_folder(
    tmp_path: Path, small: Results, name: str
) -> None:
    cells = tuple(dataclasses.replace(each, setting=name, paper=None) for each in small.cells)
    write_report(dataclasses.replace(small, cells=cells, comparisons=()), tmp_path / "run" / "report.html")
    assert "script" not in outline(tmp_path / "run" / "report.html").tags
    assert {each.parent for each in tmp_path.rglob("*.svg")} == {tmp_path / "run" / "figures"}


def test_a_page_that_can_t_be_written_is_one_clear_error(tmp_path: Path, small: Results) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_report(dataclasses.replace(small, cells=()), tmp_path / "file" / "report.html")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (percent(0.98765), "98.8"),
        (percent(None), "–"),
        (points(-0.0123), "−1.2"),
        (points(-0.0001), "+0.0"),
        (number(0.00349, 2), "0.0035"),
        (number(-12.345), "−12.3"),
        (number(1234.6), "1235"),
        (number(0.0), "0"),
        (number(4), "4"),
        (number(1.5e-7, 2), "1.5e−07"),
        (count(25000), "25\u2009000"),
        (duration(12.34), "12.3 s"),
        (duration(83.4), "1 min 23 s"),
    ],
)
def test_numbers_are_written_for_people(text: str, expected: str) -> None:
    assert text == expected


def test_other_motions_have_a_section_per_length_with_a_row_per_motion_and_controller(tmp_path: Path) -> None:
    cells, pairs = [], []
    for table in MOTION_TABLES.values():
        for motion in ("still", "strafe"):
            for low in (1.0, 2.0):
                label = {"table": table, "setting": "paper", "range_m": (low, low + 1.0), "command_limit": "gate",
                         "target": "static" if motion == "still" else "dynamic", "motion": motion}  # fmt: skip
                hits = {"policy": 90, "kalman": 80}
                cells += [
                    Cell(**label, controller=name, policy_seed=seed, hits=hits[name], shots=100, engagements=2, low=0.7,
                         high=0.95, misses_slewing=0, misses_settled=100 - hits[name])
                    for name, seed in (("policy", 3), ("kalman", None))
                ]  # fmt: skip
                pairs.append(Comparison(**label, controller="policy", policy_seed=3, against="kalman", difference=0.1,
                                        low=0.05, high=0.15))  # fmt: skip
    results = Results(seed=0, commit="abc", versions={}, cells=tuple(cells), comparisons=tuple(pairs))
    write_report(results, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    for length in (1, 3):
        assert f"Other motions, engagements of {length} s, limit gate" in page
        assert (tmp_path / "figures" / f"hit_rates_paper-gate-motions-{length}s.svg").exists()
    assert page.count("<th>Policy of several trackers (seed 3)</th>") == 4
    assert page.count("<th>Policy of several trackers (seed 3) less Kalman filter</th>") == 4
    assert page.count('<tr class="group"><th colspan="4">strafe</th></tr>') == 4
    assert "Tables II and III" not in page.partition("Other motions, engagements of 1 s")[0]
