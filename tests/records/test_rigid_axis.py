import json
from dataclasses import replace

import pytest

from archerfish.records.errors import InputError
from archerfish.records.rigid_axis import RigidAxisRecord, read_rigid_axis, write_rigid_axis

RECORD = RigidAxisRecord(
    axis_kind="pitch",
    inertia=0.02,
    damping=0.05,
    gravity_moment=0.4,
    gravity_phase=-1.2,
    axis="pitch",
    standard_errors={"inertia": 0.001},
    intervals={"inertia": (0.018, 0.022)},
    provenance={"seed": 3},
)


def test_a_record_comes_back_as_it_was(tmp_path):
    write_rigid_axis(tmp_path / "pitch.json", RECORD)
    assert read_rigid_axis(tmp_path / "pitch.json") == RECORD


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"inertia": 0.0}, "inertia must be > 0"),
        ({"gravity_moment": -0.1}, "turn the phase by π"),
        ({"friction": -0.1}, "friction must be ≥ 0"),
        ({"axis_kind": "roll"}, "must be pitch or yaw, got 'roll'"),
        ({"weight": 2.0}, 'unknown field "weight"'),
        ({"damping": "much"}, 'field "damping" is'),
        ({"intervals": {"inertia": 0.1}}, "must map names"),
        ({"schema": "archerfish.plant/1"}, "archerfish.rigid_axis/1"),
    ],
)
def test_a_damaged_record_is_refused_with_the_file_named(tmp_path, changes, told):
    path = tmp_path / "pitch.json"
    write_rigid_axis(path, RECORD)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(InputError, match=told) as caught:
        read_rigid_axis(path)
    assert str(path) in str(caught.value)


def test_a_file_from_before_friction_was_estimated_has_none(tmp_path):
    path = tmp_path / "pitch.json"
    write_rigid_axis(path, RECORD)
    facts = json.loads(path.read_text())
    assert facts.pop("friction") == 0.0
    del facts["units"]["friction"]
    path.write_text(json.dumps(facts))
    assert read_rigid_axis(path).friction == 0.0


def test_friction_comes_back(tmp_path):
    dry = replace(RECORD, friction=0.06, intervals={"friction": (0.05, 0.07)})
    write_rigid_axis(tmp_path / "pitch.json", dry)
    assert read_rigid_axis(tmp_path / "pitch.json") == dry
