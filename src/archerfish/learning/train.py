"""A whole training: iterations in compiled calls, watched, stored and stopped between them."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Literal

import numpy as np

from archerfish.arrays import map_arrays
from archerfish.compiled import import_jax
from archerfish.controllers.policy.observation import observer_facts
from archerfish.controllers.policy.observer import Observer
from archerfish.controllers.policy.policy import Policy, PolicyFacts
from archerfish.errors import InputError, checked_arguments
from archerfish.learning.config import CHUNK, ConfigLike, TrainConfig
from archerfish.learning.environment import make_environment
from archerfish.learning.reward import RewardFunction
from archerfish.learning.run_folder import Begun, RunFolder, new_run, resumed_run
from archerfish.plugins import find_plugin, names_code, registered_name
from archerfish.provenance import code_commit, library_versions
from archerfish.records.json_files import plain
from archerfish.reports import progress
from archerfish.robot import Robot, RobotLike
from archerfish.task import DRAWN, EQ_7, Task, TaskLike

Callback = Callable[[dict[str, Any]], None]
"""What a training calls after each iteration; see `train`."""
_LOOK = "look at the robot's records and the motion, and at a reward and blocks of your own"
_REMEDIES = {"observation": _LOOK, "reward": _LOOK, "action": "lower the learning rates or log_std"}


def train(
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    config: ConfigLike = None,
    trainer: Literal["gradient", "ppo"] | None = None,
    seed: int = 0,
    steps: int | None = None,
    out: str | Path | None = None,
    reward: str | RewardFunction | None = None,
    callback: Callback | None = None,
) -> Policy:
    """Train a policy; the same seed gives the same weights, bit for bit, on the same machine and versions.

    In the main thread, Ctrl-C and SIGTERM write a checkpoint, then end the training; a second one ends it at once.

    Args:
      robot: a robot or its folder; the paper's if not given.
      task: a task, its name or its file.
      config: settings, also as a dictionary; what it leaves open follows robot and task.
      trainer: "gradient" or "ppo", in the place of the settings'.
      seed: of everything random.
      steps: decisions to train for, in the place of the settings'.
      out: folder for the policy and everything about its training; nothing is written if not given.
      reward: "eq-8", "hit", "smooth-hit", or one of a user's own, a name as `find_plugin` takes it or the function.
      callback: gets a dictionary for each iteration, which is its line in log.jsonl: "iteration", "decisions",
        "mean_reward", "hit_share" and others. What it raises ends the training, after a checkpoint.

    Raises:
      InputError: if something can't be used, the folder is in use or has something else, or the training diverges.
    """
    with import_jax().enable_x64(False):
        from archerfish.learning.shards import claim_devices

        _check_callback(callback)
        begun = _begin(robot, task, with_given(TrainConfig.of(config), trainer, steps, reward), seed)
        begun = begun.replace(devices=claim_devices(begun.config.settings.shards), code=_own_code(begun))
        environment = make_environment(begun.robot, begun.task, config=begun.config)
        with nullcontext() if out is None else new_run(out, begun) as run:
            return _run(environment, begun, run, callback or (lambda _: None))


@checked_arguments
def resume(
    folder: str | Path,
    *,
    task: TaskLike | None = None,
    reward: str | RewardFunction | None = None,
    blocks: Sequence[str | Callable[..., Any]] = (),
    callback: Callback | None = None,
) -> Policy:
    """Continue the unfinished training of a folder with its own settings, to the weights of an unbroken one.

    Code of a user's own is given again, as the training was begun: what only a file names is not run.

    Args:
      folder: of the training.
      task: with a motion of a user's own, or the motion's name.
      reward: of a user's own.
      blocks: of the observation, that are a user's own.
      callback: as of `train`.

    Raises:
      InputError: if there is no such training, it is finished, in use or damaged, code is missing, not its own or has
        changed, or the training diverges.
    """
    _check_callback(callback)
    given = {f"block {registered_name(block, 'block')}" for block in blocks}
    given |= {f"motion {Task.of(task).motion}"} if task is not None else set()
    given |= {f"reward {registered_name(reward, 'reward')}"} if reward is not None else set()
    with import_jax().enable_x64(False), resumed_run(Path(folder)) as run:
        from archerfish.learning.shards import claim_devices

        begun = run.begun
        if unknown := [name for name, digest in begun.code.items() if not digest]:
            problem = f"{unknown[0]} refers to what has no content, as a lock or an open file, so it may be another now"
            raise InputError(f"{folder}: {problem}; begin another training")
        if missing := sorted(begun.code.keys() - given):
            raise InputError(f"{folder}: has a {missing[0]} of your own; give it again, as the training was begun")
        if ignored := sorted(given - begun.code.keys()):
            what = f"has no {ignored[0]} of your own, and continues with its own settings"
            raise InputError(f"{folder}: {what}; leave it out, or begin another training")
        own = _own_code(begun)
        if changed := [name for name, digest in own.items() if digest != begun.code[name]]:
            remedy = "put it back, or begin another training"
            raise InputError(f"{changed[0]} has changed since the training was begun; {remedy}")
        if (devices := claim_devices(begun.config.settings.shards)) != begun.devices:
            flag = f"XLA_FLAGS=--xla_force_host_platform_device_count={begun.devices}"
            raise InputError(f"{folder}: begun on {begun.devices} devices, got {devices}; in a new process set {flag}")
        environment = make_environment(begun.robot, begun.task, config=begun.config)
        return _run(environment, begun, run, callback or (lambda _: None))


def _check_callback(callback: Any) -> None:
    if callback is not None and not callable(callback):
        raise InputError(f"callback: expected a function of a dictionary, got {callback!r}; give one, or leave it out")


def with_given(config: TrainConfig, trainer: Any, steps: int | None, reward: Any) -> TrainConfig:
    """Return settings with what is given beside them, as to `train`, in their place."""
    config = config.replace(trainer=trainer) if trainer else config
    config = config.replace(reward=reward) if reward is not None else config
    if steps is not None:
        _check_number("steps", steps, 1)
        config = config.replace(gradient=config.gradient.replace(steps=steps), ppo=config.ppo.replace(steps=steps))
    return config


def _check_number(name: str, number: Any, least: int) -> None:
    if not (isinstance(number, int) and least <= number <= 2**53):
        raise InputError(f"{name} must be a whole number of {least} to 2^53, got {number!r}; give another one")


def _begin(robot: RobotLike, task: TaskLike, config: TrainConfig, seed: int) -> Begun:
    """Return a new training."""
    _check_number("seed", seed, 0)
    robot, task = Robot.of(robot), Task.of(task)
    if robot.folder is None:  # that of a folder was checked, or accepted, when it was loaded
        robot.check_usable()
    config = config.resolved(robot, task)
    # In single precision, as the simulator counts them.
    settings, shortest = config.settings, round(float(np.float32(min(task.lengths)) / np.float32(task.period_s)))
    if settings.decisions > shortest:  # what replaces the engagements that end is drawn once between two updates
        raise InputError(f"{settings.part} = {settings.decisions} exceeds an engagement of {shortest}; lower it")
    versions = library_versions()
    return Begun(robot=robot, task=task, config=config, seed=seed, commit=code_commit(), versions=versions)


def _own_code(begun: Begun) -> dict[str, str]:
    """Return the digests of a user's own code by kind and name: blocks of the observation, motion and reward."""
    own = [("block", name) for name in begun.config.names[1:]]
    own += [("motion", begun.task.motion)] if begun.task.motion not in (*EQ_7, *DRAWN) else []
    own += [("reward", begun.config.reward)] if names_code(begun.config.reward) else []
    return {f"{kind} {name}": find_plugin(name, kind).digest for kind, name in own}


