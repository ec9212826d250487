import json
from pathlib import Path
from typing import Any

import pytest

from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits, LimitsRecord, read_limits, write_limits

PITCH = AxisLimits(low=-0.4, high=0.2, max_rate=12.0, max_acceleration=128.0)
LIMITS = LimitsRecord(PITCH, AxisLimits(-1.3, 1.3, 12.0, 67.0), source="data sheet", provenance={"seed": 0})


def test_limits_are_read_back_exactly(tmp_path: Path) -> None:
    write_limits(tmp_path / "limits.json", LIMITS)
    assert read_limits(tmp_path / "limits.json") == LIMITS


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ((0.2, -0.4, 12.0, 67.0), r"limits\.low must be below limits\.high, got 0\.2 and -0\.4 rad"),
        ((float("nan"), 0.2, 12.0, 67.0), r"limits\.low must be below"),
        ((-0.4, 0.2, 0.0, 67.0), r"limits\.max_rate must be > 0, got 0"),
        ((-0.4, 0.2, 12.0, float("nan")), r"limits\.max_acceleration must be > 0, got nan"),
    ],
)
def test_limits_out_of_range_are_refused_by_name(values: tuple[float, ...], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        AxisLimits(*values)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"pitch": None}, 'field "pitch" is None, expected dict'),
        ({"yaw": {"low": -1.0, "high": 1.0, "max_rate": 12.0}}, 'field "max_acceleration" is None'),
        ({"yaw": {"low": "-1", "high": "1", "max_rate": 12.0, "max_acceleration": 1.0}}, "field \"low\" is '-1'"),
        ({"yaw": {"low": 1.0, "high": -1.0, "max_rate": 12.0, "max_acceleration": 1.0}}, r"limits\.low must be"),
        ({"yaw": {"low": -1.0, "maximal": 1.0}}, 'unknown field "maximal"; known are low, high'),
        ({"roll": {}}, 'unknown field "roll"; known are pitch, yaw'),
        ({"schema": "archerfish.limits/2"}, 'field "schema"'),
    ],
)
def test_a_file_with_a_bad_fact_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    path = tmp_path / "limits.json"
    write_limits(path, LIMITS)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=rf"limits\.json: {complaint}"):
        read_limits(path)
