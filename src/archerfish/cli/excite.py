"""`archerfish excite`: the commands that a team plays to its gimbal, and what their logs will tell."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from archerfish.cli.excite_summary import Summary, excite_summary, print_excite
from archerfish.cli.options import Folder, JsonFile, Switch
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.figures.excitation import CommandRun, ResponseBand, excitation_figure
from archerfish.figures.style import save_figure
from archerfish.identification.excitation.experiment_design import ExperimentPrediction, predict_experiment
from archerfish.identification.excitation.parallel_sections import second_order_plant
from archerfish.identification.excitation.plan import ExcitationSettings, Kind, PlannedLog, plan_logs
from archerfish.paper.gimbal import gate_limits
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits, read_limits
from archerfish.records.plant import PlantRecord, read_plant

_PICTURE = "excitation"

_Unset = tyro.conf.arg(metavar="VALUE", help_behavior_hint="(default: of the limits)")
_NoFile = tyro.conf.arg(metavar="FILE", help_behavior_hint="")


@dataclass(frozen=True)
class Excite:
    """Write the commands to play for an identification, and foretell their outcome.

    Each signal is a file of its own with the columns time_s and u, the commanded angle in radians, that begins and ends
    at rest at the centre angle. Sweep, multisine and PRBS are as large as the limits allow, or as asked; their
    amplitude falls with frequency where rate or acceleration would pass the limits. The foretold intervals are for an
    axis that is what --plant says, or of second order.

    Writes AXIS_KIND_command.csv for each signal, AXIS_validation_command.csv (a step to hold back for --validate), and
    AXIS_excitation.svg and .png.

    Examples:
      archerfish excite --axis yaw --out runs/my-robot
      archerfish excite --axis pitch --kinds multisine step --amplitude-deg 1 --limits limits.json
    """

    axis: Annotated[str, tyro.conf.arg(metavar="NAME")] = "yaw"
    """Axis: pitch or yaw, whose limits are taken, and the beginning of the files' names."""
    kinds: tuple[Kind, ...] = ("sweep", "step")
    """Signals, each a log of its own."""
    validation: Switch = True
    """Do without the step that is held back."""
    duration_s: float = ExcitationSettings.duration_s
    """Length of sweep, multisine and PRBS in seconds."""
    low_hz: float = ExcitationSettings.low_hz
    """Lowest frequency."""
    high_hz: float = ExcitationSettings.high_hz
    """Highest frequency."""
    period_s: float = ExcitationSettings.period_s
    """Period of multisine and PRBS in seconds."""
    amplitude_deg: Annotated[
        float | None, tyro.conf.arg(metavar="DEGREES", help_behavior_hint="(default: as large as may be)")
    ] = None
    """Largest distance of sweep, multisine and PRBS from the centre."""
    step_deg: float = 3.0
    """Size of the steps in degrees."""
    hold_s: float = ExcitationSettings.hold_s
    """How long a step is held, in seconds."""
    slew_steps: bool = False
    """Keep the steps too within the limits of rate and acceleration."""
    settle_s: float = ExcitationSettings.settle_s
    """Rest at the centre before and after each signal, in seconds."""
    centre_deg: Annotated[
        float | None, tyro.conf.arg(metavar="DEGREES", help_behavior_hint="(default: the middle of the travel)")
    ] = None
    """Angle about which the axis is moved."""
    limits: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: GM6020 motors)")] = None
    """Limits record of the robot; the options below may narrow it."""
    low_deg: Annotated[float | None, _Unset] = None
    """Smallest angle in degrees."""
    high_deg: Annotated[float | None, _Unset] = None
    """Largest angle in degrees."""
    max_rate: Annotated[float | None, _Unset] = None
    """Largest rate of the command in rad/s."""
    max_acceleration: Annotated[float | None, _Unset] = None
    """Largest acceleration of the command in rad/s²."""
    limit_share: float = ExcitationSettings.limit_share
    """Share of travel, rate and acceleration that is used."""
    sample_period_s: Annotated[
        float | None, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="(default: the plant's, or 0.001)")
    ] = None
    """Sampling period of the commands and of the logs."""
    plant: Annotated[Path | None, _NoFile] = None
    """Plant record of the axis, from an earlier identification, for the prediction."""
    bandwidth_hz: float = 10.0
    """Natural frequency of the axis for the prediction without --plant."""
    damping: float = 0.7
    """Its damping."""
    delay_ms: float = 5.0
    """Its input delay in milliseconds."""
    noise_deg: float = 0.013
    """Standard deviation of the measured angle's noise, in degrees; the default is an encoder's of 8192 counts."""
    out: Folder = Path("runs/excite")
    """Folder for the commands and the pictures."""
    seed: int = 0
    """Of the multisine's phases and the PRBS' start."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed, and the expected frequency response, to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        kinds = (*dict.fromkeys(self.kinds), *(("validation",) if self.validation else ()))
        names = (*(f"{kind}_command.csv" for kind in kinds), f"{_PICTURE}.svg", f"{_PICTURE}.png")
        return Outputs(tuple(self.out / f"{self.axis}_{name}" for name in names))


def run_excite(command: Excite, console: Console | None = None) -> Summary:
    """Plan the commands, write them and the picture, print the summary, and return what --json writes.

    Raises:
      InputError: if an option, a file or the output folder can't be used, or a signal does not fit the limits.
    """
    console = console or Console()
    check_file_name("--axis", command.axis)
    limits = _axis_limits(command)
    centre = 0.5 * (limits.low + limits.high) if command.centre_deg is None else float(np.radians(command.centre_deg))
    plant, assumed = _plant(command)
    settings, noise_sd = _settings(command, plant.sample_period_s), float(np.radians(command.noise_deg))
    logs = plan_logs(tuple(dict.fromkeys(command.kinds)), settings, limits, centre, validation=command.validation)
    fitted = [log.command for log in logs if not log.held_back]
    band = (command.low_hz, command.high_hz)
    prediction = predict_experiment(fitted, plant, noise_sd, band)
    names = [f"{command.axis}_{log.name}_command.csv" for log in logs]
    pictures = [f"{command.axis}_{_PICTURE}{ending}" for ending in (".svg", ".png")]
    with run_folder(command.out, make_writer(command)) as folder:
        for name, log in zip(names, logs, strict=True):
            _write_command(folder / name, log, settings.sample_period_s)
        figure = excitation_figure(
            [CommandRun(log.name, log.command) for log in logs],
            settings.sample_period_s,
            band,
            _response_band(prediction),
            title=command.axis,
        )
        for name in pictures:
            save_figure(folder / name, figure)
    summary = excite_summary(
        command.axis,
        logs,
        prediction,
        limits,
        assumed=assumed,
        noise_sd=noise_sd,
        sample_period_s=settings.sample_period_s,
        band_hz=band,
        files=[command.out / name for name in (*names, *pictures)],
    )
    print_excite(console, summary)
    return summary


def _settings(command: Excite, sample_period_s: float) -> ExcitationSettings:
    amplitude = None if command.amplitude_deg is None else float(np.radians(command.amplitude_deg))
    return ExcitationSettings(
        sample_period_s=sample_period_s,
        duration_s=command.duration_s,
        low_hz=command.low_hz,
        high_hz=command.high_hz,
        amplitude=amplitude,
        period_s=command.period_s,
        step=float(np.radians(command.step_deg)),
        hold_s=command.hold_s,
        slew_steps=command.slew_steps,
        settle_s=command.settle_s,
        limit_share=command.limit_share,
        seed=command.seed,
    )


def _axis_limits(command: Excite) -> AxisLimits:
    record = gate_limits() if command.limits is None else read_limits(command.limits)
    if command.axis not in ("pitch", "yaw"):
        raise InputError(f"--axis must be pitch or yaw, whose limits are known, got {command.axis!r}")
    whole: AxisLimits = getattr(record, command.axis)
    given = {
        "low": None if command.low_deg is None else float(np.radians(command.low_deg)),
        "high": None if command.high_deg is None else float(np.radians(command.high_deg)),
        "max_rate": command.max_rate,
        "max_acceleration": command.max_acceleration,
    }
    limits = replace(whole, **{name: value for name, value in given.items() if value is not None})
    wider = limits.low < whole.low or any(
        getattr(limits, name) > getattr(whole, name) for name in ("high", "max_rate", "max_acceleration")
    )
    if wider and command.limits is not None:
        raise InputError(
            f"{command.limits}: --low-deg, --high-deg, --max-rate and --max-acceleration may only narrow the record's "
            "limits; change the record if the robot can do more"
        )
    return limits


def _plant(command: Excite) -> tuple[PlantRecord, str]:
    """Return what the axis is taken to be, and that in words."""
    if command.plant is None:
        period = 1e-3 if command.sample_period_s is None else command.sample_period_s
        if not 0 < period < np.inf:
            raise InputError(f"--sample-period-s must be > 0, got {period:g}")
        plant = second_order_plant(command.bandwidth_hz, command.damping, 1e-3 * command.delay_ms, period)
        return plant, f"of order 2, {command.bandwidth_hz:g} Hz, damping {command.damping:g} (assumed)"
    plant = read_plant(command.plant)
    if command.sample_period_s not in (None, plant.sample_period_s):
        raise InputError(
            f"{command.plant}: is sampled every {plant.sample_period_s:g} s, --sample-period-s says "
            f"{command.sample_period_s:g} s; leave the option out"
        )
    return plant, f"as {command.plant.name} says"


def _write_command(path: Path, log: PlannedLog, sample_period_s: float) -> None:
    rows = (f"{round(index * sample_period_s, 9)!r},{float(angle)!r}" for index, angle in enumerate(log.command))
    storage.write_text(path, "\n".join(["time_s,u", *rows]) + "\n")


def _response_band(prediction: ExperimentPrediction) -> ResponseBand:
    bode, (low, high) = prediction.bode, prediction.known_band_hz
    shown = (bode.frequency_hz >= low) & (bode.frequency_hz <= high)
    return ResponseBand(bode.frequency_hz, bode.gain, bode.gain_half_width, bode.phase, bode.phase_half_width, shown)
