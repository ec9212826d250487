"""A whole training: iterations in compiled calls, watched, stored and stopped between them."""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from archerfish2.arrays import map_arrays
from archerfish2.compiled import import_jax
from archerfish2.controllers.policy.observation import observer_facts
from archerfish2.controllers.policy.policy import Policy, PolicyFacts
from archerfish2.errors import InputError
from archerfish2.learning.config import TrainConfig
from archerfish2.learning.environment import make_environment
from archerfish2.learning.run_folder import Begun, RunFolder, new_run, resumed_run
from archerfish2.plugins import Plugin, find_plugin, names_code
from archerfish2.provenance import code_commit, library_versions
from archerfish2.records.json_files import plain
from archerfish2.reports import progress
from archerfish2.robot import Robot
from archerfish2.task import DRAWN, EQ_7, Task

CHUNK = 4
"""Iterations per compiled call; between calls there are checkpoints, and a training can be stopped."""
_LOOK = "look at the robot's records and the motion, and at a reward and blocks of your own"
_REMEDIES = {"observation": _LOOK, "reward": _LOOK, "action": "lower the learning rates or log_std"}


def train(
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
    *,
    config: TrainConfig | None = None,
    trainer: Literal["gradient", "ppo"] | None = None,
    seed: int | None = None,
    steps: int | None = None,
    out: str | Path | None = None,
    resume: str | Path | None = None,
    reward: Any = None,
) -> Policy:
    """Train a policy; the same seed gives the same weights, bit for bit, on the same machine and versions.

    In the main thread, Ctrl-C and SIGTERM write a checkpoint, then end the training; a second one ends it at once.

    Args:
      robot: a robot or its folder; the paper's if not given.
      task: a task, its name or its file.
      config: settings; what it leaves open follows robot and task.
      trainer: "gradient" or "ppo", in the place of the settings'.
      seed: of everything random; 0 if not given.
      steps: decisions to train for, in the place of the settings'.
      out: folder for the policy and everything about its training; nothing is written if not given.
      resume: folder of an unfinished training to continue. Nothing else is given then, but code of a user's own again,
        which only a file names: as task, as reward, and as `TrainConfig(observation=…)` in config.
      reward: "eq-8", "hit", "smooth-hit", or one of a user's own, a name as `find_plugin` takes it or the function.

    Raises:
      InputError: if something can't be used, the folder is in use or has something else, or the training diverges.
    """
    jax = import_jax()
    from archerfish2.learning import shards

    with jax.enable_x64(False), ExitStack() as stack:
        folder = stack.enter_context(resumed_run(Path(resume))) if resume is not None else None
        if folder is None:
            begun = _begin(robot, task, with_given(config or TrainConfig(), trainer, steps, reward), seed)
        else:
            begun, others = folder.begun, {"robot": robot, "trainer": trainer, "seed": seed, "steps": steps, "out": out}
            _check_given(folder, task, with_given(config or TrainConfig(), None, None, reward), others)
        own, devices = _own(begun, reward), shards.claim_devices(begun.config.settings.shards)
        code = {name: plugin.digest for name, plugin in own.items()}
        if folder is None:
            begun = begun.replace(devices=devices, code=code)
        elif changed := [name for name, digest in code.items() if digest != begun.code[name] or not digest]:
            remedy = "put it back, or begin another training"
            raise InputError(f"{changed[0]} has changed since the training was begun, or has no source; {remedy}")
        elif devices != begun.devices:
            flag = f"XLA_FLAGS=--xla_force_host_platform_device_count={begun.devices}"
            raise InputError(f"begun on {begun.devices} devices, got {devices}; in a new process set {flag}")
        # The code whose digest that is.
        given = own[f"reward {begun.config.reward}"].value if names_code(begun.config.reward) else None
        environment = make_environment(begun.robot, begun.task, begun.config, given)
        if out is not None:
            folder = stack.enter_context(new_run(Path(out), begun))
        learner, rows = _run(jax, environment, begun, folder)
        policy = _policy(environment, learner, folder.begun if folder else begun, rows)
        if folder is not None:
            folder.finish(policy)
    return policy


