"""Independent jobs side by side, in a process each, with one progress bar.

Products of matrices run in one thread in each process: on a few cores that is faster than threads inside of them.
"""

import multiprocessing
import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, NamedTuple

from archerfish.errors import InputError
from archerfish.reports import progress

_XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false", "intra_op_parallelism_threads=1"
ONE_THREAD = {
    "XLA_FLAGS": " ".join(dict.fromkeys([*os.environ.get("XLA_FLAGS", "").split(), *_XLA_FLAGS])),
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
_POLL_S = 0.2


class Job(NamedTuple):
    """A function of a module with its arguments, which another process can import and be sent."""

    function: Callable[..., Any]  # of a module
    arguments: dict[str, Any]  # by name
    work: float = 1.0  # about how long it takes, compared with the others
    name: str = ""  # shown while it runs


def run_jobs(what: str, jobs: Sequence[Job], workers: int) -> list[Any]:
    """Run jobs in processes, show how far they are, and return their results in the order of the jobs.

    Args:
      what: is being done.
      jobs: the longest first keeps all processes busy.
      workers: number of processes.

    Raises:
      InputError: if a process is killed; also whatever a job raises, after the others have been stopped.
    """
    context = multiprocessing.get_context("spawn")
    shares = context.Queue()
    pool = ProcessPoolExecutor(min(workers, len(jobs)), context, _begin, (shares,))
    try:
        with _one_thread():
            futures = [pool.submit(_run, place, job) for place, job in enumerate(jobs)]
            _watch(what, jobs, futures, shares)
        return [future.result() for future in futures]
    except BrokenProcessPool as error:
        remedy = f"use fewer workers than {workers}"
        raise InputError(f"{what}: a process was killed, most likely for want of memory; {remedy}") from error
    except BaseException:
        for process in list((pool._processes or {}).values()):  # a compiled program sees no signal until it is done
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def usual_workers() -> int:
    """Return how many processes are used if not said: one per core, at most four."""
    return min(os.cpu_count() or 1, 4)


@contextmanager
def _one_thread() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _begin(shares: Any) -> None:
    """Begin a worker process: Ctrl-C is answered by its parent, and it ends with its parent, however that ends."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    progress.in_worker = shares.put


def _run(place: int, job: Job) -> Any:
    report = progress.in_worker
    progress.in_worker = lambda share: report and report((place, share))
    try:
        return job.function(**job.arguments)
    finally:
        progress.in_worker = report


def _watch(what: str, jobs: Sequence[Job], futures: Sequence[Future[Any]], shares: Any) -> None:
    """Show how far the jobs are until all are done, or one has failed."""
    done, pending, name = [0.0] * len(jobs), set(futures), ""
    with progress.bar(what, sum(job.work for job in jobs), "parts of the work") as advance:
        while pending:
            finished, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            while True:
                try:
                    place, share = shares.get_nowait()
                except queue.Empty:
                    break
                done[place], name = max(done[place], 0.99 * share * jobs[place].work), jobs[place].name
            for future in finished:
                future.result()
                done[futures.index(future)] = jobs[futures.index(future)].work
            advance(sum(done), name)
