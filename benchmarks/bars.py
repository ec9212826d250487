"""Figures and what they must be: as a table, as JSON with their conditions, and as the status of a benchmark."""

import json
import math
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from archerfish.errors import InputError
from archerfish.provenance import provenance
from archerfish.reports.table import Estimate, Table, tables_text
from archerfish.storage import write_bytes

Job = TypeVar("Job")
Row = TypeVar("Row")
RESULTS = Path(__file__).parent / "results"
_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Bar:
    """A figure and its limits."""

    name: str
    found: float
    least: float | None = None
    most: float | None = None
    count: int | None = None  # of a share
    of: int | None = None  # logs that a share is of

    @property
    def missed(self) -> bool:
        """Whether the figure is beyond a limit, or none, but for a share of no logs."""
        low, high = -math.inf if self.least is None else self.least, math.inf if self.most is None else self.most
        return self.of != 0 and not low - _TOLERANCE <= self.found <= high + _TOLERANCE


def share(name: str, held: Iterable[bool], least: float | None = None, most: float | None = None) -> Bar:
    """Return the share of what holds [%], with its limits [%]."""
    every = [bool(each) for each in held]
    return Bar(name, 100 * sum(every) / len(every) if every else math.nan, least, most, sum(every), len(every))


def wilson(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a share, of Wilson [%]."""
    if not of:
        return 0.0, 100.0
    z, p = 1.96, count / of
    middle, half = p + z * z / (2 * of), z * math.sqrt(p * (1 - p) / of + (z / (2 * of)) ** 2)
    return 100 * (middle - half) / (1 + z * z / of), 100 * (middle + half) / (1 + z * z / of)


def bars_table(bars: Sequence[Bar]) -> Table:
    """Return figures, their 95 % intervals where they are shares, and limits as a table."""
    rows = []
    for each in bars:
        limits = [f"{sign} {limit:g}" for sign, limit in (("≥", each.least), ("≤", each.most)) if limit is not None]
        interval = wilson(each.count or 0, each.of) if each.of else (math.nan, math.nan)
        found: Any = Estimate(each.found, *interval, "%") if each.of is not None else each.found
        counted = f"{each.count} of {each.of}" if each.of is not None else ""
        rows.append((each.name, found, counted, ", ".join(limits), "missed" * each.missed))
    return Table("", ("figure", "found", "count", "limit", ""), tuple(rows))


def run(function: Callable[[Job], Row], jobs: Sequence[Job], workers: int) -> Iterator[Row]:
    """Yield what a function makes of each job, in their order, in processes of their own where workers are above 1."""
    pool, begun = ProcessPoolExecutor(workers) if workers > 1 else None, time.monotonic()
    for number, row in enumerate((pool.map if pool else map)(function, jobs), 1):
        if number % max(len(jobs) // 20, 1) == 0 and number < len(jobs):
            left = (time.monotonic() - begun) * (len(jobs) / number - 1)
            print(f"{number} of {len(jobs)}, {left:.0f} s left", file=sys.stderr, flush=True)
        yield row
    if pool:
        pool.shutdown()


def quiet(function: Callable[[], Row]) -> Row | str:
    """Return what a function gives without warnings, or the text of its refusal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return function()
        except InputError as error:
            return str(error)


def finish(
    name: str,
    bars: Sequence[Bar],
    tables: Sequence[Table],
    conditions: dict[str, Any],
    rows: Sequence[dict[str, Any]],
    written: bool,
    **others: Any,
) -> None:
    """Print tables and figures, write results/NAME.json, a row in each line, and exit with 1 if a limit is missed.

    Args:
      name: of the benchmark.
      bars: the figures.
      tables: printed before them.
      conditions: under which they were found.
      rows: what they are of; all have the same fields.
      written: whether the file is written; not for a part of the runs.
      **others: written, too.
    """
    print(tables_text([*tables, bars_table(bars)]))
    if written:
        machine = {"machine": platform.machine(), "system": platform.system(), "cores": os.cpu_count()}
        figures = [_plain({**asdict(each), "missed": each.missed}) for each in bars]
        head = {"conditions": conditions, "machine": machine, "provenance": provenance(conditions.get("seed"))}
        fields = list(rows[0]) if rows else []
        content = json.dumps({**head, "figures": figures, **others, "fields": fields}, indent=1, ensure_ascii=False)
        lines = ",\n  ".join(json.dumps(_plain(list(row.values())), ensure_ascii=False) for row in rows)
        write_bytes(RESULTS / f"{name}.json", f'{content[:-2]},\n "rows": [\n  {lines}\n ]\n}}\n'.encode())
    if missed := [each.name for each in bars if each.missed]:
        sys.exit(f"missed: {'; '.join(missed)}")


def _plain(value: Any) -> Any:
    """Round to five digits; what is not finite is null."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if math.isfinite(value) else None
    return value
