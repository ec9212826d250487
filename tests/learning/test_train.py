"""Trainings: their folders, how they end, and how they continue."""

import dataclasses
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import archerfish as af
from archerfish.arrays import leaves
from archerfish.learning import learner as learners
from archerfish.learning import run_folder, train
from archerfish.learning.config import GradientConfig, PpoConfig, TrainConfig
from archerfish.records.json_files import plain
from archerfish.reports import progress

pytest.importorskip("jax")
ROOT = Path(__file__).parents[2]
SMALL = {"environments": 32, "hidden": 16, "shards": 2}
GRADIENT = GradientConfig(**SMALL, window=5, steps=32 * 5 * 12)
PPO = PpoConfig(**SMALL, rollout=5, minibatches=2, epochs=1, steps=32 * 5 * 12)
CONFIG = TrainConfig(gradient=GRADIENT, ppo=PPO, checkpoint_every_s=0.0)
CODE = "import archerfish.cli.main as m, archerfish.learning.train as t\n{}m.program()"
SETTINGS = "checkpoint_every_s=0 gradient.environments=32 gradient.hidden=16 gradient.window=5"
WORDS = f"train --task paper --set {SETTINGS} --steps 1920 --out"


def weights(policy):
    return [each.tobytes() for each in leaves((policy.normaliser[:2], policy.actor))]


def start(words, before=""):
    command = [sys.executable, "-c", CODE.format(before), *words.split()]
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT / "src")}, **pipes)


def given(trainer):
    """Settings by trainer; "muon" is that of the gradient with this optimiser."""
    muon = CONFIG.replace(gradient=GRADIENT.replace(optimiser="muon"))
    return {"config": muon, "trainer": "gradient"} if trainer == "muon" else {"config": CONFIG, "trainer": trainer}


@pytest.fixture(scope="module")
def expected():
    """Weights of an unbroken training, by trainer."""
    found = {}

    def of(trainer):
        if trainer not in found:
            found[trainer] = weights(af.train(task="paper", **given(trainer)))
        return found[trainer]

    return of


@pytest.fixture
def begin(monkeypatch):
    """Leave an unfinished training, which is stopped after a number of compiled calls."""

    def run(out, calls=1, **given):
        whole, left = learners.Trainer.advance, iter(range(calls))

        def advance(*arguments):
            if next(left, None) is None:
                raise KeyboardInterrupt
            return whole(*arguments)

        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(learners.Trainer, "advance", advance)
            af.train(**{"task": "paper", "config": CONFIG, **given}, out=out)

    return run


@pytest.mark.parametrize("trainer", ["gradient", "muon", "ppo"])
def test_a_training_that_was_stopped_continues_to_the_same_weights(tmp_path, trainer, begin, expected):
    out = tmp_path / "out"
    begin(out, 2, **given(trainer))
    assert {each.name for each in out.iterdir()} >= {"run.json", "log.jsonl", "checkpoint.safetensors"}
    policy = af.resume(out)
    assert weights(policy) == expected(trainer) == weights(af.Policy.load(out))
    files = {"run.json", "run.lock", "log.jsonl", "curve.svg", "policy.safetensors"}
    assert {each.name for each in out.iterdir()} == files
    rows = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [row["iteration"] for row in rows] == list(range(1, 13))
    assert {"mean_reward", "hit_share", "gradient_norm"} <= rows[0].keys()
    assert ("value_error" in rows[0]) == (trainer == "ppo")


def test_nothing_is_given_beside_a_folder_that_its_training_would_ignore(tmp_path, begin, refused):
    begin(tmp_path, 0)
    complaint = "has no (motion|reward|block) .* of your own, and continues with its own settings"
    for name, given in {"task": "static", "reward": "hit", "blocks": ("./mine.py:clock",)}.items():
        refused(complaint, af.resume, tmp_path, **{name: given})


