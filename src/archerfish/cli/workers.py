"""Independent tasks side by side: one process per core, one progress bar for all.

The products of each run in one thread: on a few cores this beats threads inside of them. The shards of a training keep
their own; several trainings share the cores as well as one has them to itself.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import Empty
from typing import Any

from archerfish.cli.compilation_cache import load_quietly
from archerfish.cli.interrupts import without_interrupts
from archerfish.cli.progress import progress_bar
from archerfish.records.errors import InputError

Task = tuple[Callable[..., Any], Any, float]
"""A function of (argument, advance), its argument, and the work it reports when done."""

_SINGLE_THREAD = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
_POLL_S = 0.2
_reports: Any = None


def run_tasks(what: str, unit: str, tasks: Sequence[Task], workers: int) -> list[Any]:
    """Run tasks in worker processes and show their progress.

    Args:
      what: is being done.
      unit: of the work.
      tasks: longest first gives the best use of the workers.
      workers: processes.

    Returns:
      The results, in the order of the tasks.

    Raises:
      InputError: if a worker is killed; whatever a task raises.
    """
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    pool = ProcessPoolExecutor(workers, context, _begin_worker, (reports,))
    try:
        with _single_threaded(), without_interrupts(), _blocked_ctrl_c():
            futures = [pool.submit(_run, index, task[0], task[1]) for index, task in enumerate(tasks)]
        _watch(what, unit, [task[2] for task in tasks], futures, reports)
        return [future.result() for future in futures]
    except BrokenProcessPool as error:
        problem = f"{what}: a worker process was killed, most likely for want of memory"
        raise InputError(f"{problem}; use fewer --workers than {workers}") from error
    except BaseException:
        _stop(pool)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Let processes that start in the block compute each product in one thread."""
    kept = {name: os.environ.get(name) for name in _SINGLE_THREAD}
    os.environ.update(_SINGLE_THREAD)
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _blocked_ctrl_c() -> Iterator[None]:
    """Let processes that start in the block never see Ctrl-C: it reaches the whole group, the parent alone answers."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker(reports: Any) -> None:
    global _reports  # a worker process has one
    _reports = reports
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave no orphan: end this worker when its parent ends, however that was."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run(index: int, function: Callable[..., Any], argument: Any) -> Any:
    def advance(done: float, note: str = "") -> None:
        _reports.put((index, done, note))

    load_quietly()
    return function(argument, advance)


def _watch(what: str, unit: str, totals: Sequence[float], futures: Sequence[Future[Any]], reports: Any) -> None:
    done = [0.0] * len(totals)
    with progress_bar(what, sum(totals), unit) as advance:
        pending = set(futures)
        while pending:
            finished, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            note = ""
            while True:
                try:
                    index, amount, note = reports.get_nowait()
                except Empty:
                    break
                done[index] = min(amount, totals[index])
            for future in finished:
                future.result()
                done[futures.index(future)] = totals[futures.index(future)]
            advance(sum(done), note)


def _stop(pool: ProcessPoolExecutor) -> None:
    """End the workers at once: a compiled program hears no signal that Python handles."""
    for process in list((pool._processes or {}).values()):
        process.terminate()
