"""Logs of strangers, with the truth beside them: rig, fault, length, rate, amplitude, excitation and noise are drawn.

Log number k of a seed is always the same, however many are made. Faults are dealt out in blocks of thirty logs, so that
each has its share: half of the logs carry one.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from strangers_commands import command
from strangers_faults import FAULTS, SHAPED, feedback_run, recorded, with_fault
from strangers_rigs import Rig, draw_rig, families_at, log_uniform, respond

Array = NDArray[np.float64]

NONE = "none"
_BLOCK = 30
_SHAPES = {
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
EXCITATIONS = ("sweep", "step", "early step", "staircase", "held levels", "multisine", "binary")
"""Excitations of a single file that begins at rest."""
RATES_HZ = {50.0: 0.1, 100.0: 0.2, 200.0: 0.25, 500.0: 0.2, 1000.0: 0.25}
"""Sampling rate [Hz] → share of the logs."""
_FEWEST, _MOST, _LONGEST_S = 150, 30_000, 30.0
_LONGEST_DELAY = (15, 0.04)
"""Longest dead time of a usual rig, in samples and in seconds; the shorter one counts."""
WANDERING = "wander"


class File(NamedTuple):
    """What is written to one file, and what it was made from."""

    stamps: Array
    """Column time_s, shape (N,)."""
    inputs: Array
    """Column u, shape (N,)."""
    outputs: Array
    """Column y, shape (N,)."""
    command: Array
    """Command that the rig got, at equal intervals, shape (M,)."""
    answer: Array
    """Output of the rig with its noise and drift, at equal intervals, shape (M,)."""


@dataclass(frozen=True)
class StrangersLog:
    """One log, of one file or two, and how it came about."""

    index: int
    """Its number."""
    rig: Rig
    """The truth; its gain is in the units of the columns."""
    fault: str
    """What is wrong, or "none"."""
    severity: float
    """Size of the fault, in the unit of that fault; 0 without one."""
    excitation: str
    """How the axis was moved."""
    period_s: float
    """True sampling period [s]."""
    amplitude: float
    """Largest command, from rest."""
    noise: float
    """Standard deviation of the noise over that of the clean output."""
    noise_kind: str
    """Kind of noise."""
    text: bool
    """Whether it is written as text."""
    files: tuple[File, ...]
    """Its files."""

    @property
    def samples(self) -> int:
        """Number of samples in all files."""
        return sum(len(each.stamps) for each in self.files)


def make_log(seed: int, index: int) -> StrangersLog:
    """Make one log.

    Args:
      seed: of all logs.
      index: its number.
    """
    generator = np.random.default_rng((seed, index))
    fault = _fault(seed, index)
    rate_hz = float(generator.choice(list(RATES_HZ), p=list(RATES_HZ.values())))
    excitation = SHAPED.get(fault) or str(generator.choice(list(_SHAPES), p=list(_SHAPES.values())))
    rig = _rig(generator, rate_hz, fault)
    amplitude = log_uniform(generator, 0.01, 30.0)
    rig, severity = with_fault(rig, fault, amplitude, 1 / rate_hz, generator)
    log = StrangersLog(index, rig, fault, severity, excitation, 1 / rate_hz, amplitude, 0.0, "", False, ())
    return _recorded(replace(log, text=bool(generator.random() < 0.25)), generator)


def write_log(log: StrangersLog, folder: Path) -> tuple[Path, ...]:
    """Write the files of a log and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, file in enumerate(log.files):
        path = folder / f"log{log.index}_{number}.{'csv' if log.text else 'npz'}"
        if log.text:
            table = np.column_stack([file.stamps, file.inputs, file.outputs])
            np.savetxt(path, table, ["%.6f", "%.7g", "%.7g"], ",", header="time_s,u,y", comments="")
        else:
            np.savez(path, time_s=file.stamps, u=file.inputs, y=file.outputs)
        paths.append(path)
    return tuple(paths)


def _fault(seed: int, index: int) -> str:
    block, place = divmod(index, _BLOCK)
    # A third number, so that no log's own draws are used again.
    dealt = np.random.default_rng((seed, block, 1)).permutation(_BLOCK)[place]
    return FAULTS[dealt] if dealt < len(FAULTS) else NONE


def _rig(generator: np.random.Generator, rate_hz: float, fault: str) -> Rig:
    families = families_at(rate_hz)
    if fault == "friction":
        families = tuple(each for each in families if each in ("second order", "servo", "overdamped"))
    return _usual(generator, rate_hz, families)


def usual_rig(generator: np.random.Generator, rate_hz: float) -> Rig:
    """Draw a linear rig with a usual steady gain and dead time.

    Args:
      generator: source of the draws.
      rate_hz: of the log [Hz].
    """
    return _usual(generator, rate_hz, families_at(rate_hz))


