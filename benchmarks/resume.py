"""Trainings that are killed at random moments: whether they end with the weights of one that was not.

Three measurements: SIGKILL at random moments of a small training, each run killed several times, resumed, and compared
with an unbroken one by the hash of its final checkpoint; SIGKILL of a process that does nothing but write checkpoints
and records over earlier ones, and whether what it leaves can be read; the time that a checkpoint takes, and that a
training takes with and without kept compiled programs.

Run: python benchmarks/resume.py; it writes results/resume.json unless fewer kills are asked for.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from archerfish.learning.checkpoint_folder import add_checkpoint, newest_checkpoint
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.provenance import provenance
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "resume.json"
KILLS_PER_RUN = 5
SMALL = (
    "--target paper --ppo.environments 64 --ppo.rollout 10 --ppo.hidden 32 --ppo.steps 1280000 --no-tensorboard "
    "--checkpoint-every 0.2"
)
TRAIN = "from archerfish.cli.main import program; program()"
LONGEST_WRITING_S = 0.1
"""A writer is killed at most so long after it began to write [s]: dozens of writings."""


def main() -> None:
    """Measure, print, write."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--kills", type=int, default=50, help="in trainings")
    arguments.add_argument("--writer-kills", type=int, default=200)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--writer", help=argparse.SUPPRESS)
    options = arguments.parse_args()
    if options.writer:
        write_for_ever(Path(options.writer))
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        trained = kill_trainings(Path(folder), options.kills, chance)
        written = kill_writers(Path(folder) / "written", options.writer_kills, chance)
        cost = checkpoint_cost(Path(folder) / "cost")
    facts = {
        "machine": describe_machine(),
        "provenance": provenance(options.seed),
        "training": SMALL,
        "trainings": trained,
        "writers": written,
        "checkpoint": cost,
    }
    if options.kills >= 50 and options.writer_kills >= 200:
        storage.write_json(RESULT, facts)
    show(facts)
    if trained["other_weights"] or written["unreadable"]:
        sys.exit("a killed training did not come to the weights of an unbroken one, or left what can't be read")


def train(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """Begin a training in a folder, with the compiled programs kept there."""
    environment = {**os.environ, "ARCHERFISH_CACHE": str(folder / "cache")}
    command = [sys.executable, "-c", TRAIN, "train", *words]
    return subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def weights_of(folder: Path) -> str:
    """Return the hash of everything that a finished training leaves for going on."""
    facts = json.loads((folder / "checkpoint.json").read_text())
    return str(facts["arrays_sha256"])


def kill_trainings(folder: Path, kills: int, chance: random.Random) -> dict[str, Any]:
    """Kill trainings at moments spread over all of an unbroken one, its start included."""
    durations = []
    for name in ("cold", "unbroken"):
        begun = time.monotonic()
        if train(folder, *SMALL.split(), "--out", name).wait():
            sys.exit("the unbroken training failed")
        durations.append(time.monotonic() - begun)
    expected = weights_of(folder / "unbroken")
    assert weights_of(folder / "cold") == expected, "kept compiled programs give other weights"
    done, other, before_the_start, runs = 0, 0, 0, 0
    for _ in track(range(-(-kills // KILLS_PER_RUN)), "killing trainings"):
        out = folder / "broken"
        shutil.rmtree(out, ignore_errors=True)
        process = train(folder, *SMALL.split(), "--out", "broken")
        for _ in range(min(KILLS_PER_RUN, kills - done)):
            time.sleep(chance.uniform(0.0, 0.7 * durations[1]))
            ended = process.poll() is not None
            os.killpg(process.pid, signal.SIGKILL) if not ended else None
            process.wait()
            done += 1
            begun = (out / "unfinished" / "config.json").is_file()
            before_the_start += not begun and not ended
            if ended and process.returncode == 0 and not begun:
                break
            process = train(folder, *(("--resume", "broken") if begun else (*SMALL.split(), "--out", "broken")))
        if process.wait():
            sys.exit("a resumed training failed")
        runs += 1
        other += weights_of(out) != expected
    return {
        "kills": done,
        "runs": runs,
        "other_weights": other,
        "killed_before_there_was_a_run": before_the_start,
        "seconds_cold": round(durations[0], 2),
        "seconds_warm": round(durations[1], 2),
    }


def write_for_ever(folder: Path) -> None:
    """Write checkpoints, and a record over itself, and tell of each when it is done."""
    found = newest_checkpoint(folder)
    iteration = 0 if found is None else found.iteration
    print(iteration, flush=True)
    while True:
        iteration += 1
        arrays = {"weights": np.full(50_000, iteration, np.float32)}
        add_checkpoint(folder, iteration, {"note": iteration}, arrays)
        storage.write_record(folder / "policy.json", "benchmark/1", {"note": iteration}, arrays)
        print(iteration, flush=True)


def kill_writers(folder: Path, kills: int, chance: random.Random) -> dict[str, Any]:
    """Kill processes that write, and read what they leave."""
    unreadable = lost = 0
    newest = 0
    for _ in track(range(kills), "killing writers"):
        command = [sys.executable, __file__, "--writer", str(folder)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(chance.uniform(0.0, LONGEST_WRITING_S))
            process.kill()
            told = [int(line) for line in process.stdout.read().split("\n")[:-1]]
        try:
            found = newest_checkpoint(folder)
            newest = 0 if found is None else found.iteration
            if (folder / "policy.json").exists():
                facts, arrays = storage.read_record(folder / "policy.json", "benchmark/1")
                unreadable += bool(facts["note"] != arrays["weights"][0])
            if found is not None:
                unreadable += bool(found.damaged or found.facts["note"] != found.arrays["weights"][0])
        except InputError as error:
            print(error)
            unreadable += 1
        lost += newest < max(told, default=0)
    return {"kills": kills, "unreadable": unreadable, "lost": lost, "checkpoints_written": newest}


def checkpoint_cost(folder: Path) -> dict[str, float]:
    """Time the writing of a checkpoint of a megabyte, which is more than the default training's."""
    arrays = {"weights": np.random.default_rng(0).standard_normal(250_000).astype(np.float32)}
    times = []
    for iteration in range(20):
        begun = time.perf_counter()
        add_checkpoint(folder, iteration, {}, arrays)
        times.append(time.perf_counter() - begun)
    return {
        "megabytes": 1.0,
        "median_ms": round(1e3 * float(np.median(times)), 2),
        "share_at_30_s": round(float(np.median(times)) / 30.0, 6),
    }


def show(facts: dict[str, Any]) -> None:
    """Print the figures."""
    table = Table("measured", "", title="Killed and resumed")
    for part in ("trainings", "writers", "checkpoint"):
        for name, value in facts[part].items():
            table.add_row(f"{part}: {name.replace('_', ' ')}", str(value))
    Console().print(table)


if __name__ == "__main__":
    main()
