import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.errors import InputError
from archerfish2.paper.conditions import paper_muzzle
from archerfish2.paper.gimbal import gate_limits
from archerfish2.records.json_files import plain, write_json
from archerfish2.records.limits import AxisLimits
from archerfish2.records.plant import PlantRecord
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord

Array = np.ndarray[Any, Any]
PLANT = PlantRecord.second_order(9.8, 0.4, delay_s=8e-3)
DRAWS = {name: np.repeat(getattr(PLANT, name)[None], 3, axis=0) for name in "ABCD"}
NOISE = dict.fromkeys(
    ("stamp_jitter", "bearing_sd", "elevation_sd", "range_sd", "miss_probability", "outlier_share"), 0.1
)
CAMERA = CameraRecord(rate_hz=60.0, time_offset=-0.01, noise_range=3.0, **NOISE)
RECORDS: dict[str, Any] = {
    "plant": PLANT.replace(draws=DRAWS, draw_delays=np.array([7, 8, 9]), provenance={"seed": 0, "inputs": {"a": "b"}}),
    "muzzle": paper_muzzle().replace(intervals={"speed": (17.9, 18.1)}),
    "sensing": SensingRecord(camera=CAMERA, link=LinkRecord(feedback_rate_hz=500.0, command_latency=0.01)),
    "limits": gate_limits(),
}


def simulate(A: Array, B: Array, C: Array, D: Array, u: Array) -> Array:
    state, outputs = np.zeros(len(A)), []
    for each in u:
        outputs.append(C @ state + D @ each)
        state = A @ state + B @ each
    return np.array(outputs)


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_is_read_back_exactly_and_one_of_the_first_edition_is_refused(tmp_path: Path, name: str) -> None:
    record, path = RECORDS[name], tmp_path / "x.json"
    record.save(path)
    for again in (type(record).load(path), pickle.loads(pickle.dumps(record))):
        assert plain(again) == plain(record)
    assert len(path.read_text().splitlines()) == len(record.__struct_fields__) + 3
    path.write_text(path.read_text().replace(record.schema, f"archerfish.{name}/1"))
    with pytest.raises(
        InputError, match=rf'x.json: field schema: expected "archerfish.{name}/\d", got .*identify again'
    ):
        type(record).load(path)


@pytest.mark.parametrize(
    ("name", "change", "complaint"),
    [
        ("plant", {"A": [["1"]]}, r"field A: expected float, got str"),
        ("plant", {"B": [[True], [1.0]]}, r"field B: expected float, got bool"),
        ("plant", {"C": [[None, 1.0]]}, r"field C: expected float, got null"),
        ("plant", {"D": [[1.0], [1.0, 2.0]]}, r"field D: .*inhomogeneous"),
        ("plant", {"A": []}, r"expected 1…64 states, got 0"),
        ("plant", {"A": [[1e13, 0.0], [0.0, 1.0]]}, r"field A: expected float <= 1000000000000.0"),
        ("plant", {"draws": {"A": DRAWS["A"]}}, r"field draws\[B\]: expected shape \(3, 2, 1\), got none"),
        ("plant", {"draw_delays": [7, 8]}, r"field draw_delays: expected shape \(3,\), got \(2,\)"),
        ("plant", {"delay_samples": -1}, r"field delay_samples: expected int >= 0, got -1"),
        ("plant", {"output_names": ["angle", "rate"]}, r"field output_names: expected shape \(1,\), got \(2,\)"),
        ("plant", {"provenance": {"a": {"b": {"c": 1}}}}, r"field provenance"),
        ("muzzle", {"speed": 0.0}, r"field speed: expected float >= 0.1, got 0.0"),
        ("muzzle", {"intervals": {"speed": [2.0, 1.0]}}, r"intervals.speed: expected low ≤ high, got 2 and 1"),
        ("limits", {"yaw": {"low": 1.0, "high": 0.5, "max_rate": 1.0, "max_acceleration": 1.0}}, r"low < high, got 1"),
        (
            "sensing",
            {"link": {"feedback_rate_hz": 500.0, "command_latency": -1e-3}},
            r"link.command_latency: .* -0.001",
        ),
        ("sensing", {"camera": {**plain(CAMERA), "latency": 0.02}}, r'latency_basis: .* got ""'),
    ],
)
def test_a_bad_field_is_named_from_a_file_and_in_python(
    tmp_path: Path, name: str, change: dict[str, Any], complaint: str
) -> None:
    record = RECORDS[name]
    write_json(tmp_path / "x.json", {"schema": record.schema, **plain(record), **plain(change)})
    with pytest.raises(InputError, match=f"^{tmp_path}/x.json: .*{complaint}.*; identify again$"):
        type(record).load(tmp_path / "x.json")
    with pytest.raises(InputError, match=complaint):
        record.replace(**change)


