"""Progress bars with a rate and the time left, and the check that training can run at all."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from archerfish.records.errors import InputError, one_line

NARROW = 100
"""Terminals of fewer columns leave out the unit, and have a short bar."""


class _Rate(ProgressColumn):
    """Units per second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:,.0f}/s", style="progress.data.speed")


@contextmanager
def progress_bar(what: str, total: float, unit: str) -> Iterator[Callable[[float, str], None]]:
    """Show a progress bar on standard error while a block runs.

    Args:
      what: is being done.
      total: when it is done.
      unit: of the total.

    Yields:
      A function that takes how much is done by now and a few words on how it goes.
    """
    console = Console(stderr=True)
    # The words on how it goes are worth more than the unit.
    narrow = console.width < NARROW
    units, bar = ((), BarColumn(bar_width=8)) if narrow else ((TextColumn(unit),), BarColumn())
    columns = (TextColumn("{task.description}"), bar, MofNCompleteColumn(), *units, _Rate())
    tail = (TimeRemainingColumn(), TextColumn("{task.fields[note]}"))
    with Progress(*columns, *tail, console=console) as progress:
        task = progress.add_task(what, total=total, note="")

        def advance(done: float, note: str = "") -> None:
            progress.update(task, completed=min(done, total), note=note)

        yield advance


def note(remark: str) -> None:
    """Tell the user something that is no fault, in one line on standard error."""
    print(f"archerfish: {one_line(remark)}", file=sys.stderr)  # noqa: T201


def require_jax(command: str) -> None:
    """Refuse a command that needs JAX where it is not installed.

    Raises:
      InputError: saying what to install.
    """
    missing = [name for name in ("jax", "optax") if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"archerfish {command} needs {missing[0]}, which is not installed; pip install 'archerfish[train]'"
        )
