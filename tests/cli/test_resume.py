"""A training that is killed, stopped or fails goes on to the weights of one that was not."""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.learning.checkpoint_folder import checkpoint_files
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import write_plant
from archerfish.records.policy import read_policy

jax = pytest.importorskip("jax")

TINY = "--target paper --ppo.environments 8 --ppo.rollout 4 --ppo.minibatches 2 --ppo.epochs 2 --ppo.hidden 4"
TINY += " --observation paper --seed 3 --no-tensorboard"
ITERATIONS = 600
LONG = f"{TINY} --ppo.steps {ITERATIONS * 32} --checkpoint-every 0.05"
PATIENCE_S = 120.0
PROGRAM = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from archerfish.cli.main import program
program()
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of compiled programs for all processes of this module."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def begun(tmp_path: Path, cache: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Begin `archerfish train` in the temporary folder."""
    processes = []
    others = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}

    def begin(words: str, kept: str | Path = cache, before: str = "") -> subprocess.Popen[str]:
        processes.append(
            subprocess.Popen(
                [sys.executable, "-c", before + PROGRAM, "train", *words.split()],
                cwd=tmp_path,
                env={**others, "ARCHERFISH_CACHE": str(kept), "COLUMNS": "80"},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return processes[-1]

    yield begin
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        process.communicate()


def finished(process: subprocess.Popen[str]) -> list[str]:
    """Wait for the end of a process, and return what it told on standard error besides its progress."""
    _, err = process.communicate(timeout=PATIENCE_S)
    # A bar that has hardly begun is blank where there are no colours.
    return [line for line in err.splitlines() if line.strip() and not line.startswith("training ")]


def logged(folder: Path) -> int:
    """Return the iterations that the log of a training in progress has."""
    path = folder / "unfinished" / "log.jsonl"
    return path.read_bytes().count(b"\n") if path.is_file() else 0


def wait_until(process: subprocess.Popen[str], reached: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not reached():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.002)


def weights(folder: Path) -> list[np.ndarray]:
    policy = read_policy(folder / "policy.json")
    return [*policy.weights, *policy.biases, policy.mean, policy.variance]


def assert_same_run(ours: Path, theirs: Path) -> None:
    for a, b in zip(weights(ours), weights(theirs), strict=True):
        np.testing.assert_array_equal(a, b)
    facts = [json.loads((each / "checkpoint.json").read_text())["arrays_sha256"] for each in (ours, theirs)]
    assert facts[0] == facts[1]
    assert (ours / "log.jsonl").read_bytes() == (theirs / "log.jsonl").read_bytes()
    assert not (ours / "unfinished").exists()


def test_a_training_that_is_killed_again_and_again_ends_with_the_same_weights(begun, tmp_path):
    unbroken = begun(f"{LONG} --out unbroken")
    assert finished(unbroken) == []
    assert unbroken.returncode == 0
    moments = random.Random(1)
    process = begun(f"{LONG} --out broken")
    for share in (0.05, 0.4, 0.75):
        goal = int(ITERATIONS * (share + 0.1 * moments.random()))
        wait_until(process, lambda goal=goal: logged(tmp_path / "broken") >= goal)
        process.kill()
        process.wait()
        assert len(checkpoint_files(tmp_path / "broken" / "unfinished" / "checkpoints")) <= 3
        process = begun("--resume broken")
    assert finished(process) == []
    assert process.returncode == 0
    assert_same_run(tmp_path / "broken", tmp_path / "unbroken")


@pytest.mark.parametrize(
    ("number", "status", "word"), [(signal.SIGTERM, 143, "terminated"), (signal.SIGINT, 130, "interrupted")]
)
def test_a_signal_writes_a_checkpoint_and_says_how_to_go_on(begun, tmp_path, number, status, word):
    process = begun(f"{TINY} --ppo.steps 3200000 --checkpoint-every 1000 --out runs/x")
    wait_until(process, lambda: logged(tmp_path / "runs" / "x") >= 40)
    # One writer at a time, and only as long as it lives.
    second = begun("--resume runs/x")
    assert "is writing this run; wait for it" in finished(second)[0]
    assert second.returncode == 2
    process.send_signal(number)
    assert finished(process) == [f"archerfish: {word}; archerfish train --resume runs/x goes on with it"]
    assert process.returncode == status
    (last,) = checkpoint_files(tmp_path / "runs" / "x" / "unfinished" / "checkpoints")
    assert int(last.stem) == logged(tmp_path / "runs" / "x")


def test_a_signal_after_the_last_iteration_is_not_lost(command, tmp_path, monkeypatch):
    def results(*_: Any) -> None:
        signal.raise_signal(signal.SIGTERM)
        raise AssertionError("the signal was lost")

    monkeypatch.setattr("archerfish.cli.training_run._result", results)
    status, _, err = command("train", *SHORT.split(), "--out", "run")
    assert status == 143
    assert "archerfish: terminated; archerfish train --resume run goes on with it" in err


def test_a_full_disk_stops_in_one_line_and_keeps_what_there_was(begun, tmp_path):
    # The log outgrows the limit; compiled programs would, too, and JAX warn of them.
    no_large_files = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))"
    words = f"{TINY} --ppo.steps 3200000 --checkpoint-every 0 --out full"
    process = begun(words, kept="off", before=no_large_files)
    (told,) = finished(process)
    assert process.returncode == 2
    assert "can't be written (File too large)" in told
    assert told.endswith("archerfish train --resume full goes on with it")
    assert len(checkpoint_files(tmp_path / "full" / "unfinished" / "checkpoints")) == 2


