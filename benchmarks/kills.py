"""Commands that are ended at random moments: whether a signal is ever lost, and what is left behind.

`train`, `identify`, `record` and `evaluate` are begun again and again, short, and sent SIGTERM at moments spread over
all of a run, its start and its end included; every other time into a folder that holds an earlier run. A kill counts if
it met a living process. Right after it the folder must be as it was, or hold the whole new run; a training may hold a
checkpoint to go on from. Where anything else than before is there, a complete next run follows, which must leave
nothing but its results. A second part does the same with SIGKILL, which leaves what it leaves: the next run must remove
it.

Run: python benchmarks/kills.py; it writes results/kills.json unless fewer kills are asked for.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from archerfish.cli.interrupts import LONGEST_S
from archerfish.records import storage
from archerfish.records.provenance import provenance
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "kills.json"
KILLS, HARD_KILLS = 50, 10
COMMANDS = {
    "train": "train --target paper --ppo.environments 64 --ppo.rollout 10 --ppo.hidden 32 --ppo.steps 128000 "
    "--no-tensorboard --checkpoint-every 0.3",
    "identify": "identify gimbal logs/yaw_sweep.csv logs/yaw_step.csv --axis yaw --order 2 --max-delay 10",
    "record": "record sweep --axis pitch --physics linear --duration-s 5",
    "evaluate": "evaluate --controllers kalman --engagements 4",
}
LOGS = ("record sweep --duration-s 3 --no-validation", "record step --hold-s 0.5 --no-validation")
PROGRAM = "from archerfish.cli.main import program; program()"
LIMIT_S = LONGEST_S + 15.0
"""A process that lives so long after the signal has lost it: the limit of the commands, and some for a busy machine."""
ENDED_BY = {
    signal.SIGTERM: {128 + signal.SIGTERM: "by the command", -signal.SIGTERM: "before or after it"},
    signal.SIGKILL: {-signal.SIGKILL: "killed"},
}
"""Signal → status → how it ended the process."""


@dataclass
class Bench:
    """A command, its folder, and what an unbroken run leaves there."""

    name: str
    folder: Path
    seconds: float = 0.0
    whole: frozenset[str] = frozenset()

    def begin(self, *words: str) -> subprocess.Popen[bytes]:
        """Begin the command, or the one that some words say, with the compiled programs kept in the folder."""
        environment = {**os.environ, "ARCHERFISH_CACHE": str(self.folder.parent / "cache")}
        told = [*(words or COMMANDS[self.name].split()), "--out", "out"] if "--resume" not in words else list(words)
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *told],
            cwd=self.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    @property
    def out(self) -> Path:
        """The folder that the command writes."""
        return self.folder / "out"

    def finish(self) -> None:
        """Run the command to its end: a training that can goes on with the one that was killed."""
        goes_on = any((self.out / "unfinished" / "checkpoints").glob("*.json"))
        if self.begin(*(("train", "--resume", "out") if goes_on else ())).wait():
            sys.exit(f"{self.name}: the run after a kill failed, in {self.folder}")

    def measure(self) -> None:
        """Take the time of an unbroken run, after one that compiles."""
        for _ in range(2):
            shutil.rmtree(self.out, ignore_errors=True)
            begun = time.monotonic()
            self.finish()
            self.seconds = time.monotonic() - begun
        self.whole = frozenset(contents(self.out))


def contents(folder: Path) -> dict[str, str]:
    """Return path → hash of every file below a folder, and of every folder that is empty."""
    paths = [each for each in folder.rglob("*") if each.is_file() or not any(each.iterdir())]
    if folder.is_dir() and not paths:
        return {".": "empty"}
    return {
        str(each.relative_to(folder)): hashlib.sha256(each.read_bytes()).hexdigest() if each.is_file() else "empty"
        for each in paths
    }


def left_behind(bench: Bench, before: dict[str, str]) -> list[str]:
    """Return what is there that is neither as before nor part of a whole run."""
    now = contents(bench.out)
    others = {each.name for each in bench.folder.iterdir()} - {"out", "logs"}
    if now == before or now.keys() == bench.whole:
        return sorted(others)
    return sorted(others | before.keys() - now.keys() | {name for name in now if now[name] != before.get(name)})


def kill(bench: Bench, number: int, chance: random.Random, old: bool) -> dict[str, Any] | None:
    """Kill one run, and look at what it leaves; None if it had ended before."""
    if old:
        bench.finish() if not bench.out.exists() else None
    else:
        shutil.rmtree(bench.out, ignore_errors=True)
    before = contents(bench.out)
    process = bench.begin()
    time.sleep(chance.uniform(0.0, bench.seconds))
    if process.poll() is not None:
        return None
    begun = time.monotonic()
    process.send_signal(number)
    try:
        status = process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        status = None
    took = time.monotonic() - begun
    left = left_behind(bench, before)
    kept = any((bench.out / "unfinished" / "checkpoints").glob("*.json"))
    other = [each for each in left if not (kept and each.startswith("unfinished/"))]
    if left:
        bench.finish()
    after = left_behind(bench, before if not left else {})
    found = {"status": status, "seconds": took, "left": other, "checkpoint": kept, "after": after}
    if after or (other and number != signal.SIGKILL) or status not in ENDED_BY[number]:
        print(bench.name, found)
    return found


def kill_all(bench: Bench, number: int, kills: int, chance: random.Random) -> dict[str, Any]:
    """Kill a command so many times, and count."""
    found: list[dict[str, Any]] = []
    missed = 0
    for _ in track(range(kills), f"{signal.Signals(number).name} to {bench.name}"):
        result = None
        while result is None:
            result = kill(bench, number, chance, old=len(found) % 2 == 1)
            missed += result is None
        found.append(result)
    ended = Counter(ENDED_BY[number].get(each["status"], "lost") for each in found)
    return {
        "kills": len(found),
        "met_no_living_process": missed,
        "lost": ended.pop("lost", 0),
        "ended": dict(ended),
        "seconds_to_the_end_median": round(statistics.median(each["seconds"] for each in found), 3),
        "seconds_to_the_end_longest": round(max(each["seconds"] for each in found), 2),
        "left_a_checkpoint_to_go_on_from": sum(each["checkpoint"] for each in found),
        "left_something_else": sum(bool(each["left"]) for each in found),
        "left_after_the_next_run": sum(bool(each["after"]) for each in found),
    }


def main() -> None:
    """Measure, print, write."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--kills", type=int, default=KILLS, help="by SIGTERM, of each command")
    arguments.add_argument("--hard-kills", type=int, default=HARD_KILLS, help="by SIGKILL, of each command")
    arguments.add_argument("--seed", type=int, default=0)
    options = arguments.parse_args()
    chance = random.Random(options.seed)
    soft, hard, seconds = {}, {}, {}
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for name in COMMANDS:
            bench = Bench(name, Path(folder) / name)
            bench.folder.mkdir()
            if name == "identify":
                for words in LOGS:
                    logs = [*words.split(), "--physics", "linear", "--out", "logs"]
                    subprocess.run([sys.executable, "-c", PROGRAM, *logs], cwd=bench.folder, check=True)
            bench.measure()
            seconds[name] = round(bench.seconds, 2)
            soft[name] = kill_all(bench, signal.SIGTERM, options.kills, chance)
            hard[name] = kill_all(bench, signal.SIGKILL, options.hard_kills, chance)
    facts = {
        "machine": describe_machine(),
        "provenance": provenance(options.seed),
        "load": [round(each, 1) for each in os.getloadavg()],
        "niceness": os.nice(0),
        "commands": COMMANDS,
        "seconds_of_an_unbroken_run": seconds,
        "seconds_until_a_signal_counts_as_lost": LIMIT_S,
        "seconds_of_all": round(time.monotonic() - begun),
        "sigterm": soft,
        "sigkill": hard,
    }
    if options.kills >= KILLS and options.hard_kills >= HARD_KILLS:
        storage.write_json(RESULT, facts)
    show(facts)
    if any(each["lost"] or each["left_something_else"] for each in soft.values()):
        sys.exit("a SIGTERM was lost, or left something behind")
    if any(each["left_after_the_next_run"] for part in (soft, hard) for each in part.values()):
        sys.exit("something was left behind after the next run")


def show(facts: dict[str, Any]) -> None:
    """Print the figures."""
    table = Table("", *COMMANDS, title=f"Killed at random moments, {facts['seconds_of_all']} s in all")
    table.add_row("s of an unbroken run", *(str(each) for each in facts["seconds_of_an_unbroken_run"].values()))
    for part in ("sigterm", "sigkill"):
        for name in facts[part]["train"]:
            words = f"{part.upper()}: {name.replace('_', ' ')}"
            values = [each[name] for each in facts[part].values()]
            shown = [" ".join(f"{how} {n}" for how, n in each.items()) if name == "ended" else each for each in values]
            table.add_row(words, *map(str, shown))
    Console().print(table)


if __name__ == "__main__":
    main()
