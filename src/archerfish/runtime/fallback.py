"""A controller with another one behind it, which replaces it for good at its first fault."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from archerfish.errors import one_line
from archerfish.protocols import Command, Controller, Seen, Truth
from archerfish.safety.gate import MEASURABLE

_LATE_IN_A_ROW = 3


class WithFallback:
    """Two controllers of which the second decides as well, so that it is ready: its tracker has seen all."""

    def __init__(
        self,
        first: Controller,
        fallback: Controller,
        longest_s: float,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Take both.

        Args:
          first: decides until its first fault: it raises, its command is not finite, or it is late.
          fallback: decides from then on, and where it is chosen.
          longest_s: that a decision of the first one may take; three longer ones in a row are a fault [s].
          clock: by which that is measured [s].
        """
        self._first, self._fallback = first, fallback
        self._longest, self._clock, self._late = longest_s, clock, 0
        self.fault = ""
        """What was wrong with the first one; empty while it decides."""
        self.is_fallback_chosen = False
        """Whether the operator has chosen the fallback."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        """Return the memory of both at the first detection; there is no truth on a robot."""
        del truth
        other = None
        with contextlib.suppress(Exception):
            other = self._fallback.reset(seen)
        return self._checked(lambda: self._first.reset(seen)), other

    def step(self, memory: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide by the one that is in charge; a fault of the first is answered in the same decision."""
        own, other = memory
        wanted: Command | None = None
        if not self.fault:
            begun = self._clock()
            own, wanted = self._checked(lambda: self._first.step(own, seen)) or (own, None)
            self._judge(wanted, self._clock() - begun)
        command = _no_command(seen)
        with contextlib.suppress(Exception):  # whatever a controller raises, the gate holds
            other, command = self._fallback.step(other, seen)
        if wanted is None or self.fault or self.is_fallback_chosen:
            return (own, other), command
        return (own, other), wanted

    def _judge(self, wanted: Command | None, took: float) -> None:
        """Look for a fault in a decision of the first one [s]."""
        self._late = self._late + 1 if took > self._longest else 0
        if wanted is not None and not np.all(np.abs(np.asarray(wanted.angle)) <= MEASURABLE):  # false for NaN
            self.fault = "its command is not finite, or absurd"
        elif self._late >= _LATE_IN_A_ROW:
            self.fault = f"it took {1e3 * took:.1f} ms, {self._late} times in a row"

    def _checked(self, call: Callable[[], Any]) -> Any:
        """Return what a call of the first one gives; None where it raises."""
        try:
            return call()
        except Exception as error:  # noqa: BLE001: whatever a controller raises, the robot goes on
            self.fault = one_line(f"{type(error).__name__}: {error}")[:200]
            return None


def _no_command(seen: Seen) -> Command:
    """Return a command that the gate takes for none."""
    nothing = np.full_like(np.asarray(seen.command), np.nan)
    return Command(nothing, nothing, np.zeros(len(nothing), bool), nothing[..., 0])
