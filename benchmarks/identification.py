"""Identification against its bars: real logs (first half → second half) and the printed axes at 1 % noise, order 4.

Needs the recorded logs in ../shared/data, beside the repository, and fails without them.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from archerfish.identification.excitation import linear_sweep, step
from archerfish.identification.gimbal import identify_axis
from archerfish.identification.state_space import simulate
from archerfish.identification.validation import fit_percent, free_run
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import PlantRecord
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording, make_recording, read_recording_csv, slice_recording
from archerfish.records.storage import write_json
from machine import describe_machine

ROOT = Path(__file__).parents[1]
DATA = ROOT / ".." / "shared" / "data" / "identification"
RESULT = ROOT / "benchmarks" / "results" / "identification.json"

ORDER = 4
NOISE = 0.01
SEEDS = range(3)
PERIOD_S = 0.01
"""Sampling period given to logs that state none; fits don't depend on it."""


@dataclass(frozen=True)
class Row:
    """One case."""

    case: str
    """Which log or plant."""
    fit_percent: float
    """Fit on the part that was not fitted; of the printed axes, on a step against the noise-free truth [%]."""
    bar_percent: float | None
    """What it must reach [%]; None if it is reported only."""
    training_fit_percent: float
    """Fit of the (last) training recording [%]."""
    delay_samples: int
    """Chosen input delay."""
    samples: int
    """Training samples."""
    seconds: float
    """Time of the identification [s]."""


def main() -> None:
    """Run all cases, write the results and print them; exit with 1 if a bar is missed."""
    if not DATA.is_dir():
        sys.exit(f"{DATA}: no such folder; the recorded logs belong in ../shared/data, beside the repository")
    rows = [*(_real(*case) for case in _real_cases()), *_printed_cases()]
    conditions = {"order": ORDER, "noise": NOISE, "seeds": list(SEEDS), "split": "first half → second half"}
    content = {"conditions": conditions, "machine": describe_machine(), "provenance": provenance()}
    write_json(RESULT, {**content, "rows": [asdict(row) for row in rows]})
    for row in rows:
        bar = "" if row.bar_percent is None else f"bar {row.bar_percent:5.1f}"
        print(f"{row.case:24} fit {row.fit_percent:6.2f} %  {bar:10}  delay {row.delay_samples}  {row.seconds:5.2f} s")
    missed = [row.case for row in rows if row.bar_percent is not None and row.fit_percent < row.bar_percent]
    if missed:
        sys.exit(f"below the bar: {', '.join(missed)}")


def _real_cases() -> Iterator[tuple[str, Recording, Recording, float | None]]:
    """Yield name, training recording, test recording and bar."""
    for name, file, inputs, output, bar in (
        ("robot arm", "robot_arm_dat", [0], 1, 96.0),
        ("CD player arm", "CD_player_arm_dat", [0, 1], 3, 82.0),
    ):
        table = loadmat(DATA / "slicot_sysid" / f"{file}.mat")[file]
        yield name, *_halves(table[:, inputs], table[:, output]), bar
    table = np.loadtxt(DATA / "rgp" / "dryer.dat")
    yield "hair dryer", *_halves(table[:, :1], table[:, 1]), 85.0
    silverbox = read_recording_csv(DATA / "silverbox" / "SNLS80mV.csv", "", ["V1"], ["V2"], sample_period_s=1 / 610.35)
    middle = slice_recording(silverbox, 40650, 60650)
    yield "Silverbox", slice_recording(middle, 0, 10000), slice_recording(middle, 10000, 20000), None
    multisine, steps = (_drone(name) for name in ("sinal4_multiseno", "sinal2_degraus"))
    yield "quarter drone, steps", multisine, steps, None


def _halves(inputs: NDArray[np.float64], output: NDArray[np.float64]) -> tuple[Recording, Recording]:
    names = [f"u{index}" for index in range(inputs.shape[1])]
    whole = make_recording(inputs, output, PERIOD_S, input_names=names)
    middle = len(whole) // 2
    return slice_recording(whole, 0, middle), slice_recording(whole, middle, len(whole))


def _drone(name: str) -> Recording:
    path = DATA / "quarter_drone" / f"{name}_malha_fechada.csv"
    recording = read_recording_csv(path, "Tempo_s", ["Referencia"], ["Saida_y"])
    return slice_recording(recording, 200, len(recording))


def _real(case: str, training: Recording, test: Recording, bar: float | None) -> Row:
    start = time.perf_counter()
    result = identify_axis([training], ORDER)
    seconds = time.perf_counter() - start
    fit = free_run(result.plant, test, result.offset).fit_percent.item()
    return Row(case, fit, bar, result.fit_percent[-1], result.plant.delay_samples, len(training), seconds)


def _printed_cases() -> Iterator[Row]:
    """Identify the printed axes from a 2–50 Hz sweep of 10 s and a step of 1 s."""
    for axis, plant in printed_plants().items():
        for seed in SEEDS:
            yield _printed(f"printed {axis}, seed {seed}", plant, np.random.default_rng(seed))


def _printed(case: str, true: PlantRecord, rng: np.random.Generator) -> Row:
    logs = []
    for signal in (linear_sweep(10.0, true.sample_period_s), step(1.0, true.sample_period_s)):
        clean = simulate(true, signal[:, None])
        measured = clean + NOISE * clean.std() * rng.standard_normal(clean.shape)
        logs.append(make_recording(signal, measured, true.sample_period_s))
    start = time.perf_counter()
    result = identify_axis(logs, ORDER)
    seconds = time.perf_counter() - start
    fit = fit_percent(clean, simulate(result.plant, logs[-1].inputs)).item()
    samples = sum(len(log) for log in logs)
    return Row(case, fit, 99.0, result.fit_percent[-1], result.plant.delay_samples, samples, seconds)


if __name__ == "__main__":
    main()