SHORT = f"{TINY} --ppo.steps 256 --checkpoint-every 0"


@pytest.fixture
def stopped(command, tmp_path, monkeypatch) -> Callable[..., None]:
    """Train in this process, until a number of iterations is done and a fault ends it."""

    def stop(words: str, after: int, fault: BaseException) -> None:
        from archerfish.cli.live_run import LiveRun

        real = LiveRun.watch

        def watch(self: LiveRun, standing: Any) -> None:
            real(self, standing)
            if standing.iterations == after:
                raise fault

        with monkeypatch.context() as patched:
            patched.setattr(LiveRun, "watch", watch)
            with contextlib.suppress(RuntimeError):
                command("train", *words.split())

    return stop


def test_an_unfinished_run_is_named_and_contradictions_are_refused(command, refused, stopped, tmp_path):
    stopped(f"{SHORT} --out runs/x", 4, RuntimeError("crash"))
    assert (tmp_path / "runs" / "x" / "unfinished" / "config.json").exists()
    told = refused("train", *SHORT.split(), "--out", "runs/x")
    assert "holds an unfinished run, of 4 iterations so far; archerfish train --resume runs/x goes on with it" in told
    for words, option in (
        ("--seed 4", "--seed 4 contradicts runs/x, which was begun with 3"),
        ("--ppo.clip 0.3", "--ppo.clip 0.3 contradicts"),
        ("--observation history", "--observation history contradicts"),
        ("--out other", "--out other contradicts"),
        ("--robot other", "--robot other contradicts"),
        ("--accept-unusable", "--accept-unusable True contradicts"),
    ):
        assert option in refused("train", "--resume", "runs/x", *words.split())
    status, _, _ = command("train", "--resume", "runs/x", "--seed", "3", "--json", "told.json")
    assert status == 0
    command("train", *SHORT.split(), "--out", "unbroken")
    assert_same_run(tmp_path / "runs" / "x", tmp_path / "unbroken")
    assert json.loads((tmp_path / "told.json").read_text())["steps"] == 256
    assert "holds a training that is finished" in refused("train", "--resume", "runs/x")
    assert "holds no unfinished run" in refused("train", "--resume", "runs/none")


def test_an_earlier_run_survives_a_failed_new_one_until_it_is_resumed(command, stopped, tmp_path):
    command("train", *SHORT.split(), "--out", "run")
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir() if path.is_file()}
    other = SHORT.replace("--seed 3", "--seed 5")
    stopped(f"{other} --out run", 4, RuntimeError("crash"))
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir() if path.is_file()} == before
    assert command("train", "--resume", "run")[0] == 0
    assert read_policy(tmp_path / "run" / "policy.json").training["seed"] == 5


def test_a_resumed_run_reads_the_records_that_it_began_with(command, stopped, tmp_path):
    robot = "--robot sentry --pitch pitch.json --yaw yaw.json"
    for axis, plant in printed_plants().items():
        write_plant(tmp_path / f"{axis}.json", plant)
    command("train", *f"{SHORT} {robot} --out unbroken".split())
    stopped(f"{SHORT} {robot} --out run", 4, RuntimeError("crash"))
    for path in tmp_path.glob("*.*"):
        path.unlink()
    assert command("train", "--resume", "run")[0] == 0
    assert_same_run(tmp_path / "run", tmp_path / "unbroken")


