"""How fast a table is shot on the virtual robot, beside an older commit, and whether the shots are the same.

The older commit is checked out in a git worktree of its own. One process of each version shoots Tables IV and V with
the robot `infantry`, controller after controller, in turn: rounds of both follow each other, so that other programs on
the machine slow down both alike. Each controller is compiled before it is timed. The simulator's record of the robot
is the paper's printed gimbal with a camera and a link that are near the robot's, and the policy has random weights: the
work is that of an evaluation, the hit rates are of no interest, but for their equality.

Run: python benchmarks/robot_speed.py [COMMIT] [--engagements N] [--rounds N]; it writes results/robot_speed.json unless
fewer engagements or rounds are requested.
"""

import argparse
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
RESULT = Path(__file__).parent / "results" / "robot_speed.json"
BEFORE = "a4cf8a20266b42d328fce32ba3af1ad4dd4fe7b0"
"""The last commit before many gimbals shared a model."""
CONTROLLERS = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "policy")
ENGAGEMENTS, ROUNDS, SEED = 100, 5, 0
"""Per cell, of which there are eight; rounds of each controller and version."""


def shoot_on_request() -> None:
    """Shoot the table with each controller that a line of the standard input names, and answer in a line of JSON."""
    from archerfish.cli.evaluation_run import EvaluationTask, make_ground
    from archerfish.evaluation.trial import fight

    ground = make_ground(EvaluationTask(_setting(), "gate", ENGAGEMENTS, SEED, robot="infantry", tables=("IV", "V")))
    made: dict[str, Any] = {}
    for line in sys.stdin:
        name, count, place = line.split()
        if int(count) * 8 != len(ground.trials.draws):
            task = EvaluationTask(_setting(), "gate", int(count), SEED, robot="infantry", tables=("IV", "V"))
            ground = make_ground(task)
        if name not in made:
            made[name] = _controller(name, ground.conditions)
            fight(ground.world, made[name], ground.trials)
        begun, spent = time.perf_counter(), time.process_time()
        shots = fight(ground.world, made[name], ground.trials)
        seconds, processor = time.perf_counter() - begun, time.process_time() - spent
        np.savez(place, hit=shots.hits(ground.conditions.hit_radius), miss=shots.miss)
        print(json.dumps({"seconds": seconds, "processor": processor, "shots": shots.fired.size}), flush=True)


def _setting() -> Any:
    from archerfish.cli.setting import SettingFiles, load_setting
    from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord

    camera = CameraRecord(80.0, 0.0, 3e-4, 1e-3, 1e-3, 0.03, 3.0, 0.1, 0.0065, 0.035, 0.002, "exposure")
    link = LinkRecord(
        feedback_rate_hz=1000.0, command_latency=0.01, command_latency_jitter=0.003, feedback_latency=0.002
    )
    return replace(load_setting(SettingFiles()), sensing=SensingRecord(camera, link))


def _controller(name: str, conditions: Any) -> Any:
    from archerfish.cli.evaluation_run import EvaluationTask, _bench
    from archerfish.controllers.network import Layer, Normaliser
    from archerfish.controllers.policy import PolicyController
    from archerfish.controllers.roster import make_controller
    from archerfish.dynamics.array_namespace import single_precision
    from archerfish.sensing.tracked_observation import tracked_observer

    bench = _bench(EvaluationTask(_setting(), "gate", 2, SEED), None)
    if name != "policy":
        return make_controller(name, bench)
    rng, period = np.random.default_rng(1), conditions.control_period_s
    noise = bench.noise._replace(acceleration=np.asarray(3.0))
    observer = tracked_observer(bench.muzzle, noise, period, (0.03, 0.1), np.array([0.04, 0.02]))
    sizes = (observer.size, 512, 256, 128, 2)
    layers = tuple(
        Layer(rng.standard_normal(pair) / np.sqrt(pair[0]), np.zeros(pair[1])) for pair in itertools.pairwise(sizes)
    )
    normaliser = Normaliser(np.zeros(sizes[0]), np.ones(sizes[0]), np.asarray(1.0))
    return single_precision(PolicyController(observer, normaliser, layers))


