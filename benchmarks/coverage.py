"""Do the 95 % intervals of an identified axis hold the truth 95 times in a hundred? White noise and AR(0.9) noise.

Simulated logs of the printed pitch axis, a 2–50 Hz sweep and a step each, identified with order 4: steady gain, the
poles that a log is said to determine, and the gain at five frequencies.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

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
LOGS = 320
SEED = 2026
NOISE = 0.02
"""Standard deviation of the noise over that of the clean output."""
COLOURS = {"white": 0.0, "AR(0.9)": 0.9}
"""Kind of noise → coefficient of its first-order recursion."""
BARS = {"white": (0.90, 0.98), "AR(0.9)": (0.85, 1.0)}
FREQUENCIES_HZ = np.array([3.0, 6.0, 10.0, 20.0, 40.0])
SWEEP_S, STEP_S = 5.0, 1.0


@dataclass(frozen=True)
class Row:
    """How often the intervals of one quantity held the truth."""

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
    plant = printed_plants()["pitch"]
    begun = time.perf_counter()
    rows = [row for noise in COLOURS for row in _coverage(plant, noise)]
    conditions = {"logs": LOGS, "seed": SEED, "noise": NOISE, "sweep_s": SWEEP_S, "step_s": STEP_S, "order": 4}
    seconds = time.perf_counter() - begun
    content = {"conditions": conditions, "machine": describe_machine(), "provenance": provenance(SEED)}
    write_json(RESULT, {**content, "seconds": seconds, "rows": [asdict(row) for row in rows]})
    missed = []
    for row in rows:
        share = row.covered / row.intervals
        print(f"{row.noise:8} {row.quantity:22} {100 * share:5.1f} %  ({row.covered} of {row.intervals})")
        if not row.low_bar <= share <= row.high_bar:
            missed.append(f"{row.quantity} under {row.noise} noise")
    if missed:
        sys.exit(f"outside the bars: {', '.join(missed)}")


def _coverage(plant: PlantRecord, noise: str) -> Iterator[Row]:
    counts: dict[str, list[bool]] = {}
    for index in range(LOGS):
        generator = np.random.default_rng((SEED, list(COLOURS).index(noise), index))
        for quantity, held in _held(plant, identify_axis(list(_logs(plant, COLOURS[noise], generator)))):
            counts.setdefault(quantity, []).append(held)
    for quantity, held in counts.items():
        ends = binomtest(sum(held), len(held)).proportion_ci(method="wilson")
        yield Row(noise, quantity, sum(held), len(held), (float(ends.low), float(ends.high)), *BARS[noise])


def _logs(plant: PlantRecord, memory: float, generator: np.random.Generator) -> Iterator[Recording]:
    for signal in (linear_sweep(SWEEP_S, plant.sample_period_s), step(STEP_S, plant.sample_period_s)):
        clean = simulate(plant, signal[:, None])
        # The recursion's first thousand samples are left out: it begins at rest.
        drawn = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], generator.standard_normal(signal.size + 1000))[1000:]
        yield make_recording(signal, clean[:, 0] + NOISE * clean.std() * drawn, plant.sample_period_s)


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