def _usual(generator: np.random.Generator, rate_hz: float, families: tuple[str, ...]) -> Rig:
    rig = draw_rig(generator, rate_hz, str(generator.choice(families)))
    gain = 1.0 if generator.random() < 0.6 else log_uniform(generator, 0.2, 5.0)
    gain *= -1.0 if generator.random() < 0.1 else 1.0
    longest = min(_LONGEST_DELAY[0], int(_LONGEST_DELAY[1] * rate_hz + 1e-9))
    delay = float(generator.integers(0, longest + 1))
    if generator.random() < 0.2:
        delay = round(max(delay - generator.random(), 0.1), 1)
    return replace(rig, gain=gain, delay_s=delay / rate_hz)


def _count(generator: np.random.Generator, rig: Rig, period_s: float) -> int:
    """Draw a number of samples: evenly on a logarithmic scale, the longer ones more often."""
    most = min(_MOST, _LONGEST_S / period_s)
    drawn = _FEWEST * (most / _FEWEST) ** generator.random() ** 0.4
    return int(min(max(drawn, 1.5 * (rig.settle_s + 3 * rig.delay_s) / period_s), most))


def _recorded(log: StrangersLog, generator: np.random.Generator) -> StrangersLog:
    """Run the rig and record it."""
    runs = _runs(log, generator)
    spread = float(np.std(np.concatenate([clean - clean.mean() for _, clean in runs])))
    low, high = (0.1, 0.25) if log.excitation == "small" or generator.random() < 0.05 else (0.001, 0.1)
    noise = log_uniform(generator, low, high)
    if not spread:  # there is nothing but noise
        spread, noise = log.amplitude * abs(log.rig.gain) * log_uniform(generator, 1e-3, 0.1), 1.0
    kind = str(generator.choice(["white", "AR(0.9)", WANDERING], p=[0.5, 0.3, 0.2]))
    zero = generator.uniform(-3, 3) * spread * (generator.random() < 0.5)
    quantum = spread * log_uniform(generator, 1e-4, 0.1) * (generator.random() < 0.3)
    start = float(generator.choice([0.0, round(generator.uniform(0, 1000), 3), 1.7e9], p=[0.6, 0.3, 0.1]))
    files = []
    for given, clean in runs:
        answer = clean + zero + noise * spread * draw_noise(kind, len(clean), generator)
        if quantum:
            answer = quantum * np.round(answer / quantum)
        if log.fault == "drift":
            ramp = np.linspace(0, generator.choice([-1.0, 1.0]), len(clean))
            answer = answer + log.severity * spread * ramp
        columns = recorded(log.fault, log.severity, given, answer, log.period_s, generator)
        stamps = columns.stamps + start * (1000.0 if log.fault == "milliseconds" else 1.0)
        files.append(File(stamps, columns.inputs, columns.outputs, given, answer))
        start += len(given) * log.period_s + 1.0
    peak = max(float(np.abs(given).max()) for given, _ in runs)
    return replace(log, amplitude=peak, noise=noise, noise_kind=kind, files=tuple(files))


def _runs(log: StrangersLog, generator: np.random.Generator) -> list[tuple[Array, Array]]:
    """Return the command and the clean output of each file, at equal intervals, shape (N,) each."""
    rig, period_s = log.rig, log.period_s
    count = _count(generator, rig, period_s)
    if log.fault == "feedback":
        return [feedback_run(rig, count, period_s, log.amplitude, log.severity, generator)]
    shapes = [log.excitation]
    if log.excitation == "sweep and step":
        shapes = ["sweep", "step"]
    elif log.excitation in ("cut out", "small"):
        choice = ("sweep", "held levels", "multisine", "binary") + ("step",) * (log.excitation == "small")
        shapes = [str(generator.choice(choice))]
    before = 0
    if log.excitation == "cut out":
        before = int(generator.uniform(1.0, 4.0) * rig.settle_s / period_s) + 1
    runs = []
    for shape in shapes:
        given = log.amplitude * command(shape, before + count, period_s, rig, generator)
        clean = respond(rig, given, period_s)
        if not rig.responsive:
            other = command("held levels", before + count, period_s, rig, generator)
            clean = log.severity * log.amplitude * respond(replace(rig, responsive=True), other, period_s)
        runs.append((given[before:], clean[before:]))
    return runs


def draw_noise(kind: str, count: int, generator: np.random.Generator) -> Array:
    """Draw noise of standard deviation 1, shape (count,).

    Args:
      kind: "white", "AR(0.9)" or "wander".
      count: samples.
      generator: source of the draws.
    """
    if kind == WANDERING:
        slow = lfilter([1.0], [1.0, -(1 - 5 / (count + 5))], generator.standard_normal(2 * count))[count:]
        wander = slow / max(float(np.std(slow)), 1e-12)
        return np.asarray(0.8 * wander + 0.6 * generator.standard_normal(count))
    memory = 0.9 if kind == "AR(0.9)" else 0.0
    # The recursion's first thousand samples are left out: it begins at rest.
    drawn = generator.standard_normal(count + 1000)
    return np.asarray(lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], drawn)[1000:])
