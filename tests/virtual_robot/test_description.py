"""Descriptions of virtual robots: what is not a valid one is refused in one line that names file and field."""

import json
import re
import tomllib
from importlib.resources import files
from pathlib import Path

import msgspec
import pytest

from archerfish.errors import InputError
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import load_robot, robot_names

ROBOTS = files("archerfish.virtual_robot") / "robots"
INFANTRY = (ROBOTS / "infantry.toml").read_text()
TABLES = {part.split("]")[0]: part for part in re.split(r"(?m)^\[", INFANTRY)[1:]}
FIELDS = [(table, key) for table, part in TABLES.items() for key in re.findall(r"(?m)^(\w+) =", part)]
NUMBERS = [(table, key) for table, key in FIELDS if key not in ("format", "name", "feedback_source")]
SIGNED = r"(command_)?(low|high)_deg|boresight.*|misalignment.*|recoil_n_m_s|clock_offset_ms|(forward|left|up)_m"


@pytest.fixture
def refusal(tmp_path):
    """Return what is said of a file."""

    def read(content):
        path = tmp_path / "my.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(InputError) as raised:
            load_robot(path)
        message = str(raised.value)
        assert message.startswith(f"{path}: ")
        assert message.isprintable()
        return message.removeprefix(f"{path}: ")

    return read


def changed(table, key, line):
    """Return the infantry robot's file with another line for a field."""
    part, count = re.subn(rf"(?m)^{key} = .*$", lambda _: line, TABLES[table])
    assert count == 1
    return INFANTRY.replace(TABLES[table], part)


@pytest.mark.parametrize("name", ["infantry", "worn"])
def test_a_robot_has_the_numbers_of_its_file_as_floats(name) -> None:
    assert name in robot_names()
    robot = load_robot(name)
    assert robot == load_robot(str(ROBOTS / f"{name}.toml"))
    assert msgspec.to_builtins(robot) == tomllib.loads((ROBOTS / f"{name}.toml").read_text())
    assert {type(value) for value in msgspec.to_builtins(robot.camera).values()} == {float}


def test_a_missing_or_misspelt_field_or_table_is_named(refusal) -> None:
    for table, key in FIELDS:
        assert f"field {table}: missing field {key}; " in refusal(changed(table, key, ""))
        misspelt = key[:2] + key[3:]
        message = refusal(changed(table, key, f"{misspelt} = 1.0"))
        assert message.startswith(f"field {table}.{misspelt}: ")
        assert key in message
    assert refusal(INFANTRY.replace("[" + TABLES["limits.yaw"], "")).startswith("field limits: missing field yaw; ")
    assert "no such field; perhaps you meant camera" in refusal(INFANTRY.replace("[camera]", "[cammera]"))


@pytest.mark.parametrize("value", ["'1'", "true", "[1.0]", "{}", "nan", "inf", "-inf", "1" + 400 * "0", "2020-01-01"])
def test_what_is_not_a_finite_number_is_named(refusal, value) -> None:
    expected = r"(expected (float|int)\b.*, got |number out of range; )"
    for table, key in NUMBERS:
        assert re.match(rf"field {table}.{key}: {expected}", refusal(changed(table, key, f"{key} = {value}")))


def test_a_negative_value_is_refused_with_its_bound(refusal) -> None:
    for table, key in NUMBERS:
        if not re.fullmatch(SIGNED, key):
            message = refusal(changed(table, key, f"{key} = -1"))
            assert re.match(rf"field {table}.{key}: expected \w+ >=? \d\S*, got -1; ", message)


