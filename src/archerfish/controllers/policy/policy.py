"""A trained policy: an observer, a network, and one file that holds both; NumPy is enough to decide with it."""

import abc
import itertools
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from msgspec import Meta, field

from archerfish.arrays import Array, tree
from archerfish.controllers.policy.network import Layer, Normaliser, forward, normalise
from archerfish.controllers.policy.observation import ObserverFacts, make_observer
from archerfish.controllers.policy.observer import Memory, Observer
from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.protocols import Command, Seen, Truth
from archerfish.records.json_files import parse_json, plain, to_struct
from archerfish.records.record import Struct
from archerfish.storage import read_arrays, write_arrays
from archerfish.task import Task

POLICY_SCHEMA, _REMEDY = "archerfish.policy/2", "train again"
_LARGEST_NUMBER = 1e6
"""In a policy's arrays: far beyond any that a training leaves."""


class PolicyFacts(Struct, frozen=True, kw_only=True):
    """What a policy is, beside its weights."""

    observer: ObserverFacts
    """How it sees and acts."""
    task: Task
    """That it was trained on."""
    robot: dict[str, str]
    """SHA-256 of each record that it was trained in, by part."""
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    """Of its training."""
    commit: Annotated[str, Meta(max_length=1000)] = ""
    """Of the code that ended its training."""
    training: dict[str, Any] = field(default_factory=dict)
    """Configuration and outcome of the training."""


class ObservingController(abc.ABC):
    """Base of what acts on observations alone."""

    observer: Observer

    def reset(self, seen: Seen, truth: Truth | None = None) -> Memory:  # noqa: ARG002
        """Return the memory at the beginning of an engagement."""
        return self.observer.begin(seen)

    def step(self, state: Memory, seen: Seen) -> tuple[Memory, Command]:
        """Decide."""
        memory = self.observer.remember(state, seen)
        view = self.observer.view(memory, seen)
        return memory, self.observer.decode(view, self.action(self.observer.observe(view)))

    @abc.abstractmethod
    def action(self, observation: Array) -> Array:
        """Return the action for an observation, shape B + (n,) → B + (2,)."""


@tree(left_out=("facts",))
class Policy(ObservingController):
    """A controller: the network's output for what is observed, as an offset from an aim; without randomness."""

    observer: Observer
    normaliser: Normaliser
    actor: tuple[Layer, ...]  # its network
    facts: PolicyFacts | None = None  # left out of programs, which depend on arrays alone

    def action(self, observation: Array) -> Array:
        """Return the action for an observation, shape B + (n,) → B + (2,)."""
        return forward(self.actor, normalise(self.normaliser, observation))

    def __repr__(self) -> str:
        if self.facts is None:
            return "Policy(without facts)"
        made, name = self.facts.training, ", ".join(self.facts.observer.observation)
        parts = [f"observation {name}", f"task {self.facts.task.name}", f"seed {self.facts.seed}"]
        parts += [f"robot {made['robot']}"] if "robot" in made else []
        parts += [f"{made['hit_share']:.1%} of the latest shots of its training hit"] if "hit_share" in made else []
        return f"Policy({', '.join(parts)})"

    @classmethod
    @checked_arguments
    def load(cls, path: str | Path, blocks: tuple[Any, ...] = ()) -> Self:
        """Read a policy.

        Args:
          path: a file, or a folder with policy.safetensors, as of a training.
          blocks: of the observation that are a user's own, as `find_plugin` takes them: code that only a file names
            is not run.

        Raises:
          InputError: if the file is no policy, is damaged, or a number is out of its bounds; if the training in the
            folder is not finished.
        """
        if not isinstance(blocks, tuple | list):
            raise InputError(f"blocks: expected a tuple of blocks, got one of type {type(blocks).__name__}; give one")
        folder, path = Path(path), _policy_file(Path(path))
        if not path.exists() and is_training(folder):
            raise file_error(folder, "is a training that is not finished", f"run archerfish train --resume {folder}")
        text, arrays = read_arrays(path, _REMEDY)
        if isinstance(content := parse_json(text.encode(), path, _REMEDY), dict):
            content.pop("remake", None)  # of older files
        facts = to_struct(content, path, PolicyFacts, POLICY_SCHEMA, _REMEDY)
        if (own := ", ".join(facts.observer.observation[1:])) and not blocks:
            raise file_error(path, f"has blocks of a user's own ({own})", "give them: Policy.load(path, blocks=(…))")
        try:
            observer = make_observer(facts.observer, tuple(blocks))
            return cls(observer, *_network(arrays, sum(size for _, size in observer.layout())), facts=facts)
        except InputError as error:
            raise file_error(path, str(error).removesuffix(f"; {_REMEDY}"), _REMEDY) from error

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the policy to a .safetensors file, of a folder that is there to policy.safetensors in it.

        Raises:
          InputError: if it can't be written, or its facts are missing.
        """
        if self.facts is None:
            raise InputError("a policy without facts can't be saved; take the one that train returns")
        arrays = {"mean": self.normaliser.mean, "variance": self.normaliser.variance}
        for index, layer in enumerate(self.actor):
            arrays |= {f"weight.{index}": layer.weight, f"bias.{index}": layer.bias}
        write_arrays(_policy_file(Path(path)), {"schema": POLICY_SCHEMA, **plain(self.facts)}, arrays)


def is_training(folder: Path) -> bool:
    """Whether a folder is that of a training, finished or not."""
    names = ("policy.safetensors", "checkpoint.safetensors", "log.jsonl")
    return any((folder / name).is_file() for name in names)


def _policy_file(path: Path) -> Path:
    return path / "policy.safetensors" if path.is_dir() else path


def _network(arrays: dict[str, Array], size: int) -> tuple[Normaliser, tuple[Layer, ...]]:
    """Return normaliser and layers, checked to fit each other and an observation of a size."""
    depth = len(arrays) // 2 - 1
    hidden = [np.size(arrays.get(f"bias.{index}", ())) for index in range(depth - 1)]
    shapes: dict[str, tuple[int, ...]] = {"mean": (size,), "variance": (size,)}
    for index, (inputs, outputs) in enumerate(itertools.pairwise([size, *hidden, 2])):
        shapes |= {f"weight.{index}": (inputs, outputs), f"bias.{index}": (outputs,)}
    if arrays.keys() != shapes.keys():
        raise InputError(f"expected mean, variance, weight.0, bias.0, …, got {', '.join(sorted(arrays))[:200]}")
    for name, shape in shapes.items():
        if arrays[name].shape != shape or arrays[name].dtype != np.float32:
            raise InputError(f"array {name}: expected float32 {shape}, got {arrays[name].dtype} {arrays[name].shape}")
        if not np.all(np.abs(arrays[name]) <= _LARGEST_NUMBER):
            raise InputError(f"array {name}: expected numbers within ±{_LARGEST_NUMBER:g}, got others")
    if not np.all(arrays["variance"] >= 0.0):
        raise InputError(f"array variance: expected numbers ≥ 0, got {np.min(arrays['variance']):g}")
    layers = tuple(Layer(arrays[f"weight.{index}"], arrays[f"bias.{index}"]) for index in range(depth))
    return Normaliser(arrays["mean"], arrays["variance"], np.asarray(0.0, np.float32)), layers
