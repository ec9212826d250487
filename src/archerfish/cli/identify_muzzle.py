"""`archerfish identify muzzle`: from shots to the muzzle record."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from archerfish.cli.muzzle_summary import Summary, muzzle_summary, print_muzzle
from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.figures.identification import LandingGroup, landing_figure
from archerfish.figures.style import save_figure
from archerfish.identification.muzzle_likelihood import identify_muzzle
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.errors import InputError
from archerfish.records.muzzle import write_muzzle
from archerfish.records.provenance import provenance
from archerfish.records.shots import ShotColumns, merge_shots, read_shots_csv

MUZZLE_ENDINGS = (".json", ".svg", ".png")


@dataclass(frozen=True)
class IdentifyMuzzle:
    """Identify the muzzle from landing points (CSV), by maximum likelihood.

    Estimates the muzzle speed, the pitch offset and the scatter of both, with 95 % intervals, and says whether the
    flight model fits at all. Shots at one pitch setting only need the measured speed of each; without speeds, shoot at
    several settings. Distances are measured along level ground from the point below the muzzle.

    Writes NAME.json (the muzzle record, for train and evaluate), NAME.svg and NAME.png.

    Examples:
      archerfish identify muzzle shots.csv --height-m 0.42 --out runs/my-robot
      archerfish identify muzzle shots.csv --pitch elevation --distance landing
    """

    shots: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="SHOTS…", help_behavior_hint="")]
    """CSV files with one shot per line, at least one."""
    pitch: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = ShotColumns.pitch_deg
    """Column of the barrel's elevation in degrees, muzzle up positive."""
    yaw: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = ShotColumns.yaw_deg
    """Column of the barrel's azimuth in degrees, left positive; may be missing."""
    distance: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = ShotColumns.distance_m
    """Column of the landing distance in metres."""
    speed: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = ShotColumns.speed_m_s
    """Column of the measured muzzle speed in m/s; may be missing."""
    lateral: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = ShotColumns.lateral_m
    """Column of the landing point's distance from the barrel's plane in metres, left positive; may be missing."""
    height_m: Annotated[float | None, tyro.conf.arg(metavar="METRES", help_behavior_hint="(default: estimated)")] = None
    """Height of the muzzle above the ground in metres."""
    drag_per_m: float = field(default_factory=lambda: assumed_conditions().drag)
    """Quadratic drag coefficient k in 1/m."""
    estimate_drag: bool = False
    """Estimate the drag coefficient too; needs one more pitch setting."""
    name: Annotated[str, tyro.conf.arg(metavar="NAME")] = "muzzle"
    """Name of the written files."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    json: JsonFile = None
    """Also write what is printed to this file."""


def run_muzzle(command: IdentifyMuzzle, console: Console | None = None) -> Summary:
    """Estimate the muzzle, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a file, a column, an option or the output folder can't be used, or the shots can't separate the
        parameters.
    """
    console = console or Console()
    if not command.shots:
        raise InputError("identify muzzle: no file of shots given; name at least one CSV file")
    check_file_name("--name", command.name)
    columns = ShotColumns(command.pitch, command.yaw, command.distance, command.speed, command.lateral)
    shots = merge_shots([read_shots_csv(path, columns) for path in command.shots])
    with run_folder(command.out) as folder:
        with console.status("maximising the likelihood …"):
            drag = None if command.estimate_drag else command.drag_per_m
            result = identify_muzzle(shots, drag=drag, height=command.height_m)
        muzzle = replace(result.muzzle, provenance=provenance(command.seed, command.shots))
        write_muzzle(folder / f"{command.name}.json", muzzle)
        figure = landing_figure(LandingGroup(shots.pitch, shots.distance, result.distance, result.distance_sd))
        for ending in (".svg", ".png"):
            save_figure(folder / f"{command.name}{ending}", figure)
    summary = muzzle_summary(shots, result, [command.out / f"{command.name}{ending}" for ending in MUZZLE_ENDINGS])
    print_muzzle(console, summary)
    return summary
