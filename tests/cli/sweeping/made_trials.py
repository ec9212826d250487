import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from archerfish.cli.sweeping.trial import CellHits, TrialDone, TrialJob

SHOTS, ENGAGEMENTS = 50, 4


def made_up_hits(job: TrialJob) -> TrialDone:
    """Stand in for a trial: hits that depend on clip and seed alone, best at 0.2; a clip above 0.5 diverges."""
    clip, seed = job.task.ppo.clip, job.task.seed
    if clip > 0.5:
        return TrialDone("training diverged after 0 decisions", seconds=0.1)
    hits = round(40 - 100 * abs(clip - 0.2)) + seed % 3
    by_engagement = tuple(max(0, min(SHOTS, hits + each)) for each in range(ENGAGEMENTS))
    total, fired = sum(by_engagement), SHOTS * ENGAGEMENTS
    rate = total / fired
    cells = tuple(
        CellHits(target, (1.0, 2.0), total, fired, max(0.0, rate - 0.1), min(1.0, rate + 0.1), by_engagement)
        for target in ("static", "dynamic")
    )
    files = {"policy.json": b"{}\n", "log.jsonl": f"{clip} {seed}\n".encode()}
    return TrialDone(None, cells, float(clip), f"{clip}-{seed}", 0.1, files)


def backwards(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Run jobs in the opposite order, as a cluster may."""
    for index in reversed(range(len(jobs))):
        yield index, work(jobs[index])


def ending_after(count: int) -> Callable[..., Iterator[tuple[int, Any]]]:
    """Return an executor whose driver ends after some jobs."""

    def run(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        yield from itertools.islice(backwards(work, jobs), count)
        raise KeyboardInterrupt

    return run