def with_given(config: TrainConfig, trainer: Any, steps: int | None, reward: Any) -> TrainConfig:
    """Return settings with what is given beside them, as to `train`, in their place."""
    config = config.replace(trainer=trainer) if trainer else config
    if reward is not None:
        config = config.replace(reward=reward if isinstance(reward, str) else find_plugin(reward, "reward").spec)
    if steps is not None:
        _check_number("steps", steps, 1)
        config = config.replace(gradient=config.gradient.replace(steps=steps), ppo=config.ppo.replace(steps=steps))
    return config


def _check_number(name: str, number: Any, least: int) -> None:
    if not (isinstance(number, int) and least <= number <= 2**53):
        raise InputError(f"{name} must be a whole number of {least} to 2^53, got {number!r}; give another one")


def _begin(robot: Any, task: Any, config: TrainConfig, seed: int | None) -> Begun:
    """Return a new training."""
    robot = Robot.of(robot)
    if robot.folder is None:  # that of a folder was checked, or accepted, when it was loaded
        robot.check_usable()
    task = Task.of(task)
    config, seed = config.resolved(robot, task), 0 if seed is None else seed
    _check_number("seed", seed, 0)
    # In single precision, as the simulator counts them.
    settings, shortest = config.settings, round(float(np.float32(min(task.lengths)) / np.float32(task.period_s)))
    if settings.decisions > shortest:  # what replaces the engagements that end is drawn once between two updates
        raise InputError(f"{settings.part} = {settings.decisions} exceeds an engagement of {shortest}; lower it")
    versions = library_versions()
    return Begun(robot=robot, task=task, config=config, seed=seed, commit=code_commit(), versions=versions)


def _own(begun: Begun, reward: Any) -> dict[str, Plugin]:
    """Return a user's own code by kind and name: the blocks of the observation, the motion, the reward."""
    task, config = begun.task, begun.config
    own = {f"block {name}": find_plugin(name, "block") for name in config.names[1:]}
    if task.motion not in (*EQ_7, *DRAWN):
        own[f"motion {task.motion}"] = find_plugin(task.motion, "motion")
    if names_code(config.reward):
        own[f"reward {config.reward}"] = find_plugin(reward or config.reward, "reward")
    return own


def _check_given(folder: RunFolder, task: Any, config: TrainConfig, others: dict[str, Any]) -> None:
    """Refuse what a training that continues would ignore, and that a user's own code is missing: no file runs any."""
    begun, motion = folder.begun, task.motion if isinstance(task, Task) else str(task)
    named = {f"block {name}" for name in config.names[1:]} | {f"motion {motion}", f"reward {config.reward}"}
    usual = TrainConfig(observation=config.observation and begun.config.observation)
    ignored = [name for name, value in others.items() if value is not None]
    ignored += ["task"] * (task not in ("any", begun.task, begun.task.motion))
    ignored += ["reward"] * (config.reward not in ("auto", begun.config.reward))
    ignored += ["config"] * (plain(config.replace(reward="auto")) != plain(usual))
    if missing := sorted(begun.code.keys() - named):
        raise InputError(f"this training has a {missing[0]} of your own; give it again, as the training was begun")
    if ignored:
        remedy = f"leave {', '.join(ignored)} out, or begin another training"
        raise InputError(f"{folder.path}: is continued with the training's own settings; {remedy}")


