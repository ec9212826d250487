"""A traced decision as C99: a header and a source file that call nothing but math.h, without allocation or globals."""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.codegen.decision import FIELDS, GATE_SIZE, Decision
from archerfish.codegen.printing import Printer, printed
from archerfish.safety.gate import Mode, Reason

VERSION = "@version@"
"""Stands for the version while a header is printed: its digest, so that it goes with its own source alone."""


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


def c_string(text: str) -> str:
    """Return a text as C has it, in UTF-8."""
    plain = (
        chr(each) if each < 128 and (chr(each).isalnum() or each in b" -_.") else f"\\{each:03o}"
        for each in text.encode()
    )
    return f'"{"".join(plain)}"'


def prefix(path: Path) -> str:
    """Return what the C names of a file begin with."""
    return re.sub(r"\W|^(?=\d)", "_", path.stem, flags=re.ASCII)


def print_c(decision: Decision, facts: Mapping[str, Any], path: Path, examples: Any) -> dict[Path, bytes]:
    """Print header and source.

    Args:
      decision: what is decided.
      facts: title, made, and the contract: period_s, late_s, limits (of pitch, then of yaw), robot, robot_name,
        stamp_offset_s.
      path: of the source; its stem is the prefix of all names.
      examples: for the self-test, as of `example_decisions`.
    """
    rows = [np.concatenate([np.atleast_1d(given[name]) for name in FIELDS]) for given, _ in examples]
    expected = [[*verdict.angle, verdict.fire, verdict.mode, verdict.reason, verdict.cause] for _, verdict in examples]
    facts = {**facts, "rows": rows, "expected": expected, "number": c_number, "table": table}
    facts |= {"prefix": prefix(path), "header": path.with_suffix(".h").name, "version": VERSION}
    facts |= {"modes": list(Mode), "reasons": list(Reason), "gate_size": GATE_SIZE}
    facts |= {"robot_name": c_string(facts["robot_name"]), "stamp_offset_s": float(facts["stamp_offset_s"])}
    ends = (".h", ".c")
    header, source = (printed(f"decision{end}.jinja", Printer(c_number), decision, facts) for end in ends)
    version = hashlib.sha256(header.encode()).hexdigest()[:8]
    texts = (each.replace(VERSION, version).encode() for each in (header, source))
    return {path.with_suffix(end): text for end, text in zip(ends, texts, strict=True)}
