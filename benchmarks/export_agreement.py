"""How far NumPy, JAX and ONNX Runtime are apart when they run the same policy."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from archerfish.controllers.policy import PolicyController
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.sensing.interfaces import Seen

Angles = NDArray[np.float32]
ENGINES = ("NumPy", "JAX", "ONNX Runtime")


def runtime(path: Path) -> onnxruntime.InferenceSession:
    """Open an exported policy, with one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def inputs_of(session: onnxruntime.InferenceSession, seen: Seen, first: Any, state: Any) -> dict[str, Any]:
    """Return what an exported policy is fed.

    Args:
      session: the policy.
      seen: arrays of shape (B,) first.
      first: whether it is the first decision, shape (B,).
      state: shape (B, size).
    """
    known = {**seen._asdict(), "first": first, "state": state}
    return {each.name: known[each.name] for each in session.get_inputs()}


def packed(memory: Any) -> Angles:
    """Return a controller's memory as the exported policy takes it, shape (B, size)."""
    arrays: list[Any] = []
    map_arrays(arrays.append, memory)
    return np.concatenate([np.asarray(each).reshape(len(each), -1) for each in arrays], axis=-1)


def first_commands(policy: PolicyController, session: onnxruntime.InferenceSession, seen: Seen) -> dict[str, Angles]:
    """Return each engine's commands [rad] at first decisions, shape (B, 2).

    Args:
      policy: in NumPy.
      session: the same, exported.
      seen: arrays of shape (B,) first.
    """
    policy, batch = single_precision(policy), len(seen.elapsed)

    def decide(policy: PolicyController, seen: Seen) -> Any:
        return policy.step(policy.reset(seen), seen)[1].angle

    rubbish = np.full((batch, _state_size(session)), np.nan, np.float32)
    found = session.run(["angle_command"], inputs_of(session, seen, np.ones(batch, bool), rubbish))[0]
    return dict(zip(ENGINES, (decide(policy, seen), _in_jax(decide)(policy, seen), found), strict=True))


def commands_of_sequences(
    policy: PolicyController, session: onnxruntime.InferenceSession, frames: Seen, carried: bool
) -> dict[str, Angles]:
    """Return each engine's commands [rad], shape (T, B, 2).

    Args:
      policy: in NumPy.
      session: the same, exported.
      frames: arrays of shape (T, B) first.
      carried: whether each engine goes on with its own memory, not all with NumPy's.
    """
    policy = single_precision(policy)
    in_jax, begin = _in_jax(lambda policy, *rest: policy.step(*rest)), _in_jax(lambda policy, seen: policy.reset(seen))
    start = map_arrays(lambda each: each[0], frames)
    memory, theirs = policy.reset(start), begin(policy, start)
    state = np.full((len(start.elapsed), _state_size(session)), np.nan, np.float32)
    commands = []
    for decision in range(len(frames.elapsed)):
        seen = map_arrays(lambda each, at=decision: each[at], frames)
        first = np.full(len(state), decision == 0)
        if not carried:
            state, theirs = packed(memory), memory
        angle, state = session.run(["angle_command", "next_state"], inputs_of(session, seen, first, state))
        theirs, others = in_jax(policy, theirs, seen)
        memory, ours = policy.step(memory, seen)
        commands.append((ours.angle, np.asarray(others.angle), angle))
    return dict(zip(ENGINES, (np.stack(each) for each in zip(*commands, strict=True)), strict=True))


def largest_differences(commands: dict[str, Angles]) -> dict[str, float]:
    """Return the largest difference [rad] between any two engines; infinite where only one of them says NaN."""
    pairs = (("NumPy", "ONNX Runtime"), ("NumPy", "JAX"), ("JAX", "ONNX Runtime"))
    return {f"{one}, {other}": _largest(commands[one], commands[other]) for one, other in pairs}


def _largest(one: Angles, other: Angles) -> float:
    if np.any(np.isnan(one) != np.isnan(other)):
        return float("inf")
    return float(np.nanmax(np.abs(one - other)))


def _state_size(session: onnxruntime.InferenceSession) -> int:
    return int(next(each.shape[1] for each in session.get_inputs() if each.name == "state"))


def _in_jax(function: Callable[..., Any]) -> Callable[..., Any]:
    compiled = jax.jit(function)
    return lambda *arguments: jax.tree.map(np.asarray, compiled(*jax.tree.map(jnp.asarray, arguments)))
