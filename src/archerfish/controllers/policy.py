"""The trained policy as a controller: what it sees, its network, its action; deterministic."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from archerfish.controllers.network import Layer, Normaliser, forward, normalise
from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.multimodel_observation import MultimodelObserver, multimodel_observer
from archerfish.sensing.observation import Observer, make_observer
from archerfish.sensing.observers import AnyObserver
from archerfish.sensing.tracked_observation import TrackedObserver, tracked_observer

TRACKING: dict[str, Callable[..., Any]] = {"tracked": tracked_observer, "multimodel": multimodel_observer}
"""Kind of observation that tracks the target → builder of its observer."""
_MUZZLE_FACTS = ("speed", "drag", "length")


class PolicyController(NamedTuple):
    """A policy; arrays only, so that it runs with NumPy on a robot and inside a compiled program alike."""

    observer: AnyObserver
    """How it sees and acts."""
    normaliser: Normaliser
    """Of its observations."""
    actor: tuple[Layer, ...]
    """Its network."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:  # noqa: ARG002
        """Return the memory at the beginning of an engagement."""
        return self.observer.begin(seen)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide from the memory."""
        memory = self.observer.remember(state, seen)
        action = forward(self.actor, normalise(self.normaliser, self.observer.observe(memory)))
        return memory, fire_always(self.observer.decode(memory, action))


def policy_from_record(record: PolicyRecord) -> PolicyController:
    """Build the controller of a policy record, in NumPy.

    Raises:
      InputError: if the kind of observation is unknown or has not the size that the network takes.
    """
    observer = observer_from_record(record)
    if observer.size != record.mean.size:
        raise InputError(
            f"a policy of {record.frames} frames must take {observer.size} numbers, "
            f"got a network for {record.mean.size}; train it anew"
        )
    return PolicyController(
        observer=observer,
        normaliser=Normaliser(record.mean, record.variance, np.asarray(0.0, np.float32)),
        actor=tuple(Layer(*layer) for layer in zip(record.weights, record.biases, strict=True)),
    )


def observer_from_record(record: PolicyRecord) -> AnyObserver:
    """Build the observer that a policy was trained with.

    Raises:
      InputError: if the kind of observation is unknown.
    """
    offset = np.array([record.muzzle["pitch_offset"], record.muzzle["yaw_offset"]], np.float32)
    facts = {name: np.asarray(np.float32(record.muzzle[name])) for name in _MUZZLE_FACTS}
    muzzle = Muzzle(**facts, offset=offset, **_NO_SPREAD)
    if record.observation in TRACKING:
        noise = TrackerNoise(**{name: np.asarray(each, np.float32) for name, each in record.tracker.items()})
        build = TRACKING[record.observation]
        observer = build(muzzle, noise, record.period_s, (0.0, 0.0), record.braking)
        tracked: AnyObserver = single_precision(observer._replace(action_scale=record.action_scale))
        return tracked
    plain = make_observer(record.observation, muzzle, record.frames, braking=record.braking)
    return plain._replace(action_scale=record.action_scale)


_NO_SPREAD = {"speed_sd": np.asarray(0.0, np.float32), "sd": np.zeros(2, np.float32)}


def policy_to_record(controller: PolicyController, **facts: Any) -> PolicyRecord:
    """Take a policy's arrays into a record.

    Args:
      controller: the policy.
      facts: `period_s`, `command_limit`, `training` and `provenance` of the record.
    """
    observer = controller.observer
    muzzle, offset = observer.muzzle, np.asarray(observer.muzzle.offset)
    if isinstance(observer, TrackedObserver | MultimodelObserver):
        tracker = {name: float(value) for name, value in observer.noise._asdict().items()}
        kind = "tracked" if isinstance(observer, TrackedObserver) else "multimodel"
        frames = observer.frames.shape[0]
    elif isinstance(observer, Observer):
        tracker, frames = {}, observer.history.shape[0]
        kind = "history" if frames else "paper"
    else:
        raise TypeError(f"no record for an observer of type {type(observer).__name__}")
    return PolicyRecord(
        observation=kind,
        frames=frames,
        tracker=tracker,
        weights=tuple(np.asarray(layer.weight, np.float32) for layer in controller.actor),
        biases=tuple(np.asarray(layer.bias, np.float32) for layer in controller.actor),
        mean=np.asarray(controller.normaliser.mean, np.float32),
        variance=np.asarray(controller.normaliser.variance, np.float32),
        action_scale=np.asarray(observer.action_scale, np.float32),
        braking=np.asarray(observer.braking, np.float32),
        muzzle={name: float(getattr(muzzle, name)) for name in _MUZZLE_FACTS}
        | {"pitch_offset": float(offset[0]), "yaw_offset": float(offset[1])},
        **facts,
    )
