"""What a controller of a user's own returns, looked at before anything is made of it."""

from typing import Any, NamedTuple

import numpy as np

from archerfish.records.errors import InputError
from archerfish.records.extensions import Extension, own_code
from archerfish.sensing.interfaces import Command, Controller, Seen, Truth

_TRAILING = Command(angle=(2,), rate=(2,), fire=(), hit_probability=(), fallback=())
"""Of the shapes, after that of the engagements."""


def decide(controller: Controller, state: Any, seen: Seen) -> tuple[Any, Command]:
    """Let a controller decide.

    Args:
      controller: of a user's own.
      state: of it.
      seen: of n engagements; JAX's tracers will do.

    Raises:
      InputError: if what it returns is no state and command, or the command has other shapes or types than it must.
    """
    answer: Any = controller.step(state, seen)
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[1], Command):
        raise InputError(
            f"step returns {_kind(answer)}, expected (state, Command); fire_always(angle) of "
            "archerfish.sensing.interfaces makes one of angles"
        )
    batch = seen.elapsed.shape
    for name, trailing, found in zip(Command._fields, _TRAILING, answer[1], strict=True):
        if getattr(found, "shape", None) != (*batch, *trailing):
            told = getattr(found, "shape", type(found).__name__)
            count = batch[0] if len(batch) == 1 else batch
            raise InputError(
                f"step commands {name} of shape {told} for {count} engagements, expected {(*batch, *trailing)}"
            )
    if answer[1].fire.dtype != bool:
        raise InputError(
            f"step commands fire of type {answer[1].fire.dtype}, expected true or false for each engagement; compare, "
            "as in hit_probability > 0.5"
        )
    return answer


def _kind(answer: Any) -> str:
    if hasattr(answer, "shape"):
        return "an array"
    if isinstance(answer, tuple) and not hasattr(answer, "_fields"):
        # What stands in for an array while JAX compiles is an array to who wrote the controller.
        return f"({', '.join('array' if hasattr(each, 'shape') else type(each).__name__ for each in answer)})"
    return f"a {type(answer).__name__}"


class WatchedController(NamedTuple):
    """A controller of a user's own in NumPy, of which every decision is looked at.

    Its functions raise `InputError`, with the name of the code, in the place of whatever the code raises.
    """

    controller: Any
    """The user's."""
    extension: Extension
    """Where it comes from."""

    @property
    def needs_truth(self) -> bool:
        """Whether it is to be told the truth."""
        return bool(getattr(self.controller, "needs_truth", False))

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        """Return the state at the beginning of an engagement."""
        with own_code(self.extension):
            return self.controller.reset(seen, truth)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide; refuse shapes that don't fit, angles that are no numbers, and another state than before."""
        with own_code(self.extension):
            after, command = decide(self.controller, state, seen)
            for name in ("angle", "rate"):
                if not np.all(np.isfinite(getattr(command, name))):
                    raise InputError(f"step commands {name} that are not finite, expected numbers in rad; mend it")
            if _outline(after) != _outline(state):
                raise InputError(
                    f"step returns another state than it was given: {_outline(after)} after {_outline(state)}, "
                    "expected the same structure, shapes and kinds of numbers"
                )
            return after, command


def _outline(state: Any) -> str:
    """Describe structure, shapes and kinds of numbers; not the precision, which a compiled program makes one."""
    if state is None:
        return "nothing"
    if isinstance(state, dict):
        return f"{{{', '.join(f'{name}: {_outline(state[name])}' for name in sorted(state, key=str))}}}"
    if isinstance(state, tuple | list):
        name = type(state).__name__ if hasattr(state, "_fields") or isinstance(state, list) else ""
        return f"{name}({', '.join(map(_outline, state))})"
    array = np.asarray(state)
    return f"{_KINDS.get(array.dtype.kind, array.dtype.name)}{list(array.shape)}"


_KINDS = {"f": "float", "i": "int", "u": "uint", "b": "bool"}
