"""Hit rates in the terminal: a table per world and command limit that fits 80 columns."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from archerfish.evaluation.results import Cell


def print_hit_rates(cells: Iterable["Cell"], console: Console | None = None) -> None:
    """Print a table per world and command limit, with a row per controller and a column per range.

    Where targets are not the paper's, each length of engagements has a table of its own.

    Args:
      cells: hit rates.
      console: where to; standard output if not given.
    """
    console = console or Console()
    cells = list(cells)
    for place in dict.fromkeys(map(_place, cells)):
        setting, limit, length = place
        where = f"{setting}, command limit {limit}" + (f", engagements of {length}" if length else "")
        console.print(_table(where, [cell for cell in cells if _place(cell) == place]))


def print_where(out: Path, durations: Mapping[str, float]) -> None:
    """Say how long a run took (stage → seconds), and where its page and its figures are."""
    took = ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in durations.items())
    line = f"\n{took}\nopen {out / 'report.html'}; every figure is in {out / 'results.json'}"
    Console().print(line, markup=False, highlight=False, soft_wrap=True)


def _table(where: str, cells: list["Cell"]) -> Table:
    ranges = sorted({cell.range_m for cell in cells})
    title = f"\nhit rate in % with the 95 % interval: {where}"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column("name (seed)", overflow="fold")
    for low, high in ranges:
        table.add_column(f"{low:g}–{high:g} m", justify="right", no_wrap=True)
    for target in dict.fromkeys(map(_target, cells)):
        shot = [cell for cell in cells if _target(cell) == target]
        counted = ", per fired shot" if any(cell.counts == "shots" for cell in shot) else ""
        table.add_row(f"{target} targets{counted}", style="bold")
        for entrant in dict.fromkeys(map(_entrant, shot)):
            own = {cell.range_m: cell for cell in shot if _entrant(cell) == entrant}
            table.add_row(entrant, *(_rate(own[each]) if each in own else "" for each in ranges))
            # Beside a rate of fired shots stands how many these are.
            for name, figure in _FIRED.items() if any(cell.counts == "shots" for cell in own.values()) else ():
                table.add_row(f"  {name}", *(figure(own[each]) if each in own else "" for each in ranges))
            if any(cell.fallbacks for cell in own.values()):
                table.add_row("  fell back", *(_fallbacks(own[each]) if each in own else "" for each in ranges))
    return table


_FIRED: dict[str, Callable[["Cell"], str]] = {
    "hits of shots": lambda cell: f"{cell.hits} of {cell.shots}",
    "withheld shots": lambda cell: str(cell.withheld),
    "hits/s": lambda cell: f"{cell.hits_per_s or 0.0:.1f}",
}
"""What stands below a rate of fired shots."""


def _place(cell: "Cell") -> tuple[str, str, str]:
    """Return setting, command limit and the length that a table of other motions than the paper's names."""
    _, _, length = cell.table.partition("motions, ")
    return cell.setting, cell.command_limit, length


def _target(cell: "Cell") -> str:
    return cell.motion or cell.target


def _entrant(cell: "Cell") -> str:
    return cell.controller if cell.policy_seed is None else f"{cell.controller} ({cell.policy_seed})"


def _fallbacks(cell: "Cell") -> str:
    percent = 100 * cell.fallbacks / (cell.shots + cell.withheld)
    return "<0.1 %" if 0.0 < percent < 0.05 else f"{percent:.1f} %"


def _rate(cell: "Cell") -> str:
    low, high = (f"{100 * each:.1f}".replace("100.0", "100") for each in (cell.low, cell.high))
    return f"{100 * cell.rate:.1f} {low}–{high}" if cell.counted else "–"
