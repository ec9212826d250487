import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.policy import SCHEMA, TRACKER_FACTS, PolicyRecord, read_policy, write_policy
from archerfish.sensing.kalman_filter import TrackerNoise

RNG = np.random.default_rng(0)


def floats(*shape: int) -> Any:
    return RNG.standard_normal(shape).astype(np.float32)


POLICY = PolicyRecord(
    observation="paper",
    frames=0,
    weights=(floats(6, 8), floats(8, 2)),
    biases=(floats(8), floats(2)),
    mean=floats(6),
    variance=np.ones(6, np.float32),
    action_scale=np.array([0.1, 0.3], np.float32),
    braking=np.full(2, 0.03, np.float32),
    muzzle={"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0},
    period_s=0.02,
    command_limit="gate",
    training={"seed": 4},
    provenance={"commit": "unknown"},
)


def arrays_of(policy: PolicyRecord) -> tuple[Any, ...]:
    return (*policy.weights, *policy.biases, policy.mean, policy.variance, policy.action_scale, policy.braking)


def test_a_policy_is_read_back_exactly(tmp_path: Path) -> None:
    write_policy(tmp_path / "policy.json", POLICY)
    found = read_policy(tmp_path / "policy.json")
    for written, read in zip(arrays_of(POLICY), arrays_of(found), strict=True):
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, written)
    for name in ("observation", "frames", "muzzle", "period_s", "command_limit", "training", "provenance"):
        assert getattr(found, name) == getattr(POLICY, name)


TRACKER = {name: 0.1 * index for index, name in enumerate(TRACKER_FACTS)}


def test_what_a_tracker_believes_is_read_back_exactly(tmp_path: Path) -> None:
    assert TrackerNoise._fields == TRACKER_FACTS
    write_policy(tmp_path / "policy.json", replace(POLICY, observation="tracked", tracker=TRACKER))
    assert read_policy(tmp_path / "policy.json").tracker == TRACKER


RAMP = {"pitch_gain": 1.03, "yaw_gain": 1.0, "lead": 0.05}


def test_how_the_gimbal_follows_is_read_back_and_must_be_whole(tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, replace(POLICY, ramp=RAMP))
    assert read_policy(path).ramp == RAMP
    for wrong in ({"lead": None}, {"lead": 0.0}, {"yaw_gain": float("inf")}):
        with pytest.raises(InputError, match=r"policy\.ramp must hold the number"):
            replace(POLICY, ramp=RAMP | wrong)
    facts = json.loads(path.read_text())
    del facts["ramp"]
    path.write_text(json.dumps(facts))
    assert read_policy(path).ramp == {}


def test_a_tracker_from_before_its_initial_speed_could_be_set_has_that_of_then(tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, replace(POLICY, observation="tracked", tracker=TRACKER))
    facts = json.loads(path.read_text())
    facts["tracker"].pop("initial_speed")
    path.write_text(json.dumps(facts))
    assert read_policy(path).tracker == TRACKER | {"initial_speed": 1.0}


def test_a_policy_from_before_there_were_trackers_has_none(tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, POLICY)
    facts = json.loads(path.read_text())
    assert facts.pop("tracker") == {}
    path.write_text(json.dumps(facts))
    assert read_policy(path).tracker == {}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"variance": np.ones(5, np.float32)}, r"policy\.variance must have shape \(6,\), got \(5,\)"),
        ({"weights": (floats(6, 8), floats(7, 2))}, r"policy layer 1 must take 8 inputs, got weight \(7, 2\)"),
        ({"biases": (floats(7), floats(2))}, r"policy layer 0 must take 6 inputs, .* bias \(7,\)"),
        ({"weights": (floats(6, 8), floats(8, 3)), "biases": (floats(8), floats(3))}, "must have 2 outputs, .* got 3"),
        ({"mean": np.full(6, np.nan, np.float32)}, "not finite"),
        ({"action_scale": np.ones(3, np.float32)}, r"policy\.action_scale must have shape \(2,\), got \(3,\)"),
        ({"action_scale": np.full(2, np.inf, np.float32)}, "not finite"),
        ({"braking": np.ones(1, np.float32)}, r"policy\.braking must have shape \(2,\), got \(1,\)"),
        ({"braking": np.array([0.03, 0.0], np.float32)}, r"policy\.braking must be > 0 rad"),
        ({"muzzle": {"speed": 18.0}}, r'policy\.muzzle must hold the number "drag"'),
        ({"observation": "tracked"}, r'policy\.tracker must hold the number "acceleration"'),
        ({"observation": "tracked", "tracker": TRACKER | {"across": "wide"}}, r'policy\.tracker .* "across"'),
    ],
)
def test_a_policy_that_does_not_hold_together_is_refused(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        replace(POLICY, **change)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"frames": "four"}, "field \"frames\" is 'four', expected int"),
        ({"period_s": None}, 'field "period_s" is None'),
        ({"tracker": [1.0]}, r'field "tracker" is \[1\.0\]'),
        ({"muzzle": {}}, r'policy\.muzzle must hold the number "speed"'),
        ({"schema": "archerfish.checkpoint/1"}, 'field "schema"'),
    ],
)
def test_a_file_with_a_bad_fact_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, POLICY)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=rf"policy\.json: {complaint}"):
        read_policy(path)


@pytest.mark.parametrize("missing", ["bias_1", "mean", "action_scale", "braking"])
def test_a_file_without_an_array_is_refused(tmp_path: Path, missing: str) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, POLICY)
    facts, arrays = storage.read_record(path, SCHEMA)
    facts = {name: fact for name, fact in facts.items() if name not in ("schema", "arrays_sha256")}
    storage.write_record(path, SCHEMA, facts, {name: array for name, array in arrays.items() if name != missing})
    with pytest.raises(InputError, match=rf"policy\.json: array '{missing}' is missing; train the policy anew"):
        read_policy(path)


def test_a_damaged_policy_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    write_policy(path, POLICY)
    arrays = path.with_suffix(".safetensors")
    arrays.write_bytes(arrays.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"policy\.safetensors"):
        read_policy(path)
