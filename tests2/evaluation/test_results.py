import json

import pytest

from archerfish2.controllers.registry import Tuning
from archerfish2.evaluation.results import Cell, Comparison, Results, pairs_to_compare
from archerfish2.records.json_files import plain
from archerfish2.task import Task

LABEL = {"world": "paper", "motion": "dynamic", "range_m": (1, 2), "length_s": 1.0, "command_limit": "gate"}
COUNTS = {"hits": 80, "shots": 90, "withheld": 10, "engagements": 2, "low": 0.7, "high": 0.9}
POLICY = Cell(**LABEL, **COUNTS, controller="policy", seed=0, kind="policy")
FACTS = {"table": "III", "paper": 72.1, "bound": 0.9, "bound_error": 0.0, "yaw_rad_s2": 60.0}
KALMAN = POLICY.replace(controller="kalman", seed=None, kind="classical", **FACTS)
PAIR = Comparison(**LABEL, difference=0.1, low=0.05, high=0.2, controller="policy", seed=0, against="kalman")
SETUP = {"seed": 3, "commit": "abc", "versions": {"numpy": "2"}, "robots": {"paper": {"digest": "12"}}}
SETUP |= {"tuning": {"paper/gate": {"kalman": Tuning(acceleration_sd=4.0)}}, "durations": {"tuning": 1.5}}
RESULTS = Results(tasks=(Task(),), cells=(POLICY, KALMAN), comparisons=(PAIR,), **SETUP)
FAULTS = [
    ("cells", {"hits": 91}, "91 of 90 shots"),
    ("cells", {"engagements": 101}, "0 < engagements ≤ decisions"),
    ("cells", {"range_m": [2, 1]}, "the smaller distance first"),
    ("cells", {"high": 0.75}, "interval is 0.7 to 0.75, expected one around the rate, 0.8"),
    ("cells", {"bound": 0.9}, "expected both or neither"),
    ("cells", {"seed": 1}, "a comparison of policy has no cell"),
    ("cells", {"controller": "kalman", "seed": None}, "have one label"),
    ("comparisons", {"low": 0.15}, "interval is 0.15 to 0.2, expected one around the difference, 0.1"),
]
CONTRADICTIONS = {
    "seed of the results is": {"seed": 4},
    "have one label": {"cells": (POLICY.replace(hits=79),)},
    "robots: digest of paper differs": {"robots": {"paper": {"digest": "other"}}},
    "tuning: kalman of paper/gate differs": {"tuning": {"paper/gate": {"kalman": Tuning(acceleration_sd=5.0)}}},
}


def test_results_survive_the_disk_in_a_file_or_its_folder(tmp_path):
    RESULTS.save(tmp_path / "run")
    Results.load(tmp_path / "run").save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "run" / "results.json").read_bytes()
    assert plain(Results.load(tmp_path / "again.json")) == plain(RESULTS)


@pytest.mark.parametrize(("part", "changes", "complaint"), FAULTS)
def test_a_damaged_file_is_refused(tmp_path, part, changes, complaint, refused):
    content = {"schema": Results.schema, **plain(RESULTS)}
    content[part][0].update(changes)
    (tmp_path / "results.json").write_text(json.dumps(content))
    refused(rf"results\.json: .*{complaint}.*evaluate again$", Results.load, tmp_path)


def test_any_mutated_file_is_read_or_refused(tmp_path, mutated):
    RESULTS.save(tmp_path)
    assert all(repr(found) for found in mutated(tmp_path / "results.json", lambda: Results.load(tmp_path), 60))


def test_joined_results_have_the_cells_of_both_once_and_contradict_each_other_nowhere(refused):
    infantry = {"robots": {"infantry": {"digest": "3"}}, "cells": (KALMAN, KALMAN.replace(world="infantry"))}
    joined = RESULTS.join(RESULTS.replace(comparisons=(), **infantry), RESULTS)
    assert [(each.world, each.controller) for each in joined.cells[1:]] == [("paper", "kalman"), ("infantry", "kalman")]
    assert [len(each) for each in (joined.cells, joined.robots, joined.tasks, joined.comparisons)] == [3, 2, 1, 1]
    assert joined.durations == {"tuning": 4.5}
    for complaint, changes in CONTRADICTIONS.items():
        refused(complaint, RESULTS.join, RESULTS.replace(**changes))


def test_a_pair_is_compared_in_both_directions(refused):
    (there,), (back,) = RESULTS.compare("policy", "kalman"), RESULTS.compare("kalman", "policy")
    assert (there.difference, there.low, there.high) == (0.1, 0.05, 0.2)
    assert (back.controller, back.difference, back.low, back.high) == ("kalman", -0.1, -0.2, -0.05)
    refused("no comparison of policy with oracle; there are policy with kalman; ", RESULTS.compare, "policy", "oracle")


def test_policies_are_compared_with_classical_controllers_and_all_with_the_first():
    kalman, mine, perfect = ("kalman", "classical"), ("mine", "user"), ("perfect", "perfect")
    assert pairs_to_compare([perfect, kalman, mine, ("lq", "classical")]) == [(2, 1), (2, 3), (3, 1)]
    assert pairs_to_compare([("policy", "policy")] * 2 + [kalman, mine]) == [(0, 2), (1, 2), (3, 2), (3, 0)]


def test_rows_for_a_data_frame_are_plain():
    row = RESULTS.to_dicts()[1]
    assert (row["range_low_m"], row["range_high_m"], row["rate"], row["paper"]) == (1.0, 2.0, 0.8, 72.1)
    assert all(isinstance(value, str | int | float | None) for value in row.values())
