"""`archerfish identify axis`: the plant of one axis from its logs."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.identification.axis.identify import identify_axis
from archerfish.logs.log import Unit, read_log
from archerfish.records.json_files import plain, write_json


@dataclass(frozen=True)
class IdentifyAxis(Writes):
    """Identify the plant of one axis: what the gimbal does with a command.

    - prints what is known of the axis, how sure that is, whether it is usable, and what to record next
    - writes AXIS.json (the plant with draws), AXIS.html (plots and tables), AXIS_report.json and run.json

    Logs are CSV and other tables, JSON, .npz, .mat and ROS bags. A signal is the name of a column, its number from
    1 on in a table without names, of an array ("x[0]": a column of a matrix), or /topic/field of a bag.

    Examples:
      archerfish identify axis sweep.csv step.csv --validate step_2.csv --axis pitch --out my-robot
      archerfish identify axis log.mcap --input /command/yaw --output /joint_states/yaw/position
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, shown("LOG…")]
    """Logs that the plant is fitted to, in which the input moves the axis: sweeps, steps, driving."""
    validate: Annotated[tuple[Path, ...], shown("LOG…")] = ()
    """Logs that are held back: the order is chosen, and the plant judged, by how they are predicted."""
    axis: str = "axis"
    """Name of the axis: pitch, yaw, or another."""
    input: tuple[str, ...] = ("u",)
    """Signals that move the axis; after a minus, with changed sign (--input=-u)."""
    output: tuple[str, ...] = ("y",)
    """Signals in which the axis responds; after a minus, with changed sign (--output=-y)."""
    time: str = "time_s"
    """Stamps, in seconds or in the unit that the name ends with (time_ms)."""
    input_unit: Annotated[Unit | None, shown("rad|deg")] = None
    """Of the inputs; degrees are turned into radians."""
    output_unit: Annotated[Unit | None, shown("rad|deg")] = None
    """Of the outputs; degrees are turned into radians."""
    sample_period_s: Annotated[float | None, shown("SECONDS")] = None
    """Time between rows, of logs without stamps."""
    order: Annotated[int | None, shown("NUMBER")] = None
    """Number of poles; chosen from 1 to 8 if not given."""
    max_delay: Annotated[int | None, shown("SAMPLES")] = None
    """Largest input delay in samples; found if not given."""
    dc_gain: Annotated[tuple[float, ...], shown("NUMBER…")] = ()
    """Steady output per steady input that the plant is to have, if it is known."""
    no_feedthrough: Annotated[bool, shown()] = False
    """Leave no plant the possibility to respond within a sample, as none with inertia does."""
    seed: int = 0
    """Of the draws."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/identify")
    """Folder for what is written."""

    def run(self, options: str = "") -> Ending:
        """Read, identify, write; `options` are as typed, for run.json."""
        read = partial(
            read_log,
            inputs=self.input,
            outputs=self.output,
            time=self.time,
            sample_period_s=self.sample_period_s,
            input_unit=self.input_unit,
            output_unit=self.output_unit,
        )
        logs, held_back = ([read(each) for each in group] for group in (self.logs, self.validate))
        names = (f"{self.axis}.json", f"{self.axis}.html", f"{self.axis}_report.json")
        inputs = (*self.logs, *self.validate)
        with self.written(self.out, f"identify axis {self.axis}", options, inputs, names) as folder:
            found = identify_axis(
                logs,
                validate=held_back,
                axis=self.axis,
                order=self.order,
                max_delay=self.max_delay,
                feedthrough=not self.no_feedthrough,
                dc_gain=self.dc_gain or None,
                seed=self.seed,
            )
            found.save(folder)
            write_json(folder / names[-1], plain(found.report.to_dict()))
        other = "yaw" if self.axis == "pitch" else "pitch"
        then = f"archerfish identify axis LOGS --axis {other} --out {self.out}"
        if (self.out / f"{other}.json").exists():
            then = f"archerfish train {self.out}"
        where = f"open {self.out / self.axis}.html; the plant is in {self.out / self.axis}.json"
        return Ending(f"{found}", where, then)
