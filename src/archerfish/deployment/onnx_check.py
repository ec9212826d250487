"""An exported file against the policy that it was made from, before anyone relies on it."""

import importlib.util

import numpy as np

from archerfish.controllers.guarded_policy import GuardedPolicy
from archerfish.controllers.policy import PolicyController
from archerfish.dynamics.array_namespace import single_precision
from archerfish.sensing.interfaces import Seen

ROBOTS, DECISIONS = 100, 20
"""How much is compared."""
_ERROR = 3
"""Of ONNX Runtime's levels of messages: what is less is not for our users."""


def can_check() -> bool:
    """Whether ONNX Runtime is installed."""
    return importlib.util.find_spec("onnxruntime") is not None


def largest_difference(policy: PolicyController | GuardedPolicy, model: bytes, period_s: float) -> float:
    """Return the largest difference of the two's commands [rad] over a few engagements, each with its own memory.

    It is not finite if a command is not.

    Args:
      policy: in NumPy.
      model: the ONNX file made from it.
      period_s: decision period [s].
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = _ERROR
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    names = {each.name: each.shape for each in session.get_inputs()}
    policy, rng = single_precision(policy), np.random.default_rng(0)
    place = rng.uniform([1.0, -1.0, -0.2], [5.0, 1.0, 0.3], (ROBOTS, 3))
    velocity = rng.normal(0.0, 0.4, (ROBOTS, 3))
    memory, state = None, np.zeros((ROBOTS, names["state"][1]), np.float32)
    largest = 0.0
    for decision in range(DECISIONS):
        seen = _seen(place + velocity * period_s * decision, period_s * (decision > 0), rng)
        memory = policy.reset(seen) if memory is None else memory
        memory, command = policy.step(memory, seen)
        known = {**seen._asdict(), "first": np.full(ROBOTS, decision == 0), "state": state}
        angle, state = session.run(["angle_command", "next_state"], {name: known[name] for name in names})
        # Unlike max, maximum passes a NaN on.
        largest = float(np.maximum(largest, np.max(np.abs(angle - command.angle))))
    return largest


def _seen(plate: np.ndarray, elapsed: float, rng: np.random.Generator) -> Seen:
    """Return what robots see whose gimbals are about where they should be."""
    bearing = np.arctan2(plate[:, 1], plate[:, 0])
    aim = np.stack([0.05 + 0.0 * bearing, bearing], axis=-1)
    angle, command = aim + rng.normal(0.0, 0.02, (2, ROBOTS, 2))
    zero = np.zeros(ROBOTS)
    return Seen(
        *single_precision((zero + elapsed, angle, 0.0 * angle, zero + 0.004, command, plate[:, None], zero[:, None])),
        *single_precision((zero[:, None] + 0.03, np.ones((ROBOTS, 1), bool), np.zeros((ROBOTS, 4)), zero + 18.0, zero)),
    )