def _run(environment: Any, begun: Begun, folder: RunFolder | None, callback: Callback) -> Policy:
    """Run a training to its end."""
    import jax

    from archerfish.learning import learner, shards
    from archerfish.learning.gradient import GRADIENT
    from archerfish.learning.ppo import PPO

    config, trainer = begun.config.settings, PPO if begun.config.trainer == "ppo" else GRADIENT
    arrays = jax.tree.map(jax.numpy.asarray, environment)
    state = trainer.begin(arrays, config, jax.random.key(begun.seed))
    state, rows = (folder.restore(state), folder.rows) if folder else (state, [])
    state = shards.placed(state, config.shards, learner.SPLIT)
    total, stored = config.trained // config.batch, time.monotonic()
    with progress.bar("training", config.trained, "decisions", "compiling") as advance, _stop_requests() as stop:
        while len(rows) < total and not stop:
            state, metrics = trainer.advance(arrays, config, state, CHUNK)
            new, fault = _rows({name: np.asarray(each) for name, each in metrics.items()}, len(rows), config.batch)
            rows += new
            if folder:
                folder.log(new)
            if fault:
                raise _diverged(fault, len(rows), config.batch, folder, state)
            advance(len(rows) * config.batch, f"{rows[-1]['hit_share']:.1%} hit")
            if not any(row.get("gradient_norm", 1.0) for row in new):
                raise InputError(f"{begun.config.reward}: this reward has no gradient; smooth it, or take trainer ppo")
            try:
                for row in new:
                    callback(dict(row))
            except BaseException:
                if folder:
                    folder.save(state)
                raise
            if folder and (stop or time.monotonic() - stored >= begun.config.checkpoint_every_s):
                folder.save(state)
                stored = time.monotonic()
    if stop:  # once more, to whoever handled it before
        if progress.in_worker is None:  # else the process that this one works for says what remains
            message = f"continue with archerfish train --resume {folder.path}" if folder else "nothing is kept"
            print(message, file=sys.stderr)  # noqa: T201
        signal.raise_signal(stop[0])
        raise KeyboardInterrupt  # where that one returned
    policy = _policy(environment.observer, state, folder.begun if folder else begun, rows)
    if folder:
        folder.finish(policy)
    return policy


