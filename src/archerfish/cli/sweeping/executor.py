"""Who runs the trials: a seam, so that what a sweep does is the same with Ray and without."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol


class Executor(Protocol):
    """Runs independent jobs."""

    def __call__(self, work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield index and result of every job, each once, in the order in which they finish."""


def in_process(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Run jobs here, one after the other."""
    for index, job in enumerate(jobs):
        yield index, work(job)
