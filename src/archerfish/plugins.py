"""Controllers, target motions and plants of a user's own: where the names of code that is run may come from.

Code of a user's own comes from the command line of this invocation, from a Python call, or from the entry points of
installed packages. What a file names is never executed: a run folder or a sweep file may have come from somebody else.
A file may still say which code it was made with; the user then names that code on the command line.
"""

import shlex
from collections.abc import Mapping
from pathlib import Path

from archerfish.records.errors import InputError, file_error


def names_code(spec: str) -> bool:
    """Return whether a name is that of code in a file or module, ./FILE.py:NAME or MODULE:NAME.

    A name without a colon is that of an entry point, an installed package's, which a file may name as well.

    Args:
      spec: a name that no data file has.
    """
    return ":" in spec


def same_code_name(spec: str, other: str) -> bool:
    """Return whether two names are of code of one name, wherever its files lie."""
    return names_code(spec) and names_code(other) and spec.rpartition(":")[2] == other.rpartition(":")[2]


def code_file_name(spec: str) -> str:
    """Return the name, without folders, of the file that ./FILE.py:NAME or MODULE:NAME stands for."""
    where = spec.rpartition(":")[0]
    is_path = where.endswith(".py") or "/" in where or "\\" in where
    return Path(where).name if is_path else f"{where.rpartition('.')[2]}.py"


def options_to_type(options: Mapping[str, str]) -> str:
    """Write options as words for a shell.

    Args:
      options: option, for instance "--plant" → its value.
    """
    return " ".join(f"{option} {shlex.quote(value)}" for option, value in options.items())


def not_run(source: Path, options: Mapping[str, str], hashes: Mapping[str, str]) -> InputError:
    """Build the error for code that a file names and the command line does not.

    Args:
      source: the file.
      options: option that names code → what the file says of it; others that must be typed along with it.
      hashes: name of a file without its folders → its SHA-256, as far as the source holds any.
    """
    specs = dict.fromkeys(spec for spec in options.values() if names_code(spec))
    known = {spec: hashes.get(code_file_name(spec)) for spec in specs}
    said = ", ".join(spec + (f" (SHA-256 {digest})" if digest else "") for spec, digest in known.items())
    problem = f"names code, {said}, and code that only a file names is not run"
    return file_error(source, problem, f"read that code first, then add {options_to_type(options)}")