def _rows(metrics: dict[str, Any], done: int, batch: int) -> tuple[list[dict[str, Any]], str]:
    """Return a row per good iteration, and what was first bad, "" if nothing was."""
    from archerfish.learning.learner import WATCHED

    bad = ~(metrics.pop("watched") <= np.array(list(WATCHED.values())))
    good = int(np.argmax(bad.any(axis=1))) if bad.any() else len(bad)
    rows = [
        {"iteration": done + i + 1, "decisions": (done + i + 1) * batch, **{n: float(a[i]) for n, a in metrics.items()}}
        for i in range(good)
    ]
    return rows, list(WATCHED)[int(np.argmax(bad[good]))] if good < len(bad) else ""


def _diverged(first: str, done: int, batch: int, folder: RunFolder | None, learner: Any) -> InputError:
    remedy = _REMEDIES.get(first, "lower the learning rates")
    if folder:
        folder.diverged(learner, {"iteration": done + 1, "first": first})
        remedy += f"; {folder.path} has the last good checkpoint"
    what = f"training diverged after {done * batch} decisions, in iteration {done + 1}"
    return InputError(f"{what}: {first} not finite, or growing beyond all bounds; {remedy}")


@contextmanager
def _stop_requests() -> Iterator[list[int]]:
    """Yield a list that gets the number of a signal that asks to stop; a second one is handled as it was before."""
    found: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield found
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    handled = {number: handler for number, handler in before.items() if handler not in (signal.SIG_IGN, None)}

    def restore() -> None:
        for number, handler in handled.items():
            signal.signal(number, handler)

    def stop(number: int, _: Any) -> None:
        found.append(number)
        restore()
        print("stopping after these updates; another signal ends at once", file=sys.stderr)  # noqa: T201

    try:
        for number in handled:
            signal.signal(number, stop)
        yield found
    finally:
        restore()


def _policy(observer: Observer, learner: Any, begun: Begun, rows: list[dict[str, Any]]) -> Policy:
    """Return the policy of a learner, in NumPy: its mean action."""
    commits = [begun.commit, *(resumed.commit for resumed in begun.resumed)]
    training = {"config": plain(begun.config), "robot": begun.robot.name, "commits": commits}
    facts = PolicyFacts(
        observer=observer_facts(begun.config.names, begun.robot, begun.task, begun.config.frames),
        task=begun.task,
        robot=begun.robot.record_digests(),
        seed=begun.seed,
        commit=commits[-1],
        training=training | (rows[-1] if rows else {}),
    )
    normaliser, layers = map_arrays(np.asarray, (learner.normaliser, learner.actor.layers))
    seen = len(layers[0].weight)  # what comes after is for the critic alone
    normaliser = normaliser._replace(mean=normaliser.mean[:seen], variance=normaliser.variance[:seen])
    return Policy(observer, normaliser, layers, facts=facts)
