"""What is wrong with the logs of strangers: in the axis, in how it was moved, and in how it was recorded."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from strangers_commands import command
from strangers_rigs import Rig, held_steps, log_uniform, modes

Array = NDArray[np.float64]

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
SHAPED = {"single sine": "sine", "feedback": "feedback"}
"""Fault → excitation that it brings with it."""
BEYOND_USE = ("swapped columns", "milliseconds", "single sine")
"""Faults of logs that are rightly refused: columns that hold something else than their names say, and a single
frequency, which tells two numbers and never of which plant."""
_DEGREES = 180 / np.pi
_CLOSEST = 0.02
"""Shortest interval between the stamps of samples that come at once, in periods."""


class Columns(NamedTuple):
    """The columns of a file, shape (N,) each."""

    stamps: Array
    """Time since the first sample, in seconds unless the fault says otherwise."""
    inputs: Array
    """Column of the input."""
    outputs: Array
    """Column of the output."""


def with_fault(
    rig: Rig, fault: str, amplitude: float, period_s: float, generator: np.random.Generator
) -> tuple[Rig, float]:
    """Give a rig the fault that is in the axis itself, and draw how severe a fault is.

    Args:
      rig: the rig.
      fault: one of `FAULTS`, or anything else for none.
      amplitude: largest command that it gets.
      period_s: sampling period of the log [s].
      generator: source of the draws.

    Returns:
      The rig, and the severity in a unit of the fault's own.
    """
    low, high = _SEVERITY.get(fault, (1.0, 1.0))
    severity = log_uniform(generator, low, high) if fault in _SEVERITY else 0.0
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
        return replace(rig, friction=friction, stiction=friction * generator.uniform(1.0, 1.6)), severity
    if fault == "long delay":
        samples = int(generator.integers(21, 81))
        return replace(rig, delay_s=samples * period_s), float(samples)
    if fault == "integrating":
        return replace(rig, integrating=True, gain=rig.gain * 2 * np.pi * rig.bandwidth_hz), 0.0
    if fault == "no response":
        return replace(rig, responsive=False), float(generator.integers(0, 2))
    if fault == "mixed units":
        factor = _DEGREES if generator.random() < 0.75 else 1 / _DEGREES
        return replace(rig, gain=rig.gain * factor), factor
    return rig, severity


_SEVERITY = {
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
share of the amplitude; disturbance over set point; drift over the whole log, and the stamps' errors, in standard
deviations of the output and in periods. Besides: the samples of a long delay, the factor between mixed units, and where
nothing responds 1 for the motion of another axis and 0 for noise alone."""


def recorded(
    fault: str, severity: float, given: Array, answer: Array, period_s: float, generator: np.random.Generator
) -> Columns:
    """Record a run, with the fault that is in columns or stamps.

    Args:
      fault: one of `FAULTS`, or anything else for none.
      severity: as drawn by `with_fault`.
      given: commands at equal intervals, shape (N,).
      answer: outputs, shape (N,).
      period_s: sampling period [s].
      generator: source of the draws.
    """
    stamps: Array = period_s * np.arange(len(given), dtype=np.float64)
    if fault == "swapped columns":
        return Columns(stamps, answer, given)
    if fault == "milliseconds":
        return Columns(1000.0 * stamps, given, answer)
    if fault == "uneven stamps":
        return _uneven(Columns(stamps, given, answer), severity, period_s, generator)
    return Columns(stamps, given, answer)


def _uneven(columns: Columns, severity: float, period_s: float, generator: np.random.Generator) -> Columns:
    """Stamp samples when they arrive at a host, and lose some of them."""
    count = len(columns.stamps)
    kind = str(generator.choice(["late", "lost", "gaps", "all"]))
    stamps, kept = columns.stamps, np.ones(count, bool)
    if kind in ("late", "all"):
        # In order: a sample that comes late holds up those behind it.
        least = _CLOSEST * stamps
        stamps = least + np.maximum.accumulate(
            stamps - least + severity * period_s * generator.standard_exponential(count)
        )
    if kind in ("lost", "all"):
        kept &= generator.random(count) >= 0.1 * severity
    if kind in ("gaps", "all"):
        for _ in range(int(generator.integers(1, 4))):
            begin = int(generator.integers(count // 10, count - count // 10))
            kept[begin : begin + int(generator.integers(5, max(count // 8, 6)))] = False
    return Columns(stamps[kept], columns.inputs[kept], columns.outputs[kept])


def feedback_run(
    rig: Rig, count: int, period_s: float, amplitude: float, disturbance: float, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Run a rig in a loop that holds a set point against a disturbance; the controller's output is the command.

    Args:
      rig: a linear rig.
      count: samples.
      period_s: sampling period [s].
      amplitude: of the set point, as the command that it takes.
      disturbance: at the output, standard deviation over that of the set point.
      generator: source of the draws.

    Returns:
      Commands and clean outputs, shape (count,) each.
    """
    target = amplitude * rig.gain * command("held levels", count, period_s, rig, generator)
    memory = np.exp(-2 * np.pi * rig.bandwidth_hz * period_s * log_uniform(generator, 0.2, 2.0))
    pushed = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], generator.standard_normal(count))
    pushed *= disturbance * float(np.std(target))
    rates, weights = modes(rig)
    whole, older, newer = held_steps(rates, weights, rig.delay_s, period_s)
    kept, state = np.exp(rates * period_s), np.zeros(len(rates), complex)
    lag_s = rig.delay_s + 0.25 * rig.settle_s + 0.5 / rig.bandwidth_hz / np.pi
    proportional, integral = 0.15 / rig.gain, 0.3 * period_s / (rig.gain * lag_s)
    commands, outputs, summed = np.zeros(count + whole + 1), np.zeros(count), 0.0
    for index in range(count):
        outputs[index] = state.sum().real + pushed[index]
        error = target[index] - outputs[index]
        summed += integral * error
        commands[index + whole + 1] = summed + proportional * error
        state = kept * state + newer * commands[index + 1] + older * commands[index]
    return commands[whole + 1 :], outputs
