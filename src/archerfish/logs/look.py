"""What is in a log, before anything is identified: its signals, their rates, ranges, units and gaps, and a picture."""

import json
import re
import shlex
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.logs.log import tables_in
from archerfish.logs.recording import GAP, Finding, LogTable, Rows, Signals, Values, drawn_signals, log_files
from archerfish.logs.stamps import in_order, in_seconds
from archerfish.reports.report import Report
from archerfish.reports.style import Figure
from archerfish.reports.table import Entry, Table

_TIME = re.compile(r"(?i)(^|[^a-z])t([^a-z]|$)|time|tempo|stamp|clock")
_COMMAND = re.compile(r"(?i)(^|[^a-z])u([^a-z]|$)|c(om)?m(an)?d|set|ref|target|goal|desired")
_RATE = re.compile(r"(?i)rate|vel|speed|gyro|accel|omega|dot|effort|torque|current|voltage")
_UNIT = re.compile(r"(?i)(?:^|[^a-z])(deg|rad|rpm|mm|cm|m|pct|v|ms|s)(?:[^a-z]|$)")
_OTHERS = re.compile(r"(?i)shots|landings|timing_|tape\.|limits\.|.*_step_\d+deg")  # logs of other parts than axes
_MUZZLE = """
# [muzzle]
# shots = {}
# columns = {{distance_m = "distance_m"}}  # usual name = that of the files
# length_m = 0.16  # from the pivot to the muzzle, measured
# height_m = 0.45  # of the muzzle above the ground, measured
"""
_DRAWN = 6  # signals in the picture


class Looked(NamedTuple):
    """Signals of a table or a topic, each in all rows."""

    time: Values  # of the rows [s], or their numbers where they have no stamps, (N,)
    stamps: str | None  # name of the stamps; None where there are none
    signals: dict[str, Values]  # the others by name, (N,) each
    findings: tuple[Finding, ...]  # of the reader, and of the stamps


@checked_arguments
def log_report(path: str | Path) -> Report:
    """Report what a file has: each signal with its rate, range, gaps and repeats, and the unit that it may be in.

    Args:
      path: of a file of any format that `read_log` takes, or of the folder of a bag.

    Raises:
      InputError: if it can't be read.
    """
    tables = [_looked(table) for table in tables_in(Path(path))]
    rows = [row for table in tables for row in _rows(table)]
    if not rows:
        raise file_error(path, "has no columns of numbers", "pass a log that has some", "no-data")
    columns = "signal", "unit", "samples", "rate [Hz]", "length [s]", "lowest", "highest", "gaps", "repeats [%]"
    note = "Units with a question mark are guessed from the values; repeats are samples equal to the one before."
    commands = dict.fromkeys(_identify(path, tables, axis) for axis in _axes_in(Path(path), tables))
    return Report(
        title=f"{Path(path).name}: what is in it",
        headline=f"{len(rows)} signals, {max(len(table.time) for table in tables)} samples at most",
        next_steps=tuple(f"If these are command and angle: {command}" for command in commands if command),
        tables=(Table("Signals", columns, tuple(rows), note),),
        figures=(("The first signals over time.", partial(_picture, tables)),),
        findings=tuple(dict.fromkeys(finding for table in tables for finding in table.findings)),
    )


def _axes_in(path: Path, tables: Sequence[Looked]) -> list[str]:
    """Return the axes that names of a file, or its signals, state; yaw where they state none."""
    names = " ".join([path.stem, *_moving(tables)]).lower()
    return [axis for axis in ("pitch", "yaw") if axis in names] or ["yaw"]


def _identify(path: str | Path, tables: Sequence[Looked], axis: str) -> str:
    """Return the command that identifies an axis by signals that are guessed; nothing where there are none."""
    inputs, outputs, stamps = guessed(tables, axis)
    if outputs == "NAME":
        return ""
    units = _units(tables)
    words = ["archerfish", "identify", "axis", str(path), f"--input={inputs}", f"--output={outputs}"]
    words += [f"--time={stamps}"] if stamps else ["--sample-period-s=SECONDS"]
    words += ["--input-unit=deg"] if units[inputs].startswith("deg") else []
    words += ["--output-unit=deg"] if units[outputs].startswith("deg") else []
    return shlex.join(words)


def _units(tables: Sequence[Looked]) -> dict[str, str]:
    return {name: unit for table in tables for name, unit in guessed_units(table.signals).items()}


def _looked(table: LogTable) -> Looked:
    """Find the stamps of a table by name and growth, and turn them into seconds; without any, number the rows."""
    rising = [name for name, values in table.columns.items() if np.mean(np.diff(values) > 0) > 0.5 and np.ptp(values)]
    named = [name for name in rising if _TIME.search(name)] or [name for name in rising[:1] if name == "1"]
    stamps = named[0] if named else None
    names = [name for name in table.columns if name != stamps]
    time, findings = np.arange(len(table.places), dtype=float), [*table.findings]
    signals = dict(table.columns)
    if stamps and names:
        try:
            rows = Rows.of(table, Signals(tuple(names), tuple(names[:1]), stamps), 1.0)
            for step in (in_seconds, in_order):
                rows, found = step(rows)
                findings += found
            time, signals = rows.time, dict(zip(names, rows.inputs.T, strict=True))
        except InputError as error:
            problem, _, remedy = str(error).rpartition("; ")
            findings.append(Finding(error.code or "", "warning", table.source, problem, remedy))
    there = {name: signals[name] for name in names if not np.isnan(signals[name]).all()}
    return Looked(time, stamps, there, tuple(findings))


