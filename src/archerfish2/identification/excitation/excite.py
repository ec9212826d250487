"""`excite`: the commands that identify an axis, and how well their logs will determine it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from archerfish2.identification.axis.identify import AxisResult
from archerfish2.identification.excitation.plan import ExcitationSettings, Kind, demand, plan_commands
from archerfish2.identification.excitation.predict import predict
from archerfish2.logs.recording import Recording
from archerfish2.records.limits import AxisLimits
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import new_figure, plot_style
from archerfish2.reports.table import Entry, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENCODER_NOISE = 2 * math.pi / 8192 / math.sqrt(12)
"""Standard deviation of the rounding of an encoder of 8192 counts a turn [rad]."""
_COLUMNS = ("command", "length [s]", "lowest [°]", "highest [°]", "rate [rad/s]", "acceleration [rad/s²]")
_JUMPS = "Steps jump beyond the limits of rate and acceleration: the motor saturates for their first milliseconds."
_NO_STEP = "The steady gain is extrapolated from the lowest frequency: add a step."
_PLAY = "Play column u of each file, log the angle as y under the same name, and identify the folder of these logs."


@dataclass(frozen=True)
class Excitation:
    """Commands for one axis, and what to expect of their logs."""

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
                axes[0, 0].plot(log.time, np.degrees(log.inputs), label=name)
                axes[1, 0].magnitude_spectrum(log.inputs[:, 0] - log.inputs[0], Fs=1 / log.period_s, scale="dB")
            axes[0, 0].set(xlabel="time [s]", ylabel="command [°]")
            axes[1, 0].set(xlabel="frequency [Hz]", ylabel="amplitude [dB re 1 rad]", ylim=(-160, None))
            axes[0, 0].legend()
        return figure

    @property
    def report(self) -> Report:
        """The commands against the limits, and what the identification makes of their simulated logs."""
        limits, found = self.limits, self.expected
        rows: list[tuple[Entry, ...]] = []
        for name, log in self.logs.items():
            moved = demand(log.inputs[:, 0] - log.inputs[0], log.period_s)[1:].tolist()
            moved = moved if moved[1] <= limits.max_acceleration else ["jump", "jump"]
            ends = np.degrees([log.inputs.min(), log.inputs.max()]).tolist()
            rows.append((name, len(log) * log.period_s, *ends, *moved))
        most = (math.degrees(limits.low), math.degrees(limits.high), limits.max_rate, limits.max_acceleration)
        figures = [("steady gain", found.dc_gain[0]), ("delay [samples]", found.delay_samples)]
        for pole in found.poles:
            figures += [("pole [Hz]", pole.frequency_hz), ("its damping", pole.damping)]
        unknown = [
            f"The pole at {pole.frequency_hz.value:.3g} Hz is not determined."
            for pole in found.poles
            if not pole.determined
        ]
        jumps = [_JUMPS] * any("jump" in row for row in rows)
        no_step = [_NO_STEP] * (not any("step" in name for name in self.logs))
        return Report(
            title=f"{found.plant.axis}: commands for its identification",
            headline=f"{len(rows)} commands of {sum(len(log) * log.period_s for log in self.logs.values()):.0f} s in all",
            doubts=(*jumps, *no_step, *unknown),
            next_steps=(_PLAY,),
            tables=(
                Table("Commands", _COLUMNS, (*rows, ("limit", None, *most))),
                Table("Expected", ("", "value"), tuple(figures)),
            ),
            figures=(("Commands and their spectra", self.plot),),
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
      plant: what the axis is taken to be, whose sampling period the commands have; of second order with 10 Hz, a
        damping of 0.7 and a delay of 5 ms, sampled at 1 kHz, if None.
      noise_sd: standard deviation of the measured angle's noise [rad].
      settings: what the commands are made from.
      seed: of noise and identification.

    Raises:
      InputError: if a command does not fit the limits, or logs of them would not determine the plant.
    """
    plant = plant or PlantRecord.second_order(10.0, 0.7, delay_s=5e-3)
    commands = plan_commands(kinds, limits, settings or ExcitationSettings(), plant.sample_period_s, validation)
    named = {f"{axis}_{name}.csv": command for name, command in commands.items()}
    return Excitation(limits, *predict(named, plant, noise_sd, axis, seed))
