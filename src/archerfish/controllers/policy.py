"""The trained policy as a controller: what it sees, its network, its action; deterministic."""

from typing import Any, NamedTuple

import numpy as np

from archerfish.controllers.network import Layer, Normaliser, forward, normalise
from archerfish.dynamics.array_namespace import Array
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.sensing.observation import (
    Observer,
    begin_memory,
    decode_action,
    make_observer,
    observation_size,
    observe,
    remember,
)

_MUZZLE_FACTS = ("speed", "drag", "length")


class PolicyController(NamedTuple):
    """A policy; arrays only, so that it runs with NumPy on a robot and inside a compiled program alike."""

    observer: Observer
    """How it sees and acts."""
    normaliser: Normaliser
    """Of its observations."""
    actor: tuple[Layer, ...]
    """Its network."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Array:  # noqa: ARG002
        """Return the memory at the beginning of an engagement."""
        return begin_memory(self.observer, seen)

    def step(self, state: Array, seen: Seen) -> tuple[Array, Command]:
        """Decide from the memory, shape B + (h, 7)."""
        memory = remember(self.observer, state, seen)
        action = forward(self.actor, normalise(self.normaliser, observe(self.observer, memory)))
        return memory, fire_always(decode_action(self.observer, memory, action))


def policy_from_record(record: PolicyRecord) -> PolicyController:
    """Build the controller of a policy record, in NumPy.

    Raises:
      InputError: if the kind of observation is unknown or has not the size that the network takes.
    """
    offset = np.array([record.muzzle["pitch_offset"], record.muzzle["yaw_offset"]], np.float32)
    facts = {name: np.float32(record.muzzle[name]) for name in _MUZZLE_FACTS}
    muzzle = Muzzle(**{name: np.asarray(value) for name, value in facts.items()}, offset=offset, **_NO_SPREAD)
    observer = make_observer(record.observation, muzzle, record.frames, braking=record.braking)
    observer = observer._replace(action_scale=record.action_scale)
    if observation_size(observer) != record.mean.size:
        raise InputError(
            f"a policy of {record.frames} frames must take {observation_size(observer)} numbers, "
            f"got a network for {record.mean.size}; train it anew"
        )
    return PolicyController(
        observer=observer,
        normaliser=Normaliser(record.mean, record.variance, np.asarray(0.0, np.float32)),
        actor=tuple(Layer(*layer) for layer in zip(record.weights, record.biases, strict=True)),
    )


_NO_SPREAD = {"speed_sd": np.asarray(0.0, np.float32), "sd": np.zeros(2, np.float32)}


def policy_to_record(controller: PolicyController, **facts: Any) -> PolicyRecord:
    """Take a policy's arrays into a record.

    Args:
      controller: the policy.
      facts: `period_s`, `command_limit`, `training` and `provenance` of the record.
    """
    muzzle = controller.observer.muzzle
    frames = controller.observer.history.shape[0]
    offset = np.asarray(muzzle.offset)
    return PolicyRecord(
        observation="history" if frames else "paper",
        frames=frames,
        weights=tuple(np.asarray(layer.weight, np.float32) for layer in controller.actor),
        biases=tuple(np.asarray(layer.bias, np.float32) for layer in controller.actor),
        mean=np.asarray(controller.normaliser.mean, np.float32),
        variance=np.asarray(controller.normaliser.variance, np.float32),
        action_scale=np.asarray(controller.observer.action_scale, np.float32),
        braking=np.asarray(controller.observer.braking, np.float32),
        muzzle={name: float(getattr(muzzle, name)) for name in _MUZZLE_FACTS}
        | {"pitch_offset": float(offset[0]), "yaw_offset": float(offset[1])},
        **facts,
    )