def test_what_a_callback_gets_is_the_log_and_what_it_raises_leaves_a_checkpoint(tmp_path, expected, refused):
    rows = []

    def stop_after_six(row):
        rows.append(row)
        if len(rows) == 6:
            raise ZeroDivisionError

    config = CONFIG.replace(checkpoint_every_s=1e6)
    with pytest.raises(ZeroDivisionError):
        af.train(task="paper", config=config, out=tmp_path, callback=stop_after_six)
    written = [json.loads(line) for line in (tmp_path / run_folder.LOG).read_text().splitlines()]
    assert rows == written[:6]
    assert len(written) == 8
    assert weights(af.resume(tmp_path, callback=rows.append)) == expected("gradient")
    assert [row["iteration"] for row in rows] == [1, 2, 3, 4, 5, 6, 9, 10, 11, 12]
    refused("callback: expected a function of a dictionary, got 'x'; give one", af.train, callback="x")


def test_settings_may_be_a_dictionary_and_a_policy_shows_itself_in_a_line(refused, expected):
    fields = {"gradient": plain(GRADIENT), "ppo": plain(PPO)}
    policy = af.train(task="paper", config=fields)
    assert weights(policy) == expected("gradient")
    said = r"observation history, task paper, seed 0, robot paper, [\d.]+% of the latest shots of its training hit"
    assert re.fullmatch(rf"Policy\({said}\)", repr(policy))
    refused("there is no field sed; fields are trainer, ", af.train, config={"sed": 1})
    refused("config: expected a TrainConfig or a dictionary, got a str", af.train, config="paper")


def test_a_training_that_continues_with_other_libraries_or_code_says_so(tmp_path, begin):
    begin(tmp_path)
    run = json.loads((tmp_path / "run.json").read_text())
    run["train"] |= {"commit": "0" * 40, "versions": run["train"]["versions"] | {"jax": "0.0.1"}}
    del run["train"]["config"]["gradient"]["optimiser"]  # as of versions that had Adam alone
    (tmp_path / "run.json").write_text(json.dumps(run))
    said = "continued with commit 0+ → .*, jax 0.0.1 → .*may not be those of an unbroken"
    with pytest.warns(UserWarning, match=said):
        policy = af.resume(tmp_path)
    (later,) = run_folder.read_run(tmp_path).resumed
    assert policy.facts.training["commits"] == ["0" * 40, policy.facts.commit]
    assert (later.commit, later.iterations) == (policy.facts.commit, 4)


def test_a_training_is_in_single_precision_whatever_jax_is_set_to(expected):
    import jax

    whole = expected("gradient")
    with jax.enable_x64(True):
        assert weights(af.train(task="paper", config=CONFIG)) == whole


def test_a_damaged_checkpoint_gives_way_to_the_one_before(tmp_path, begin, expected, refused):
    begin(tmp_path, 2)
    newest, before = tmp_path / run_folder.CHECKPOINT, tmp_path / run_folder.PREVIOUS
    content = bytearray(newest.read_bytes())
    content[-9] ^= 1
    newest.write_bytes(content)
    kept = before.read_bytes()
    before.write_bytes(kept[:1000])
    refused("no checkpoint is whole .*damaged.*begin the training again", af.resume, tmp_path)
    before.write_bytes(kept)
    with pytest.warns(UserWarning, match="damaged.*continuing from the checkpoint before"):
        assert weights(af.resume(tmp_path)) == expected("gradient")


def test_a_signal_checkpoints_and_ends_and_a_kill_loses_nothing(tmp_path, expected):
    out = tmp_path / "out"
    raised = "r = t._rows\nt._rows = lambda *a: (t.signal.raise_signal({}), r(*a))[1]\n"
    process = start(f"{WORDS} {out}", raised.format(int(signal.SIGTERM)))
    begun, *said = process.communicate(timeout=120)[1].splitlines()
    assert begun.startswith("training: 0 of ")
    assert said[-2:] == [f"continue with archerfish train --resume {out}", "archerfish: terminated"]
    assert process.returncode == 143
    assert (out / run_folder.CHECKPOINT).exists()
    process = start(f"train --resume {out}", raised.format(int(signal.SIGKILL)))
    process.communicate(timeout=120)
    assert process.returncode == -signal.SIGKILL
    assert weights(af.resume(out)) == expected("gradient")