CONTRADICTIONS = [
    ("muzzle", "speed_m_s", "speed_km_per_min = 1", 'unit "km_per_min", expected speed_m_s; convert the value'),
    ("gimbal.yaw", "armature_kg_m2", "armature = 1", "does not say its unit, expected armature_kg_m2; name it so"),
    ("camera", "rate_hz", "rate_hz = 80\nexposure_us = 2", "there is no such field; fields are "),
    ("gimbal.yaw", "low_deg", "low_deg = 90", "field gimbal.yaw.low_deg: expected < high_deg, got 90 and 80; "),
    ("firmware.pitch", "command_low_deg", "command_low_deg = 11", "expected < command_high_deg, got 11 and 10"),
    ("camera", "latency_low_ms", "latency_low_ms = 41", "expected ≤ latency_high_ms, got 41 and 40"),
    ("firmware.yaw", "command_high_deg", "command_high_deg = 81", "-75…81°, expected within gimbal.yaw -80…80°"),
    ("firmware.pitch", "angle_per_encoder", "angle_per_encoder = 1.2", "expected within gimbal.pitch -28…13°"),
    ("limits.yaw", "high_deg", "high_deg = 76", "-75…76°, expected within the commands of firmware.yaw -75…75°"),
    ("limits.pitch", "low_deg", "low_deg = 2", "2…10°, expected to include 0°, where recordings begin"),
    ("gimbal.pitch_body", "roll_inertia_kg_m2", "roll_inertia_kg_m2 = 1", "the sum of the others, 0.0157, got 1"),
    ("gimbal.pitch_body", "mass_kg", "mass_kg = 50", "needs 13.2 N·m, expected at most what the motor holds"),
    ("gimbal.pitch", "supply_v", "supply_v = 0.1", "1.2 N·m by torque_limit_n_m and 0.0206 N·m by supply_v"),
    ("link", "command_loss", "command_loss = 1.5", "field link.command_loss: expected float <= 1.0, got 1.5; "),
    ("firmware", "bus_delay_ms", "bus_delay_ms = 1.5", "field firmware.bus_delay_ms: expected int, got float"),
    ("link", "feedback_source", "feedback_source = 'eye'", "enum value 'eye', expected imu or encoder"),
    ("schema", "format", "format = 'archerfish.robot/2'", "robot/2', expected archerfish.robot/1; "),
    ("schema", "name", "name = '../up'", "field schema.name: expected str matching regex"),
]


@pytest.mark.parametrize(("table", "key", "line", "words"), CONTRADICTIONS)
def test_a_wrong_field_or_a_contradiction_is_explained(refusal, table, key, line, words) -> None:
    assert words in refusal(changed(table, key, line))


def test_a_latency_may_be_fixed_and_a_later_format_is_named_before_its_fields(tmp_path, refusal) -> None:
    (tmp_path / "fixed.toml").write_text(changed("camera", "latency_low_ms", "latency_low_ms = 40"))
    assert load_robot(tmp_path / "fixed.toml").camera.latency_low_ms == 40.0
    assert "expected archerfish.robot/1" in refusal("[wheels]\n[schema]\nformat = 'archerfish.robot/2'\nname = 'a'")


def test_a_file_that_is_not_a_robot_is_refused(refusal) -> None:
    assert refusal("[schema]\nformat = ").startswith("is not TOML (")
    assert refusal(b"\xff\xff\x00") == "is not TOML (byte 0 is no utf-8, save it as UTF-8); correct that place"
    assert refusal("").startswith("field schema: missing field format; ")
    assert refusal(f"gimbal = 3\n[{TABLES['schema']}").startswith("field gimbal: expected table, got int; ")


def test_an_unknown_robot_is_refused_with_the_known_ones(tmp_path, refused) -> None:
    refused("no robot 'infanty'; perhaps you meant infantry", load_robot, "infanty")
    refused(r"absent\.toml: there is no such file", load_robot, tmp_path / "absent.toml")
    refused("is a folder, expected a robot's description; known are infantry", load_robot, tmp_path)


def test_any_mutated_file_is_a_robot_or_refused(tmp_path, mutated) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(json.dumps(tomllib.loads(INFANTRY)))
    read = [*mutated(path, lambda: load_robot(path), 200)]
    assert len(read) > 10
    assert all(msgspec.convert(msgspec.to_builtins(robot), RobotDescription) == robot for robot in read)


def test_each_field_of_a_description_is_on_the_page_of_the_virtual_robot():
    page = Path(__file__).parents[2].joinpath("docs", "virtual_robot.md").read_text()
    assert [key for _, key in FIELDS if f"`{key}`" not in page] == []
