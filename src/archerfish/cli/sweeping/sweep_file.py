"""A sweep said in a TOML file: the same options as on the command line, under the same names."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from archerfish.cli.parsing import parse
from archerfish.records.errors import InputError, file_error

Options = TypeVar("Options")


def read_sweep_file(path: Path, kind: type[Options]) -> Options:
    """Read options from a TOML file.

    A key is an option without its dashes. Tables stand for prefixes: `[ppo]` for `--ppo.…`; in `[vary]` a parameter has
    a list of values, or a range as it is typed.

    Args:
      path: the file.
      kind: dataclass of the options.

    Raises:
      InputError: if the file can't be read, or an option is unknown or its value can't be used.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise file_error(path, "no such file", "check the path") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise file_error(path, f"can't be read as TOML ({error})", "see docs/sweep.md for an example") from error
    for name in content:
        # Not an option of ours: the parser would write a file of completions wherever this one says.
        if name.replace("_", "-").startswith("tyro-"):
            raise InputError(f"{path}: --{name} is no option of a sweep; see archerfish sweep --help")
    try:
        return parse(kind, f"archerfish sweep {path}", words_of(content))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def words_of(content: dict[str, Any]) -> list[str]:
    """Return the words of the command line that says the same."""
    words: list[str] = []
    for name, value in content.items():
        if name == "vary" and isinstance(value, dict):
            words += ["--vary", *_varied(value)]
        elif isinstance(value, dict):
            words += [word for inner, each in value.items() for word in _option(f"{name}.{inner}", each)]
        else:
            words += _option(name, value)
    return words


def _option(name: str, value: Any) -> list[str]:
    if isinstance(value, bool):
        prefix, dot, last = name.rpartition(".")
        # anneal = false is --ppo.no-anneal; what is so anyway needs no word.
        if name in ("ppo.anneal", "gradient.anneal"):
            return [] if value else [f"--{prefix}{dot}no-{last}"]
        return [f"--{name}"] if value else []
    return [f"--{name}", *(_word(each) for each in (value if isinstance(value, list) else [value]))]


def _varied(table: dict[str, Any]) -> list[str]:
    words: list[str] = []
    for name, value in table.items():
        if isinstance(value, dict):
            words += [f"{name}.{word}" for word in _varied(value)]
        else:
            words.append(f"{name}={','.join(map(_word, value if isinstance(value, list) else [value]))}")
    return words


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
