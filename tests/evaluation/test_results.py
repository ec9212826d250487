"""Results: their file, joins and comparisons, and the tables, plot and page of them."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import archerfish as af
from archerfish.controllers.tuning import Tuning
from archerfish.evaluation.comparison import default_comparisons
from archerfish.evaluation.hit_rate import paired_difference
from archerfish.evaluation.published import with_bounds
from archerfish.evaluation.results import Cell, Results
from archerfish.evaluation.tables import mean, rate_tables
from archerfish.records.json_files import plain
from archerfish.reports.table import entry_texts

PAPER, ROBOT, INFANTRY = af.Task.load("paper"), af.Robot.paper(), af.Robot.load(Path(__file__).parents[1] / "infantry")
SETUP = {"seed": 0, "commit": "abc", "versions": {"numpy": "2"}, "robots": {"paper": {"digest": "12"}}}
SETUP |= {"tuning": {"paper/gate/paper/kalman": Tuning(acceleration_sd=4.0)}, "durations": {"tuning": 1.5}}
TRAINED = [("policy", "policy", seed) for seed in (2, 0, 1)]
CLASSICAL = ["kalman", "oracle", "kalman-paper", "kalman-lq", "imm-lq", "parabola-lq", "no-lead"]
OTHERS = [("six-number", "policy", 0), ("mine", "user", None), *((each, "classical", None) for each in CLASSICAL)]
OTHERS.append(("perfect", "perfect", None))
MOTIONS = ["still", "parabola", "pass", "strafe", "stop-and-go", "sinusoid", "circle", "singer"]


def evaluated(motions, contenders, engagements, ranges=4, **place):
    """Results with made-up hits: the later a controller in the list, the fewer."""
    generator, cells = np.random.default_rng(1), []
    rates = 0.9 - 0.03 * np.arange(len(contenders))[:, None, None]
    place = {"world": "paper", "length_s": 1.0, "command_limit": "gate", "decisions_each": 50} | place
    for motion, near in itertools.product(motions, range(1, ranges + 1)):
        label = place | {"motion": motion, "range_m": (near, near + 1), "stream": near}
        label["table"] = {"static": "II", "dynamic": "III"}.get(motion)
        hits = generator.random((len(contenders), engagements, 50)) < rates + generator.normal(0, 0.1, (engagements, 1))
        for (name, kind, seed), hit in zip(contenders, hits.sum(axis=2).tolist(), strict=True):
            facts = label | {"controller": name, "seed": seed, "kind": kind, "hits_by_engagement": hit}
            facts |= {"withheld": int(kind == "user"), "yaw_rad_s2": 50.0}
            cells.append(Cell(**facts, paper=83.8 if label["table"] and kind == "policy" else None))
    return Results(tasks=(PAPER,), cells=with_bounds(cells, ROBOT, PAPER, 0), **SETUP)


RESULTS = evaluated(["dynamic"], [TRAINED[0], OTHERS[2]], 500, ranges=1)
POLICY, KALMAN = RESULTS.cells
TABLES = evaluated(["static", "dynamic"], [*TRAINED[:1], *OTHERS], 500)  # the paper's, of one training each
MANY = evaluated(MOTIONS, TRAINED + OTHERS, 4)  # motions and trainings
FAULTS = [
    ({"hits_by_engagement": [51, 3]}, "51 hits of 50 decisions"),
    ({"hits_by_engagement": [3]}, "hits_by_engagement: expected array of length >= 2"),
    ({"withheld": 25_000}, r"\d+ of 0 shots hit, expected at most all"),
    ({"range_m": [2, 1]}, "the smaller distance first"),
    ({"bound": None}, "expected both or neither"),
    ({"controller": "kalman", "seed": None}, "have one label"),
]
CONTRADICTIONS = {
    "results: seed differs: 0 and 4": {"seed": 4},
    "have one label": {"cells": (POLICY.replace(withheld=1),)},
    "robots: paper differs": {"robots": {"paper": {"digest": "other"}}},
    "tuning: paper/gate/paper/kalman differs": {"tuning": {"paper/gate/paper/kalman": Tuning(acceleration_sd=5.0)}},
    "task paper: hit_radius_m differs: 0.06 and 0.1; give": {"tasks": (PAPER.replace(hit_radius_m=0.1),)},
}


def test_results_survive_the_disk_in_a_file_or_its_folder(tmp_path):
    RESULTS.save(tmp_path / "run")
    Results.load(tmp_path / "run").save(file := tmp_path / "again.json")
    assert file.read_bytes() == (tmp_path / "run" / "results.json").read_bytes()
    assert plain(Results.load(file)) == plain(RESULTS)


def test_any_mutated_file_is_read_or_refused(tmp_path, mutated):
    RESULTS.save(file := tmp_path / "results.json")
    assert all(repr(found) for found in mutated(file, lambda: Results.load(file), 60))


@pytest.mark.parametrize(("changes", "complaint"), FAULTS)
def test_a_damaged_file_is_refused(tmp_path, changes, complaint, refused):
    content = {"schema": Results.schema, **plain(RESULTS)}
    content["cells"][0].update(changes)
    (tmp_path / "results.json").write_text(json.dumps(content))
    refused(rf"results\.json: .*{complaint}.*evaluate again$", Results.load, tmp_path)


def test_joined_results_have_the_cells_of_both_once():
    infantry = {"robots": {"infantry": {"digest": "3"}}, "cells": (KALMAN, KALMAN.replace(world="infantry"))}
    joined = RESULTS.join(RESULTS.replace(**infantry), [RESULTS])
    assert [(each.world, each.controller) for each in joined.cells[1:]] == [("paper", "kalman"), ("infantry", "kalman")]
    assert [len(each) for each in (joined.cells, joined.robots, joined.tasks)] == [3, 2, 1]
    assert joined.durations == {"tuning": 4.5}


@pytest.mark.parametrize("complaint", CONTRADICTIONS)
def test_results_that_contradict_each_other_are_not_joined(complaint, refused):
    refused(complaint, RESULTS.join, RESULTS.replace(**CONTRADICTIONS[complaint]))


@pytest.mark.parametrize("other", ["results.json", 3, [RESULTS, None]])
def test_what_are_no_results_is_not_joined(other, refused):
    refused("join: expected Results, got a (str|int|NoneType); give what", RESULTS.join, other)


def test_any_two_controllers_are_compared_by_engagement():
    (found,) = RESULTS.compare("policy", "kalman")
    expected = paired_difference(POLICY.hits_by_engagement, KALMAN.hits_by_engagement, 50)
    assert found[-3:] == expected
    (turned,) = RESULTS.compare("kalman", "policy")
    assert turned[-3:] == pytest.approx((-found.difference, -found.high, -found.low), abs=1e-15)
    assert len(TABLES.compare("oracle", "perfect")) == 8


def test_several_trainings_are_compared_in_the_mean():
    found = MANY.compare("policy", "mine")
    rates = {name: [each.rate for each in MANY.cells if each.controller == name] for name in ("policy", "mine")}
    assert {each.seed for each in found} == {0, 1, 2}
    assert mean(found).value == pytest.approx(100 * (np.mean(rates["policy"]) - np.mean(rates["mine"])))
    assert "policy, 3 seeds − mine" in repr(found)


def test_a_controller_that_is_not_there_is_refused_with_those_that_are(refused):
    refused("there is no controller 'oracle', but policy, kalman; name two", RESULTS.compare, "policy", "oracle")


def test_cells_of_other_engagements_are_not_compared(refused):
    others = KALMAN.replace(stream=9), KALMAN.replace(hits_by_engagement=(3, 4)), KALMAN.replace(world="other")
    for other in others:
        refused("no engagements in common", RESULTS.replace(cells=(POLICY, other)).compare, "policy", "kalman")


def test_a_comparison_is_rows_for_a_data_frame_and_a_table_in_a_notebook():
    found = TABLES.compare("policy", "oracle")
    row = json.loads(json.dumps(found.to_dicts()))[0]
    names = ("controller", "seed", "against", "motion", "range_low_m", "range_high_m")
    assert [row[name] for name in names] == ["policy", 2, "oracle", "static", 1, 2]
    assert [row[name] for name in ("difference", "low", "high")] == [*found[0][-3:]]
    assert all(entry_texts(mean([each]))[1] in found._repr_html_() for each in found)


def test_policies_are_compared_with_classical_controllers_and_all_with_the_first():
    contenders = [OTHERS[-1], OTHERS[2], OTHERS[1], OTHERS[3]]
    pairs = default_comparisons(evaluated(["pass"], contenders, 4, ranges=1).cells)
    found = [f"{each.controller} − {each.against}" for each in pairs]
    assert found == ["mine − kalman", "mine − oracle", "oracle − kalman"]


def test_rows_for_a_data_frame_are_plain():
    row = json.loads(json.dumps(RESULTS.to_dicts()))[0]
    hits = sum(POLICY.hits_by_engagement)
    assert [row[name] for name in ("hits", "shots", "withheld", "engagements")] == [hits, 25_000, 0, 500]
    assert [row[name] for name in ("rate", "low", "high")] == [hits / 25_000, POLICY.low, POLICY.high]
    assert {type(value) for value in row.values()} <= {str, float, int, type(None)}


def test_every_rate_and_its_interval_are_printed():
    text, page, wide = repr(TABLES), TABLES._repr_html_(), evaluated(["pass"], OTHERS[:3], 500, ranges=30)
    for cell in TABLES.cells:
        interval = f"{100 * cell.low:.1f}–{100 * cell.high:.1f}"
        assert (f"{100 * cell.rate:.1f} ({interval})" in text, interval in page) == (True, True)
    assert {f"{100 * cell.low:.1f}–{100 * cell.high:.1f}" for cell in wide.cells} < {*repr(wide).split()}
    assert all(f" {near}–{near + 1} m" in repr(wide) for near in range(1, 31))
    lines = [line for results in (TABLES, MANY, wide) for line in repr(results).split("\n")[2:] if line[:3] != "  -"]
    assert max(map(len, lines)) <= 110


def test_the_bound_is_printed():
    bound = next(line for line in repr(TABLES).split("\n") if line.startswith("bound "))
    assert bound.split() == ["bound", "87.8", "90.5", "91.1", "91.9", "90.3"]


def test_the_papers_figures_are_one_row_each_whoever_shoots():
    for results in (TABLES, TABLES.replace(cells=[each for each in TABLES.cells if each.controller == "no-lead"])):
        lines = [line.split() for line in repr(results).split("\n") if "(printed)  " in line]
        assert [line[1] for line in lines] == 2 * ["PPO", "Kalman"]
        assert [line[3] for line in lines] == ["83.80", "80.22", "88.35", "76.84"]  # of 1–2 m in Tables II and III


def test_results_without_a_cell_are_printed_and_reported():
    empty = evaluated([], OTHERS, 4)
    assert "Seed 0, commit abc, 0 cells." in repr(empty)
    assert empty.report.headline == "No controller was evaluated."


def test_many_motions_share_a_table_of_means_and_trainings_a_row_with_their_spread():
    (table,) = rate_tables(MANY.cells)
    rows = {row[0]: row for row in table.rows}
    own = [each.rate for each in MANY.cells if (each.controller, each.motion) == ("kalman", "circle")]
    assert rows["kalman"][table.columns.index("circle")].value == pytest.approx(100 * np.mean(own))
    trainings = [[each for each in MANY.cells if each.key[-2:] == ("policy", seed)] for seed in range(3)]
    rates = [100 * np.mean([each.rate for each in own]) for own in trainings]
    assert rows["policy, 3 seeds"][-1].value == pytest.approx(np.mean(rates))
    assert rows["policy (seeds)"][-1] == f"{min(rates):.1f}–{max(rates):.1f}"
    # The same engagements again are no new engagements.
    again = [each.replace(seed=9) for each in trainings[0]]
    assert mean([*trainings[0], *again])[:3] == pytest.approx(mean(trainings[0])[:3])


def test_a_cell_is_better_where_the_whole_interval_is_above_zero():
    own = TABLES.compare("policy", "oracle")
    (row,) = [line for line in repr(TABLES).split("\n") if line.startswith("policy − oracle")]
    assert row.split()[-3:] == [str(sum(each.low > 0 for each in own)), "0", "8"]
    assert all(" (".join(entry_texts(mean([each]))) in repr(own) for each in own)
    assert max(len(line) for line in repr(own).split("\n") if line[:3] != "  -") <= 110


def test_bounds_are_of_these_engagements_of_this_robot_alone():
    cells = evaluated(("dynamic",), OTHERS[2:], 500, command_limit="box").cells
    bounds = {each.controller: each.bound for each in cells}
    assert (bounds["kalman"], bounds["oracle"], bounds["perfect"]) == pytest.approx((0.982, 0.982, None), abs=1e-3)
    assert "bound of oracle" in repr(TABLES.replace(cells=cells))
    unbounded = [each.replace(bound=None, bound_error=None) for each in cells]
    fewer = [each.replace(hits_by_engagement=each.hits_by_engagement[:250], withheld=0) for each in unbounded]
    refitted, wider = ROBOT.replace(muzzle=INFANTRY.muzzle), PAPER.replace(lateral_m=0.5)
    others = [(fewer, ROBOT, PAPER, 0)]
    others += [(unbounded, *each) for each in ((ROBOT, PAPER, 1), (refitted, PAPER, 0), (ROBOT, wider, 0))]
    assert all(with_bounds(*each) == (*each[0],) for each in others)
    cells = with_bounds(evaluated(("static", "dynamic"), OTHERS[2:], 250).cells, INFANTRY, PAPER, 0)
    assert all((each.bound is None) == (each.kind == "perfect") for each in cells)


def test_the_plot_has_a_panel_per_motion_and_every_controller_looks_different(has_units):
    figure = TABLES.plot()
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {*CLASSICAL, "policy", "mine", "perfect", "bound", "hollow: the paper"} < names
    lines = [each for each in figure.axes[1].lines if each.get_linestyle() != "None"]
    assert len({(each.get_color(), each.get_marker()) for each in lines}) == len(lines) == len(OTHERS) + 2
    joined = MANY.join(evaluated(MOTIONS, TRAINED[:1], 4, length_s=3.0))
    assert [axes.get_title("left") for axes in joined.plot().axes][::8] == ["still, 1 s", "still, 3 s"]
    has_units(TABLES.report, len(TABLES.report.figures))
