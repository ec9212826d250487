"""What trials side by side gain, and whether a sweep survives a machine that is lost.

Throughput: the same trainings one after the other in one process, which has all threads, and on Ray with one worker and
with two, one thread each. Fault: a Ray cluster of two nodes on this machine, one of which is killed in the middle of
its trials; the sweep must end with every trial in the results once, and with the table that one node gives. Writes
benchmarks/results/sweep.json; exits with 1 if the fault test fails. Left out where the extra `sweep` is not installed.
"""

import argparse
import contextlib
import functools
import importlib.util
import io
import os
import signal
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from archerfish.cli.outputs import make_writer
from archerfish.cli.sweep import Sweep, run_sweep, write_sweep
from archerfish.cli.sweeping.folder import sweep_folder
from archerfish.cli.sweeping.preparation import prepare
from archerfish.cli.sweeping.ray_executor import own_ray, ray_executor, run_on_ray
from archerfish.cli.sweeping.results import read_results
from archerfish.cli.sweeping.run import run_rounds
from archerfish.learning.config import PpoConfig
from archerfish.records.storage import write_json
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "sweep.json"
SEEDS = (0, 1, 2, 3)
STEPS = 400_000
"""Decisions of a training whose throughput is measured."""
TINY = PpoConfig(steps=40_000, environments=64, rollout=20, hidden=32)
"""A training of the fault test."""
KILLED_AFTER = 2
"""Trials that are done when the node is killed."""


def sweep_quietly(command: Sweep) -> tuple[float, float]:
    """Run a sweep without its tables; return its wall time and the sum of its trials' [s]."""
    begun = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        summary = run_sweep(command)
    return time.perf_counter() - begun, summary["seconds_of_trials"]


def throughput(steps: int, folder: Path) -> list[dict[str, Any]]:
    """Time the same trainings with nobody, one and two side by side; Ray's start, timed by itself, is taken off."""
    begun = time.perf_counter()
    with ray_executor(1) as executor:
        next(executor(abs, [1]))
        start = time.perf_counter() - begun
    base = Sweep(seeds=SEEDS, ppo=PpoConfig(steps=steps))
    runs = {
        "one process, all threads": replace(base, in_process=True),
        "Ray, 1 worker": replace(base, workers=1),
        "Ray, 2 workers": replace(base, workers=2),
    }
    rows = []
    for index, (name, command) in enumerate(runs.items()):
        wall, of_trials = sweep_quietly(replace(command, out=folder / str(index)))
        spent = wall - (0.0 if command.in_process else start)
        rows.append(
            {
                "run": name,
                "seconds": round(spent, 2),
                "ray_start_seconds": None if command.in_process else round(start, 2),
                "seconds_per_trial": round(of_trials / len(SEEDS), 2),
                "decisions_per_second": round(len(SEEDS) * steps / spent),
            }
        )
    tables = {(folder / str(index) / "results.csv").read_bytes() for index in range(len(runs))}
    if len(tables) > 1:
        sys.exit("the same trainings gave other results with other workers")
    for row in rows:
        row["of_one_worker"] = round(row["decisions_per_second"] / rows[1]["decisions_per_second"], 2)
    return rows


def counted(attempts: Path, work: Callable[[Any], Any], job: Any) -> Any:
    """Do a job, and leave a file that says on which node it was begun."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    (attempts / f"{node}-{os.getpid()}-{uuid.uuid4().hex}").touch()
    return work(job)


def fault(folder: Path) -> dict[str, Any]:
    """Kill one of two nodes in the middle of its trials, and compare with a sweep on one node."""
    from ray.cluster_utils import Cluster

    command = Sweep(seeds=tuple(range(4)), vary=("ppo.clip=0.1,0.2",), ppo=TINY, engagements=8)
    attempts = folder / "attempts"
    attempts.mkdir()
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    lost = cluster.add_node(num_cpus=1)
    killed: dict[str, Any] = {}

    def kill(results: Path) -> None:
        while not results.exists() or len(read_results(results)) < KILLED_AFTER:
            time.sleep(0.1)
        # All of the node, as when a machine fails: without its raylet, a worker would still end what it has begun.
        workers = {int(path.name.split("-")[1]) for path in attempts.glob(f"{lost.node_id}-*")}
        for process in (lost.all_processes["raylet"][0].process.pid, *workers):
            os.kill(process, signal.SIGKILL)
        killed.update(after=len(read_results(results)), at=time.perf_counter())

    def executor(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        yield from run_on_ray(functools.partial(counted, attempts, work), jobs)

    out = folder / "two"
    threading.Thread(target=kill, args=(out / "results.jsonl",), daemon=True).start()
    begun = time.perf_counter()
    with ray_executor(0, cluster.address), contextlib.redirect_stdout(io.StringIO()):
        prepared = prepare(command)
        with sweep_folder(out, prepared.told, resume=False) as kept:
            total = run_rounds(prepared.plan, prepared.proposer, kept, executor)
            write_sweep(kept, total, prepared.learning, make_writer(command))
    wall = time.perf_counter() - begun
    cluster.shutdown()
    sweep_quietly(replace(command, workers=2, out=folder / "one"))
    tables = [(folder / name / "results.csv").read_text() for name in ("two", "one")]
    begun_on = [path.name.split("-") for path in attempts.iterdir()]
    numbers = [each.trial for each in read_results(out / "results.jsonl")]
    return {
        "trials": prepared.trials,
        "finished_before_the_node_was_killed": killed["after"],
        "begun_on_the_killed_node": sum(node == lost.node_id for node, *_ in begun_on),
        "begun_on_the_other": sum(node != lost.node_id for node, *_ in begun_on),
        "in_results": len(numbers),
        "twice_in_results": len(numbers) - len(set(numbers)),
        "same_table_as_one_node": tables[0] == tables[1],
        "seconds": round(wall, 1),
    }


def show(title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows as a table."""
    table = Table(*(name.replace("_", " ") for name in rows[0]), title=title)
    for row in rows:
        table.add_row(
            *("—" if value is None else f"{value:,}" if type(value) is int else str(value) for value in row.values())
        )
    Console(width=140).print(table)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS, help="decisions of a training whose throughput is measured")
    parser.add_argument("--fault-only", action="store_true", help="leave the throughput out, and write nothing")
    options = parser.parse_args()
    if importlib.util.find_spec("ray") is None:
        print("left out: needs ray; pip install 'archerfish[sweep]'")
        return
    os.environ.update(own_ray())  # for the cluster as well: on loopback alone
    with tempfile.TemporaryDirectory() as folder:
        found = fault(Path(folder))
        show("a node is killed", [found])
        passed = (
            found["in_results"] == found["trials"]
            and not found["twice_in_results"]
            and found["same_table_as_one_node"]
            and found["begun_on_the_killed_node"] + found["begun_on_the_other"] > found["trials"]
        )
        if not options.fault_only:
            rows = throughput(options.steps, Path(folder))
            show(f"{len(SEEDS)} trainings of {options.steps:,} decisions", rows)
            conditions = {"seeds": SEEDS, "steps": options.steps, "fault_ppo_steps": TINY.steps}
            write_json(
                RESULT, {"machine": describe_machine(), "conditions": conditions, "throughput": rows, "fault": found}
            )
    if not passed:
        sys.exit("the sweep did not survive the loss of a node")


if __name__ == "__main__":
    main()
