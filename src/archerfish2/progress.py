"""One progress bar on standard error, in a terminal or a notebook and nowhere else."""

import importlib.util
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

_shown: list[Any] = []  # the display that is on; a bar inside another gets a line of it


@contextmanager
def bar(what: str, total: float, unit: str) -> Iterator[Callable[..., None]]:
    """Show a progress bar with rate and time left while a block runs.

    Args:
      what: is being done.
      total: when it is done.
      unit: of the total, in the plural.

    Yields:
      A function advance(done, note="") of how much is done by now, and of what is being done.
    """
    notebook = "ipykernel" in sys.modules
    if multiprocessing.parent_process() is not None or not (notebook or sys.stderr.isatty()):
        yield lambda *_, **__: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    names = ("{task.description}", "{task.fields[rate]}", "{task.fields[note]}")
    describe, rate, note = (TextColumn(name) for name in names)
    # Without ipywidgets a notebook can still show a terminal's line.
    widgets = importlib.util.find_spec("ipywidgets") is not None
    console = Console(stderr=True, force_terminal=True, force_jupyter=notebook and widgets)
    columns = (describe, BarColumn(bar_width=20), MofNCompleteColumn(), rate, TimeRemainingColumn(), note)
    with ExitStack() as stack:
        if not _shown:
            _shown.append(stack.enter_context(Progress(*columns, console=console)))
            stack.callback(_shown.clear)
        display, start = _shown[0], time.monotonic()
        task = display.add_task(what, total=total, rate="", note="")

        def advance(done: float, note: str = "") -> None:
            each = done / max(time.monotonic() - start, 1e-3)
            display.update(task, completed=min(done, total), rate=f"{each:,.3g} {unit}/s", note=note)

        yield advance
        if len(display.tasks) > 1:
            display.remove_task(task)
