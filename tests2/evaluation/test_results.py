"""Results: their file, joins and comparisons, and the tables, plot and page of them."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import archerfish2 as af
from archerfish2.controllers.tuning import Tuning
from archerfish2.evaluation.hit_rate import hit_rate, paired_difference
from archerfish2.evaluation.published import with_bounds
from archerfish2.evaluation.results import Cell, Comparison, Results, pairs_to_compare
from archerfish2.evaluation.tables import mean, rate_tables
from archerfish2.records.json_files import plain
from archerfish2.reports.table import entry_texts

PAPER, ROBOT, INFANTRY = af.Task.load("paper"), af.Robot.paper(), af.Robot.load(Path(__file__).parents[1] / "infantry")
SETUP = {"seed": 0, "commit": "abc", "versions": {"numpy": "2"}, "robots": {"paper": {"digest": "12"}}}
SETUP |= {"tuning": {"paper/gate": {"kalman": Tuning(acceleration_sd=4.0)}}, "durations": {"tuning": 1.5}}
TRAINED = [("policy", "policy", seed) for seed in (2, 0, 1)]
CLASSICAL = ["kalman", "oracle", "kalman-paper", "kalman-lq", "imm-lq", "parabola-lq", "no-lead"]
OTHERS = [("six-number", "policy", 0), ("mine", "user", None), *((each, "classical", None) for each in CLASSICAL)]
OTHERS.append(("perfect", "perfect", None))
MOTIONS = ["still", "parabola", "pass", "strafe", "stop-and-go", "sinusoid", "circle", "singer"]


def evaluated(motions, contenders, engagements, ranges=4, **place):
    """Results with made-up hits: the later a controller in the list, the fewer."""
    generator, cells, pairs = np.random.default_rng(1), [], []
    rates = 0.9 - 0.03 * np.arange(len(contenders))[:, None, None]
    place = {"world": "paper", "length_s": 1.0, "command_limit": "gate"} | place
    for motion, near in itertools.product(motions, range(1, ranges + 1)):
        label = place | {"motion": motion, "range_m": (near, near + 1)}
        labels = [label | {"controller": name, "seed": seed} for name, _, seed in contenders]
        hits = generator.random((len(contenders), engagements, 50)) < rates + generator.normal(0, 0.1, (engagements, 1))
        table = {"static": "II", "dynamic": "III"}.get(motion)
        for label, (_, kind, _), hit in zip(labels, contenders, hits, strict=True):
            facts = label | hit_rate(hit)._asdict() | {"withheld": int(kind == "user"), "yaw_rad_s2": 50.0}
            facts |= {"shots": facts.pop("decisions") - facts["withheld"], "kind": kind, "table": table}
            cells.append(Cell(**facts, paper=83.8 if table and kind == "policy" else None))
        for one, other in pairs_to_compare([each[:2] for each in contenders]):
            difference = paired_difference(hits[one], hits[other])._asdict()
            pairs.append(Comparison(**labels[one], **difference, against=contenders[other][0]))
    return Results(tasks=(PAPER,), cells=with_bounds(cells, ROBOT, PAPER, 0), comparisons=tuple(pairs), **SETUP)


RESULTS = evaluated(["dynamic"], [TRAINED[0], OTHERS[2]], 500, ranges=1)
(POLICY, KALMAN), (PAIR,) = RESULTS.cells, RESULTS.comparisons
TABLES = evaluated(["static", "dynamic"], [*TRAINED[:1], *OTHERS], 500)  # the paper's, of one training each
MANY = evaluated(MOTIONS, TRAINED + OTHERS, 4)  # motions and trainings
FAULTS = [
    ("cells", {"hits": 25_001}, "25001 of 25000 shots"),
    ("cells", {"engagements": 25_001}, "0 < engagements ≤ decisions"),
    ("cells", {"range_m": [2, 1]}, "the smaller distance first"),
    ("cells", {"high": POLICY.low}, f"interval is {POLICY.low} to {POLICY.low}, expected one around the rate"),
    ("cells", {"bound": None}, "expected both or neither"),
    ("cells", {"seed": 1}, "a comparison of policy has no cell"),
    ("cells", {"controller": "kalman", "seed": None}, "have one label"),
    ("comparisons", {"low": PAIR.high}, f"interval is {PAIR.high} to {PAIR.high}, expected one around the difference"),
]
CONTRADICTIONS = {
    "seed of the results is": {"seed": 4},
    "have one label": {"cells": (POLICY.replace(hits=POLICY.hits - 1),)},
    "robots: digest of paper differs": {"robots": {"paper": {"digest": "other"}}},
    "tuning: kalman of paper/gate differs": {"tuning": {"paper/gate": {"kalman": Tuning(acceleration_sd=5.0)}}},
}


def test_results_survive_the_disk_in_a_file_or_its_folder_and_any_mutated_file_is_read_or_refused(tmp_path, mutated):
    RESULTS.save(tmp_path / "run")
    Results.load(tmp_path / "run").save(file := tmp_path / "again.json")
    assert file.read_bytes() == (tmp_path / "run" / "results.json").read_bytes()
    assert plain(Results.load(file)) == plain(RESULTS)
    assert all(repr(found) for found in mutated(file, lambda: Results.load(file), 60))


@pytest.mark.parametrize(("part", "changes", "complaint"), FAULTS)
def test_a_damaged_file_is_refused(tmp_path, part, changes, complaint, refused):
    content = {"schema": Results.schema, **plain(RESULTS)}
    content[part][0].update(changes)
    (tmp_path / "results.json").write_text(json.dumps(content))
    refused(rf"results\.json: .*{complaint}.*evaluate again$", Results.load, tmp_path)


def test_joined_results_have_the_cells_of_both_once_and_contradict_each_other_nowhere(refused):
    infantry = {"robots": {"infantry": {"digest": "3"}}, "cells": (KALMAN, KALMAN.replace(world="infantry"))}
    joined = RESULTS.join(RESULTS.replace(comparisons=(), **infantry), RESULTS)
    assert [(each.world, each.controller) for each in joined.cells[1:]] == [("paper", "kalman"), ("infantry", "kalman")]
    assert [len(each) for each in (joined.cells, joined.robots, joined.tasks, joined.comparisons)] == [3, 2, 1, 1]
    assert joined.durations == {"tuning": 4.5}
    for complaint, changes in CONTRADICTIONS.items():
        refused(complaint, RESULTS.join, RESULTS.replace(**changes))


def test_a_pair_is_compared_in_both_directions(refused):
    turned = {"difference": -PAIR.difference, "low": -PAIR.high, "high": -PAIR.low}
    expected = [PAIR, PAIR.replace(controller="kalman", against="policy", **turned)]
    assert plain([*RESULTS.compare("policy", "kalman"), *RESULTS.compare("kalman", "policy")]) == plain(expected)
    refused("no comparison of policy with oracle; there are policy with kalman; ", RESULTS.compare, "policy", "oracle")


def test_policies_are_compared_with_classical_controllers_and_all_with_the_first():
    kalman, mine, perfect = ("kalman", "classical"), ("mine", "user"), ("perfect", "perfect")
    assert pairs_to_compare([perfect, kalman, mine, ("lq", "classical")]) == [(2, 1), (2, 3), (3, 1)]
    assert pairs_to_compare([("policy", "policy")] * 2 + [kalman, mine]) == [(0, 2), (1, 2), (3, 2), (3, 0)]


def test_rows_for_a_data_frame_are_plain():
    facts = plain(POLICY) | {"range_low_m": 1.0, "range_high_m": 2.0, "rate": POLICY.hits / 25_000}
    del facts["range_m"]
    assert json.loads(json.dumps(RESULTS.to_dicts()))[0] == facts


def test_every_rate_and_its_interval_are_printed_within_110_columns():
    text, empty, wide = repr(TABLES), evaluated([], OTHERS, 4), evaluated(["pass"], OTHERS[:3], 500, ranges=30)
    for cell in TABLES.cells:
        assert f"{100 * cell.rate:.1f} ({100 * cell.low:.1f}–{100 * cell.high:.1f})" in text
    assert {f"{100 * cell.low:.1f}–{100 * cell.high:.1f}" for cell in wide.cells} < {*repr(wide).split()}
    assert all(f" {near}–{near + 1} m" in repr(wide) for near in range(1, 31))
    for said in ("Table II, static targets", "paper: PPO (printed)", "83.80", "mine (no fire)", "the 95 %", "Bound: "):
        assert said in text
    bound = next(line for line in text.split("\n") if line.startswith("bound "))
    assert bound.split() == ["bound", "87.8", "90.5", "91.1", "91.9", "90.3"]
    drop = TABLES.comparisons[0].replace(against="simulated/policy")  # to a robot
    assert "policy − simulated/policy" in repr(TABLES.replace(comparisons=(drop,)))
    assert max(len(line) for each in (TABLES, MANY, wide) for line in repr(each).split("\n")) <= 110
    assert repr(empty).startswith("Results: seed 0, commit abc, 0 cells")
    assert empty.report().headline == "No controller was evaluated."


def test_a_notebook_shows_every_rate():
    page = TABLES._repr_html_()
    assert all(f"{100 * cell.low:.1f}–{100 * cell.high:.1f}" in page for cell in TABLES.cells)


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
    assert max(map(len, repr(own).split("\n"))) <= 110


def test_bounds_are_of_these_engagements_of_this_robot_alone():
    cells = evaluated(("dynamic",), OTHERS[2:], 500, command_limit="box").cells
    bounds = {each.controller: each.bound for each in cells}
    assert (bounds["kalman"], bounds["oracle"], bounds["perfect"]) == pytest.approx((0.982, 0.982, None), abs=1e-3)
    assert "bound of oracle" in repr(TABLES.replace(cells=cells, comparisons=()))
    fewer, refitted = [each.replace(engagements=250) for each in cells], ROBOT.replace(muzzle=INFANTRY.muzzle)
    wider = PAPER.replace(lateral_m=0.5)
    others = [(fewer, ROBOT, PAPER, 0), (cells, ROBOT, PAPER, 1), (cells, refitted, PAPER, 0), (cells, ROBOT, wider, 0)]
    assert all(with_bounds(*each) == (*each[0],) for each in others)
    cells = with_bounds(evaluated(("static", "dynamic"), OTHERS[2:], 250).cells, INFANTRY, PAPER, 0)
    assert all((each.bound is None) == (each.kind == "perfect") for each in cells)


def test_the_plot_has_a_panel_per_motion_and_every_controller_looks_different():
    figure = TABLES.plot()
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {*CLASSICAL, "policy", "mine", "perfect", "bound", "hollow: the paper"} < names
    lines = [each for each in figure.axes[1].lines if each.get_linestyle() != "None"]
    assert len({(each.get_color(), each.get_marker()) for each in lines}) == len(lines) == len(OTHERS) + 2
    joined = MANY.join(evaluated(MOTIONS, TRAINED[:1], 4, length_s=3.0))
    assert [axes.get_title("left") for axes in joined.plot().axes][::8] == ["still, 1 s", "still, 3 s"]


def test_the_page_has_a_headline_for_any_policy_and_the_cells_beside_the_papers(tmp_path):
    TABLES.report().write_page(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    rate, interval = entry_texts(mean([each for each in TABLES.cells if each.controller == "policy"]))
    assert f"policy: {rate}\u00a0% ({interval}) of all decisions hit (paper, limit gate" in page
    for text in ("policy − kalman-lq", ">83.80</td>", "one training, seed 2", "rad/s²", "of the bound"):
        assert text in page