@contextmanager
def version(tree: Path) -> Iterator["subprocess.Popen[str]"]:
    """Start a process that shoots with the code of a working tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    arguments = [sys.executable, str(Path(__file__).resolve()), "--serve"]
    pipe = subprocess.PIPE
    with subprocess.Popen(arguments, env=environment, stdin=pipe, stdout=pipe, text=True) as process:
        yield process
        assert process.stdin
        process.stdin.close()


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Check out a commit in a worktree that is removed afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", "--quiet", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def shoot(process: "subprocess.Popen[str]", controller: str, engagements: int, place: Path) -> dict[str, float]:
    """Let a process shoot the table once; return what it answers."""
    assert process.stdin and process.stdout
    process.stdin.write(f"{controller} {engagements} {place}\n")
    process.stdin.flush()
    answer: dict[str, float] = json.loads(process.stdout.readline())
    return answer


def measure(commit: str, engagements: int, rounds: int) -> list[dict[str, Any]]:
    """Shoot with both versions in turn; return the figures of each controller."""
    found = []
    with (
        checked_out(commit) as tree,
        tempfile.TemporaryDirectory() as folder,
        version(tree) as before,
        version(ROOT) as now,
    ):
        places = [Path(folder) / f"{name}.npz" for name in ("before", "now")]
        for controller in CONTROLLERS:
            answers: list[list[dict[str, float]]] = [[], []]
            for _ in range(rounds):
                for each, place, kept in zip((before, now), places, answers, strict=True):
                    kept.append(shoot(each, controller, engagements, place))
            found.append(_figures(controller, answers, places))
    return found


def _figures(controller: str, answers: list[list[dict[str, float]]], places: list[Path]) -> dict[str, Any]:
    shots = int(answers[0][0]["shots"])
    before, now = (np.load(place) for place in places)
    apart = np.abs(before["miss"] - now["miss"]).max(axis=-1)
    return {
        "controller": controller,
        "shots": shots,
        "seconds_before": [round(each["seconds"], 3) for each in answers[0]],
        "seconds_now": [round(each["seconds"], 3) for each in answers[1]],
        "processor_before": [round(each["processor"], 3) for each in answers[0]],
        "processor_now": [round(each["processor"], 3) for each in answers[1]],
        "hits_before": int(before["hit"].sum()),
        "hits_now": int(now["hit"].sum()),
        "other_outcomes": int((before["hit"] != now["hit"]).sum()),
        "miss_apart_median_m": float(np.median(apart)),
        "miss_apart_by_more_than_0.1_mm": int((apart > 1e-4).sum()),
        "miss_apart_most_m": float(apart.max()),
    }


def with_whole(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add the whole table: all controllers together, round by round."""
    whole: dict[str, Any] = {"controller": "all"}
    for key in ("seconds_before", "seconds_now", "processor_before", "processor_now"):
        whole[key] = [round(sum(times), 3) for times in zip(*(row[key] for row in rows), strict=True)]
    for key in ("shots", "hits_before", "hits_now", "other_outcomes", "miss_apart_by_more_than_0.1_mm"):
        whole[key] = sum(row[key] for row in rows)
    whole["miss_apart_most_m"] = max(row["miss_apart_most_m"] for row in rows)
    for row in (*rows, whole):
        for kind in ("seconds", "processor"):
            pairs = zip(row[f"{kind}_before"], row[f"{kind}_now"], strict=True)
            ratios = [before / now for before, now in pairs]
            row[f"{kind}_ratio"] = [round(each, 2) for each in (statistics.median(ratios), min(ratios), max(ratios))]
        row["shots_per_s_before"], row["shots_per_s_now"] = (
            round(row["shots"] / statistics.median(row[f"seconds_{when}"])) for when in ("before", "now")
        )
    return [*rows, whole]


def print_rows(rows: list[dict[str, Any]]) -> None:
    """Print the table."""
    table = Table(title="shots per second on the virtual robot")
    for heading in ("controller", "before", "now", "ratio (least–most)", "by processor time", "other outcomes"):
        table.add_column(heading, justify="left" if heading == "controller" else "right")
    for row in rows:
        table.add_row(
            row["controller"],
            f"{row['shots_per_s_before']:,}",
            f"{row['shots_per_s_now']:,}",
            *("{} ({}–{})".format(*row[f"{kind}_ratio"]) for kind in ("seconds", "processor")),
            f"{row['other_outcomes']} of {row['shots']:,}",
        )
    Console(width=120).print(table)


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", nargs="?", default=BEFORE, help=f"to compare with (default: {BEFORE})")
    parser.add_argument("--engagements", type=int, default=ENGAGEMENTS, help=f"per cell (default: {ENGAGEMENTS})")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of each (default: {ROUNDS})")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        shoot_on_request()
        return
    from archerfish.records import storage
    from machine import describe_machine

    machine = describe_machine()
    rows = with_whole(measure(options.commit, options.engagements, options.rounds))
    print_rows(rows)
    if options.engagements >= ENGAGEMENTS and options.rounds >= ROUNDS:
        conditions = {
            "robot": "infantry",
            "tables": ["IV", "V"],
            "engagements_per_cell": options.engagements,
            "rounds": options.rounds,
            "seed": SEED,
            "before": options.commit,
            "processes": "one of each version, in turn",
            "load_average": [round(each, 2) for each in os.getloadavg()],
        }
        storage.write_json(RESULT, {"machine": machine, "conditions": conditions, "rows": rows})


if __name__ == "__main__":
    main()
