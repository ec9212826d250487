"""`excite`: the commands that identify an axis, and how well their logs will determine it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from archerfish2.identification.axis.identify import AxisResult
from archerfish2.identification.excitation.plan import ExcitationSettings, Kind, demand, plan_commands
from archerfish2.identification.excitation.predict import predict
from archerfish2.logs.recording import Recording
from archerfish2.records.limits import AxisLimits
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import new_figure, plot_style
from archerfish2.reports.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENCODER_NOISE = 2 * math.pi / 8192 / math.sqrt(12)
"""Standard deviation of the rounding of an encoder of 8192 counts a turn [rad]."""
_COLUMNS = ("command", "length [s]", "lowest [°]", "highest [°]", "rate [rad/s]", "acceleration [rad/s²]")
_JUMPS = "Steps jump, whatever the limits of rate and acceleration: the motor saturates for their first milliseconds."
_STEPS = "The steady gain is extrapolated by the model from the sweep's lowest frequency: add a step."
_PLAY = "Play column u of each file, log the angle as y under the same name, and identify the folder of these logs."


@dataclass(frozen=True)
class Excitation:
    """Commands for one axis, and what to expect of their logs."""

    axis: str  # "pitch" or "yaw"
    limits: AxisLimits
    logs: dict[str, Recording]  # by file name: the command "u", and the "expected" angle with noise [rad]
    expected: AxisResult  # what the identification makes of them

    def save(self, folder: str | Path) -> None:
        """Write each command to a file.

        Raises:
          InputError: if the folder can't be written.
        """
        for name, log in self.logs.items():
            log.write_csv(Path(folder) / name)

    def plot(self) -> "Figure":
        """Draw the commands and their spectra."""
        with plot_style():
            figure, axes = new_figure(2, 1, height=5.5)
            for name, log in self.logs.items():
                u = np.degrees(log.inputs[:, 0] - log.inputs[0])
                axes[0, 0].plot(log.time, u, label=name)
                axes[1, 0].loglog(np.fft.rfftfreq(len(u), log.period_s)[1:], np.abs(np.fft.rfft(u))[1:] * log.period_s)
            axes[0, 0].set(title=f"{self.axis}: commands about the centre", xlabel="time [s]", ylabel="command [°]")
            axes[1, 0].set(xlabel="frequency [Hz]", ylabel="spectrum [° s]")
            axes[0, 0].legend()
        return figure

    @property
    def report(self) -> Report:
        """The commands against the limits, and what the identification reports on their simulated logs."""
        rows: list[tuple[Any, ...]] = []
        for name, log in self.logs.items():
            _, rate, acceleration = demand(log.inputs[:, 0] - log.inputs[0], log.period_s).tolist()
            moved = (rate, acceleration) if acceleration <= self.limits.max_acceleration else ("jump", "jump")
            ends = np.degrees([log.inputs.min(), log.inputs.max()]).tolist()
            rows.append((name, len(log) * log.period_s, *ends, *moved))
        low, high = np.degrees([self.limits.low, self.limits.high]).tolist()
        doubts = {_JUMPS: any("jump" in row for row in rows), _STEPS: not any("step" in name for name in self.logs)}
        expected, limit = self.expected.report, (self.limits.max_rate, self.limits.max_acceleration)
        return Report(
            title=f"{self.axis}: commands for its identification",
            headline=f"{len(rows)} commands of {sum(row[1] for row in rows):.0f} s; expected: {expected.headline}",
            doubts=(*(text for text, holds in doubts.items() if holds), *expected.doubts),
            next_steps=(_PLAY,),
            tables=(Table("Commands", _COLUMNS, (*rows, ("limit", None, low, high, *limit))), *expected.tables),
            figures=(("Commands and their spectra", self.plot), *expected.figures),
        )


def excite(
    axis: Literal["pitch", "yaw"],
    limits: AxisLimits,
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
      limits: of the axis.
      kinds: signals, a command for each.
      validation: whether there is another command of each kind, to be held back.
      plant: what the axis is taken to be; of second order, 10 Hz, damping 0.7 and 5 ms delay if None.
      noise_sd: standard deviation of the measured angle's noise [rad].
      settings: what the commands are made from; the sampling period is that of `plant`.
      seed: of noise and PRBS.

    Raises:
      InputError: if a command does not fit the limits, or logs of them would not determine the plant.
    """
    settings = settings or ExcitationSettings()
    period_s = plant.sample_period_s if plant else settings.sample_period_s
    plant = plant or PlantRecord.second_order(10.0, 0.7, round(5e-3 / period_s) * period_s, period_s)
    settings = settings.replace(sample_period_s=period_s)
    commands = plan_commands(kinds, limits, settings, validation=validation, seed=seed)
    logs, expected = predict({f"{axis}_{name}.csv": u for name, u in commands.items()}, plant, noise_sd, axis, seed)
    return Excitation(axis, limits, logs, expected)
