"""Logs as JSON: an object or an array a line, an array of these, or an object of arrays, also inside other objects."""

import json
import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from archerfish.logs.arrays import same_length
from archerfish.logs.recording import Finding, LogTable, Signals, listed, log_fault, open_log
from archerfish.logs.text import clocks_in_seconds, numbers_of
from archerfish.storage import text_of

_BEGIN = re.compile(r"\s*(\{\s*[\"}]|\[\s*[\[{\"\d\]-])")
"""How JSON begins that has an object, or an array of these, of texts or numbers; "[s]" is the name of a column."""
_SPACE = re.compile(r"\s*")
Column = tuple[str, Sequence[Any]]


def is_json(begin: bytes) -> bool:
    """Return whether a file that begins so is JSON."""
    text = begin[:64].decode(json.detect_encoding(begin[:64]), "ignore").removeprefix("\ufeff")
    return _BEGIN.match(text) is not None


def read_json_log(path: Path, signals: Signals) -> LogTable:
    """Read signals from JSON; fields of objects are named "imu.yaw", elements of arrays "position[0]".

    Raises:
      InputError: if it is no JSON, a signal is not in it, a value is no number, or signals differ in length.
    """
    columns, findings = json_columns(path)
    for name in signals.columns():
        if name not in columns:
            remedy = f"it has {listed(columns)}; {signals.remedy(list(columns))}"
            raise log_fault(path, f'has no field "{name}"', remedy, "no-column")
    chosen = {name: columns[name] for name in signals.columns()}
    places = range(1, same_length(chosen, str(path)) + 1)
    texts = {name: ["" if each is None else str(each).strip() for each in column] for name, column in chosen.items()}
    findings += clocks_in_seconds(path, texts)
    values = {name: numbers_of(path, "row", places, name, column) for name, column in texts.items()}
    return LogTable(values, places, "row", str(path), findings)


def json_columns(path: Path) -> tuple[dict[str, Sequence[Any]], tuple[Finding, ...]]:
    """Return what a file has by name, values as JSON has them, and whether its last line breaks off.

    Raises:
      InputError: if it is no JSON, with the line.
    """
    with open_log(path) as file:
        content = file.read()
    values, decoder, text, at = list[Any](), json.JSONDecoder(), "", 0
    findings: tuple[Finding, ...] = ()
    try:
        text = text_of(content)
        end = len(text.rstrip("\0\x1a \t\r\n"))
        while at < end:
            at += len(_SPACE.match(text, at)[0])
            value, at = decoder.raw_decode(text, at)
            values.append(value)
    except (ValueError, RecursionError) as error:
        place = f"line {text.count(chr(10), 0, at) + 1}"
        if not values or "\n" in text[at:end]:
            problem = f"is JSON that is damaged or ends too early, {place} ({error!s:.200})"
            raise log_fault(path, problem, "copy it again, or save it as CSV", "damaged") from error
        message, remedy = "the last line breaks off, and was left out", "stop the recorder before its log is copied"
        findings = (Finding("truncated", "repaired", f"{path}: {place}", message, remedy, 1),)
    return dict(_columns(values[0] if len(values) == 1 else values)), findings


def _columns(value: Any, name: str = "") -> Iterator[Column]:
    """Yield the arrays of an object by name; of an array of objects, or of an object numbered as one, their fields."""
    if isinstance(value, dict) and not (value and all(map(str.isdecimal, value))):
        for field, each in value.items():
            yield from _columns(each, f"{name}.{field}" if name else field)
    elif isinstance(value, dict | list):
        rows = [dict(_scalars(each)) for each in (value.values() if isinstance(value, dict) else value)]
        for field in dict.fromkeys(chain.from_iterable(rows)):
            yield f"{name}.{field}".strip(".").replace(".[", "["), [row.get(field) for row in rows]


def _scalars(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what is in an object, an array or a value, with the path to it."""
    if isinstance(value, dict):
        for field, each in value.items():
            yield from _scalars(each, f"{name}.{field}" if name else field)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from _scalars(each, f"{name}[{index}]")
    else:
        yield name, value
