"""Logs as JSON: an object or an array a line, an array of these, or an object of arrays, also inside other objects."""

import json
import re
from pathlib import Path
from typing import Any

from archerfish.logs.arrays import fields_of
from archerfish.logs.recording import Finding, log_fault, open_log
from archerfish.storage import text_of

_BEGIN = re.compile(r"\s*(?!\[[^][\n]*\][ \t]*[,;[])(\{\s*[\"}]|\[\s*[\[{\"\d\]-])")
"""How JSON begins that has an object, or an array of these, of texts or numbers; "[s]" and "[0],[1]" are columns."""
_BLANK = re.compile(r"\s*")


def is_json(begin: bytes) -> bool:
    """Return whether a file that begins so is JSON."""
    text = begin[:64].decode(json.detect_encoding(begin[:64]), "ignore").removeprefix("\ufeff")
    return _BEGIN.match(text) is not None


def json_fields(path: Path) -> tuple[dict[str, Any], tuple[Finding, ...]]:
    """Return what a file has, by the names of `fields_of`, and a finding if its last line breaks off.

    Raises:
      InputError: if it is damaged, with the line.
    """
    with open_log(path) as file:
        content = file.read()
    values, text, at, end, decoder = list[Any](), "", 0, 0, json.JSONDecoder()
    findings: tuple[Finding, ...] = ()
    try:
        text = text_of(content)
        end = len(text.rstrip("\0\x1a \t\r\n"))
        while at < end:
            value, at = decoder.raw_decode(text, _BLANK.match(text, at).end())  # type: ignore[union-attr]
            values.append(value)
    except (ValueError, RecursionError) as error:
        place = f"line {text.count(chr(10), 0, getattr(error, 'pos', at)) + 1}"
        if not values or "\n" in text[at:end].strip():
            problem = f"{place}: is JSON that is damaged or ends too early ({getattr(error, 'msg', error)!s:.200})"
            raise log_fault(path, problem, "correct it, copy the file again, or save it as CSV", "damaged") from error
        message, remedy = "the last line breaks off, and was left out", "stop the recorder before its log is copied"
        findings = (Finding("truncated", "repaired", f"{path}: {place}", message, remedy, 1),)
    return dict(fields_of(values[0] if len(values) == 1 else values)), findings