def test_numbers_of_numpy_are_numbers_and_those_that_are_not_finite_are_refused() -> None:
    assert AxisLimits(low=np.float32(-1.0), high=np.int64(1), max_rate=12, max_acceleration=67.0).high == 1.0
    assert type(paper_muzzle().replace(speed=18).speed) is float
    for value in (float("nan"), float("inf")):
        with pytest.raises(InputError, match="field D: expected float"):
            PLANT.replace(D=np.array([[value]]))
        with pytest.raises(InputError, match="field speed_sd: expected float"):
            paper_muzzle().replace(speed_sd=value)


def test_measured_values_are_named_as_their_intervals() -> None:
    values = RECORDS["sensing"].values()
    assert (values["camera.rate_hz"], values["link.command_latency"]) == (60.0, 0.01)
    assert "camera.latency" not in values


@pytest.mark.parametrize("damping", [0.4, 3.0])
def test_a_second_order_plant_steps_as_its_poles_say(damping: float) -> None:
    plant = PlantRecord.second_order(9.8, damping, delay_s=5e-3, gain=1.1)
    one, two = 2 * np.pi * 9.8 * (-damping + np.sqrt(damping**2 - 1 + 0j) * np.array([1, -1]))
    time, u = 1e-3 * np.arange(300), np.ones((305, 1))
    expected = (1 + (two * np.exp(one * time) - one * np.exp(two * time)) / (one - two)).real
    assert_allclose(simulate(*plant.to_state_space()[:4], u)[5:, 0], 1.1 * expected, atol=1e-12)
    assert_allclose(simulate(*plant.with_dc_gain(0.9).to_state_space()[:4], u)[5:, 0], 0.9 * expected, atol=1e-12)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_the_matrices_that_are_given_out_contain_the_delay(delay: int) -> None:
    rng = np.random.default_rng(0)
    A, B, C, D = (
        0.2 * rng.normal(size=(3, 3)),
        rng.normal(size=(3, 2)),
        rng.normal(size=(2, 3)),
        rng.normal(size=(2, 2)),
    )
    plant, u = PlantRecord.from_state_space(A, B, C, D, 0.01, delay_samples=delay), rng.normal(size=(50, 2))
    late = np.vstack([np.zeros((delay, 2)), u])[:50]
    assert_allclose(simulate(*plant.to_state_space()[:4], u), simulate(A, B, C, D, late), atol=1e-12)


def test_what_no_plant_can_be_made_of_is_refused() -> None:
    with pytest.raises(InputError, match=r"delay_s must be a multiple .* got 0.0123"):
        PlantRecord.second_order(9.8, 0.4, delay_s=0.0123)
    with pytest.raises(InputError, match="natural_hz must be > 0"):
        PlantRecord.second_order(-1.0, 0.4)
    with pytest.raises(InputError, match="integrates"):
        _ = PlantRecord.from_state_space(1.0, 1.0, 1.0, 0.0, 0.01).dc_gain
    with pytest.raises(InputError, match="delay of 3000 samples has 3002 states"):
        PLANT.replace(delay_samples=3000).to_state_space()
