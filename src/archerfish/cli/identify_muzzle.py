"""`archerfish identify muzzle`: from shots to the muzzle record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.identification.muzzle.identify import PELLET_DRAG, identify_muzzle
from archerfish.logs.shots import COLUMNS, ShotColumns, read_shots


@dataclass(frozen=True)
class IdentifyMuzzle(Writes):
    """Identify the muzzle from shots: landing points, or hits on planes.

    - finds muzzle speed, offsets of pitch and yaw and the scatter of all three, with 95 % intervals
    - leaves out ricochets and flyers, and tests whether the flight model fits
    - writes muzzle.json (the record), muzzle.html and run.json

    A file is a table with a shot in each line, in the order of fire: pitch_deg, and distance_m of landing points, or
    plane_distance_m and hit_height_m of hits; speed_m_s, lateral_m, yaw_deg and missed are optional. Shots at one
    setting need the measured speed of each; without, shoot at several pitches, or at planes at several distances.

    Examples:
      archerfish identify muzzle shots.csv
      archerfish identify muzzle landings.csv --height-m 0.42 --length-m 0.16 --out my-robot
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, shown("FILE…")]
    """Tables of shots with the same columns."""
    height_m: Annotated[float | None, shown("M", "(default: estimated)")] = None
    """Of the muzzle above the ground with the barrel level [m]; hits on planes do not need it."""
    length_m: float = 0.0
    """From the gimbal's pivot to the muzzle [m]."""
    drag: float | Literal["estimate"] = PELLET_DRAG
    """Quadratic drag coefficient [1/m], or "estimate"."""
    columns: ShotColumns = COLUMNS
    """Names of the columns, where they are others."""
    seed: int = 0
    """Of the bootstrap."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/muzzle")
    """Folder for what is found."""

    def run(self, options: str = "") -> Ending:
        """Identify, write; `options` are as typed, for run.json."""
        shots, names = read_shots(*self.files, columns=self.columns), ("muzzle.json", "muzzle.html")
        with self.written(self.out, "identify muzzle", options, self.files, names) as folder:
            result = identify_muzzle(
                shots, height_m=self.height_m, length_m=self.length_m, drag=self.drag, seed=self.seed
            )
            result.save(folder)
        then = f"archerfish train {self.out}, once its folder has both axes (archerfish identify axis)"
        return Ending(f"{result.report}", f"open {self.out / 'muzzle.html'}", then)
