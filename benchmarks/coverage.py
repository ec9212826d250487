"""Do the 95 % intervals of an identified axis contain the truth 95 times in a hundred? White and AR(0.9) noise.

`python benchmarks/coverage.py` identifies simulated logs of the printed pitch axis (a sweep and a step each) and of
axes whose delay a noisy sweep doesn't determine, and writes results/coverage.json: for each axis and noise the steady
gain, the gain at five frequencies, and frequency and damping of the poles that are reported as determined. A quarter of
an hour with `--workers 2`; `--logs 10` takes so many of each axis, and writes nothing.
"""

import argparse
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from archerfish.identification.axis.bootstrap import interval
from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.frequency import frequency_response
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import PlantRecord
from archerfish.reports.table import Table
from bars import Bar, finish, run, share
from rigs import Array, draw_noise

SEED, PERIOD_S, STEP_S = 2026, 1e-3, 1.0
NOISES = ("white", "AR(0.9)")
FREQUENCIES_HZ = np.array([3.0, 6.0, 10.0, 20.0, 40.0])
INSIDE, WORST, POOLED = (90.0, 98.0), 85.0, (93.0, 97.0)  # of a row, of all but some, of a quantity [%]
MOST_OUTSIDE = 3


class Case(NamedTuple):
    """An axis, and how it is logged and identified."""

    name: str
    plant: PlantRecord
    noise: float  # standard deviation over that of the clean output
    order: int  # of the identified plant
    logs: int = 200  # per kind of noise
    sweep_s: float = 10.0
    with_step: bool = False


def second_order(natural_hz: float, damping: float, delay: int) -> PlantRecord:
    """Return an axis of second order and steady gain 1, its delay in samples."""
    pole = np.exp(2 * np.pi * natural_hz * PERIOD_S * (-damping + 1j * np.sqrt(1 - damping**2)))
    first, second = -2 * pole.real, abs(pole) ** 2
    B = np.full((2, 1), (1 + first + second) / 2)
    return PlantRecord.from_state_space([[-first, 1], [-second, 0]], B, [[1, 0]], 0.0, PERIOD_S, delay)


def linear_sweep(duration_s: float, period_s: float) -> Array:
    """Return a sine whose frequency rises linearly with time from 2 to 50 Hz, shape (N,)."""
    time = period_s * np.arange(round(duration_s / period_s))
    return np.asarray(np.sin(2 * np.pi * (2 * time + 48 * time**2 / (2 * duration_s))))


def step(duration_s: float, period_s: float) -> Array:
    """Return zero, and one from 0.05 s on, shape (N,)."""
    return (np.arange(round(duration_s / period_s)) >= round(0.05 / period_s)).astype(float)


LATE, DAMPED = second_order(8.0, 0.5, 6), second_order(3.0, 0.9, 12)
CASES = (
    Case("printed pitch, sweep and step, 2 %", printed_plants()["pitch"], 0.02, 4, 320, 5.0, True),
    Case("8 Hz, 6 samples late, 10 %", LATE, 0.10, 2),
    Case("8 Hz, 6 samples late, 2 %", LATE, 0.02, 2),
    Case("3 Hz, 12 samples late, 10 %", DAMPED, 0.10, 2),
    Case("8 Hz, 6 samples late, 10 %, with order 4", LATE, 0.10, 4),
)


def logs_of(case: Case, noise: str, index: int) -> Iterator[Recording]:
    """Yield the logs of an axis under a kind of noise."""
    rng = np.random.default_rng((SEED, NOISES.index(noise), index))
    for u in (linear_sweep(case.sweep_s, PERIOD_S), *([step(STEP_S, PERIOD_S)] if case.with_step else [])):
        clean = simulate(case.plant, u[:, None])[:, 0]
        yield Recording.from_arrays(u, clean + case.noise * clean.std() * draw_noise(noise, u.size, rng), PERIOD_S)


def covered(job: tuple[int, str, int]) -> dict[str, bool]:
    """Return whether the interval of each quantity contains the truth, for one log."""
    case = CASES[job[0]]
    result = identify_axis(list(logs_of(case, *job[1:])), order=case.order)
    gain, true = result.dc_gain[0], float(case.plant.dc_gain.item())
    found = {"steady gain": bool(gain.low <= true <= gain.high)}
    lows, highs = interval(np.abs(frequency_response(result.record, FREQUENCIES_HZ, draws=True)[..., 0, 0]))
    gains = np.abs(frequency_response(case.plant, FREQUENCIES_HZ)[:, 0, 0])
    for frequency, low, at, high in zip(FREQUENCIES_HZ, lows, gains, highs, strict=True):
        found[f"gain at {frequency:g} Hz"] = bool(low <= at <= high)
    rates = np.log(np.linalg.eigvals(case.plant.A).astype(complex)) / PERIOD_S
    for each in result.poles:
        if each.determined and each.damping.value < 1:
            pole = rates[np.argmin(np.abs(np.abs(rates) / (2 * np.pi) - each.frequency_hz.value))]
            parts = {"frequency": abs(pole) / (2 * np.pi), "damping": -pole.real / abs(pole)}
            estimates = {"frequency": each.frequency_hz, "damping": each.damping}
            for name, value in parts.items():
                found[f"pole, {name}"] = bool(estimates[name].low <= value <= estimates[name].high)
    return found


def figures(rows: list[dict[str, Any]]) -> list[Bar]:
    """Return the figures with their limits."""
    quantities = dict.fromkeys(row["quantity"] for row in rows)
    bars = [
        Bar(
            "rows outside 90–98 %", sum(not INSIDE[0] <= row["percent"] <= INSIDE[1] for row in rows), most=MOST_OUTSIDE
        ),
        Bar("worst row, %", min(row["percent"] for row in rows), least=WORST),
    ]
    for name in quantities:
        some = [row for row in rows if row["quantity"] == name]
        held, of = (sum(row[field] for row in some) for field in ("covered", "intervals"))
        bars.append(share(f"{name}, all axes, %", [True] * held + [False] * (of - held), *POOLED))
    return bars


def main() -> None:
    """Identify all logs, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, help="of each axis and noise; nothing is then written")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for number, case in enumerate(CASES):
        for noise in NOISES:
            jobs = [(number, noise, index) for index in range(options.logs or case.logs)]
            found = list(run(covered, jobs, options.workers))
            for quantity in dict.fromkeys(name for each in found for name in each):
                held = [each[quantity] for each in found if quantity in each]
                facts = {"case": case.name, "noise": noise, "quantity": quantity, "covered": sum(held)}
                rows.append({**facts, "intervals": len(held), "percent": 100 * sum(held) / len(held)})
    names = list(dict.fromkeys(row["quantity"] for row in rows))
    lines = []
    for case in CASES:
        for noise in NOISES:
            some = {
                row["quantity"]: row["percent"] for row in rows if (row["case"], row["noise"]) == (case.name, noise)
            }
            lines.append((f"{case.name}, {noise}", *(some.get(name) for name in names)))
    table = Table("intervals that contain the truth, %", ("axis and noise", *names), tuple(lines))
    cases = [{**case._asdict(), "plant": repr(case.plant)} for case in CASES]
    conditions = {"seed": SEED, "step_s": STEP_S, "cases": cases}
    finish("coverage", figures(rows), [table], conditions, rows, options.logs is None)


if __name__ == "__main__":
    main()
