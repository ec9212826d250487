"""Do the 95 % intervals of an identified axis hold the truth 95 times in a hundred? White noise and AR(0.9) noise.

Simulated logs of the printed pitch axis (a 2–50 Hz sweep and a step each), and of axes whose delay a noisy sweep leaves
open: steady gain, the poles that a log is said to determine, and the gain at five frequencies.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import binomtest

from archerfish.identification.axis.gimbal import AxisIdentification, identify_axis
from archerfish.identification.axis.state_space import plant_poles, simulate
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.identification.validation.frequency import plant_response
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import PlantRecord, dc_gain
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording, make_recording
from archerfish.records.storage import write_json
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "coverage.json"
SEED = 2026
COLOURS = {"white": 0.0, "AR(0.9)": 0.9}
"""Kind of noise → coefficient of its first-order recursion."""
BARS = {"white": (0.90, 0.98), "AR(0.9)": (0.85, 1.0)}
FREQUENCIES_HZ = np.array([3.0, 6.0, 10.0, 20.0, 40.0])
STEP_S = 1.0
PERIOD_S = 1e-3


class Case(NamedTuple):
    """An axis, and how it is logged and identified."""

    name: str
    """What it is called in tables."""
    plant: PlantRecord
    """The truth."""
    noise: float
    """Standard deviation of the noise over that of the clean output."""
    order: int
    """Order of the identified plant."""
    logs: int
    """Logs per kind of noise."""
    sweep_s: float = 10.0
    """Length of the sweep [s]."""
    with_step: bool = False
    """Whether a step is logged too."""


def cases() -> list[Case]:
    """Return the axes, the paper's first."""
    late, damped = second_order(8.0, 0.5, 6), second_order(3.0, 0.9, 12)
    return [
        Case("printed pitch, sweep and step, 2 %", printed_plants()["pitch"], 0.02, 4, 320, 5.0, True),
        Case("8 Hz, 6 samples late, 10 %", late, 0.10, 2, 200),
        Case("8 Hz, 6 samples late, 2 %", late, 0.02, 2, 200),
        Case("3 Hz, 12 samples late, 10 %", damped, 0.10, 2, 200),
        Case("8 Hz, 6 samples late, 10 %, fitted with order 4", late, 0.10, 4, 200),
    ]


def second_order(frequency_hz: float, damping: float, delay: int) -> PlantRecord:
    """Return an axis of second order and steady gain 1."""
    pole = np.exp(2 * np.pi * frequency_hz * PERIOD_S * (-damping + 1j * np.sqrt(1 - damping**2)))
    first, second = -2 * pole.real, abs(pole) ** 2
    A = np.array([[-first, 1.0], [-second, 0.0]])
    B = np.full((2, 1), (1 + first + second) / 2)
    return PlantRecord(A, B, np.array([[1.0, 0.0]]), np.zeros((1, 1)), delay, PERIOD_S)


@dataclass(frozen=True)
class Row:
    """How often the intervals of one quantity held the truth."""

    case: str
    """Which axis."""
    noise: str
    """Kind of noise."""
    quantity: str
    """Which quantity."""
    covered: int
    """Intervals that held the truth."""
    intervals: int
    """Intervals that there were."""
    interval_95: tuple[float, float]
    """Of the share, by Wilson."""
    low_bar: float
    """Share that is wanted at least."""
    high_bar: float
    """Share that is wanted at most."""


def main() -> None:
    """Run all logs, write the results and print them; exit with 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--logs", type=int, help="so many logs of each axis, and nothing written")
    logs = parser.parse_args().logs
    begun = time.perf_counter()
    missed = []
    rows = []
    for case in cases():
        for noise in COLOURS:
            for row in _coverage(case if logs is None else case._replace(logs=logs), noise):
                rows.append(row)
                share = row.covered / row.intervals
                outside = not row.low_bar <= share <= row.high_bar
                missed += [f"{row.quantity} of {row.case} under {row.noise} noise"] * outside
                print(
                    f"{row.case:48} {row.noise:8} {row.quantity:16} {100 * share:5.1f} %  "
                    f"({row.covered} of {row.intervals}){' outside' * outside}",
                    flush=True,
                )
    if logs is None:
        _write(rows, time.perf_counter() - begun)
    if missed:
        sys.exit(f"outside the bars: {', '.join(missed)}")


def _write(rows: list[Row], seconds: float) -> None:
    conditions = {
        "seed": SEED,
        "step_s": STEP_S,
        "cases": [
            {"name": each.name, "noise": each.noise, "order": each.order, "logs": each.logs, "sweep_s": each.sweep_s}
            for each in cases()
        ],
    }
    content = {"conditions": conditions, "machine": describe_machine(), "provenance": provenance(SEED)}
    write_json(RESULT, {**content, "seconds": seconds, "rows": [asdict(row) for row in rows]})


def _coverage(case: Case, noise: str) -> Iterator[Row]:
    counts: dict[str, list[bool]] = {}
    for index in range(case.logs):
        generator = np.random.default_rng((SEED, list(COLOURS).index(noise), index))
        result = identify_axis(list(_logs(case, COLOURS[noise], generator)), case.order)
        for quantity, held in _held(case.plant, result):
            counts.setdefault(quantity, []).append(held)
    for quantity, held in counts.items():
        ends = binomtest(sum(held), len(held)).proportion_ci(method="wilson")
        yield Row(case.name, noise, quantity, sum(held), len(held), (float(ends.low), float(ends.high)), *BARS[noise])


def _logs(case: Case, memory: float, generator: np.random.Generator) -> Iterator[Recording]:
    period = case.plant.sample_period_s
    for signal in (linear_sweep(case.sweep_s, period), *([step(STEP_S, period)] if case.with_step else [])):
        clean = simulate(case.plant, signal[:, None])
        # The recursion's first thousand samples are left out: it begins at rest.
        drawn = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], generator.standard_normal(signal.size + 1000))[1000:]
        yield make_recording(signal, clean[:, 0] + case.noise * clean.std() * drawn, period)


def _held(plant: PlantRecord, result: AxisIdentification) -> Iterator[tuple[str, bool]]:
    ((low, high),) = result.dc_gain_interval
    yield "steady gain", low <= dc_gain(plant).item() <= high
    lows, highs = result.gain_interval(FREQUENCIES_HZ)
    true: NDArray[np.float64] = np.abs(plant_response(plant, FREQUENCIES_HZ)[:, 0, 0])
    for frequency, low, gain, high in zip(FREQUENCIES_HZ, lows, true, highs, strict=True):
        yield f"gain at {frequency:g} Hz", bool(low <= gain <= high)
    poles = plant_poles(plant)
    for index in np.flatnonzero(result.determined & (result.poles.imag > 0)):
        pole = poles[np.argmin(np.abs(poles - result.poles[index]))]
        for part, sd in zip(("real", "imag"), result.pole_sd, strict=True):
            error = getattr(result.poles[index], part) - getattr(pole, part)
            yield f"pole, {part} part", bool(abs(error) <= 1.96 * sd[index])


if __name__ == "__main__":
    main()