def _rows(table: Looked) -> list[tuple[Entry, ...]]:
    """Return a row for each signal of a table."""
    rows, units = list[tuple[Entry, ...]](), guessed_units(table.signals)
    for name, values in table.signals.items():
        known = ~np.isnan(values)
        signal, steps = values[known], np.diff(table.time[known])
        if signal.size < 2:
            continue
        interval = float(np.median(steps[steps > 0])) if table.stamps and (steps > 0).any() else np.nan
        repeats, length = 100 * float(np.mean(np.diff(signal) == 0)), float(steps.sum()) if table.stamps else np.nan
        figures = 1 / interval, length, float(signal.min()), float(signal.max())
        rows.append((name, units[name], signal.size, *figures, int(np.sum(steps > GAP * interval)), repeats))
    return rows


def guessed_units(signals: dict[str, Values]) -> dict[str, str]:
    """Return the units that names state, or that values suggest, then with a "?"; of signals by name, each (N,)."""
    units = dict[str, str]()
    for name, values in signals.items():
        stated = _UNIT.search(name)
        counts = float(np.nanmax(np.abs(values))) > 400 and not np.any(np.nan_to_num(values) % 1)
        position = {f"{name[:-1]}{axis}" for axis in "xyz"} <= signals.keys()
        none = position or _RATE.search(name)
        units[name] = stated[1].lower() if stated else "counts?" if counts else "" if none else "angle"
    angles = [np.nanmax(np.abs(signals[name])) for name, unit in units.items() if unit == "angle"]
    largest = float(max(angles, default=0.0))
    unit = "rad?" if largest <= 2 * np.pi else "deg?" if largest <= 720 else ""  # all alike
    return {name: unit if each == "angle" else each for name, each in units.items()}


def guessed(tables: Sequence[Looked], axis: str) -> tuple[str, str, str | None]:
    """Return the names of a command, of a measured angle and of stamps, "NAME" of what there is none of.

    Args:
      tables: of a file.
      axis: that they are of; names that contain it go before others.
    """
    every = [name for name in _moving(tables) if axis in name.lower()] or _moving(tables)
    commands = [name for name in every if _COMMAND.search(name)] or every or ["NAME"]
    others = [name for name in every if name != commands[0]]
    angles = [name for name in others if not (_COMMAND.search(name) or _RATE.search(name))] or others or ["NAME"]
    return commands[0], angles[0], tables[0].stamps if tables else None


def _moving(tables: Sequence[Looked]) -> list[str]:
    """Return the names of the signals that change."""
    return [name for table in tables for name, values in table.signals.items() if np.ptp(values[~np.isnan(values)])]


def names_to_fill_in(folder: str | Path) -> str:
    """Return a logs.toml for the logs in a folder, by names that are guessed: to be checked before `identify` takes it.

    Raises:
      InputError: if there is no log in it that has a command and an angle.
    """
    found = dict[str, dict[str, dict[str, str]]]()  # axis → file → key → name
    for path in sorted(each for each in Path(folder).iterdir() if log_files(each) and not _OTHERS.match(each.name)):
        tables = list[Looked]()
        with suppress(InputError):  # of what is no log
            tables = [_looked(table) for table in tables_in(path)]
        for axis in _axes_in(path, tables):
            inputs, outputs, stamps = guessed(tables, axis)
            if outputs != "NAME":
                unit = "deg" if _units(tables)[outputs].startswith("deg") else "rad"
                names = {"time": stamps or "time_s", "input": inputs, "output": outputs, "unit": unit}
                found.setdefault(axis, {})[path.name] = names
    if not found:
        raise file_error(folder, "has no file with a command and an angle", "name a folder of logs", "no-data")
    lines = ["# Names and units are guessed: correct them. Logs that are to be held back go from fit to validate."]
    for axis, files in found.items():
        first, held_back = next(iter(files.values())), [file for file in files if "valid" in file]
        fit = [file for file in files if file not in held_back]
        lines += ["", f"[{axis}]", f"fit = {_text(fit)}", f"validate = {_text(held_back)}"] + [
            f"{key} = {_text(first[key])}" for key in first
        ]
        for file, names in files.items():
            if others := [f"{key} = {_text(name)}" for key, name in names.items() if name != first[key]]:
                lines += ["", f"[{axis}.files.{_text(file)}]", *others]
    shots = [path.name for path in sorted(Path(folder).iterdir()) if re.search("(?i)shot|landing|pellet", path.name)]
    return "\n".join([*lines, _MUZZLE.format(_text(shots or ["shots.csv"]))])


_text = partial(json.dumps, ensure_ascii=False)  # a text of JSON is one of TOML


def _picture(tables: Sequence[Looked]) -> Figure:
    """Draw the first signals, one above the other."""
    signals = list[tuple[str, Values, Values]]()
    for table in tables:
        for name, unit in guessed_units(table.signals).items():
            signals.append((f"{name[-70:]} [{unit or '–'}]", table.time, table.signals[name]))
    return drawn_signals(signals[:_DRAWN], "time [s]" if tables[0].stamps else "row [–]")
