"""A training that has ended puts its results in the place of earlier ones, and is killed before every step of it.

Run as a script with a folder. Nothing here computes with JAX: a process that does must not fork.
"""

import shutil
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "learning"))

from killed_writer import killed_at

from archerfish.cli import training_run
from archerfish.cli.interrupts import StopRequests
from archerfish.cli.live_run import CONFIGURATION, LiveRun
from archerfish.cli.training_run import TrainingResult, write_run
from archerfish.cli.writer import Writer
from archerfish.learning.ppo import Metrics
from archerfish.learning.training import Curve
from archerfish.records import storage
from archerfish.records.policy import PolicyRecord, read_policy


def result(number: int) -> TrainingResult:
    """Return what a training leaves, all of whose numbers are one number."""
    policy = PolicyRecord(
        observation="paper",
        frames=0,
        weights=tuple(np.full(size, number, np.float32) for size in ((6, 4), (4, 2))),
        biases=tuple(np.full(size, number, np.float32) for size in (4, 2)),
        mean=np.zeros(6, np.float32),
        variance=np.ones(6, np.float32),
        action_scale=np.full(2, 0.1, np.float32),
        braking=np.full(2, 0.03, np.float32),
        muzzle={"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0},
        period_s=0.02,
        command_limit="gate",
        training={"seed": number},
    )
    metrics = Metrics(*(np.full(3, 0.0, np.float32) for _ in Metrics._fields))
    curve = Curve(np.arange(1, 4) * 32, np.zeros(3, np.float32), metrics)
    return TrainingResult(policy, {"a": np.full(9, number, np.float32)}, curve, np.zeros(3), 0.0, "")


def publish(out: Path, number: int) -> None:
    """Do what `archerfish train` does when a training has ended."""
    run = LiveRun(out, StopRequests(), 1.0, 32, tensorboard=False)
    write_run(run.results, result(number), {"number": number})
    run.publish(Writer("train"))


def check(out: Path) -> int:
    """Return the number of the run that is there, every record of which must be whole."""
    policy = read_policy(out / "policy.json")
    assert policy.weights[0][0, 0] == policy.training["seed"]
    facts, arrays = storage.read_record(out / "checkpoint.json", "archerfish.checkpoint/1")
    assert facts["configuration"]["number"] == arrays["['a']"][0]
    return int(policy.training["seed"])


def survive(folder: Path) -> int:
    """Kill at every step; what is there can be read, and what is unfinished can be finished."""
    training_run.save_figure = lambda path, _: storage.write_text(path, "figure")  # drawing takes long
    step = 0
    while True:
        step += 1
        out = folder / f"run{step}"
        for number, name in ((1, "events.old"), (2, "events.new")):
            storage.write_text(out / "unfinished" / "tensorboard" / name, "events")
            storage.write_json(out / "unfinished" / CONFIGURATION, {"number": number})
            if number == 1:
                publish(out, 1)
        was_killed = killed_at(step, lambda out=out: publish(out, 2))
        found = check(out)
        if (out / "unfinished" / CONFIGURATION).exists():
            assert was_killed
            publish(out, 2)
        else:
            # Over: whatever is left of the folder, the results are in place.
            assert found == 2
            shutil.rmtree(out / "unfinished", ignore_errors=True)
        assert check(out) == 2
        assert (out / "log.jsonl").read_text().count("\n") == 3
        assert [path.name for path in (out / "tensorboard").iterdir()] == ["events.new"]
        if not was_killed:
            return step


if __name__ == "__main__":
    print(survive(Path(sys.argv[1])))  # noqa: T201