MOTION = """
from typing import Any, NamedTuple
from archerfish.dynamics.array_namespace import namespace

class Still(NamedTuple):
    place: Any
    @classmethod
    def draw(cls, place, speed, chance): return cls(place)
    def position(self, time): return self.place + 0.0 * time[..., None]
"""


def test_a_motion_whose_file_has_changed_is_refused_until_it_is_put_back(command, refused, stopped, tmp_path):
    motion = tmp_path / "own.py"
    motion.write_text(MOTION)
    stopped(f"{SHORT} --motion ./own.py:Still --out run", 4, RuntimeError("crash"))
    message = refused("train", *SHORT.split(), "--motion", "./own.py:Still", "--out", "run")
    assert "; archerfish train --resume run --motion ./own.py:Still goes on with it" in message
    motion.write_text(MOTION.replace("0.0 * time", "0.1 * time"))
    told = refused("train", "--resume", "run", "--motion", "./own.py:Still")
    assert "own.py: has changed since run was begun with --motion ./own.py:Still; put the file back as it was" in told
    motion.write_text(MOTION)
    assert command("train", "--resume", "run", "--motion", "./own.py:Still")[0] == 0
    command("train", *SHORT.split(), "--motion", "./own.py:Still", "--out", "unbroken")
    assert_same_run(tmp_path / "run", tmp_path / "unbroken")


def test_a_damaged_last_checkpoint_is_told_in_one_line_and_costs_nothing_but_time(command, stopped, tmp_path):
    command("train", *SHORT.split(), "--out", "unbroken")
    stopped(f"{SHORT} --ppo.steps 256 --out run", 8, RuntimeError("crash"))
    last = checkpoint_files(tmp_path / "run" / "unfinished" / "checkpoints")[-1].with_suffix(".safetensors")
    last.write_bytes(last.read_bytes()[:-1])
    status, _, err = command("train", "--resume", "run")
    told = [line for line in err.splitlines() if "━" not in line and line.strip()]
    assert status == 0
    assert len(told) == 1
    assert told[0].startswith("archerfish: run/unfinished/checkpoints/000000008.safetensors")
    assert told[0].endswith("goes on from iteration 4 instead")
    assert_same_run(tmp_path / "run", tmp_path / "unbroken")


def test_a_damaged_configuration_is_named_with_its_field(command, refused, stopped, tmp_path):
    stopped(f"{SHORT} --out run", 4, RuntimeError("crash"))
    path = tmp_path / "run" / "unfinished" / "config.json"
    whole = json.loads(path.read_text())
    for damage, told in (
        ([], "is list, expected an object"),
        (whole | {"frames": "4"}, "\"frames\" is '4', expected a whole number"),
        (whole | {"frames": True}, '"frames" is True, expected a whole number'),
        (whole | {"trainer": "none"}, "\"trainer\" is 'none', expected one of ppo, gradient"),
        (whole | {"ppo": whole["ppo"] | {"clip": "x"}}, "\"ppo.clip\" is 'x', expected a number"),
        (whole | {"ppo": whole["ppo"] | {"clip": -1}}, '"ppo": clip must be finite and > 0, got -1'),
        (whole | {"ppo": 3}, '"ppo" is 3, expected an object'),
        (whole | {"setting": None}, '"setting" is None, expected an object'),
        ({name: each for name, each in whole.items() if name != "provenance"}, 'field "provenance" is None'),
        (whole | {"provenance": {"versions": []}}, 'field "versions" is [], expected dict'),
        (whole | {"provenance": {"versions": {}}}, 'field "commit" is None, expected str'),
    ):
        path.write_text(json.dumps(damage))
        assert f"run/unfinished/config.json: {told}" in refused("train", "--resume", "run")


def test_a_changed_configuration_is_refused(command, stopped, tmp_path):
    stopped(f"{SHORT} --out run", 4, RuntimeError("crash"))
    path = tmp_path / "run" / "unfinished" / "config.json"
    path.write_text(path.read_text().replace('"discount": 0.95', '"discount": 0.9'))
    status, _, err = command("train", "--resume", "run")
    assert status == 2
    assert "config.json: is not that of 000000004.json" in err


