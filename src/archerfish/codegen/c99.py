"""A traced decision as C99: a header and a source file that call nothing but math.h, without allocation or globals."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.codegen.decision import FIELDS, Decision
from archerfish.codegen.printing import Printer, printed


def c_number(value: Any) -> str:
    """Return a number as C has it, exact in float32."""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    text = f"{np.float32(value):.9g}"
    named = {"nan": "NAN", "inf": "INFINITY", "-inf": "-INFINITY"}.get(text)
    text = named or (f"{text}f" if "." in text or "e" in text else f"{text}.0f")
    return f"({text})" if text.startswith("-") else text


def table(values: Any) -> str:
    """Return numbers as the content of an array, some on a line."""
    texts = [c_number(each).strip("()") for each in np.asarray(values).reshape(-1)]
    return ",\n  ".join(", ".join(texts[at : at + 12]) for at in range(0, len(texts), 12))


def prefix(path: Path) -> str:
    """Return what the C names of a file begin with."""
    return re.sub(r"\W|^(?=\d)", "_", path.stem, flags=re.ASCII)


def print_c(decision: Decision, facts: Mapping[str, Any], path: Path, examples: Any) -> dict[Path, bytes]:
    """Print header and source.

    Args:
      decision: what is decided.
      facts: title, made, period_s, limits (of pitch, then of yaw) and robot, the contract.
      path: of the source; its stem is the prefix of all names.
      examples: for the self-test, as of `example_decisions`.
    """
    rows = [np.concatenate([np.atleast_1d(given[name]) for name in FIELDS]) for given, _ in examples]
    expected = [[*command.angle, command.fire] for _, command in examples]
    facts = {**facts, "rows": rows, "expected": expected, "number": c_number, "table": table}
    facts |= {"prefix": prefix(path), "header": path.with_suffix(".h").name}
    ends = {path.with_suffix(end): f"decision{end}.jinja" for end in (".h", ".c")}
    return {each: printed(template, Printer(c_number), decision, facts).encode() for each, template in ends.items()}
