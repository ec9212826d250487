"""What decides for one robot: a controller behind the gate, in NumPy or in C, and another one behind it.

Whatever a controller does, a decision ends with a verdict of the gate.
"""

import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from archerfish.arrays import map_arrays
from archerfish.codegen.decision import Gated
from archerfish.codegen.library import library_of
from archerfish.errors import one_line
from archerfish.protocols import Command, Controller, Seen, Truth
from archerfish.robot import Robot
from archerfish.safety.gate import GateState, GateVerdict, Reason
from archerfish.safety.rules import LOST_S, GateConfig, gate_rules
from archerfish.task import Task

_LATE_IN_A_ROW = 3


class Decider(Protocol):
    """A controller behind the gate, with a memory of its own; `codegen.library.Library` is one, too."""

    gate: GateState
    """State of the gate after the last decision, shape (); setting it takes a decision back."""
    error: str
    """What the controller raised in the last decision; empty if nothing."""
    fault: str
    """What was wrong with the controller first; empty while nothing was."""
    language: str
    """C or NumPy."""

    def reset(self) -> None:
        """Forget everything; the gate is disarmed."""

    def decide(self, given: Mapping[str, Any]) -> tuple[GateVerdict, int]:
        """Decide from `codegen.decision.FIELDS`, each of shape () or (size,); return 1, too, where the input is bad."""


class NumpyDecider:
    """A gated controller in NumPy, a batch of one; where the controller raises, the gate gets no command."""

    def __init__(self, gated: Gated) -> None:
        """Begin without a memory."""
        self._gated, self._without = gated, Gated(_NoCommand(), gated.rules)
        self.error, self.fault, self.language = "", "", "NumPy"
        self.reset()

    def reset(self) -> None:
        """Forget everything; a controller that raises here raises in the next decision, too."""
        self._state = map_arrays(_one, self._without.reset())

    @property
    def gate(self) -> GateState:
        """See `Decider.gate`."""
        return GateState(*(array[0] for array in self._state.gate))

    @gate.setter
    def gate(self, state: GateState) -> None:
        self._state = self._state._replace(gate=map_arrays(_one, state))

    def decide(self, given: Mapping[str, Any]) -> tuple[GateVerdict, int]:
        """See `Decider.decide`."""
        self.error = ""
        given = {name: _one(value) for name, value in given.items()}
        try:
            self._state, verdict = self._gated.step(self._state, given)
        except (Exception, SystemExit) as error:  # whatever a controller raises, the gate decides
            self.error = error_text(error)
            self.fault = self.fault or self.error
            begun = self._state._replace(begins=np.ones(1, np.float32))
            self._state, verdict = self._without.step(begun, given)
        return GateVerdict(*(array[0] for array in verdict)), int(self._state.gate.good_for[0] <= 0.0)


def error_text(error: BaseException) -> str:
    """Return what a user's code raised, and where, on a line."""
    [*_, place] = traceback.extract_tb(error.__traceback__)
    return one_line(f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})")[:200]


def _one(value: Any) -> Any:
    """Return a batch of one."""
    return np.asarray(value)[None]


class WithFallback:
    """Two deciders; the second one replaces the first for good at its first fault.

    The second decides as well all the time, so that its tracker has seen all; both gates go on from the one decision
    that is sent.
    """

    def __init__(
        self, first: Decider, fallback: Decider, longest_s: float, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Take both.

        Args:
          first: decides until its first fault: it raises, its command is not finite or absurd, or it is late.
          fallback: decides from then on, and where it is chosen.
          longest_s: that a decision of the first one may take; three longer ones in a row are a fault, as is one of
            more than 0.1 s [s].
          clock: by which that is measured [s].
        """
        self._first, self._fallback = first, fallback
        self._longest, self._clock, self._late = longest_s, clock, 0
        self.error = ""
        self.language = " and ".join(dict.fromkeys((first.language, fallback.language)))
        self.fault = ""
        """What was wrong with the first one; empty while it decides."""
        self.is_fallback_chosen = False
        """Whether the operator has chosen the fallback."""

    @property
    def why_fallback(self) -> str:
        """Why the fallback decides; empty while the first one does."""
        return self.fault or ("it was chosen" if self.is_fallback_chosen else "")

    @property
    def gate(self) -> GateState:
        """See `Decider.gate`."""
        return self._fallback.gate

    @gate.setter
    def gate(self, state: GateState) -> None:
        self._first.gate = self._fallback.gate = state

    def reset(self) -> None:
        """Forget everything but a fault."""
        self._first.reset()
        self._fallback.reset()

    def decide(self, given: Mapping[str, Any]) -> tuple[GateVerdict, int]:
        """Decide by the one that is in charge; a fault of the first is answered in the same decision."""
        other = self._fallback.decide(given)
        self.error = self._fallback.error
        if self.fault:
            return other
        begun = self._clock()
        own = self._first.decide(given)
        self.fault = self._fault(own[1], self._clock() - begun)
        if self.fault or self.is_fallback_chosen:
            self._first.gate = self._fallback.gate
            return other
        self._fallback.gate = self._first.gate
        return own

    def _fault(self, status: int, took: float) -> str:
        """Return what was wrong with the last decision of the first one, which took so long [s]."""
        self._late = self._late + 1 if took > self._longest else 0
        if self._first.error:
            return self._first.error
        if status and self._first.gate.cause == Reason.NO_COMMAND:
            return "its command is not finite, or absurd"
        if took > max(LOST_S, self._longest):
            return f"it took {1e3 * took:.0f} ms"
        if self._late >= _LATE_IN_A_ROW:
            return f"it took {1e3 * took:.1f} ms, {self._late} times in a row"
        return ""


def make_decider(
    name: str, controller: Controller, robot: Robot, task: Task, config: GateConfig, *, in_c: bool = False
) -> Decider:
    """Return a controller behind the gate.

    Args:
      name: of the controller.
      controller: built for robot and task.
      robot: has the limits of its commands.
      task: decision period and command limit.
      config: what the gate allows less than the records.
      in_c: whether it decides in C, where a compiler is at hand and its formulas can be traced.

    Raises:
      InputError: if the configuration is wider than the robot's limits, or the task limits commands by where the
        target really is.
    """
    gated = Gated(controller, gate_rules(robot, task, config))
    library = library_of(name, gated, robot, task) if in_c else None
    return library or NumpyDecider(gated)


class _NoCommand:
    """A controller that never asks for anything."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        """Remember nothing."""
        del truth
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Return a command that the gate takes for none."""
        nothing = np.full_like(seen.command, np.nan)
        return state, Command(nothing, nothing, seen.elapsed < 0.0, nothing[..., 0])
