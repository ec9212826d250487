"""`archerfish emulate`: an emulated robot behind a port."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from archerfish.cli.options import Ending, ForRobot, shown
from archerfish.errors import InputError
from archerfish.runtime.configuration import read_config
from archerfish.studies.rehearse import SwingingPlate, emulated_robot
from archerfish.virtual_robot.emulator import FAULTS, Fault
from archerfish.virtual_robot.emulator_port import EmulatorPort

_LATE_S = 0.03  # that the computer's checks notice


@dataclass(frozen=True)
class Emulate(ForRobot):
    """Be a robot at the other end of a wire, in real time, for archerfish deploy or a program of your own.

    - prints the name of its port, a pseudo-terminal
    - ROBOT/deploy.toml has the address that detections go to and, as position_m, the place of the camera, so that it
      is where archerfish deploy assumes it, wherever a virtual robot's file has it
    - the operator's switch goes on 1 s after the computer's first bytes; times of faults count from there, too
    - the operator switches off for 1 s, 0.5 s after the end of each fault, or of the last one where faults overlap,
      since after some faults the gate asks for that
    - after a second without bytes of the computer all these times begin again, for one that is started again
    - without MuJoCo, or with --virtual identified, it is the robot of ROBOT's records: its plants, camera and muzzle
    - a plate swings before it; at the end hits, pellets and violations of the robot's limits are printed

    Examples:
      archerfish emulate my-robot
      archerfish emulate my-robot --fault silence 3 4 blind 6 7 --seconds 20
    """

    virtual: Annotated[str, shown("NAME|FILE", "(default: infantry; without MuJoCo, identified)")] = ""
    """Virtual robot (infantry, worn), its TOML file, or identified for the robot of the records."""
    fault: Annotated[tuple[str, ...], shown("KIND BEGIN END …")] = ()
    """What goes wrong, from when to when [s]: silence, flip, triple, garbage, frozen, nan, late, burst, camera-clock,
    blind, nan-detections, hidden."""
    seconds: float = float("inf")
    """After the computer's very first bytes, when it ends by itself."""
    frequency_hz: float = SwingingPlate().frequency_hz
    """At which the plate swings [Hz]."""
    watchdog_s: float = 0.1
    """For so long its microcontroller goes on firing if no command comes [s]; with 0 a command fires one pellet."""
    seed: int = 0
    """Of the robot's noise, of the dispersion and of the faults."""

    def run(self, options: str = "") -> Ending:
        """Emulate; nothing is written."""
        del options
        robot, task = self.robot_and_task()
        config = read_config(self.folder)
        emulator = emulated_robot(
            self.virtual,
            robot,
            task,
            config.wires,
            SwingingPlate(frequency_hz=self.frequency_hz),
            camera_m=config.detections.position_m,
            seed=self.seed,
            faults=read_faults(self.fault),
            watchdog_s=self.watchdog_s,
        )
        with EmulatorPort(emulator, config.detections.address) as port:
            print(f"port {port.name}\narcherfish deploy {self.robot or 'paper'} --port {port.name}", flush=True)  # noqa: T201
            try:
                port.run(lambda: False, self.seconds)
            except KeyboardInterrupt:
                print("", file=sys.stderr)  # noqa: T201
        late = f"; the robot was up to {1e3 * port.late_s:.0f} ms late, since this computer is too busy for it"
        hits = sum(pellet.is_hit for pellet in emulator.pellets)
        violations = dict(+emulator.monitor.violations)
        if not emulator.pellets:
            raise InputError("no pellet was fired; see what archerfish deploy says of its gate")
        found = f"{hits} of {len(emulator.pellets)} pellets hit; violations of the limits: {violations or 'none'}"
        return Ending(found + (late if port.late_s > _LATE_S else ""), "nothing is written")


def read_faults(words: Sequence[str]) -> list[Fault]:
    """Return the faults in the words of --fault.

    Raises:
      InputError: if they are not a kind and two times for each fault.
    """
    faults = list[Fault]()
    try:
        for place in range(0, len(words), 3):
            kind, begin, end = words[place : place + 3]
            faults.append(Fault(kind, float(begin), float(end)))
    except ValueError as error:
        expected = "expected three words for each fault, KIND BEGIN END, with times in seconds"
        remedy = f"write for instance silence 3 4; kinds are {', '.join(FAULTS)}"
        raise InputError(f"--fault: {expected}, got {' '.join(words)}; {remedy}") from error
    return faults
