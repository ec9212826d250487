import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.plant import SCHEMA, PlantRecord, dc_gain, read_plant, write_plant

RNG = np.random.default_rng(0)
SHAPES = {"A": (2, 2), "B": (2, 1), "C": (1, 2), "D": (1, 1)}
PLANT = PlantRecord(
    A=np.array([[0.9, 0.1], [0.0, 0.8]]),
    B=np.array([[0.0], [0.5]]),
    C=np.array([[1.0, 0.0]]),
    D=np.array([[0.25]]),
    delay_samples=3,
    sample_period_s=0.001,
    axis="yaw",
    draws={name: RNG.standard_normal((4, *shape)) for name, shape in SHAPES.items()},
    draw_delays=np.array([3, 3, 2, 5]),
    provenance={"seed": 7},
)


def test_a_plant_is_read_back_exactly(tmp_path: Path) -> None:
    write_plant(tmp_path / "yaw.json", PLANT)
    found = read_plant(tmp_path / "yaw.json")
    for name in ("A", "B", "C", "D"):
        np.testing.assert_array_equal(getattr(found, name), getattr(PLANT, name))
        np.testing.assert_array_equal(found.draws[name], PLANT.draws[name])
    np.testing.assert_array_equal(found.draw_delays, PLANT.draw_delays)
    for name in ("delay_samples", "sample_period_s", "axis", "input_names", "output_names", "provenance"):
        assert getattr(found, name) == getattr(PLANT, name)


def test_the_dc_gain_is_where_a_step_ends() -> None:
    state = np.zeros((2, 1))
    for _ in range(500):
        state = PLANT.A @ state + PLANT.B
    np.testing.assert_allclose(dc_gain(PLANT), PLANT.C @ state + PLANT.D, rtol=1e-12)


def test_scaling_to_a_dc_gain_reaches_it() -> None:
    without_feedthrough = replace(PLANT, D=np.zeros((1, 1)))
    np.testing.assert_allclose(dc_gain(without_feedthrough.with_dc_gain(1.0)), 1.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"A": np.zeros((2, 3))}, r"plant\.A must have shape \(2, 2\), got \(2, 3\)"),
        ({"B": np.zeros((3, 1))}, r"plant\.B must have shape \(2, 1\), got \(3, 1\)"),
        ({"C": np.array([[np.nan, 0.0]])}, r"plant\.C holds a value that is not finite"),
        ({"D": np.zeros((1, 2))}, r"plant\.D must have shape \(1, 1\)"),
        ({"sample_period_s": 0.0}, r"plant\.sample_period_s must be > 0 s, got 0"),
        ({"sample_period_s": float("nan")}, r"plant\.sample_period_s must be > 0 s, got nan"),
        ({"draw_delays": np.array([3, 3])}, r"plant\.draw_delays must have shape \(4,\), got \(2,\)"),
        ({"draw_delays": np.array([3, 3, -1, 3])}, r"plant\.draw_delays must be ≥ 0, got -1"),
        ({"delay_samples": -1}, r"plant\.delay_samples must be ≥ 0, got -1"),
        ({"draws": {"A": np.zeros((4, 2, 2))}}, r"plant\.draws must hold A, B, C and D, got A"),
        ({"draws": PLANT.draws | {"B": np.zeros((3, 2, 1))}}, r"plant\.draws\[B\] must have shape \(4, 2, 1\)"),
        ({"draws": PLANT.draws | {"D": np.full((4, 1, 1), np.inf)}}, r"plant\.draws\[D\] holds a value that is not"),
    ],
)
def test_a_plant_that_does_not_hold_together_is_refused(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        replace(PLANT, **change)


def test_draws_without_delays_of_their_own_have_that_of_the_plant() -> None:
    np.testing.assert_array_equal(replace(PLANT, draw_delays=np.zeros(0, np.int64)).delays_of_draws(), [3, 3, 3, 3])
    np.testing.assert_array_equal(PLANT.delays_of_draws(), [3, 3, 2, 5])
    assert replace(PLANT, draws={}, draw_delays=np.zeros(0, np.int64)).delays_of_draws().size == 0


def test_a_record_of_the_first_version_is_read_with_one_delay_for_all_draws(tmp_path: Path) -> None:
    write_plant(tmp_path / "yaw.json", PLANT)
    facts, arrays = storage.read_record(tmp_path / "yaw.json", SCHEMA)
    del facts["schema"], facts["arrays_sha256"], arrays["draw_delays"]
    storage.write_record(tmp_path / "old.json", "archerfish.plant/1", facts, arrays)
    np.testing.assert_array_equal(read_plant(tmp_path / "old.json").delays_of_draws(), [3, 3, 3, 3])


def facts_with(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"delay_samples": 2.5}, r'yaw\.json: field "delay_samples" is 2\.5, expected int'),
        ({"delay_samples": -2}, r"yaw\.json: plant\.delay_samples must be ≥ 0"),
        ({"axis": None}, r'yaw\.json: field "axis" is None, expected str'),
        ({"schema": "archerfish.muzzle/1"}, r"yaw\.json: field \"schema\""),
    ],
)
def test_a_file_with_a_bad_fact_is_refused(tmp_path: Path, changes: dict[str, Any], complaint: str) -> None:
    write_plant(tmp_path / "yaw.json", PLANT)
    facts_with(tmp_path / "yaw.json", **changes)
    with pytest.raises(InputError, match=complaint):
        read_plant(tmp_path / "yaw.json")


def test_a_file_without_a_matrix_is_refused(tmp_path: Path) -> None:
    storage.write_record(tmp_path / "yaw.json", SCHEMA, {}, {name: np.eye(2) for name in "ABC"})
    with pytest.raises(InputError, match=r"yaw\.json: matrix D is missing; identify the axis anew"):
        read_plant(tmp_path / "yaw.json")
