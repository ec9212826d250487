"""The policy record: a trained network and everything it needs to be run, with NumPy alone."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

SCHEMA = "archerfish.policy/1"
Floats = NDArray[np.float32]
MUZZLE_FACTS = ("speed", "drag", "length", "pitch_offset", "yaw_offset")
"""Numbers that `PolicyRecord.muzzle` holds."""
TRACKER_FACTS = ("acceleration", "along", "across", "along_share", "across_angle", "initial_speed")
"""Numbers that `PolicyRecord.tracker` of a tracked observation holds."""
RAMP_FACTS = ("pitch_gain", "yaw_gain", "lead")
"""Numbers that `PolicyRecord.ramp` holds, if any."""
EARLIER_INITIAL_SPEED = 1.0
"""`initial_speed` [m/s] of trackers in records from before it could be set."""


@dataclass(frozen=True)
class PolicyRecord:
    """A policy: observation → network with ReLU → offset of the command from the aim."""

    observation: str
    """Kind of the observation: "history", "paper", "tracked" or "multimodel"."""
    frames: int
    """Frames that a history observation remembers."""
    weights: tuple[Floats, ...]
    """Weight matrices of the layers, shape (inputs, outputs) each."""
    biases: tuple[Floats, ...]
    """Biases of the layers, shape (outputs,) each."""
    mean: Floats
    """Mean of the observations in training, shape (n,)."""
    variance: Floats
    """Their variance, shape (n,)."""
    action_scale: Floats
    """Command offset per unit of action, pitch and yaw [rad], shape (2,)."""
    braking: Floats
    """By how much the command's move per decision may change under that limit, pitch and yaw [rad], shape (2,)."""
    muzzle: dict[str, float]
    """Muzzle that the aim is computed for: speed [m/s], drag [1/m], length [m], pitch_offset and yaw_offset [rad]."""
    period_s: float
    """Decision period that it was trained with [s]."""
    command_limit: str
    """Command limit that it was trained under."""
    tracker: dict[str, float] = field(default_factory=dict)
    """What the tracker believes, as `sensing.kalman_filter.TrackerNoise`; empty where an observation has none."""
    ramp: dict[str, float] = field(default_factory=dict)
    """How the robot that it was trained for follows commands that change at a constant rate, as
    `dynamics.linear_axis.RampResponse`: `pitch_gain`, `yaw_gain` and, of yaw, `lead` [s]; empty where not known."""
    training: dict[str, Any] = field(default_factory=dict)
    """Configuration and outcome of the training."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""

    def __post_init__(self) -> None:
        size = self.mean.shape[0]
        if self.variance.shape != (size,):
            raise InputError(f"policy.variance must have shape ({size},), got {self.variance.shape}; train it anew")
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape[0] != size or bias.shape != weight.shape[1:]:
                raise InputError(
                    f"policy layer {index} must take {size} inputs, got weight {weight.shape}, bias {bias.shape}; "
                    "train it anew"
                )
            size = weight.shape[1]
        if size != 2:
            raise InputError(f"a policy must have 2 outputs, pitch and yaw, got {size}; train it anew")
        for name in ("action_scale", "braking"):
            found = getattr(self, name)
            if found.shape != (2,):
                raise InputError(f"policy.{name} must have shape (2,), got {found.shape}; train it anew")
        if not np.all(self.braking > 0):
            raise InputError(f"policy.braking must be > 0 rad, got {self.braking.tolist()}; train it anew")
        missing = [name for name in MUZZLE_FACTS if not isinstance(self.muzzle.get(name), (int, float))]
        if missing:
            raise InputError(f'policy.muzzle must hold the number "{missing[0]}"; train it anew')
        tracked = TRACKER_FACTS if self.observation in ("tracked", "multimodel") else ()
        missing = [name for name in tracked if not isinstance(self.tracker.get(name), (int, float))]
        if missing:
            raise InputError(f'policy.tracker must hold the number "{missing[0]}"; train it anew')
        missing = [name for name in RAMP_FACTS if self.ramp and not _is_positive(self.ramp.get(name))]
        if missing:
            raise InputError(f'policy.ramp must hold the number "{missing[0]}", finite and > 0; train it anew')
        for array in (*self.weights, *self.biases, self.mean, self.variance, self.action_scale, self.braking):
            if not np.all(np.isfinite(array)):
                raise InputError("a policy's network holds a value that is not finite; train it anew")


def _is_positive(value: Any) -> bool:
    return isinstance(value, (int, float)) and bool(np.isfinite(value)) and value > 0


def write_policy(path: Path, policy: PolicyRecord) -> None:
    """Write a policy record to `path` (.json) and its arrays beside it."""
    arrays = {name: getattr(policy, name) for name in ("mean", "variance", "action_scale", "braking")}
    for index, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        arrays |= {f"weight_{index}": weight, f"bias_{index}": bias}
    names = (
        "observation",
        "frames",
        "muzzle",
        "period_s",
        "command_limit",
        "tracker",
        "ramp",
        "training",
        "provenance",
    )
    storage.write_record(path, SCHEMA, {name: getattr(policy, name) for name in names}, arrays)


def read_policy(path: Path) -> PolicyRecord:
    """Read a policy record.

    Raises:
      InputError: if the file is not a policy record or does not hold together.
    """
    facts, arrays = storage.read_record(path, SCHEMA)
    layers = sum(name.startswith("weight_") for name in arrays)
    kinds = {"observation": str, "frames": int, "muzzle": dict, "period_s": float, "command_limit": str}
    kinds |= {"training": dict, "provenance": dict}
    tracker = storage.field(path, facts, "tracker", dict) if "tracker" in facts else {}
    if tracker:
        tracker = {"initial_speed": EARLIER_INITIAL_SPEED} | tracker
    try:
        return PolicyRecord(
            weights=tuple(arrays[f"weight_{index}"] for index in range(layers)),
            biases=tuple(arrays[f"bias_{index}"] for index in range(layers)),
            mean=arrays["mean"],
            variance=arrays["variance"],
            action_scale=arrays["action_scale"],
            braking=arrays["braking"],
            tracker=tracker,
            ramp=storage.field(path, facts, "ramp", dict) if "ramp" in facts else {},
            **{name: storage.field(path, facts, name, kind) for name, kind in kinds.items()},
        )
    except KeyError as error:
        raise file_error(path, f"array {error} is missing", "train the policy anew") from error
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error
