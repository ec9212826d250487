"""Progress of long work on standard error: a bar in a terminal, one line in a notebook, elsewhere a line a minute."""

import functools
import importlib
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

in_worker: Callable[[Any], None] | None = None
"""Gets the share that is done of what a bar would show, in a process that works for another one."""
_display: list[Any] = []  # rich's, while a bar is on; a bar inside another gets a line of it


@contextmanager
def bar(what: str, total: float, unit: str, note: str = "") -> Iterator[Callable[..., None]]:
    """Show how far a block is, and about how long it will take.

    Args:
      what: is being done.
      total: when it is done.
      unit: of the total, in the plural.
      note: what is done before the first progress, which a compiled program makes after its compilation.

    Yields:
      A function advance(done, note="") of how much is done by now, and of what is being done.
    """
    if multiprocessing.parent_process() is not None:
        report = in_worker or (lambda _: None)
        yield lambda done, note="": report(min(done / total, 1.0))  # noqa: ARG005
        return
    with ExitStack() as stack:
        is_bar = sys.stderr.isatty() and not _in_notebook()
        show, start = _bar(what, total, unit, stack) if is_bar else _lines(what, total, unit), time.monotonic()

        def advance(done: float, note: str = "") -> None:
            show(min(done, total), time.monotonic() - start, note)

        show(0.0, 0.0, note)
        yield advance


def _bar(what: str, total: float, unit: str, stack: ExitStack) -> Callable[[float, float, str], None]:
    """Return what shows in a terminal how much is done, after how many seconds, and of what."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    if not _display:
        columns: list[Any] = [TextColumn("{task.description}"), BarColumn(bar_width=12), MofNCompleteColumn()]
        columns += [TextColumn("{task.fields[rate]}"), TimeRemainingColumn(), TextColumn("{task.fields[note]}")]
        console = Console(stderr=True, force_terminal=True, force_jupyter=False)
        _display.append(stack.enter_context(Progress(*columns, console=console)))
        stack.callback(_display.clear)
    display = _display[0]
    task = display.add_task(what, total=total, rate="", note="")
    if len(display.tasks) > 1:
        stack.callback(display.remove_task, task)
    rate_text = f"{{:,.3g}} {unit}/s".format
    return lambda done, s, note: display.update(task, completed=done, rate=rate_text(done / max(s, 1e-3)), note=note)


def _in_notebook() -> bool:
    """Whether a notebook's kernel runs this; a program may have loaded ipykernel for another reason."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _lines(what: str, total: float, unit: str) -> Callable[[float, float, str], None]:
    """Return what shows the same in lines: at once, at the end, and between at most one a minute."""
    write: Any = functools.partial(print, file=sys.stderr, flush=True)
    every_s, due, first = 60.0, 0.0, (0.0, 0.0)  # the latter once a first step is done, of which compiling is a part
    if _in_notebook():
        display = importlib.import_module("IPython.display").display
        if shown := display({"text/plain": ""}, raw=True, display_id=True):  # None without a notebook
            write, every_s = lambda text: shown.update({"text/plain": text}, raw=True), 0.5

    def show(done: float, seconds: float, note: str) -> None:
        nonlocal due, first
        first = first if first[0] else (done, seconds)
        steps, spent = done - first[0], (seconds - first[1]) / 60
        if seconds >= due or done >= total:
            due = seconds + every_s
            left = f", about {spent * (total - done) / steps:.1f} min left" if steps > 0 and done < total else ""
            write(f"{what}: {done:,.0f} of {total:,.0f} {unit}, {seconds / 60:.1f} min{left}{note and f'; {note}'}")

    return show
