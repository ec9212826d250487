"""`archerfish deploy`: a controller on the robot's computer."""

import sys
import threading
import time
from dataclasses import dataclass
from typing import Annotated, Literal

from archerfish.cli.options import Ending, ForRobot, shown
from archerfish.runtime.configuration import FILE, read_config
from archerfish.runtime.pilot import Pilot
from archerfish.studies.deploy import deploy

_EVERY_S = 1.0  # between lines


@dataclass(frozen=True)
class Deploy(ForRobot):
    """Aim and shoot with the robot: frames of its wire in and out, detections by UDP.

    - begins disarmed: the operator's switch must go off, and on after half a second of good input
    - a policy has a classical controller behind it, which decides from its first fault on
    - holds on feedback older than 50 ms, fires never then; a fault after 100 ms, until the switch was off
    - Ctrl-C, SIGTERM or a fault of the program: the last frame ends the fire
    - ROBOT/deploy.toml has port, wire, camera and limits (docs/deployment.md)

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
    tuning: Annotated[Literal["kept", "start"], shown("kept|start", "(default: kept)")] = "kept"
    """Settings of a classical controller: those that are kept, which are searched for where there are none, or those
    where the search begins."""

    def run(self, options: str = "") -> Ending:
        """Deploy; nothing is written."""
        del options
        robot, task = self.robot_and_task()
        config = read_config(self.folder)
        controller = self.controller or config.controller.mode or next(iter(self.own_policy()), "")
        watch = _Watch()
        deployment = deploy(
            controller, robot, task, config, port=self.port, seconds=self.seconds, tuning=self.tuning, watch=watch
        )
        return Ending(f"{deployment}", f"settings: {self.folder / FILE if self.folder else 'defaults'}")


class _Watch:
    """Prints a line where the state of the pilot has changed, and lets Enter be the switch of a wire without one."""

    def __init__(self) -> None:
        self._shown, self._shown_s, self._keyboard = "", 0.0, False

    def __call__(self, pilot: Pilot) -> bool:
        state, now = pilot.state_text, time.monotonic()
        if pilot.verdict is not None and not pilot.has_switch and not self._keyboard:
            self._keyboard = True
            print("the wire has no operator's switch: Enter arms and disarms", file=sys.stderr, flush=True)  # noqa: T201
            threading.Thread(target=_toggle, args=[pilot], daemon=True).start()
        if state != self._shown and now > self._shown_s + _EVERY_S:
            print(state, file=sys.stderr, flush=True)  # noqa: T201
            self._shown, self._shown_s = state, now
        return False


def _toggle(pilot: Pilot) -> None:
    """Turn the switch with each line that is typed."""
    for _ in sys.stdin:
        pilot.switch = not pilot.switch
