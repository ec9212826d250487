"""Logs as strangers record them, of known truth: rig, fault, length, rate, amplitude, excitation and noise are drawn.

Log number k of a seed is always the same, however many are made. Faults are dealt out in blocks of thirty logs, so that
each has its share: half of the logs have one. A plant is usable if its held-back fit is at least 80 % and its steady
gain is right within 5 %.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from archerfish.errors import InputError
from archerfish.identification.simulation import free_run
from archerfish.records.plant import PlantRecord
from rigs import (
    COMMANDS,
    RATES_HZ,
    Array,
    Drawn,
    Rig,
    Rng,
    draw_noise,
    held_steps,
    log_uniform,
    modes,
    respond,
    sum_of_sines,
    usual_rig,
)
from rigs import FAMILIES as ALL

NONE, BLOCK = "none", 30
FAULTS = (
    "swapped columns",
    "milliseconds",
    "single sine",
    "slew",
    "saturation",
    "dead zone",
    "backlash",
    "friction",
    "long delay",
    "feedback",
    "integrating",
    "no response",
    "uneven stamps",
    "mixed units",
    "drift",
)
SHAPED = {"single sine": "sine", "feedback": "feedback"}  # fault → excitation that it brings with it
SHAPES = {
    "sweep": 0.14,
    "step": 0.12,
    "early step": 0.08,
    "staircase": 0.1,
    "held levels": 0.12,
    "multisine": 0.1,
    "binary": 0.1,
    "sweep and step": 0.1,
    "cut out": 0.08,
    "small": 0.06,
}
"""Excitation → share of the logs."""
SEVERITY = {
    "slew": (0.02, 2.0),
    "saturation": (0.25, 0.98),
    "dead zone": (0.01, 0.5),
    "backlash": (0.005, 0.5),
    "friction": (0.005, 0.5),
    "feedback": (0.05, 3.0),
    "drift": (0.05, 5.0),
    "uneven stamps": (0.01, 0.5),
}
"""Fault → mildest and most severe. The time of a full slew in settling times; limit, dead zone, play and friction as a
share of the amplitude; disturbance over set point; drift over the log, and the stamps' errors, in standard deviations
of the output and in periods. Besides: the samples of a long delay, the factor between mixed units, and where nothing
responds 1 for the motion of another axis and 0 for noise alone."""
_FEWEST, _MOST, _LONGEST_S, _DEGREES = 150, 30_000, 30.0, 180 / np.pi
GAIN_SHARE = 0.05  # by which a steady gain may be off
_OTHER_UNIT = 30.0  # factor between the periods of plant and log beyond which time was taken in another unit
_SINES, _STEPS, _MOST_LEVELS, _WORST_FIT = 14, 10, 12, -1000.0


class File(NamedTuple):
    """What is written to one file, and what it was made from."""

    stamps: Array  # column time_s, (N,)
    inputs: Array  # column u, (N,)
    outputs: Array  # column y, (N,)
    command: Array  # that the rig got, at equal intervals, (M,)


@dataclass(frozen=True)
class StrangerLog:
    """One log, of one file or two, and how it was made."""

    index: int
    rig: Rig  # the truth, its gain in the units of the columns
    fault: str  # what is wrong, or "none"
    severity: float  # of the fault, in a unit of its own; 0 without one
    excitation: str  # how the axis was moved
    period_s: float  # true sampling period
    amplitude: float  # largest command, from rest
    noise: float = 0.0  # standard deviation over that of the clean output
    noise_kind: str = ""
    text: bool = False  # whether it is written as text
    files: tuple[File, ...] = ()


def make_log(seed: int, index: int) -> StrangerLog:
    """Make one log.

    Args:
      seed: of all logs.
      index: its number.
    """
    rng = np.random.default_rng((seed, index))
    block, place = divmod(index, BLOCK)
    dealt = int(np.random.default_rng((seed, block, 1)).permutation(BLOCK)[place])
    fault = FAULTS[dealt] if dealt < len(FAULTS) else NONE
    rate_hz = float(rng.choice(list(RATES_HZ), p=list(RATES_HZ.values())))
    excitation = SHAPED.get(fault) or str(rng.choice(list(SHAPES), p=list(SHAPES.values())))
    rig = usual_rig(rng, rate_hz, ("second order", "servo", "overdamped") if fault == "friction" else ALL)
    amplitude = log_uniform(rng, 0.01, 30.0)
    rig, severity = _with_fault(rig, fault, amplitude, 1 / rate_hz, rng)
    log = StrangerLog(index, rig, fault, severity, excitation, 1 / rate_hz, amplitude)
    return _recorded(replace(log, text=bool(rng.random() < 0.25)), rng)


def write_log(log: StrangerLog, folder: Path) -> tuple[Path, ...]:
    """Write the files of a log and return their paths."""
    paths = [folder / f"log{log.index}_{k}.{'csv' if log.text else 'npz'}" for k in range(len(log.files))]
    for path, file in zip(paths, log.files, strict=True):
        if log.text:
            table = np.column_stack([file.stamps, file.inputs, file.outputs])
            np.savetxt(path, table, ["%.6f", "%.7g", "%.7g"], ",", header="time_s,u,y", comments="")
        else:
            np.savez(path, time_s=file.stamps, u=file.inputs, y=file.outputs)
    return tuple(paths)


def _with_fault(rig: Rig, fault: str, amplitude: float, period_s: float, rng: Rng) -> tuple[Rig, float]:
    """Give a rig the fault that is in the axis itself, and draw how severe a fault is."""
    severity = log_uniform(rng, *SEVERITY[fault]) if fault in SEVERITY else 0.0
    if fault == "slew":
        return replace(rig, slew=amplitude / (severity * rig.settle_s)), severity
    if fault == "saturation":
        return replace(rig, limit=amplitude * severity), severity
    if fault == "dead zone":
        return replace(rig, dead_zone=amplitude * severity), severity
    if fault == "backlash":
        return replace(rig, backlash=amplitude * abs(rig.gain) * severity), severity
    if fault == "friction":
        friction = amplitude * severity
        return replace(rig, friction=friction, stiction=friction * rng.uniform(1.0, 1.6)), severity
    if fault == "long delay":
        samples = int(rng.integers(21, 81))
        return replace(rig, delay_s=samples * period_s), float(samples)
    if fault == "integrating":
        return replace(rig, integrating=True, gain=rig.gain * 2 * np.pi * rig.bandwidth_hz), 0.0
    if fault == "no response":
        return replace(rig, responsive=False), float(rng.integers(0, 2))
    if fault == "mixed units":
        factor = _DEGREES if rng.random() < 0.75 else 1 / _DEGREES
        return replace(rig, gain=rig.gain * factor), factor
    return rig, severity


def _recorded(log: StrangerLog, rng: Rng) -> StrangerLog:
    """Run the rig and record it."""
    runs = _runs(log, rng)
    spread = float(np.std(np.concatenate([clean - clean.mean() for _, clean in runs])))
    low, high = (0.1, 0.25) if log.excitation == "small" or rng.random() < 0.05 else (0.001, 0.1)
    noise = log_uniform(rng, low, high)
    if not spread:  # there is nothing but noise
        spread, noise = log.amplitude * abs(log.rig.gain) * log_uniform(rng, 1e-3, 0.1), 1.0
    kind = str(rng.choice(["white", "AR(0.9)", "wander"], p=[0.5, 0.3, 0.2]))
    zero = rng.uniform(-3, 3) * spread * (rng.random() < 0.5)
    quantum = spread * log_uniform(rng, 1e-4, 0.1) * (rng.random() < 0.3)
    start = float(rng.choice([0.0, round(rng.uniform(0, 1000), 3), 1.7e9], p=[0.6, 0.3, 0.1]))
    files = []
    for given, clean in runs:
        measured = clean + zero + noise * spread * draw_noise(kind, len(clean), rng)
        if quantum:
            measured = quantum * np.round(measured / quantum)
        if log.fault == "drift":
            measured = measured + log.severity * spread * np.linspace(0, rng.choice([-1.0, 1.0]), len(clean))
        stamps = log.period_s * np.arange(len(given), dtype=np.float64)
        columns: tuple[Array, ...] = (stamps, given, measured)
        if log.fault == "swapped columns":
            columns = (stamps, measured, given)
        if log.fault == "uneven stamps":
            columns = _uneven(columns, log.severity, log.period_s, rng)
        (stamps, inputs, outputs), unit = columns, 1000.0 if log.fault == "milliseconds" else 1.0
        files.append(File(unit * stamps + start * unit, inputs, outputs, given))
        start += len(given) * log.period_s + 1.0
    peak = max(float(np.abs(given).max()) for given, _ in runs)
    return replace(log, amplitude=peak, noise=noise, noise_kind=kind, files=tuple(files))


def _runs(log: StrangerLog, rng: Rng) -> list[tuple[Array, Array]]:
    """Return the command and the clean output of each file, at equal intervals, shape (N,) each."""
    rig, period_s = log.rig, log.period_s
    most = min(_MOST, _LONGEST_S / period_s)
    drawn = _FEWEST * (most / _FEWEST) ** rng.random() ** 0.4
    count = int(min(max(drawn, 1.5 * (rig.settle_s + 3 * rig.delay_s) / period_s), most))
    if log.fault == "feedback":
        return [_feedback_run(rig, count, period_s, log.amplitude, log.severity, rng)]
    shapes, before = [log.excitation], 0
    if log.excitation == "sweep and step":
        shapes = ["sweep", "step"]
    elif log.excitation in ("cut out", "small"):
        choice = ("sweep", "held levels", "multisine", "binary") + ("step",) * (log.excitation == "small")
        shapes = [str(rng.choice(choice))]
    if log.excitation == "cut out":
        before = int(rng.uniform(1.0, 4.0) * rig.settle_s / period_s) + 1
    runs = []
    for shape in shapes:
        given = log.amplitude * COMMANDS[shape](Drawn(before + count, period_s, rig, rng))
        clean = respond(rig, given, period_s)
        if not rig.responsive:
            other = COMMANDS["held levels"](Drawn(before + count, period_s, rig, rng))
            clean = log.severity * log.amplitude * respond(replace(rig, responsive=True), other, period_s)
        runs.append((given[before:], clean[before:]))
    return runs


def _feedback_run(
    rig: Rig, count: int, period_s: float, amplitude: float, disturbance: float, rng: Rng
) -> tuple[Array, Array]:
    """Run a linear rig in a loop that holds set points against a disturbance; the controller's output is the command.

    The disturbance is in standard deviations of the set point.
    """
    target = amplitude * rig.gain * COMMANDS["held levels"](Drawn(count, period_s, rig, rng))
    memory = np.exp(-2 * np.pi * rig.bandwidth_hz * period_s * log_uniform(rng, 0.2, 2.0))
    pushed = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(count))
    pushed *= disturbance * float(np.std(target))
    rates, weights = modes(rig)
    late, older, newer = held_steps(rates, weights, rig.delay_s, period_s)
    kept, state = np.exp(rates * period_s), np.zeros(len(rates), complex)
    lag_s = rig.delay_s + 0.25 * rig.settle_s + 0.5 / rig.bandwidth_hz / np.pi
    proportional, integral = 0.15 / rig.gain, 0.3 * period_s / (rig.gain * lag_s)
    commands, outputs, summed = np.zeros(count + late + 1), np.zeros(count), 0.0
    for index in range(count):
        outputs[index] = state.sum().real + pushed[index]
        error = target[index] - outputs[index]
        summed += integral * error
        commands[index + late + 1] = summed + proportional * error
        state = kept * state + newer * commands[index + 1] + older * commands[index]
    return commands[late + 1 :], outputs


def _uneven(columns: tuple[Array, ...], severity: float, period_s: float, rng: Rng) -> tuple[Array, ...]:
    """Stamp samples when they arrive at a host, and lose some of them."""
    stamps, count = columns[0], len(columns[0])
    kind, kept = str(rng.choice(["late", "lost", "gaps", "all"])), np.ones(count, bool)
    if kind in ("late", "all"):
        # In order: a sample that comes late holds up those behind it, at least 0.02 periods apart.
        least = 0.02 * stamps
        stamps = least + np.maximum.accumulate(stamps - least + severity * period_s * rng.standard_exponential(count))
    if kind in ("lost", "all"):
        kept &= rng.random(count) >= 0.1 * severity
    if kind in ("gaps", "all"):
        for _ in range(int(rng.integers(1, 4))):
            begin = int(rng.integers(count // 10, count - count // 10))
            kept[begin : begin + int(rng.integers(5, max(count // 8, 6)))] = False
    return tuple(each[kept] for each in (stamps, *columns[1:]))


def held_back(log: StrangerLog, period_s: float) -> tuple[Array, Array]:
    """Return command and clean output of a log that is not fitted, from rest, shape (N,) each.

    Levels that are held until the axis rests, then sines through the band, at the amplitude of the fitted log. Where
    the fitted log only steps, by the same height each time, and the axis is not linear, the held-back log has such
    steps, too: what larger and smaller moves do is nowhere in the fitted one.

    Args:
      log: the log that was fitted.
      period_s: sampling period [s].
    """
    levels = None if log.rig.linear else _levels(log)
    given = _moves(log, period_s) if levels is None else _steps(log, levels, period_s)
    return given, respond(log.rig, given, period_s)


def _moves(log: StrangerLog, period_s: float) -> Array:
    settle_s = log.rig.settle_s + log.rig.delay_s
    spans = np.ceil(settle_s * np.array([0.25, 1.5, 1.5, 1.5, 1.5]) / period_s).astype(int)
    band = log.rig.bandwidth_hz * np.geomspace(0.1, 2.5, _SINES)
    count = int(np.ceil(10.0 / log.rig.bandwidth_hz / period_s))
    sines = sum_of_sines(count, period_s, band[band < 0.4 / period_s], np.random.default_rng(log.index))
    return np.asarray(log.amplitude * np.concatenate([np.repeat([0.0, 1.0, -1.0, 0.5, 0.0], spans), sines]))


def _levels(log: StrangerLog) -> Array | None:
    """Return the levels between which a log steps, rising, if it does nothing else than steps of one height."""
    levels = np.unique(np.concatenate([each.command for each in log.files]))
    if not 1 < levels.size <= _MOST_LEVELS:
        return None
    heights = np.concatenate([np.abs(np.diff(each.command)) for each in log.files])
    heights = heights[heights > 0]
    return levels if heights.size and np.ptp(heights) < 1e-6 * heights.max() else None


def _steps(log: StrangerLog, levels: Array, period_s: float) -> Array:
    """Step up and down between neighbouring levels, after times of which some are too short to settle."""
    rng = np.random.default_rng(log.index)
    settle = (log.rig.settle_s + log.rig.delay_s) / period_s
    spans = np.ceil(settle * rng.uniform(0.4, 1.6, _STEPS)).astype(int)
    at, places = int(np.argmin(np.abs(levels))), []
    for _ in range(_STEPS):
        places.append(at)
        at = int(rng.choice([each for each in (at - 1, at + 1) if 0 <= each < levels.size]))
    return np.concatenate([np.zeros(int(np.ceil(0.25 * settle))), np.repeat(levels[places], spans)])


def judge(log: StrangerLog, plant: PlantRecord) -> tuple[float, bool]:
    """Return a plant's fit of the held-back log [%] and whether its steady gain is right.

    The fit is 0 where the axis does not respond or time has another unit.
    """
    rig = log.rig
    if not (rig.responsive and 1 / _OTHER_UNIT < plant.sample_period_s / log.period_s < _OTHER_UNIT):
        return 0.0, False
    given, clean = held_back(log, plant.sample_period_s)
    fit = float(free_run(plant, given[:, None], clean[:, None], np.zeros(1)).fit_percent[0])
    try:
        gain = float(plant.dc_gain.item())
    except InputError:
        gain = np.inf
    # A dead zone and a limit change the steady gain; with friction or play the axis comes to rest anywhere between two.
    inner = max(min(log.amplitude, rig.limit) - rig.dead_zone, 0.0)
    held = min(rig.stiction + rig.backlash / abs(rig.gain), inner)
    low, high = sorted(abs(rig.gain * (inner + side * held) / log.amplitude) for side in (-1, 1))
    right = gain * rig.gain > 0 and (1 - GAIN_SHARE) * low <= abs(gain) <= (1 + GAIN_SHARE) * high
    return max(fit, _WORST_FIT) if np.isfinite(fit) else _WORST_FIT, bool(right and not rig.integrating)
