import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.errors import InputError
from archerfish2.paper.conditions import paper_muzzle
from archerfish2.paper.gimbal import gate_limits
from archerfish2.records.json_files import plain, read_json, write_json
from archerfish2.records.limits import AxisLimits, LimitsRecord
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.records.plant import PlantRecord
from archerfish2.records.record import Record
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord

Array = Any
PLANT = PlantRecord.second_order(9.8, 0.4, delay_s=8e-3)
DRAWS = {name: np.repeat(getattr(PLANT, name)[None], 3, axis=0) for name in "ABCD"}
CAMERA = CameraRecord(
    rate_hz=60.0,
    time_offset=-0.01,
    stamp_jitter=0.001,
    bearing_sd=0.002,
    elevation_sd=0.002,
    range_sd=0.03,
    noise_range=3.0,
    miss_probability=0.01,
    outlier_share=0.0,
)
SENSING = SensingRecord(camera=CAMERA, link=LinkRecord(feedback_rate_hz=500.0, command_latency=0.01))
RECORDS = {
    "plant": PLANT.replace(draws=DRAWS, draw_delays=np.array([7, 8, 9]), provenance={"seed": 0, "inputs": {"a": "b"}}),
    "muzzle": paper_muzzle().replace(intervals={"speed": (17.9, 18.1)}),
    "sensing": SENSING,
    "limits": gate_limits(),
}


def simulate(A: Array, B: Array, C: Array, D: Array, u: Array) -> Array:
    state, outputs = np.zeros(len(A)), []
    for each in u:
        outputs.append(C @ state + D @ each)
        state = A @ state + B @ each
    return np.array(outputs)


def step_response(plant: PlantRecord, samples: int) -> Array:
    return simulate(*plant.to_state_space()[:4], np.ones((samples, 1)))[:, 0]


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_is_read_back_exactly_from_its_file_and_from_a_pickle(tmp_path: Path, name: str) -> None:
    record = RECORDS[name]
    record.save(tmp_path / "x.json")
    for again in (type(record).load(tmp_path / "x.json"), pickle.loads(pickle.dumps(record))):
        assert plain(again) == plain(record)
        assert len(repr(again)) < 2000


@pytest.mark.parametrize("name", RECORDS)
def test_files_of_the_first_edition_are_refused_with_the_remedy(tmp_path: Path, name: str) -> None:
    write_json(tmp_path / "x.json", {**plain(RECORDS[name]), "schema": f"archerfish.{name}/1"})
    with pytest.raises(
        InputError, match=rf'x.json: field schema: expected "archerfish.{name}/\d", got .*identify again'
    ):
        type(RECORDS[name]).load(tmp_path / "x.json")


@pytest.mark.parametrize(
    ("name", "change", "complaint"),
    [
        ("plant", {"A": [["1"]]}, r"field A: expected float, got str"),
        ("plant", {"B": [[True], [1.0]]}, r"field B: expected float, got bool"),
        ("plant", {"C": [[None, 1.0]]}, r"field C: expected float, got null"),
        ("plant", {"D": [[1.0], [1.0, 2.0]]}, r"field D: .*inhomogeneous"),
        ("plant", {"D": [[[[[[1.0]]]]]]}, r"field D: expected float, got array"),
        ("plant", {"A": []}, r"expected 1…64 states, got 0"),
        ("plant", {"A": 1.0}, r"expected 1…64 states, got 0"),
        ("plant", {"A": [[1e13, 0.0], [0.0, 1.0]]}, r"field A: expected float <= 1000000000000.0"),
        ("plant", {"draws": {"A": DRAWS["A"]}}, r"field draws\[B\]: expected shape \(3, 2, 1\), got none"),
        ("plant", {"draws": {**DRAWS, "E": [1.0]}}, r"field draws\[E\]: expected shape none, got \(1,\)"),
        ("plant", {"draw_delays": [7, 8]}, r"field draw_delays: expected shape \(3,\), got \(2,\)"),
        ("plant", {"draw_delays": [7, 8, -1]}, r"field draw_delays: expected int >= 0"),
        ("plant", {"delay_samples": 3.5}, r"field delay_samples: expected int, got float"),
        ("plant", {"delay_samples": 1_000_001}, r"field delay_samples: expected int <= 1000000, got 1000001"),
        ("plant", {"sample_period_s": 0}, r"field sample_period_s: expected float >= .*, got 0"),
        ("plant", {"output_names": ["angle", "rate"]}, r"field output_names: expected shape \(1,\), got \(2,\)"),
        ("plant", {"provenance": {"a": {"b": {"c": 1}}}}, r"field provenance"),
        ("plant", {"speed": 1.0}, r"unknown field speed"),
        ("muzzle", {"speed": 0.0}, r"field speed: expected float >= 0.1, got 0.0"),
        ("muzzle", {"yaw_sd": -0.1}, r"field yaw_sd: expected float >= 0.0, got -0.1"),
        ("muzzle", {"drag": "0.02"}, r"field drag: expected float, got str"),
        ("muzzle", {"intervals": {"speed": [2.0, 1.0]}}, r"intervals.speed: expected low ≤ high, got 2 and 1"),
        ("muzzle", {"intervals": {"speed": [2.0]}}, r"field intervals"),
        ("limits", {"yaw": {"low": 1.0, "high": 0.5, "max_rate": 1.0, "max_acceleration": 1.0}}, r"low < high, got 1"),
        (
            "limits",
            {"yaw": {"low": 0.0, "high": 0.5, "max_rate": 0.0, "max_acceleration": 1.0}},
            r"max_rate: .* got 0.0",
        ),
        ("sensing", {"link": {"feedback_rate_hz": 500.0, "command_latency": -1e-3}}, r"link.command_latency"),
        ("sensing", {"camera": {**plain(CAMERA), "miss_probability": 1.5}}, r"miss_probability: expected float <= 1.0"),
        ("sensing", {"camera": {**plain(CAMERA), "latency": 0.02}}, r'latency_basis: .* got ""'),
        ("sensing", {"camera": {**plain(CAMERA), "latency_basis": "stamp"}}, r"latency_basis"),
    ],
)
def test_a_bad_field_is_named_from_a_file_and_in_python(
    tmp_path: Path, name: str, change: dict[str, Any], complaint: str
) -> None:
    record: Record = RECORDS[name]
    write_json(tmp_path / "x.json", {"schema": record.schema, **plain(record), **plain(change)})
    with pytest.raises(InputError, match=complaint) as error:
        type(record).load(tmp_path / "x.json")
    assert str(error.value).startswith(f"{tmp_path}/x.json: ")
    assert str(error.value).endswith("; identify again")
    assert "\n" not in str(error.value)
    if "speed" not in change or name != "plant":
        with pytest.raises(InputError, match=complaint):
            record.replace(**change)