def test_a_handler_that_returns_ends_no_training_as_finished(tmp_path, monkeypatch, expected, refused):
    rows, before = train._rows, signal.signal(signal.SIGTERM, lambda *_: None)
    monkeypatch.setattr(train, "_rows", lambda *given: (signal.raise_signal(signal.SIGTERM), rows(*given))[1])
    try:
        with pytest.raises(KeyboardInterrupt):
            af.train(task="paper", config=CONFIG, out=tmp_path)
    finally:
        signal.signal(signal.SIGTERM, before)
    monkeypatch.undo()
    begun = (tmp_path / "run.json").read_text()
    (tmp_path / "run.json").write_text(begun.replace('"devices": 2', '"devices": 7'))
    refused("begun on 7 devices, got .*device_count=7", af.resume, tmp_path)
    (tmp_path / "run.json").write_text(begun)
    assert weights(af.resume(tmp_path)) == expected("gradient")


def test_a_folder_has_one_writer_and_an_earlier_training_stays_until_the_end(tmp_path, begin, refused):
    out, before = tmp_path / "out", tmp_path / "out.before"
    first = af.train(task="paper", config=CONFIG, out=out)
    refused("has a finished training", af.resume, out)
    begin(out, seed=1)
    assert weights(af.Policy.load(before)) == weights(first)
    refused(f"has an unfinished training; continue it: --resume {out}, in", af.train, task="paper", out=out)
    with run_folder.resumed_run(out):
        refused("in use by another process", af.resume, out)
    assert weights(af.resume(out)) != weights(first)
    assert not before.exists()
    (out / "mine.txt").touch()
    refused("has files of something else, as mine.txt", af.train, task="paper", out=out)
    refused("has no training", af.resume, tmp_path / "none")


def test_a_disk_that_is_full_leaves_the_checkpoint_before(tmp_path, monkeypatch, refused, expected):
    written = run_folder.RunFolder.save

    def full(folder, learner):
        if len(folder.rows) > 4:
            monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        written(folder, learner)

    monkeypatch.setattr(run_folder.RunFolder, "save", full)
    refused("can't be written .No space left on device", af.train, task="paper", config=CONFIG, out=tmp_path)
    monkeypatch.undo()
    assert weights(af.resume(tmp_path)) == expected("gradient")


def test_a_window_is_no_longer_than_the_shortest_engagement(refused):
    task = af.Task.load("paper").replace(lengths_s=(0.2, 1.0))
    refused("window = 16 exceeds an engagement of 10", af.train, task=task)
    refused("rollout = 25 exceeds an engagement of 10", af.train, task=task, trainer="ppo")


def test_a_reward_of_a_users_own_is_checked_and_does_not_hold_the_folder(tmp_path, begin, monkeypatch, refused):
    (tmp_path / "mine.py").write_text(
        "def one(shot, command, seen): return 1.0\n"
        "def branch(shot, command, seen): return shot.margin if shot.margin[0] > 0 else -shot.margin\n"
        "def step(shot, command, seen): return 1.0 * (shot.margin >= 0.0)\n"
    )
    monkeypatch.chdir(tmp_path)
    complaints = {"one": "returns float of shape .., expected floats of shape", "branch": "line 2: Tracer.*xp.where",
                  "step": "has no gradient; smooth it, or take trainer ppo"}  # fmt: skip
    for name, complaint in complaints.items():
        refused(complaint, af.train, task="paper", config=CONFIG, reward=f"./mine.py:{name}", out="out")
    for name, wrong in (("seed", -1), ("seed", 2.0), ("steps", 0)):
        refused(f"^{name} must be a whole number of .*, got {wrong}", af.train, task="paper", **{name: wrong})
    begin("out", 0, trainer="ppo", reward="./mine.py:step")


