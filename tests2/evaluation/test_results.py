import json

import pytest

from archerfish2.controllers.registry import Tuning
from archerfish2.errors import InputError
from archerfish2.evaluation.results import Cell, Comparison, Results, pairs_to_compare
from archerfish2.records.json_files import plain
from archerfish2.task import Task

LABEL = {"world": "paper", "motion": "dynamic", "range_m": (1, 2), "length_s": 1.0, "command_limit": "gate"}
COUNTS = {"hits": 80, "shots": 90, "withheld": 10, "engagements": 2, "low": 0.7, "high": 0.9}
POLICY = Cell(**LABEL, **COUNTS, controller="policy", seed=0, kind="policy")
FACTS = {"table": "III", "paper": 72.1, "bound": 0.9, "bound_error": 0.0, "yaw_rad_s2": 60.0}
KALMAN = POLICY.replace(controller="kalman", seed=None, kind="classical", **FACTS)
FIGURES = {"difference": 0.1, "low": 0.05, "high": 0.2}
SETUP = {"seed": 3, "commit": "abc", "versions": {"numpy": "2"}, "robots": {"paper": {"digest": "12"}}}
RESULTS = Results(
    **SETUP,
    tasks=(Task(),),
    tuning={"paper/gate": {"kalman": Tuning(acceleration_sd=4.0)}},
    cells=(POLICY, KALMAN),
    comparisons=(Comparison(**LABEL, **FIGURES, controller="policy", seed=0, against="kalman"),),
    durations={"tuning": 1.5},
)
FILE = json.dumps({"schema": Results.schema, **plain(RESULTS)})


def test_results_survive_the_disk_in_a_file_or_its_folder(tmp_path):
    RESULTS.save(tmp_path / "run")
    Results.load(tmp_path / "run").save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "run" / "results.json").read_bytes()
    assert plain(Results.load(tmp_path / "again.json")) == plain(RESULTS)


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        (None, {"schema": "archerfish.results/2"}, "archerfish.results/3"),
        ("cells", {"hits": 91}, "91 of 90 shots"),
        ("cells", {"engagements": 101}, "0 < engagements ≤ decisions"),
        ("cells", {"range_m": [2, 1]}, "the smaller distance first"),
        ("cells", {"high": 0.75}, "interval is 0.7 to 0.75, expected one around the rate, 0.8"),
        ("cells", {"bound": 0.9}, "expected both or neither"),
        ("cells", {"seed": 1}, "a comparison of policy has no cell"),
        ("cells", {"controller": "kalman", "seed": None}, "have one label"),
        ("comparisons", {"low": 0.15}, "interval is 0.15 to 0.2, expected one around the difference, 0.1"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, part, changes, message):
    content = json.loads(FILE)
    (content if part is None else content[part][0]).update(changes)
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"results\.json: .*evaluate again$") as caught:
        Results.load(tmp_path)
    assert message in str(caught.value)


@pytest.mark.parametrize("count", [60, pytest.param(400, marks=pytest.mark.slow)])
def test_any_mutated_file_is_read_or_refused_in_one_line(tmp_path, mutations, accepted, count):
    outcomes = set()
    for content in mutations(FILE.encode(), count, 1):
        (tmp_path / "results.json").write_bytes(content)
        found = accepted(lambda: Results.load(tmp_path))
        outcomes.add(found is None or bool(repr(found)))
    assert outcomes == {True}


def test_joined_results_have_the_cells_of_both_once():
    infantry = {"robots": {"infantry": {"digest": "3"}}, "cells": (KALMAN, KALMAN.replace(world="infantry"))}
    joined = RESULTS.join(RESULTS.replace(comparisons=(), **infantry), RESULTS)
    assert [(each.world, each.controller) for each in joined.cells[1:]] == [("paper", "kalman"), ("infantry", "kalman")]
    assert [len(each) for each in (joined.cells, joined.robots, joined.tasks, joined.comparisons)] == [3, 2, 1, 1]
    assert joined.durations == {"tuning": 4.5}


def test_results_that_contradict_each_other_are_not_joined():
    tuning = {"paper/gate": {"kalman": Tuning(acceleration_sd=5.0)}}
    contradictions = {
        "seed of the results is": {"seed": 4},
        "have one label": {"cells": (POLICY.replace(hits=79),)},
        "robots: digest of paper differs": {"robots": {"paper": {"digest": "other"}}},
        "tuning: kalman of paper/gate differs": {"tuning": tuning},
    }
    for message, changes in contradictions.items():
        with pytest.raises(InputError, match=message):
            RESULTS.join(RESULTS.replace(**changes))


def test_a_pair_is_compared_in_both_directions():
    (there,), (back,) = RESULTS.compare("policy", "kalman"), RESULTS.compare("kalman", "policy")
    assert (there.difference, there.low, there.high) == (0.1, 0.05, 0.2)
    assert (back.controller, back.difference, back.low, back.high) == ("kalman", -0.1, -0.2, -0.05)
    with pytest.raises(InputError, match="no comparison of policy with oracle; there are policy with kalman; "):
        RESULTS.compare("policy", "oracle")


def test_policies_are_compared_with_classical_controllers_and_all_with_the_first():
    kalman, mine, perfect = ("kalman", "classical"), ("mine", "user"), ("perfect", "perfect")
    assert pairs_to_compare([perfect, kalman, mine, ("lq", "classical")]) == [(2, 1), (2, 3), (3, 1)]
    assert pairs_to_compare([("policy", "policy")] * 2 + [kalman, mine]) == [(0, 2), (1, 2), (3, 2), (3, 0)]


def test_rows_for_a_data_frame_are_plain():
    row = RESULTS.to_dicts()[1]
    assert (row["range_low_m"], row["range_high_m"], row["rate"], row["paper"]) == (1.0, 2.0, 0.8, 72.1)
    assert all(isinstance(value, str | int | float | None) for value in row.values())