@pytest.mark.parametrize("harm", ["observation", "reward"])
def test_a_divergence_leaves_a_policy_and_what_reproduces_it(command, tmp_path, monkeypatch, harm):
    from archerfish.simulation import assembly

    command("train", *SHORT.split(), "--out", "run")
    before = (tmp_path / "run" / "policy.json").read_bytes()

    class Spoilt(assembly.ShootingEnvironment):
        def step(self, state, action, normals, uniforms):
            following, outcome = super().step(state, action, normals, uniforms)
            # Of another seed there is a moment at which the first engagement's clock is at 7 for the first time.
            bad = jax.numpy.where((following.step[0] == 7) & (following.step[1] > 7), jax.numpy.nan, 0.0)
            return following, outcome._replace(**{harm: getattr(outcome, harm) + bad})

    monkeypatch.setattr(assembly, "ShootingEnvironment", Spoilt)
    status, _, err = command("train", *SHORT.split(), "--out", "run")
    assert status == 2
    assert "run/diverged holds the policy of before, and what reproduces it" in err
    assert (tmp_path / "run" / "policy.json").read_bytes() == before
    assert not (tmp_path / "run" / "unfinished").exists()
    fault = json.loads((tmp_path / "run" / "diverged" / "fault.json").read_text())
    assert fault["first_not_finite"] == harm
    assert f"in iteration {fault['iteration']}: {harm}" in err
    (last,) = checkpoint_files(tmp_path / "run" / "diverged" / "checkpoints")
    assert int(last.stem) == fault["iteration"] - 1
    assert all(np.all(np.isfinite(each)) for each in weights(tmp_path / "run" / "diverged"))


def test_results_that_are_put_in_place_are_readable_wherever_the_process_is_killed(tmp_path):
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("killed_publisher.py"), tmp_path],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src")},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 30


def test_training_ends_early_at_a_certain_hit_rate_resumed_or_not(command, stopped, tmp_path):
    words = f"{TINY} --ppo.steps 1600 --stop-at-hit-rate 0.01"
    assert command("train", *words.split(), "--out", "run", "--json", "told.json")[0] == 0
    assert json.loads((tmp_path / "told.json").read_text())["steps"] == 20 * 32
    stopped(f"{words} --checkpoint-every 0 --out broken", 8, RuntimeError("crash"))
    assert command("train", "--resume", "broken")[0] == 0
    assert_same_run(tmp_path / "broken", tmp_path / "run")


def test_event_files_stand_in_the_run_folder(command, tmp_path):
    pytest.importorskip("tensorboardX")
    words = SHORT.replace(" --no-tensorboard", "")
    assert command("train", *words.split(), "--out", "run")[0] == 0
    (events,) = (tmp_path / "run" / "tensorboard").glob("events.out.tfevents.*")
    assert b"mean_reward" in events.read_bytes()
    assert command("train", *words.split(), "--out", "run")[0] == 0
    assert len(list((tmp_path / "run" / "tensorboard").glob("events.out.tfevents.*"))) == 1
    # Files of others are neither removed nor mixed with.
    other = tmp_path / "run" / "tensorboard" / "events.out.tfevents.1700000000.host.0"
    other.write_text("of another program")
    status, _, err = command("train", *words.split(), "--out", "run")
    assert status == 2
    assert "run/tensorboard: holds files that no training left there, such as events.out.tfevents.1700000000" in err
    assert len(list((tmp_path / "run" / "tensorboard").iterdir())) == 2
    assert command("train", *words.split(), "--out", "run", "--overwrite")[0] == 0
    assert not other.exists()


def test_what_others_put_into_the_folder_of_a_training_in_progress_stays(command, stopped, tmp_path):
    stopped(f"{SHORT} --out run", 4, RuntimeError("crash"))
    (tmp_path / "run" / "unfinished" / "notes.txt").write_text("mine")
    assert command("train", "--resume", "run")[0] == 0
    assert [path.name for path in (tmp_path / "run" / "unfinished").iterdir()] == ["notes.txt"]


def test_json_is_not_put_where_a_resumed_training_is_in_progress(command, stopped, tmp_path):
    stopped(f"{SHORT} --out run", 4, RuntimeError("crash"))
    for name in ("unfinished/facts.json", "unfinished"):
        status, _, err = command("train", "--resume", "run", "--json", f"run/{name}")
        assert status == 2
        assert "is written by this command anyway" in err or "names a folder" in err
