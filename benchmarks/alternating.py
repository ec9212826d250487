"""Speed of this working tree: alone, or in pairs with another commit, where the two take turns on the same work."""

import argparse
import contextlib
import json
import os
import platform
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from archerfish.provenance import provenance

Work = dict[str, Callable[[], int]]
ROOT = Path(__file__).resolve().parents[1]
SECONDS = 0.4
SURROUNDINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TF_CPP_MIN_LOG_LEVEL": "3"}
"""Environment variables of every process that is measured."""


def run(
    description: str,
    file: str,
    prepare: Callable[[], Work],
    names: tuple[str, ...],
    pairs: int,
    *,
    usual: tuple[str, ...] = (),
    in_seconds: bool = False,
) -> None:
    """Measure each name, print a table, and write results/NAME.json beside the benchmark, but not of a part of it.

    Args:
      description: of the benchmark.
      file: the benchmark's own, which is run again in a process of each tree.
      prepare: returns name → a function that works and returns how much it did; it is called once before it is timed.
      names: of the work, in the order of the table.
      pairs: of measurements of each name, if not given on the command line.
      usual: names that are measured if none are given; all if left out.
      in_seconds: whether the figures are durations of one unit of work rather than units per second.
    """
    usual = usual or names
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="REVISION", help="another commit, with this benchmark, to be compared")
    parser.add_argument("--work", nargs="+", choices=names, default=usual, help="only these; the result isn't written")
    parser.add_argument("--pairs", type=int, default=pairs, help="of measurements; the result of fewer isn't written")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of a measurement, at least")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        _serve(prepare(), options.work, options.seconds)
        return
    script = Path(file).resolve().relative_to(ROOT)
    words = [str(script), "--serve", "--seconds", str(options.seconds), "--work", *options.work]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # or the other commit's tree would be left
    load, rows = os.getloadavg()[0], dict[str, Any]()
    with contextlib.ExitStack() as stack:
        trees = [ROOT] if options.against is None else [ROOT, stack.enter_context(worktree(options.against))]
        commits = [_commit(tree) for tree in trees]
        processes = [stack.enter_context(_started(words, tree)) for tree in trees]
        unit = "seconds" if in_seconds else "per second"
        print(
            f"{'':24} {unit:>12} {'of processor':>12}",
            f"{'against':>12} {'ratio':>7} {'of processor':>12}" * bool(trees[1:]),
        )
        for name in options.work:
            found = [_measured(processes, name, number, in_seconds) for number in range(options.pairs)]
            rows[name] = _row(found)
            _print(name, rows[name], 2 if in_seconds else 0)
    if options.pairs >= pairs and options.seconds >= SECONDS and set(usual) <= set(options.work):
        conditions = {
            "pairs": options.pairs,
            "cores": os.cpu_count(),
            "machine": platform.machine(),
            "load": round(load, 1),
        }
        conditions |= {
            "commit": commits[0],
            "against": commits[1] if trees[1:] else None,
            "versions": provenance()["versions"],
        }
        content = {"conditions": conditions, unit.replace(" ", "_"): rows}
        (ROOT / script.parent / "results" / f"{script.stem}.json").write_text(json.dumps(content, indent=2) + "\n")


@contextlib.contextmanager
def worktree(revision: str) -> Iterator[Path]:
    """Check out a commit into a temporary folder, and remove it at the end."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        words = ["git", "worktree", "add", "--quiet", "--detach", str(tree), revision]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"--against {revision}: {done.stderr.strip()}")
        try:
            yield tree
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(tree)], cwd=ROOT, check=True)


def cpu_seconds() -> float:
    """Return the processor time of this process and of those that it ran to their end [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _commit(tree: Path) -> str:
    words = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    return subprocess.check_output(words, cwd=tree, text=True).strip()


@contextlib.contextmanager
def _started(words: list[str], tree: Path) -> Iterator[Any]:
    """Start the benchmark of a tree, which serves until its standard input ends."""
    environment = {**os.environ, **SURROUNDINGS, "PYTHONPATH": str(tree / "src")}
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, *words], cwd=tree, env=environment, **pipes) as process:
        if process.stdout is None or process.stdout.readline() != "ready\n":
            sys.exit(f"{tree / words[0]}: did not begin to measure; another commit needs this benchmark, too")
        yield process


def _measured(processes: list[Any], name: str, number: int, in_seconds: bool) -> list[list[float]]:
    """Return wall and processor figure of each tree, in its turn."""
    found: list[list[float]] = [[] for _ in processes]
    order = list(range(len(processes)))
    for place in order if number % 2 else order[::-1]:
        process = processes[place]
        process.stdin.write(f"{name}\n")
        process.stdin.flush()
        count, *times = json.loads(process.stdout.readline())
        found[place] = [spent / count if in_seconds else count / spent for spent in times]
    return found


def _row(found: list[list[list[float]]]) -> dict[str, float]:
    """Return medians, and where there are two trees medians of the pairs' ratios."""
    medians = [
        [statistics.median(pair[place][kind] for pair in found) for kind in range(2)] for place in range(len(found[0]))
    ]
    row = {"wall": medians[0][0], "processor": medians[0][1]}
    if medians[1:]:
        ratios = [statistics.median(pair[0][kind] / pair[1][kind] for pair in found) for kind in range(2)]
        row |= {"against": medians[1][0], "ratio": ratios[0], "ratio_of_processor_time": ratios[1]}
    return {name: float(f"{value:.4g}") for name, value in row.items()}


def _print(name: str, row: dict[str, float], digits: int) -> None:
    line = f"{name:24} {row['wall']:12,.{digits}f} {row['processor']:12,.{digits}f}"
    if "against" in row:
        line += f" {row['against']:12,.{digits}f} {row['ratio']:7.3f} {row['ratio_of_processor_time']:12.3f}"
    print(line, flush=True)


def _serve(functions: Work, names: list[str], seconds: float) -> None:
    """Work for each name on standard input, and print the count, wall and processor time [s]."""
    for name in names:
        functions[name]()
    print("ready", flush=True)
    for line in sys.stdin:
        wall, spent, count = time.perf_counter(), cpu_seconds(), 0
        while not count or time.perf_counter() - wall < seconds:
            count += functions[line.strip()]()
        print(json.dumps([count, time.perf_counter() - wall, cpu_seconds() - spent]), flush=True)
