import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from archerfish.records.errors import InputError
from archerfish.records.muzzle import MuzzleRecord, read_muzzle, write_muzzle

MUZZLE = MuzzleRecord(
    speed=18.0,
    speed_sd=0.2,
    pitch_offset=-0.01,
    pitch_sd=0.003,
    yaw_offset=0.002,
    yaw_sd=0.004,
    drag=0.019,
    length=0.1,
    height=0.4,
    intervals={"speed": (17.5, 18.5)},
    provenance={"seed": None},
)


def test_a_muzzle_is_read_back_exactly(tmp_path: Path) -> None:
    write_muzzle(tmp_path / "muzzle.json", MUZZLE)
    assert read_muzzle(tmp_path / "muzzle.json") == MUZZLE


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, -0.1) for name in ("speed_sd", "pitch_sd", "yaw_sd", "drag", "length", "height")),
        ("speed", 0.0),
        *((name, float("nan")) for name in ("speed", "speed_sd", "pitch_offset", "drag")),
        ("yaw_offset", float("inf")),
        ("yaw_sd", float("inf")),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"muzzle\.{name} must be .*{value}"):
        replace(MUZZLE, **{name: value})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"speed": "fast"}, "field \"speed\" is 'fast', expected int or float"),
        ({"speed": -1}, r"muzzle\.speed must be > 0 m/s, got -1"),
        ({"sped": 18.0}, 'unknown field "sped"; known are drag'),
        ({"drag": None}, 'field "drag" is None'),
        ({"intervals": {"speed": [17.5]}}, 'field "intervals" must map names to'),
        ({"intervals": 3}, 'field "intervals" must map names to'),
        ({"schema": "archerfish.plant/1"}, 'field "schema"'),
    ],
)
def test_a_file_with_a_bad_fact_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    path = tmp_path / "muzzle.json"
    write_muzzle(path, MUZZLE)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=rf"muzzle\.json: {complaint}"):
        read_muzzle(path)
