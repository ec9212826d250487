"""Reading a robot's TOML file: strict, so that a misspelt field or a wrong unit never passes for a default."""

import re
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec

from archerfish.errors import InputError, file_error, meant, one_line
from archerfish.records.json_files import fault, read_toml
from archerfish.virtual_robot.description import RobotDescription

_ROBOTS = Path(__file__).with_name("robots")
_REMEDY = "correct it, docs/virtual_robot.md has every field"
_UNITS = "kg|g|m2|s2|n|m|s|v|a|rad|mrad|deg|turn|shot|per|hz|khz|mm|cm|km|cm2|mm2|us|ms|min|rpm|percent|ohm|kohm"
_UNIT = re.compile(rf"(_({_UNITS}))+\Z")


def robot_names() -> list[str]:
    """Return the names of the robots that come with Archerfish."""
    return sorted(path.stem for path in _ROBOTS.glob("*.toml"))


def robot_path(name_or_path: str | Path) -> Path:
    """Return the file of a robot: one that comes with Archerfish, by name, or any other.

    Raises:
      InputError: if there is no such robot.
    """
    names = robot_names()
    path = _ROBOTS / f"{name_or_path}.toml" if str(name_or_path) in names else Path(name_or_path)
    known = f"known are {', '.join(names)}, or give a TOML file (docs/virtual_robot.md)"
    if not str(name_or_path) or (path.suffix != ".toml" and not path.exists()):
        raise InputError(f"no robot {str(name_or_path)!r}; {meant(str(name_or_path), names, known)}")
    if path.is_dir():
        raise file_error(path, "is a folder, expected a robot's description", known)
    return path


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """Read a robot by its name or from its TOML file.

    Raises:
      InputError: naming the table and the field, if there is no such robot or the file is not a robot's.
    """
    path = robot_path(name_or_path)
    content = read_toml(path, "correct that place")
    try:
        # The format first: a file of another one would be refused for some field, which would mislead.
        return msgspec.convert({"schema": {}} | content, RobotDescription)
    except msgspec.ValidationError as error:
        raise file_error(path, *_problem(error, content)) from error


def _problem(error: msgspec.ValidationError, content: dict[str, Any]) -> tuple[str, str]:
    """Return what is wrong in a file, and the remedy."""
    if "unknown field" in str(error) and (unknown := _unknown_field(content, RobotDescription, "")):
        return unknown
    text = fault(error, content).replace("expected object", "expected table")
    text = text.replace("object missing required", "missing")
    if str(error).startswith("Invalid enum value"):
        kind: Any = RobotDescription
        for name in re.findall(r"\w+", str(error).rpartition("$")[2]):
            kind = get_type_hints(kind)[name]
        text += f", expected {' or '.join(get_args(kind))}"
    return text, _REMEDY


def _unknown_field(table: dict[str, Any], kind: type[Any], place: str) -> tuple[str, str] | None:
    """Return what is wrong with the first field that a table should not have, and the remedy."""
    fields = get_type_hints(kind)
    for name, value in table.items():
        if name not in fields:
            problem, remedy = _misnamed(name[:100], list(fields))
            return f"field {one_line(place + name[:100])}: {problem}", remedy
        table_inside = isinstance(value, dict) and hasattr(fields[name], "__struct_fields__")
        if table_inside and (unknown := _unknown_field(value, fields[name], f"{place}{name}.")):
            return unknown
    return None


def _misnamed(name: str, fields: list[str]) -> tuple[str, str]:
    """Return what is wrong with a field's name, and the remedy."""
    unit = _UNIT.search(name)
    for field in fields:
        if _UNIT.sub("", field) == _UNIT.sub("", name):
            if unit:
                return f'has the unit "{unit[0][1:]}", expected {field}', "convert the value"
            return f"does not say its unit, expected {field}", "name it so, in that unit"
    return "there is no such field", meant(name, fields, f"fields are {', '.join(fields)}")