def _run(jax: Any, environment: Any, begun: Begun, folder: RunFolder | None) -> tuple[Any, list[dict[str, Any]]]:
    """Return the learner at the end, and a row of metrics per iteration."""
    from archerfish2.learning import learner, shards
    from archerfish2.learning.gradient import GRADIENT
    from archerfish2.learning.ppo import PPO

    config, trainer = begun.config.settings, PPO if begun.config.trainer == "ppo" else GRADIENT
    environment = jax.tree.map(jax.numpy.asarray, environment)
    state = trainer.begin(environment, config, jax.random.key(begun.seed))
    rows: list[dict[str, Any]] = []
    if folder is not None:
        state, rows = folder.restore(state), folder.rows
    state = shards.placed(state, config.shards, learner.SPLIT)
    total, stored = -(-config.iterations // CHUNK) * CHUNK, time.monotonic()
    with progress.bar("training", total * config.batch, "decisions") as advance, _stop_requests() as stop:
        while len(rows) < total:
            state, metrics = trainer.advance(environment, config, state, CHUNK)
            new, fault = _rows({name: np.asarray(each) for name, each in metrics.items()}, len(rows), config.batch)
            if folder is None:
                rows += new
            else:
                folder.log(new)
            if rows:
                advance(len(rows) * config.batch, f"{rows[-1]['hit_share']:.1%} hit")
            if not any(row.get("gradient_norm", 1.0) for row in new) and not fault:
                raise InputError(f"{begun.config.reward}: this reward has no gradient; smooth it, or take trainer ppo")
            if fault:
                raise _diverged(fault, len(rows), config.batch, folder, state)
            due = stop or time.monotonic() - stored >= begun.config.checkpoint_every_s
            if folder is not None and due and len(rows) < total:
                folder.save(state)
                stored = time.monotonic()
            if stop:
                break
    if stop:  # once more, to whoever handled it before
        print(f"continue with --resume {folder.path}" if folder else "nothing is kept", file=sys.stderr)  # noqa: T201
        signal.raise_signal(stop[0])
        raise KeyboardInterrupt  # where that one returned
    return state, rows


def _rows(metrics: dict[str, Any], done: int, batch: int) -> tuple[list[dict[str, Any]], str]:
    """Return a row per good iteration, and what was first bad, "" if nothing was."""
    from archerfish2.learning.learner import WATCHED

    bad = ~(metrics.pop("watched") <= np.array(list(WATCHED.values())))
    good = int(np.argmax(bad.any(axis=1))) if bad.any() else len(bad)
    rows = [
        {"iteration": done + i + 1, "decisions": (done + i + 1) * batch, **{n: float(a[i]) for n, a in metrics.items()}}
        for i in range(good)
    ]
    return rows, list(WATCHED)[int(np.argmax(bad[good]))] if good < len(bad) else ""


def _diverged(first: str, done: int, batch: int, folder: RunFolder | None, learner: Any) -> InputError:
    where = ""
    if folder is not None:
        folder.diverged(learner, {"iteration": done + 1, "first": first})
        where = f"; {folder.path} has the last good checkpoint"
    return InputError(
        f"training diverged after {done * batch} decisions, in iteration {done + 1}: {first} not finite, or growing "
        f"beyond all bounds; {_REMEDIES.get(first, 'lower the learning rates')}{where}"
    )


@contextmanager
def _stop_requests() -> Iterator[list[int]]:
    """Yield a list that gets the number of a signal that asks to stop; a second one is handled as it was before."""
    found: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield found
        return
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}

    def stop(number: int, _: Any) -> None:
        found.append(number)
        restore()

    def restore() -> None:
        for each, handler in before.items():
            signal.signal(each, handler)

    try:
        for each, handler in before.items():
            if handler not in (signal.SIG_IGN, None):
                signal.signal(each, stop)
        yield found
    finally:
        restore()


def _policy(environment: Any, learner: Any, begun: Begun, rows: list[dict[str, Any]]) -> Policy:
    """Return the policy of a learner, in NumPy: its mean action."""
    layers, seen = learner.actor.layers, learner.actor.layers[0].weight.shape[0]
    config, task = begun.config, begun.task
    commits = [begun.commit, *(resumed.commit for resumed in begun.resumed)]
    facts = PolicyFacts(
        observer=observer_facts(config.names, begun.robot, task, config.frames),
        task=task,
        robot=begun.robot.record_digests(),
        seed=begun.seed,
        commit=commits[-1],
        training={"config": plain(config), "commits": commits, **(rows[-1] if rows else {})},
    )
    normaliser = learner.normaliser._replace(
        mean=learner.normaliser.mean[:seen], variance=learner.normaliser.variance[:seen]
    )
    normaliser, layers = map_arrays(np.asarray, (normaliser, layers))
    return Policy(environment.observer, normaliser, layers, facts=facts)
