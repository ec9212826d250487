import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.evaluation.paper_results import LearningCurves, StepResponse, TrainingRun
from archerfish.evaluation.results import (
    SCHEMA,
    Cell,
    Comparison,
    Results,
    new_results,
    read_results,
    results_json,
    write_results,
)
from archerfish.paper.conditions import assumed_conditions, calibration
from archerfish.records.errors import InputError

CELL: dict[str, Any] = {
    "table": "III",
    "setting": "paper",
    "target": "dynamic",
    "range_m": [1.0, 2.0],
    "command_limit": "gate",
    "controller": "history",
    "policy_seed": 0,
    "motion": None,
    "counts": "decisions",
    "hits": 90,
    "shots": 100,
    "engagements": 2,
    "low": 0.8,
    "high": 0.95,
    "misses_slewing": 7,
    "misses_settled": 3,
    "paper": 88.35,
    "withheld": 0,
    "fallbacks": 0,
    "hits_per_s": 45.0,
    "bound": 0.93,
    "bound_error": 0.001,
    "bound_kind": "combined",
}
MINIMAL: dict[str, Any] = {"schema": SCHEMA, "seed": 1, "commit": "unknown", "versions": {}}


def write_raw(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def test_results_survive_the_disk(tmp_path: Path, synthetic_results: Results) -> None:
    write_results(tmp_path / "results.json", synthetic_results)
    assert read_results(tmp_path / "results.json") == synthetic_results


def test_what_was_not_computed_may_be_absent(tmp_path: Path) -> None:
    found = read_results(write_raw(tmp_path / "results.json", MINIMAL))
    assert found == Results(seed=1, commit="unknown", versions={})
    assert found.table1 is None
    assert found.figures.fig5 is None


def test_a_cell_in_the_file_has_the_documented_names(tmp_path: Path, synthetic_results: Results) -> None:
    write_results(tmp_path / "results.json", synthetic_results)
    written = json.loads((tmp_path / "results.json").read_text())
    assert written["schema"] == SCHEMA
    assert set(written["cells"][0]) == set(CELL)
    assert set(written["figures"]["fig5"]["runs"][0]) == {"policy_seed", "mean_return"}
    documented = (Path(__file__).parents[2] / "docs" / "results.md").read_text()
    assert [
        name for name in [*written, *written["cells"][0], *written["comparisons"][0]] if f"`{name}`" not in documented
    ] == []


def test_what_a_robot_adds_to_the_file_is_documented_and_survives_it(tmp_path: Path, robot_results: Results) -> None:
    write_results(tmp_path / "results.json", robot_results)
    assert read_results(tmp_path / "results.json") == robot_results
    written = json.loads((tmp_path / "results.json").read_text())
    robot = written["robot"]
    names = [*robot, *robot["axes"]["yaw"], *robot["landings"][0], *robot["steps"][0], *written["drops"][0]]
    documented = (Path(__file__).parents[2] / "docs" / "results.md").read_text()
    assert [name for name in names if f"`{name}`" not in documented] == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": "one"}, "field \"seed\" is 'one', expected a whole number"),
        ({"seed": True}, 'field "seed" is True, expected a whole number'),
        ({"colour": 1}, 'unknown field "colour"; known are seed'),
        ({"cells": {}}, 'field "cells" is {}, expected a list'),
        ({"cells": [{**CELL, "low": None}]}, r'field "cells\[0\].low" is None, expected a number'),
        ({"cells": [CELL, {**CELL, "range_m": [1]}]}, r'field "cells\[1\].range_m" has 1 entries, expected 2'),
        ({"cells": [{**CELL, "hits": 9.5}]}, r'"cells\[0\].hits" is 9.5, expected a whole number'),
        ({"cells": [{k: v for k, v in CELL.items() if k != "hits"}]}, r'field "cells\[0\].hits" is missing'),
        (
            {"cells": [{**CELL, "table": "VI"}]},
            r"cells\[0\].: table must be one of II, III, IV, V, motions, .*, got 'VI'",
        ),
        ({"cells": [{**CELL, "target": "slow"}]}, "target must be one of static, dynamic"),
        ({"cells": [{**CELL, "range_m": [2, 1]}]}, "range_m must be two distances, the smaller one first"),
        ({"cells": [{**CELL, "hits": 101}]}, "hits must lie between 0 and shots"),
        ({"cells": [{**CELL, "shots": 0, "hits": 0}]}, "shots \\+ withheld must be > 0, got 0 of 0, 0 withheld"),
        ({"cells": [{**CELL, "counts": "pellets"}]}, "counts must be one of decisions, shots, got 'pellets'"),
        ({"cells": [{**CELL, "withheld": 5}]}, "the misses, 105 decisions − 90 hits, got 7 and 3"),
        ({"cells": [CELL, {**CELL, "counts": "shots"}]}, "cells of table III at 1–2 m in paper, gate, count decisions"),
        ({"cells": [{**CELL, "high": 0.85}]}, "interval 0.8 to 0.85 must hold hits/counted = 0.9"),
        ({"cells": [{**CELL, "bound_error": None}]}, "bound, bound_error and bound_kind must be given together"),
        ({"cells": [{**CELL, "bound_kind": "likely"}]}, "bound_kind must be one of reach, hindsight, combined"),
        ({"cells": [{**CELL, "misses_settled": 4}]}, "the misses, 100 decisions − 90 hits, got 7 and 4"),
        ({"figures": {"fig5": {"steps": [1, 2], "runs": [{"policy_seed": 0, "mean_return": [1.0]}]}}}, "1 for 2 steps"),
        ({"conditions": {"drag": {"value": float("nan")}}}, "holds NaN, which JSON does not know"),
    ],
)
def test_a_damaged_file_is_refused_by_the_name_of_the_field(tmp_path: Path, change: Any, message: str) -> None:
    path = write_raw(tmp_path / "results.json", {**MINIMAL, **change})
    with pytest.raises(InputError, match=message) as caught:
        read_results(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_another_schema_is_refused(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "results.json", {**MINIMAL, "schema": "archerfish.results/9"})
    with pytest.raises(InputError, match=r"expected 'archerfish.results/2'"):
        read_results(path)


def test_a_file_from_before_shots_could_be_withheld_is_read_as_it_was_meant(tmp_path: Path) -> None:
    old = {name: value for name, value in CELL.items() if name not in {"counts", "withheld", "fallbacks", "hits_per_s"}}
    path = write_raw(tmp_path / "results.json", {**MINIMAL, "schema": "archerfish.results/1", "cells": [old]})
    (cell,) = read_results(path).cells
    assert (cell.counts, cell.shots, cell.withheld, cell.counted) == ("decisions", 100, 0, 100)
    assert (cell.rate, cell.hits_per_s) == (0.9, None)
    # Written again, it is a file of today.
    write_results(tmp_path / "again.json", read_results(path))
    assert json.loads((tmp_path / "again.json").read_text())["schema"] == SCHEMA
    assert read_results(tmp_path / "again.json").cells == (cell,)


@pytest.mark.parametrize("value", [float("nan"), np.int64(3), "many"])
def test_what_a_reader_would_refuse_is_not_written(tmp_path: Path, value: Any) -> None:
    results = Results(seed=1, commit="", versions={}, durations={"training": value})
    with pytest.raises(InputError, match=r"results\.json: not written, .*durations\.training"):
        write_results(tmp_path / "results.json", results)
    assert list(tmp_path.iterdir()) == []


def test_a_difference_outside_its_interval_is_refused() -> None:
    label = {name: CELL[name] for name in ("table", "setting", "target", "command_limit", "controller")}
    with pytest.raises(InputError, match=r"must hold the difference 0\.2"):
        Comparison(**label, range_m=(1.0, 2.0), against="kalman", difference=0.2, low=0.3, high=0.4)


def test_curves_of_unequal_length_are_refused() -> None:
    with pytest.raises(InputError, match="one length, got 2, 1 and 2"):
        StepResponse((0.0, 0.1), (0.0,), (0.0, 1.0), 99.0)
    with pytest.raises(InputError, match="seed 4 must have one entry per step, got 1 for 2"):
        LearningCurves((1, 2), (TrainingRun(4, (-1.0,)),))


def test_new_results_carry_their_origin(synthetic_results: Results) -> None:
    found = new_results(seed=3, conditions=assumed_conditions(), cells=list(synthetic_results.cells), quick=True)
    assert found.commit
    assert {"python", "archerfish", "numpy"} <= found.versions.keys()
    assert found.calibration == calibration()
    assert found.quick
    assert all(isinstance(cell, Cell) for cell in found.cells)
    assert results_json(found)["conditions"]["hit_radius"] == assumed_conditions().hit_radius


def test_other_conditions_don_t_borrow_the_calibration() -> None:
    other = dataclasses.replace(assumed_conditions(), muzzle_speed=25.0)
    assert new_results(seed=3, conditions=other).calibration is None
