"""`archerfish excite`: the commands that identify an axis, and what their logs would give."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.identification.excitation import ExcitationKind, ExcitationSettings, excite
from archerfish.paper.gimbal import gate_limits
from archerfish.records.json_files import plain, write_json
from archerfish.records.limits import LimitsRecord
from archerfish.records.plant import PlantRecord


@dataclass(frozen=True)
class Excite(Writes):
    """Write the commands to play to an axis for its identification, and predict what their logs will give.

    - AXIS_KIND.csv for each signal, with the columns time_s, u (the commanded angle in radians) and expected (what the
      assumed axis makes of it, with noise), and AXIS_KIND_validation.csv, another one to be held back
    - AXIS_excitation.html (tables and figures), AXIS_excitation.json and run.json
    - a command begins and ends at rest at the centre, and is as large as the limits allow, or as asked; the amplitude
      falls with frequency where rate or acceleration would pass the limits
    - the prediction is the identification itself, on the logs that --plant, or an axis of second order, would give

    A new gimbal needs its travel, the period at which it takes commands, and small angles, with which motors saturate
    less:
      archerfish excite pitch --range-deg -20 30 --sample-period-s 0.005 --amplitude-deg 1 --step-deg 2

    Limits that are not given are those of GM6020 motors: pitch -25 to 10°, yaw -75 to 75°, 688 °/s, 7330 °/s² of pitch
    and 3840 °/s² of yaw. An axis accelerates by its motor's torque over its inertia; a lower value only makes commands
    smaller.

    Other examples:
      archerfish excite pitch --limits my-robot/limits.json --out runs/excite
      archerfish excite yaw --kinds multisine step --amplitude-deg 1
    """

    axis: Annotated[Literal["pitch", "yaw"], tyro.conf.Positional]
    """Axis that is to be moved: names the files, and chooses its part of the limits."""
    kinds: tuple[ExcitationKind, ...] = ("sweep", "step")
    """Signals, each a log of its own."""
    no_validation: Annotated[bool, shown()] = False
    """Do without the commands that are held back."""
    range_deg: Annotated[tuple[float, float] | None, shown("LOW HIGH")] = None
    """Travel of the axis [°]; pitch is positive with the muzzle up, yaw to the left."""
    max_rate_deg_s: Annotated[float | None, shown("FLOAT")] = None
    """Largest rate that the axis can follow [°/s]."""
    max_acceleration_deg_s2: Annotated[float | None, shown("FLOAT")] = None
    """Largest acceleration that the axis can follow [°/s²]."""
    limits: Annotated[Path | None, shown("FILE")] = None
    """Limits record of the robot, as identify writes it; the three options before replace its figures."""
    centre_deg: Annotated[float | None, shown("FLOAT")] = None
    """Angle about which the axis is moved; the middle of its travel if not given."""
    amplitude_deg: Annotated[float | None, shown("FLOAT")] = None
    """Largest distance of sweep, multisine and PRBS from the centre; as large as the limits allow if not given."""
    step_deg: float = 3.0
    """Size of the steps."""
    slew_steps: Annotated[bool, shown()] = False
    """Keep the steps, too, within the limits of rate and acceleration."""
    duration_s: float = 10.0
    """Length of sweep, multisine and PRBS."""
    low_hz: float = 2.0
    """Lowest frequency."""
    high_hz: Annotated[float | None, shown("FLOAT")] = None
    """Highest frequency; 50, or 0.4 of the sampling rate where that is less, if not given."""
    sample_period_s: float = 1e-3
    """Time between commands, and between samples of the logs: 0.005 for 200 Hz; --plant brings its own."""
    plant: Annotated[Path | None, shown("FILE")] = None
    """Plant record of the axis, from an earlier identification; else 10 Hz, damping 0.7, delay 5 ms."""
    noise_deg: float = 0.013
    """Standard deviation of the measured angle's noise; the default is the rounding of an encoder of 8192 counts."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/excite")
    """Folder for what is written."""

    def run(self, options: str = "") -> Ending:
        """Plan, predict, write; `options` are as typed, for run.json."""
        limits = getattr(LimitsRecord.load(self.limits) if self.limits else gate_limits(), self.axis)
        low, high = self.range_deg or (None, None)
        travel = {"low": low, "high": high}
        most = {"max_rate": self.max_rate_deg_s, "max_acceleration": self.max_acceleration_deg_s2}
        angles = {"amplitude": self.amplitude_deg, "step": self.step_deg, "centre": self.centre_deg}
        names = ("sample_period_s", "duration_s", "low_hz", "high_hz", "slew_steps")
        found = excite(
            self.axis,
            limits.replace(**_radians(travel | most)),
            kinds=self.kinds,
            validation=not self.no_validation,
            plant=PlantRecord.load(self.plant) if self.plant else None,
            noise_sd=math.radians(self.noise_deg),
            settings=ExcitationSettings(**{name: getattr(self, name) for name in names} | _radians(angles)),
        )
        with self.written(self.out, f"excite {self.axis}", options, (self.limits, self.plant)) as folder:
            found.save(folder)
            found.report.write_page(folder / f"{self.axis}_excitation.html")
            write_json(folder / f"{self.axis}_excitation.json", plain(found.report.to_dict()))
        where = f"open {self.out / self.axis}_excitation.html; the commands are in the same folder"
        return Ending(
            f"{found.report}",
            where,
            f"play them, record the angle, then archerfish identify axis LOGS --axis {self.axis}",
        )


def _radians(degrees: dict[str, float | None]) -> dict[str, float]:
    return {name: math.radians(value) for name, value in degrees.items() if value is not None}
