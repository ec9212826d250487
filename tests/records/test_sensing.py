import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from archerfish.records.errors import InputError
from archerfish.records.sensing import (
    CameraRecord,
    LinkRecord,
    SensingRecord,
    read_sensing,
    sensing_values,
    write_sensing,
)

CAMERA = CameraRecord(
    rate_hz=80.0,
    time_offset=-0.134,
    stamp_jitter=3e-4,
    bearing_sd=0.0017,
    elevation_sd=0.0016,
    range_sd=0.045,
    noise_range=3.0,
    miss_probability=0.05,
    outlier_share=0.01,
    latency=0.035,
    latency_jitter=0.002,
    latency_basis="exposure",
)
LINK = LinkRecord(feedback_rate_hz=500.0, feedback_quantum=7.7e-4, command_delay=0.013, command_jitter=0.003)
RECORD = SensingRecord(CAMERA, LINK, {"camera.latency": (0.034, 0.036)}, {"seed": 0})


def test_a_record_is_read_back_exactly_with_what_was_not_measured(tmp_path: Path) -> None:
    write_sensing(tmp_path / "sensing.json", RECORD)
    assert read_sensing(tmp_path / "sensing.json") == RECORD
    assert RECORD.link.feedback_delay is None


STAMPED = replace(
    LINK,
    command_latency=0.0101,
    command_latency_jitter=0.0029,
    feedback_latency=0.002,
    feedback_latency_jitter=0.0006,
)


def test_latencies_of_both_directions_are_read_back_exactly(tmp_path: Path) -> None:
    intervals = {"link.command_latency": (0.0099, 0.0103), "link.feedback_latency_jitter": (0.0005, 0.0007)}
    record = SensingRecord(CAMERA, STAMPED, intervals)
    write_sensing(tmp_path / "sensing.json", record)
    assert read_sensing(tmp_path / "sensing.json") == record
    assert sensing_values(record)["link.feedback_latency"] == 0.002


def test_a_record_from_before_there_were_latencies_of_messages_has_none(tmp_path: Path) -> None:
    path = tmp_path / "sensing.json"
    write_sensing(path, RECORD)
    facts = json.loads(path.read_text())
    for name in ("command_latency", "command_latency_jitter", "feedback_latency", "feedback_latency_jitter"):
        assert facts["link"].pop(name) is None
    path.write_text(json.dumps(facts))
    assert read_sensing(path) == RECORD


@pytest.mark.parametrize(
    "name", ["command_latency", "command_latency_jitter", "feedback_latency", "feedback_latency_jitter"]
)
def test_no_message_arrives_before_it_was_sent(name: str) -> None:
    with pytest.raises(InputError, match=rf"sensing\.link\.{name} must be ≥ 0, got -0\.001"):
        SensingRecord(CAMERA, replace(STAMPED, **{name: -0.001}))


def test_values_are_named_as_their_intervals() -> None:
    values = sensing_values(RECORD)
    assert RECORD.intervals.keys() <= values.keys()
    assert values["camera.latency"] == 0.035
    assert "link.feedback_delay" not in values


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate_hz", 0.0),
        ("time_offset", float("nan")),
        ("range_sd", -0.1),
        ("miss_probability", 1.5),
        ("latency", float("inf")),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"sensing\.camera\.{name} must be .*{value}"):
        replace(RECORD, camera=replace(CAMERA, **{name: value}))


def test_a_latency_says_what_it_counts_from() -> None:
    with pytest.raises(InputError, match="latency_basis"):
        replace(RECORD, camera=replace(CAMERA, latency_basis=""))
    with pytest.raises(InputError, match="latency_basis"):
        replace(RECORD, camera=replace(CAMERA, latency=None))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"camera": 3}, 'field "camera"'),
        ({"lens": {}}, 'unknown field "lens"'),
        ({"camera": {"fps": 80}}, r'unknown field "camera\.fps"'),
        ({"link": {}}, 'field "feedback_rate_hz"'),
        ({"link": {"feedback_rate_hz": "fast"}}, "field \"feedback_rate_hz\" is 'fast'"),
        ({"link": {"feedback_rate_hz": -1}}, r"sensing\.link\.feedback_rate_hz must be > 0"),
        ({"intervals": 3}, 'field "intervals" must map names to'),
        ({"schema": "archerfish.plant/1"}, 'field "schema"'),
    ],
)
def test_a_file_with_a_bad_fact_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    path = tmp_path / "sensing.json"
    write_sensing(path, RECORD)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=rf"sensing\.json: {complaint}"):
        read_sensing(path)
