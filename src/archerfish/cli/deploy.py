"""`archerfish deploy`: a controller on the robot's computer."""

import contextlib
import queue
import sys
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal

from archerfish.cli.options import Ending, ForRobot, shown
from archerfish.runtime.configuration import FILE, read_config
from archerfish.runtime.deciders import WithFallback
from archerfish.runtime.pilot import Pilot
from archerfish.studies.deploy import deploy

_EVERY_S = 0.5  # between lines


@dataclass(frozen=True)
class Deploy(ForRobot):
    """Aim and shoot with the robot: frames of its wire in and out, detections by UDP.

    - begins disarmed: the operator's switch must go off, and on after half a second of good input
    - a policy has a classical controller behind it, which decides from its first fault on, or while it is chosen: type
      f and Enter
    - holds on feedback older than 50 ms, fires never then; a fault after 100 ms, until the switch was off
    - Ctrl-C, SIGTERM or a fault of the program: the last frame ends the fire
    - ROBOT/deploy.toml has port, wire, camera and limits, and what the yaw counts from (docs/deployment.md)

    Examples:
      archerfish emulate my-robot
      archerfish deploy my-robot --port /dev/pts/3
      archerfish deploy my-robot --controller kalman --seconds 30
    """

    port: Annotated[str, shown("DEVICE")] = ""
    """Serial port of the robot; that of deploy.toml if not given."""
    controller: Annotated[str, shown("NAME|FOLDER")] = ""
    """A policy, or a name of archerfish evaluate; that of deploy.toml, else ROBOT/policy if there is one, or kalman."""
    seconds: float = float("inf")
    """After which it ends by itself."""
    numpy: bool = False
    """Decide in NumPy even where a C compiler is at hand."""
    tuning: Annotated[Literal["kept", "start"], shown("kept|start", "(default: kept)")] = "kept"
    """Settings of a classical controller: those that are kept, which are searched for where there are none, or those
    where the search begins."""

    def run(self, options: str = "") -> Ending:
        """Deploy; nothing is written."""
        del options
        robot, task = self.robot_and_task()
        config = read_config(self.folder)
        controller = self.robot_controller(self.controller or config.controller.mode)
        deployment = deploy(
            controller,
            robot,
            task,
            config,
            port=self.port,
            seconds=self.seconds,
            tuning=self.tuning,
            in_c=not self.numpy,
            watch=StateDisplay(),
        )
        has_file = self.folder is not None and (self.folder / FILE).exists()
        return Ending(f"{deployment}", f"settings: {self.folder / FILE if has_file and self.folder else 'defaults'}")


class StateDisplay:
    """Shows the state of the pilot where it has changed, and reads the keyboard; see `_obey`.

    A thread of its own prints: a terminal that is stopped keeps the one that writes to it.
    """

    def __init__(self) -> None:
        self._shown, self._keyboard = "", False
        self._lines = queue.Queue[str](maxsize=1)
        threading.Thread(target=self._print, daemon=True).start()

    def __call__(self, pilot: Pilot) -> bool:
        """Show the state if it is another one; never ends the run."""
        state = pilot.state_text
        if pilot.verdict is not None and not self._keyboard:
            self._keyboard = True
            threading.Thread(target=_obey, args=[pilot, sys.stdin], daemon=True).start()
            state += "" if pilot.has_switch else " (the wire has no operator's switch: Enter turns it on and off)"
        if state != self._shown:
            with contextlib.suppress(queue.Full):
                self._lines.put_nowait(state)
                self._shown = state
        return False

    def _print(self) -> None:
        while True:
            print(self._lines.get(), file=sys.stderr, flush=True)  # noqa: T201
            time.sleep(_EVERY_S)


def _obey(pilot: Pilot, lines: Iterable[str]) -> None:
    """Do what is typed: "f" chooses the fallback, and the first controller again.

    An empty line is the switch of a wire without one, which is off at the end of the input.
    """
    for line in lines:
        if line.strip() == "f" and isinstance(pilot.decider, WithFallback):
            pilot.decider.is_fallback_chosen = not pilot.decider.is_fallback_chosen
        elif not line.strip() and not pilot.has_switch:
            pilot.switch = not pilot.switch
    if not pilot.has_switch:
        pilot.switch = False
