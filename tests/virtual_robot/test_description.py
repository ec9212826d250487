import copy
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from archerfish.records.errors import InputError
from archerfish.virtual_robot.description_file import load_robot, parse_robot, robot_names, robot_path

from .made_robots import content_of


def leaves(table: dict[str, Any], path: str = "") -> Iterator[tuple[str, str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{path}.{key}" if path else key)
        else:
            yield path, key, value


def tables(table: dict[str, Any], path: str = "") -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, dict):
            inner = f"{path}.{key}" if path else key
            yield inner
            yield from tables(value, inner)


LEAVES = list(leaves(content_of("infantry")))
NUMBERS = [(table, key) for table, key, value in LEAVES if isinstance(value, int | float)]
NEVER_NEGATIVE = [
    (table, key)
    for table, key in NUMBERS
    if not key.startswith(("low_deg", "high_deg", "command_low_deg", "command_high_deg", "boresight", "misalignment"))
    and key not in ("recoil_n_m_s", "clock_offset_ms", "forward_m", "left_m", "up_m")
]


def refusal(*changes: tuple[str, str, Any]) -> str:
    """Return the complaint about the infantry robot with some values changed, or removed where the value is None."""
    content = copy.deepcopy(content_of("infantry"))
    for table, key, value in changes:
        inner = content
        for each in table.split(".") if table else []:
            inner = inner[each]
        if value is None:
            del inner[key]
        else:
            inner[key] = value
    with pytest.raises(InputError) as raised:
        parse_robot(content, "my.toml")
    message = str(raised.value)
    assert message.startswith("my.toml: ")
    return message


def test_the_robots_of_the_package_are_read() -> None:
    assert robot_names() == ["infantry", "worn"]
    for name in robot_names():
        robot = load_robot(name)
        assert robot.schema.name == name
        assert load_robot(robot_path(name)) == robot
        with pytest.raises(dataclasses.FrozenInstanceError):
            robot.schema.name = "other"


def test_the_worn_robot_is_the_harder_one() -> None:
    good, worn = load_robot("infantry"), load_robot("worn")
    assert worn.gimbal.yaw.friction_n_m > good.gimbal.yaw.friction_n_m
    assert worn.link.command_latency_high_ms > good.link.command_latency_high_ms
    assert worn.muzzle.speed_m_s < good.muzzle.speed_m_s
    assert worn.muzzle.speed_sd_m_s > good.muzzle.speed_sd_m_s
    assert worn.muzzle.dispersion_yaw_deg > good.muzzle.dispersion_yaw_deg


@pytest.mark.parametrize(("table", "key"), [(table, key) for table, key, _ in LEAVES])
def test_a_missing_key_is_named(table: str, key: str) -> None:
    assert f"[{table}] {key} is missing" in refusal((table, key, None))


@pytest.mark.parametrize("table", list(tables(content_of("infantry"))))
def test_a_missing_table_is_named(table: str) -> None:
    parent, _, key = table.rpartition(".")
    message = refusal((parent, key, None))
    # Without [schema] it is no robot at all, and the first key of it is what is missed.
    assert f"[{table}]: the table is missing" in message or "[schema] format is missing" in message


@pytest.mark.parametrize(("table", "key"), NUMBERS)
@pytest.mark.parametrize("value", ["1", True, [1.0], float("nan"), float("inf"), -float("inf"), 10**400])
def test_what_is_no_finite_number_is_named(table: str, key: str, value: Any) -> None:
    assert f"[{table}] {key} must be " in refusal((table, key, value))


@pytest.mark.parametrize(("table", "key"), NEVER_NEGATIVE)
def test_a_negative_value_is_named(table: str, key: str) -> None:
    message = refusal((table, key, -1))
    assert f"[{table}] {key} must be " in message
    assert "got -1" in message


@pytest.mark.parametrize(("table", "key"), NUMBERS)
def test_a_misspelt_key_is_answered_with_the_right_one(table: str, key: str) -> None:
    wrong = key[:2] + key[3:]
    message = refusal((table, wrong, 1.0), (table, key, None))
    assert f"[{table}] {wrong} " in message
    assert key in message


@pytest.mark.parametrize(
    ("table", "key", "expected"),
    [
        ("gimbal.yaw", "armature_g_cm2", "armature_kg_m2"),
        ("gimbal.pitch", "low_rad", "low_deg"),
        ("gimbal.pitch_body", "mass_g", "mass_kg"),
        ("camera", "latency_low_s", "latency_low_ms"),
        ("camera", "lateral_sd_m", "lateral_sd_mm"),
        ("muzzle", "speed_km_per_min", "speed_m_s"),
        ("firmware", "bus_delay_s", "bus_delay_ms"),
        ("link", "command_rate_khz", "command_rate_hz"),
    ],
)
def test_another_unit_is_told(table: str, key: str, expected: str) -> None:
    assert f'has the unit "{key.removeprefix(_common(key, expected))}", expected {expected}' in refusal((table, key, 1))


def _common(key: str, expected: str) -> str:
    words = [a for a, b in zip(key.split("_"), expected.split("_"), strict=False) if a == b]
    return "_".join(words) + "_"


@pytest.mark.parametrize(("table", "key", "expected"), [("gimbal.yaw", "armature", "armature_kg_m2")])
def test_a_key_without_its_unit_is_told(table: str, key: str, expected: str) -> None:
    assert f"[{table}] {key} does not say its unit, expected {expected}" in refusal((table, key, 1))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([("gimbal.yaw", "armature_kg_m2", -0.1)], "[gimbal.yaw] armature_kg_m2 must be > 0, got -0.1"),
        ([("gimbal.yaw", "low_deg", 90)], "[gimbal.yaw] low_deg must be below high_deg, got 90 and 80"),
        ([("gimbal.yaw", "low_deg", 80)], "[gimbal.yaw] low_deg must be below high_deg"),
        (
            [("firmware.pitch", "command_low_deg", 11)],
            "[firmware.pitch] command_low_deg must be below command_high_deg",
        ),
        ([("limits.pitch", "high_deg", -26)], "[limits.pitch] low_deg must be below high_deg"),
        ([("link", "command_latency_low_ms", 16)], "[link] command_latency_low_ms must be at most"),
        ([("link", "feedback_latency_low_ms", 16)], "[link] feedback_latency_low_ms must be at most"),
        ([("camera", "latency_low_ms", 41)], "[camera] latency_low_ms must be at most latency_high_ms, got 41 and 40"),
        ([("firmware.yaw", "command_high_deg", 81)], "outside the stops of [gimbal.yaw]"),
        ([("firmware.pitch", "angle_per_encoder", 1.2)], "outside the stops of [gimbal.pitch]"),
        ([("limits.yaw", "high_deg", 76)], "[limits.yaw] low_deg and high_deg -75…76° lie outside"),
        ([("gimbal.pitch_body", "roll_inertia_kg_m2", 1)], "as in no body"),
        ([("gimbal.pitch_body", "mass_kg", 50)], "more than the motor holds"),
        ([("gimbal.pitch", "supply_v", 0.1)], "more than the motor holds"),
        ([("link", "command_loss", 1.5)], "[link] command_loss must be within 0…1, got 1.5"),
        ([("link", "feedback_loss", -0.5)], "[link] feedback_loss must be within 0…1"),
        ([("camera", "miss_probability", 2)], "[camera] miss_probability must be within 0…1"),
        ([("camera", "rate_hz", 0)], "[camera] rate_hz must be within 1…1000, got 0"),
        ([("firmware", "bus_delay_ms", 1.5)], "[firmware] bus_delay_ms must be a whole number, got 1.5"),
        ([("link", "feedback_source", "eye")], "[link] feedback_source must be 'imu' or 'encoder', got 'eye'"),
        ([("schema", "format", "archerfish.robot/2")], "[schema] format must be 'archerfish.robot/1'"),
        ([("schema", "name", "../up")], "[schema] name must be a text of letters"),
        ([("schema", "name", 3)], "[schema] name must be a text of letters"),
        ([("", "gimbal", 3)], "[gimbal] is 3, expected a table"),
        ([("", "cammera", {})], "cammera is unknown; did you mean camera?"),
        ([("camera", "exposure_us", 2)], "[camera] exposure_us is unknown; known are rate_hz"),
    ],
)
def test_a_contradiction_is_told(changes: list[tuple[str, str, Any]], words: str) -> None:
    assert words in refusal(*changes)


def test_equal_latencies_are_a_fixed_latency() -> None:
    content = content_of("infantry")
    content["camera"]["latency_low_ms"] = content["camera"]["latency_high_ms"] = 20
    assert parse_robot(content, "x").camera.latency_low_ms == 20.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[schema]\nformat = ", "is not TOML"),
        (b"[schema]\nformat = 'a'\nformat = 'b'", "is not TOML"),
        (b"\xff\xfe\x00", "is not UTF-8"),
        (b"", "[schema] format is missing"),
        (b"a = " + b"[" * 5000 + b"]" * 5000, "can't be read"),
    ],
)
def test_a_file_that_is_no_toml_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"robot\.toml: ") as raised:
        load_robot(path)
    assert words in str(raised.value)


def test_an_unknown_robot_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no robot 'infanty'; known are infantry, worn"):
        load_robot("infanty")
    with pytest.raises(InputError, match="no such file"):
        load_robot(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="no robot ''; known are infantry, worn"):
        load_robot("")
    with pytest.raises(InputError, match="is a folder, expected a robot's description"):
        load_robot(tmp_path)
