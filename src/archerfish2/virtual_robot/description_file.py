"""Reading a robot's TOML file: strict, so that a misspelt key or a wrong unit never passes for a default."""

import difflib
import re
import tomllib
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from archerfish2.errors import InputError
from archerfish2.storage import read_bytes
from archerfish2.virtual_robot.description import RobotDescription, Schema
from archerfish2.virtual_robot.description_bounds import Bounds, broken_bound
from archerfish2.virtual_robot.description_checks import check_description

_ROBOTS = Path(__file__).with_name("robots")
_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")
_UNITS = "kg g m2 s2 n m s v a rad mrad deg turn shot per hz khz mm cm km cm2 mm2 us ms min rpm percent ohm kohm"
_UNIT_WORDS = frozenset(_UNITS.split())


def robot_names() -> list[str]:
    """Return the names of the robots that come with Archerfish."""
    return sorted(path.stem for path in _ROBOTS.glob("*.toml"))


def robot_path(name_or_path: str | Path) -> Path:
    """Return the file of a robot: one that comes with Archerfish, by name, or any other.

    Raises:
      InputError: if there is no such robot.
    """
    if str(name_or_path) in robot_names():
        return _ROBOTS / f"{name_or_path}.toml"
    path, known = Path(name_or_path), ", ".join(robot_names())
    if not str(name_or_path) or (path.suffix != ".toml" and not path.exists()):
        raise InputError(
            f"no robot {str(name_or_path)!r}; known are {known}, or pass a TOML file (docs/virtual_robot.md)"
        )
    if path.is_dir():
        raise InputError(
            f"{path}: is a folder, expected a robot's description; known are {known}, or pass a TOML file "
            "(docs/virtual_robot.md)"
        )
    return path


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """Read a robot by its name or from its TOML file.

    Raises:
      InputError: naming the table and the key, if the file is not a robot's.
    """
    path = robot_path(name_or_path)
    remedy = "write it again"
    try:
        content = tomllib.loads(read_bytes(path, remedy).decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}); save it as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not TOML ({error}); mend that place") from error
    except (RecursionError, OSError) as error:
        raise InputError(f"{path}: can't be read ({error}); write it again") from error
    return parse_robot(content, str(path))


def parse_robot(content: dict[str, Any], source: str) -> RobotDescription:
    """Build a robot from the content of its TOML file.

    Args:
      content: tables and keys.
      source: where it comes from, for messages.

    Raises:
      InputError: naming the table and the key.
    """
    try:
        # The format first: a file of another one would fail on some key, which would be the wrong complaint.
        _table(Schema, content.get("schema", {}), "schema")
        description: RobotDescription = _table(RobotDescription, content, "")
        check_description(description)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return description


def _table(kind: type[Any], content: Any, name: str) -> Any:
    if not isinstance(content, dict):
        raise InputError(f"[{name}] is {content!r}, expected a table; begin it with a line [{name}]")
    kinds = get_type_hints(kind, include_extras=True)
    for key in content:
        if key not in kinds:
            raise InputError(_unknown(key, list(kinds), name))
    return kind(**{key: _entry(each, key, content, name) for key, each in kinds.items()})


def _entry(kind: Any, key: str, content: dict[str, Any], table: str) -> Any:
    path = f"{table}.{key}" if table else key
    if key not in content:
        lacking = f"[{path}]: the table is missing" if is_dataclass(kind) else f"[{table}] {key} is missing"
        raise InputError(f"{lacking}; every key is required, see docs/virtual_robot.md")
    if isinstance(kind, type) and is_dataclass(kind):
        return _table(kind, content[key], path)
    return _value(kind, content[key], f"[{table}] {key}")


def _unknown(key: str, known: list[str], table: str) -> str:
    where = f"[{table}] " if table else ""
    same = [each for each in known if _stem(each) == _stem(key)]
    unit = key.removeprefix(_stem(key)).removeprefix("_")
    if same and unit:
        return f'{where}{key} has the unit "{unit}", expected {same[0]}; convert the value'
    if same:
        return f"{where}{key} does not say its unit, expected {same[0]}; name it so, in that unit"
    near = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    return f"{where}{key} is unknown; {hint}"


def _stem(key: str) -> str:
    """Return a key without the unit at its end."""
    words = key.split("_")
    while len(words) > 1 and words[-1] in _UNIT_WORDS:
        words.pop()
    return "_".join(words)


def _value(kind: Any, value: Any, where: str) -> Any:
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise InputError(f"{where} must be {' or '.join(map(repr, get_args(kind)))}, got {value!r}")
        return value
    if kind is str:
        if not isinstance(value, str) or not _NAME.fullmatch(value):
            raise InputError(f"{where} must be a text of letters, digits, _, - and ., got {value!r}")
        return value
    number, bounds = get_args(kind)
    return _number(number, bounds, value, where)


def _number(kind: type[float], bounds: Bounds, value: Any, where: str) -> float:
    wanted = (int,) if kind is int else (int, float)
    if isinstance(value, bool) or not isinstance(value, wanted):
        expected = "a whole number" if kind is int else "a number"
        raise InputError(f"{where} must be {expected}, got {value!r}")
    try:
        problem = broken_bound(bounds, value)
    except OverflowError:
        problem = "a finite number"
    if problem:
        raise InputError(f"{where} must be {problem}, got {value!r}; mend the value")
    return kind(value)
