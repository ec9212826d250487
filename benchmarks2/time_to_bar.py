"""How long it takes from a cold process to a policy on disk that reaches the paper, against the first edition.

`python benchmarks2/time_to_bar.py` trains by PPO and by gradients in the paper's task under `box` with the observation
`history`: the paper's six numbers hold no velocity, and their policies stay below its PPO column where targets move
far away. First each edition is trained for longer and longer until the policies of five seeds reach that column in all
eight cells of Tables II and III. Then, with as many decisions, three other seeds are timed from the start of a process
to its end, as users train: `af.train(..., out=...)`, and the command `archerfish train`. Goals: 0.7 of the first
edition's time with kept compiled programs, 0.6 with an empty cache. The machine should do nothing else. Writes
results/time_to_bar.json.
"""

import argparse
import itertools
import json
import os
import platform
import runpy
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import archerfish2 as af

ROOT = Path(__file__).resolve().parents[1]
RESULT = Path(__file__).parent / "results" / "time_to_bar.json"
EDITIONS, TRAINERS = ("first", "second"), ("ppo", "gradient")
SEEDS, TRIED = (0, 1, 2), (10, 11, 12, 13, 14)
"""Of the trainings that are timed, and of those that tell how many decisions are needed."""
LENGTHS = (51_200, 102_400, 153_600, 204_800, 307_200, 512_000, 1_024_000)
"""Decisions that are asked for; a trainer rounds them to whole calls."""
GOALS = {"kept": 0.7, "empty": 0.6}
"""State of the folder of compiled programs → most of the first edition's time."""
READ_FIRST = runpy.run_path(str(ROOT / "tests2" / "against_first" / "test_policies.py"))["read_first"]
TASK = af.Task.load("paper").replace(command_limit="box")
SECOND = """import archerfish2 as af
task, config = af.Task.load("paper").replace(command_limit="box"), af.TrainConfig(observation="history")
af.train(task=task, config=config, trainer=TRAINER, steps=STEPS, seed=SEED, out=OUT)"""
FIRST = "import sys; from archerfish.cli.main import main; sys.exit(main())"
STAGES = """import json, time
moments, programs = [("imports", time.time())], []
from archerfish2.compiled import import_jax
import_jax().monitoring.register_event_duration_secs_listener(lambda name, spent, **_: programs.append((name, spent)))
from archerfish2.learning import learner, run_folder, train
def marked(name, function):
    def call(*arguments):
        moments.append((name, time.time()))
        return function(*arguments)
    return call
for name in ("begin", "advance"):
    setattr(learner.Trainer, name, marked(name, getattr(learner.Trainer, name)))
run_folder.RunFolder.finish = marked("finish", run_folder.RunFolder.finish)
moments.append(("setting", time.time()))
SECOND
moments.append(("exit", time.time()))
print(json.dumps([moments, programs]))""".replace("SECOND", SECOND)
"""The same, which prints the moments at which its stages begin, and how long JAX took over programs."""
PROGRAMS = {"tracing": "jaxpr_trace", "lowering": "jaxpr_to_mlir_module", "loading or compiling": "backend_compile"}
"""What the stage `programs` consists of: name → JAX's event."""


class Edition(NamedTuple):
    """An edition and what it trains by."""

    name: str  # "first" or "second"
    trainer: str
    folder: Path  # for kept programs and policies

    def train(self, steps: int, seed: int, cache: Path | None = None, code: str = SECOND) -> tuple[float, float, str]:
        """Train in a process of its own; return its duration, its processor time [s] and what it prints."""
        given = {"TRAINER": repr(self.trainer), "STEPS": str(steps), "SEED": str(seed), "OUT": repr(str(self.out))}
        for name, value in given.items():
            code = code.replace(name, value)
        options = f"--target paper --observation history --command-limit box --trainer {self.trainer} --seed {seed}"
        options += f" --{self.trainer}.steps {steps} --overwrite --out {self.out}"
        words = ["-c", code] if self.name == "second" else ["-c", FIRST, "train", *options.split()]
        kept = cache or self.folder / self.name
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "ARCHERFISH_CACHE": str(kept)}
        before, begun = os.times(), time.perf_counter()
        done = subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.stderr)
        wall, after = time.perf_counter() - begun, os.times()
        spent = after.children_user + after.children_system - before.children_user - before.children_system
        return round(wall, 2), round(spent, 2), done.stdout

    @property
    def out(self) -> Path:
        """Folder of the policy."""
        return self.folder / f"{self.name}-{self.trainer}"

    def margin(self, engagements: int) -> float:
        """Return by how many points the policy is above the paper's PPO column, in the cell where it is least so."""
        policy = af.Policy.load(self.out) if self.name == "second" else READ_FIRST(self.out)
        cells = af.evaluate({"policy": policy}, task=TASK, engagements=engagements, seed=1).cells
        return round(min(100.0 * each.rate - (each.paper or 0.0) for each in cells), 2)

    def enough(self, seeds: tuple[int, ...], engagements: int) -> tuple[int, list[float]]:
        """Return the decisions after which the policies of all seeds reach the column, and their margins [points]."""
        for steps in LENGTHS:
            margins = []
            for seed in seeds:
                self.train(steps, seed)
                margins.append(self.margin(engagements))
                if margins[-1] < 0.0:
                    break
            else:
                return steps, margins
        raise SystemExit(f"{self.name} edition, {self.trainer}: not reached with {LENGTHS[-1]} decisions")