def test_a_reward_that_was_edited_is_another_reward(tmp_path, begin, refused):
    file, given = tmp_path / "mine.py", []
    for number in (0.0, 1.0):
        file.write_text(f"def one(shot, command, seen): return {number} + 0.1 * shot.margin\n")
        environment = af.make_environment(task="paper", reward=f"{file}:one")
        zeros = [np.zeros((1, each), np.float32) for each in (environment.normals, environment.uniforms, 2)]
        fresh = environment.fresh(*zeros[:2])
        given.append(environment.step(fresh[0], zeros[2], zeros[0], fresh)[1].reward)
    assert given[1] == pytest.approx(given[0] + 1.0)
    begin(tmp_path / "out", 0, reward=f"{file}:one")
    (digest,) = run_folder.read_run(tmp_path / "out").code.values()
    assert digest == hashlib.sha256(file.read_bytes()).hexdigest()
    file.write_text(file.read_text() + "\n")
    refused("one has changed since the training was begun", af.resume, tmp_path / "out", reward=f"{file}:one")


def test_progress_is_shown_up_to_the_total(monkeypatch):
    begun, calls = [], []

    def bar(*given):
        begun.append(given)
        return nullcontext(lambda done, note: calls.append(done))

    monkeypatch.setattr(progress, "bar", bar)
    af.train(task="paper", config=CONFIG, steps=1800)  # rounded to whole iterations, in calls of four
    assert begun == [("training", 1920, "decisions", "compiling")]
    assert calls == [640, 1280, 1920]


def without_number(*given, **more):
    """Make an environment whose hits are worth NaN."""
    environment = af.make_environment(*given, **more)
    return dataclasses.replace(environment, reward=dataclasses.replace(environment.reward, hit=np.float32("nan")))


WILD = CONFIG.replace(ppo=PPO.replace(actor_learning_rate=1e6))
DIVERGING = [("ppo", WILD, af.make_environment, [*learners.WATCHED]), ("gradient", CONFIG, without_number, ["reward"])]


@pytest.mark.parametrize(("trainer", "config", "make", "first"), DIVERGING, ids=["rate", "reward"])
def test_a_training_that_diverges_keeps_a_learner(trainer, config, make, first, tmp_path, monkeypatch, refused):
    monkeypatch.setattr(train, "make_environment", make)
    complaint = r"diverged after \d+ decisions, in iteration \d+: \w+ not finite"
    refused(complaint, af.train, task="paper", config=config, trainer=trainer, out=tmp_path)
    assert json.loads((tmp_path / run_folder.FAULT).read_text())["first"] in first
    assert (tmp_path / run_folder.CHECKPOINT).exists()


@pytest.mark.slow
def test_code_of_a_users_own_is_given_again(tmp_path, begin, monkeypatch, refused):
    (tmp_path / "mine.py").write_text("def clock(observer, view): return view.memory.clock[..., None]\n")
    monkeypatch.chdir(tmp_path)
    begin("out", config=CONFIG.replace(observation=("history", "./mine.py:clock")))
    refused("has a block .*mine.py:clock of your own; give it again", af.resume, "out")
    policy = af.resume("out", blocks=("./mine.py:clock",))
    assert policy.observer.layout()[-1] == ("clock", 1)
    refused("blocks of a user's own", af.Policy.load, "out")
    loaded = af.Policy.load("out", blocks=("./mine.py:clock",))
    assert np.isfinite(af.rollout(loaded, task=af.Task.load("static"), engagements=4).in_force).all()


def test_a_robot_in_memory_of_which_a_part_is_not_usable_is_refused(refused):
    verdict = {"usable": False, "headline": "fit 40 %", "reasons": ("It explains 40 %.",), "next_step": "Record it"}
    robot = af.Robot.paper().replace(parts={"yaw": verdict})
    refused(r"paper: yaw: is not usable: It explains 40 %\.; Record it", af.train, robot, "paper", steps=1000)
