"""`excite`: the commands that identify an axis, and what their logs would give.

The prediction simulates the logs and runs the identification on them, so that its intervals are the tool's own.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from archerfish2.errors import InputError, file_error
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.excitation.plan import ExcitationSettings, Kind, demand, plan_command
from archerfish2.identification.simulation import simulate
from archerfish2.logs.recording import Recording
from archerfish2.paper.gimbal import gate_limits
from archerfish2.records.limits import AxisLimits
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import Figure, new_figure, plot_style
from archerfish2.reports.table import Entry, Table

ENCODER_NOISE = 2 * math.pi / 8192 / math.sqrt(12)
"""Standard deviation of the rounding of an encoder of 8192 counts a turn [rad]."""
_COLUMNS = ("command", "length [s]", "lowest [°]", "highest [°]", "rate [°/s]", "acceleration [°/s²]")
_JUMPS = "Steps jump beyond the limits: the motor saturates for their first milliseconds (--slew-steps keeps them)."


@dataclass(frozen=True, eq=False)
class Excitation:
    """Commands for one axis, and what to expect of their logs."""

    limits: AxisLimits
    logs: dict[str, Recording]  # by file name: the command "u", and the "expected" angle with noise [rad]
    expected: AxisResult  # what the identification makes of them

    def __repr__(self) -> str:
        return str(self.report)

    def save(self, folder: str | Path) -> None:
        """Write each command to a file, with the expected angle beside it.

        Raises:
          InputError: if the folder can't be written, or has a file of that name, which may be a log.
        """
        paths = {Path(folder) / name: log for name, log in self.logs.items()}
        for path in filter(Path.exists, paths):
            raise file_error(path, "is there already, and may be a log", "move it, or save into another folder")
        for path, log in paths.items():
            log.write_csv(path)

    def plot(self) -> Figure:
        """Draw the commands."""
        with plot_style():
            figure, ((panel,),) = new_figure()
            for name, log in self.logs.items():
                panel.plot(log.time, np.degrees(log.inputs[:, 0]), label=name)
            panel.set(xlabel="time [s]", ylabel="command [°]")
            panel.legend()
        return figure

    @property
    def report(self) -> Report:
        """The commands, and what the identification reports of their simulated logs."""
        found, limits, rows = self.expected.report, self.limits, list[tuple[Entry, ...]]()
        for name, log in self.logs.items():
            u = np.degrees(log.inputs[:, 0])
            moved = demand(u - u[0], log.period_s)[1:].tolist()
            jumps = moved[1] > np.degrees(limits.max_acceleration)
            rows.append((name, len(log) * log.period_s, u.min(), u.max(), *(["jump"] * 2 if jumps else moved)))
        most = np.degrees([limits.low, limits.high, limits.max_rate, limits.max_acceleration]).tolist()
        jumping, start, every = any("jump" in row for row in rows), f"{u[0]:.3g}°", f"{1e3 * log.period_s:g} ms"
        steps = (
            f"Bring the axis to {start}, its centre, and play u [rad] of each file, a value every {every}.",
            f"Log time_s, u and the angle y [rad] side by side, into files of the same names, as logs/{rows[0][0]}.",
            "Then: archerfish2 identify logs --out my-robot",
        )
        return Report(
            f"{self.expected.record.axis}: commands for its identification",
            f"expected of their logs: {found.headline}",
            known=found.known,
            doubts=(*[_JUMPS] * jumping, *found.reasons, *found.doubts),
            next_steps=(*steps, *found.next_steps),
            tables=(Table("Commands", _COLUMNS, (*rows, ("limit", None, *most))), *found.tables[:2]),
            figures=(("Commands", self.plot), *found.figures),
        )


def excite(
    axis: Literal["pitch", "yaw"],
    limits: AxisLimits | None = None,
    *,
    kinds: Sequence[Kind] = ("sweep", "step"),
    validation: bool = True,
    plant: PlantRecord | None = None,
    noise_sd: float = ENCODER_NOISE,
    settings: ExcitationSettings | None = None,
    seed: int = 0,
) -> Excitation:
    """Plan the commands that identify an axis, and predict what their logs will give.

    Args:
      axis: names the files.
      limits: of the axis; those of a gimbal of GM6020 motors if None.
      kinds: signals, a command for each.
      validation: whether there is another command of each kind, to be held back.
      plant: what the axis is taken to be, of one input and one output, whose sampling period the commands have; of
        second order with 10 Hz, a damping of 0.7 and a delay of 5 ms if None.
      noise_sd: standard deviation of the measured angle's noise [rad].
      settings: what the commands are made from.
      seed: of noise and identification.

    Raises:
      InputError: if a command does not fit the limits, or logs of them would not determine a plant.
    """
    rng, settings = np.random.default_rng(seed), settings or ExcitationSettings()
    limits = limits or getattr(gate_limits(), axis)
    period_s = plant.sample_period_s if plant else settings.sample_period_s
    plant = plant or PlantRecord.second_order(10.0, 0.7, round(5e-3 / period_s) * period_s, period_s)
    if plant.D.shape != (1, 1) or not 0 <= noise_sd < math.inf:
        found = f"a plant of shape {plant.D.shape} and noise_sd {noise_sd:g}"
        raise InputError(f"excite: {found}, expected shape (1, 1) and noise_sd ≥ 0; change --plant, --noise-deg")
    logs: tuple[list[Recording], list[Recording]] = [], []
    for held_back, group in enumerate(logs[: 1 + validation]):
        for kind in kinds:
            u = plan_command(kind, limits, settings, period_s, bool(held_back))[:, None]
            y = u[0] @ plant.dc_gain.T + simulate(plant, u - u[0]) + noise_sd * rng.standard_normal(u.shape)
            source = f"{axis}_{kind}{'_validation' * held_back}.csv"
            group.append(Recording.from_arrays(u, y, period_s, output_names=("expected",), source=source))
    expected = identify_axis(logs[False], validate=logs[True], axis=axis, order=len(plant.A), seed=seed)
    return Excitation(limits, {each.source: each for each in (*logs[False], *logs[True])}, expected)
