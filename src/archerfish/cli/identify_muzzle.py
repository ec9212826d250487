"""`archerfish identify muzzle`: from shots to the muzzle record."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from matplotlib.figure import Figure
from rich.console import Console

from archerfish.cli.muzzle_page import muzzle_page, shot_groups
from archerfish.cli.muzzle_summary import Summary, muzzle_summary, print_muzzle
from archerfish.cli.muzzle_verdict import muzzle_verdict
from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.figures.shots import shots_figure
from archerfish.figures.style import save_figure
from archerfish.identification.muzzle.likelihood import MuzzleIdentification, identify_muzzle
from archerfish.identification.muzzle.model import Flight
from archerfish.paper.conditions import assumed_conditions
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.muzzle import write_muzzle
from archerfish.records.provenance import provenance
from archerfish.records.shots import Shots, merge_shots
from archerfish.records.shots_csv import DEFAULT_COLUMNS, ShotColumns, read_shots_csv

MUZZLE_ENDINGS = (".json", ".html", ".svg", ".png")


@dataclass(frozen=True)
class IdentifyMuzzle:
    """Identify the muzzle from shots: landing points, or hits on a plane (CSV).

    Estimates, by maximum likelihood, the muzzle speed, the offsets of pitch and yaw and the scatter of all three, with
    95 % intervals, leaves out ricochets and flyers, and says whether the flight model fits at all. Shots at one setting
    only need the measured speed of each; without speeds, shoot at several pitches onto level ground, or at planes at
    several distances. Give the shots in the order of fire: intervals are widened where successive shots are alike.

    Distances to landing points are measured along level ground from the point below the muzzle (columns pitch_deg,
    distance_m); hits on a plane by its distance and their height above the muzzle (pitch_deg, plane_distance_m,
    hit_height_m). docs/shots.md has all columns, and the codes of the faults.

    Writes NAME.json (the muzzle record, for train and evaluate), NAME.html (what is known, how sure that is, and what
    to do next), NAME.svg and NAME.png.

    Examples:
      archerfish identify muzzle shots.csv --height-m 0.42 --length-m 0.16 --out runs/my-robot
      archerfish identify muzzle plane_2m.csv plane_4m.csv plane_6m.csv --out runs/my-robot
      archerfish identify muzzle shots.csv --pitch elevation --distance landing
    """

    shots: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="SHOTS…", help_behavior_hint="")]
    """CSV files with one shot per line, at least one."""
    pitch: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.pitch_deg
    """Column of the barrel's elevation in degrees, muzzle up positive."""
    yaw: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.yaw_deg
    """Column of the barrel's azimuth in degrees, left positive; may be missing."""
    distance: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.distance_m
    """Column of the landing distance in metres."""
    speed: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.speed_m_s
    """Column of the measured muzzle speed in m/s; may be missing."""
    lateral: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.lateral_m
    """Column of how far left of the barrel's plane (on a target plane, of straight ahead) the pellet went in metres;
    may be missing."""
    plane_distance: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.plane_distance_m
    """Column of the distance to the target plane in metres, in place of the landing distance."""
    hit_height: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DEFAULT_COLUMNS.hit_height_m
    """Column of the hit's height above the muzzle in metres, with the distance to the plane."""
    height_m: Annotated[float | None, tyro.conf.arg(metavar="METRES", help_behavior_hint="(default: estimated)")] = None
    """Height of the muzzle above the ground in metres, with the barrel level."""
    length_m: Annotated[float, tyro.conf.arg(metavar="METRES")] = 0.0
    """Distance from the gimbal's pivot to the muzzle in metres, by tape: so much ahead of the pivot the muzzle rises
    with the pitch, and pellets of a policy's simulator leave there."""
    drag_per_m: float = field(default_factory=lambda: assumed_conditions().drag)
    """Quadratic drag coefficient k in 1/m."""
    estimate_drag: bool = False
    """Estimate the drag coefficient too; needs one more pitch setting."""
    flight: Flight = "flat-fire"
    """How pellets fly: as in the simulator, or by eq (5) as printed."""
    name: Annotated[str, tyro.conf.arg(metavar="NAME")] = "muzzle"
    """Name of the written files."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        return Outputs(tuple(self.out / f"{self.name}{ending}" for ending in MUZZLE_ENDINGS))


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
    shots = merge_shots([read_shots_csv(path, _columns(command)) for path in command.shots])
    with run_folder(command.out, make_writer(command)) as folder:
        with console.status("maximising the likelihood …"):
            drag = None if command.estimate_drag else command.drag_per_m
            result = identify_muzzle(
                shots, drag=drag, height=command.height_m, length=command.length_m, flight=command.flight
            )
        muzzle = replace(result.muzzle, provenance=provenance(command.seed, command.shots))
        verdict = muzzle_verdict(shots, result)
        write_muzzle(folder / f"{command.name}.json", muzzle)
        page = muzzle_page(shots, result, muzzle, verdict, command.name)
        storage.write_text(folder / f"{command.name}.html", page)
        figure = _picture(shots, result)
        for ending in (".svg", ".png"):
            save_figure(folder / f"{command.name}{ending}", figure)
    files = [command.out / f"{command.name}{ending}" for ending in MUZZLE_ENDINGS]
    summary = muzzle_summary(shots, result, verdict, files)
    print_muzzle(console, summary)
    return summary


def _columns(command: IdentifyMuzzle) -> ShotColumns:
    return ShotColumns(
        pitch_deg=command.pitch,
        yaw_deg=command.yaw,
        distance_m=command.distance,
        speed_m_s=command.speed,
        lateral_m=command.lateral,
        plane_distance_m=command.plane_distance,
        hit_height_m=command.hit_height,
    )


def _picture(shots: Shots, result: MuzzleIdentification) -> Figure:
    groups = shot_groups(shots, result)
    if shots.on_plane:
        return shots_figure(groups, title="Hits on the target plane", quantity="Height above the muzzle")
    return shots_figure(groups)