def stages(edition: Edition, steps: int, cache: Path | None) -> dict[str, float]:
    """Return the seconds of each stage of a training of the second edition."""
    begun = time.time()
    *_, printed = edition.train(steps, SEEDS[0], cache, STAGES)
    moments, programs = json.loads(printed)
    moments = [("interpreter", begun), *moments, ("", time.time())]
    spent = [(name, end - since) for (name, since), (_, end) in itertools.pairwise(moments)]
    found: dict[str, float] = {}
    for name, seconds in spent:
        found[name] = found.get(name, 0.0) + seconds
    calls = [seconds for name, seconds in spent if name == "advance"]
    training = len(calls) * statistics.median(calls[1:] or [0.0])
    found["programs"] = found.pop("begin") + found.pop("advance") - training
    for name, event in PROGRAMS.items():
        found[f"programs, {name}"] = sum(spent for each, spent in programs if f"/{event}_duration" in each)
    found |= {"training": training, "saving": found.pop("finish"), "exit": found.pop("exit")}
    return {name: round(seconds, 2) for name, seconds in found.items()}


def measure(
    trainer: str, folder: Path, seeds: tuple[int, ...], tried: tuple[int, ...], engagements: int
) -> dict[str, Any]:
    """Find how many decisions each edition needs, and time both."""
    editions = {name: Edition(name, trainer, folder) for name in EDITIONS}
    found: dict[str, Any] = {}
    for name, edition in editions.items():
        steps, margins = edition.enough(tried, engagements)
        found[name] = {"decisions": steps, "margins_tried": margins, "margins": []}
        found[name] |= {f"{state}{kind}_s": list[float]() for state in GOALS for kind in ("", "_processor")}
        print(f"{trainer}, {name} edition: {steps:,} decisions, margins {margins}", flush=True)
    for state in GOALS:
        for number, seed in enumerate(seeds):
            for name in EDITIONS[:: 1 if number % 2 else -1]:
                edition, row = editions[name], found[name]
                with tempfile.TemporaryDirectory() as empty:
                    cache = Path(empty) if state == "empty" else None
                    wall, spent, _ = edition.train(row["decisions"], seed, cache)
                row[f"{state}_s"].append(wall)
                row[f"{state}_processor_s"].append(spent)
                if state == "kept":
                    row["margins"].append(edition.margin(engagements))
        both = (found[name][f"{state}_s"] for name in EDITIONS)
        found[f"ratio_{state}"] = round(statistics.median(b / a for a, b in zip(*both, strict=True)), 3)
        with tempfile.TemporaryDirectory() as empty:
            cache, steps = Path(empty) if state == "empty" else None, found["second"]["decisions"]
            found["second"][f"stages_{state}_s"] = stages(editions["second"], steps, cache)
    return found


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trainers", nargs="+", choices=TRAINERS, default=TRAINERS)
    parser.add_argument("--quick", action="store_true", help="one seed and few engagements; nothing is written")
    options, load = parser.parse_args(), round(os.getloadavg()[0], 1)
    sizes = (SEEDS[:1], TRIED[:1], 20) if options.quick else (SEEDS, TRIED, 200)
    with tempfile.TemporaryDirectory() as folder:
        found = {trainer: measure(trainer, Path(folder), *sizes) for trainer in options.trainers}
    faults = []
    for trainer, rows in found.items():
        for state, goal in GOALS.items():
            seconds = [statistics.median(rows[edition][f"{state}_s"]) for edition in EDITIONS]
            ratio = rows[f"ratio_{state}"]
            spent = [statistics.median(rows[edition][f"{state}_processor_s"]) for edition in EDITIONS]
            both = f"first {seconds[0]:6.2f} s   second {seconds[1]:6.2f} s   ratio {ratio}"
            print(f"{trainer:8} programs {state:5}   {both}   of processor time {spent[1] / spent[0]:.3f}")
            print(" " * 10, "  ".join(f"{name} {each}" for name, each in rows["second"][f"stages_{state}_s"].items()))
            faults += [f"{trainer}, {state} programs: {ratio}, goal {goal}"] if ratio > goal else []
        faults += [f"{trainer}, {each} edition: a policy is below the column" for each in EDITIONS
                   if min(rows[each]["margins"]) < 0.0]  # fmt: skip
    if not options.quick:
        conditions = {"seeds": SEEDS, "seeds_tried": TRIED, "engagements": sizes[2], "evaluation_seed": 1, "load": load,
                      "cores": os.cpu_count(), "machine": platform.machine(), "goals": GOALS}  # fmt: skip
        RESULT.write_text(json.dumps({"conditions": conditions, "from_cold_process": found}, indent=1) + "\n")
    if faults:
        raise SystemExit(f"missed: {'; '.join(faults)}")


if __name__ == "__main__":
    main()