def test_numbers_that_are_not_finite_are_refused_in_python() -> None:
    for value in (float("nan"), float("inf")):
        with pytest.raises(InputError, match="field D: expected float"):
            PLANT.replace(D=np.array([[value]]))
        with pytest.raises(InputError, match="field speed_sd: expected float"):
            paper_muzzle().replace(speed_sd=value)


def test_numbers_of_numpy_are_numbers() -> None:
    limits = AxisLimits(low=np.float32(-1.0), high=np.int64(1), max_rate=12, max_acceleration=67.0)
    assert LimitsRecord(pitch=limits, yaw=limits).yaw.high == 1.0
    assert type(MuzzleRecord(speed=18, speed_sd=0, pitch_sd=0, yaw_sd=0, drag=0).speed) is float


def test_measured_values_are_named_as_their_intervals() -> None:
    values = SENSING.values()
    assert (values["camera.rate_hz"], values["link.command_latency"]) == (60.0, 0.01)
    assert "camera.latency" not in values


@pytest.mark.parametrize("damping", [0.4, 3.0])
def test_a_second_order_plant_steps_as_its_poles_say(damping: float) -> None:
    plant = PlantRecord.second_order(9.8, damping, delay_s=5e-3, sample_period_s=1e-3, gain=1.1)
    time = 1e-3 * np.arange(300)
    one, two = 2 * np.pi * 9.8 * (-damping + np.sqrt(damping**2 - 1 + 0j) * np.array([1, -1]))
    expected = 1.1 * (1 + (two * np.exp(one * time) - one * np.exp(two * time)) / (one - two)).real
    assert_allclose(step_response(plant, 305)[5:], expected, atol=1e-12)
    assert plant.dc_gain.item() == pytest.approx(1.1)
    assert_allclose(step_response(plant.with_dc_gain(0.9), 300), 0.9 / 1.1 * step_response(plant, 300), atol=1e-12)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_the_matrices_that_are_given_out_contain_the_delay(delay: int) -> None:
    rng = np.random.default_rng(0)
    A, B, C, D = (
        0.2 * rng.normal(size=(3, 3)),
        rng.normal(size=(3, 2)),
        rng.normal(size=(2, 3)),
        rng.normal(size=(2, 2)),
    )
    plant = PlantRecord.from_state_space(A, B, C, D, 0.01, delay_samples=delay)
    u = rng.normal(size=(50, 2))
    late = np.vstack([np.zeros((delay, 2)), u])[:50]
    assert_allclose(simulate(*plant.to_state_space()[:4], u), simulate(A, B, C, D, late), atol=1e-12)
    assert plant.input_names == ("command_1", "command_2")


def test_what_no_plant_can_be_made_of_is_refused() -> None:
    with pytest.raises(InputError, match=r"delay_s must be a multiple .* got 0.0123"):
        PlantRecord.second_order(9.8, 0.4, delay_s=0.0123, sample_period_s=1e-3)
    with pytest.raises(InputError, match="natural_hz must be > 0"):
        PlantRecord.second_order(-1.0, 0.4)
    with pytest.raises(InputError, match="integrates"):
        _ = PlantRecord.from_state_space(1.0, 1.0, 1.0, 0.0, 0.01).dc_gain
    with pytest.raises(InputError, match="delay of 3000 samples has 3002 states"):
        PLANT.replace(delay_samples=3000).to_state_space()


def test_draws_without_delays_of_their_own_have_that_of_the_plant() -> None:
    assert_array_equal(PLANT.replace(draws=DRAWS).delays_of_draws(), [8, 8, 8])
    assert_array_equal(RECORDS["plant"].delays_of_draws(), [7, 8, 9])  # type: ignore[attr-defined]


def test_the_file_is_json_with_a_line_per_field(tmp_path: Path) -> None:
    PLANT.save(tmp_path / "x.json")
    content = read_json(tmp_path / "x.json")
    assert content["A"] == PLANT.A.tolist()
    assert len((tmp_path / "x.json").read_text().splitlines()) == len(content) + 2
