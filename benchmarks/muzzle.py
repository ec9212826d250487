"""Coverage of `identify muzzle`: how often its 95 % intervals hold the truth, over simulated sets of shots.

Pellets fly under 3-D quadratic drag, not by the model that is fitted. Each case is a way of recording shots; two have
5 % ricochets, one speeds that drift in rapid fire. Prints coverages, times and the verdicts on Table I, and writes
benchmarks/results/muzzle.json. An argument sets the number of sets.
"""

import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import quadratic_crossing
from archerfish.identification.muzzle.likelihood import MuzzleIdentification, identify_muzzle
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.tables import landing_table
from archerfish.records import storage
from archerfish.records.shots import Shots
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "muzzle.json"
SEED = 0
SETS = 320
TRUTH = {
    "speed": 18.0,
    "speed_sd": 0.5,
    "pitch_offset": 0.007,
    "pitch_sd": 0.006,
    "yaw_offset": -0.004,
    "yaw_sd": 0.005,
    "height": 0.42,
    "drag": 0.019,
}

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A way of recording shots."""

    name: str
    pitch_deg: tuple[float, ...]
    each: int
    """Shots at each setting."""
    planes_m: tuple[float, ...] = ()
    """Distances of the target plane; none for landing points."""
    speeds: bool = True
    """Whether the speed of each shot is measured."""
    height: bool = True
    """Whether the height of the muzzle is given."""
    drag: bool = True
    """Whether the drag coefficient is given."""
    ricochets: float = 0.0
    """Share of shots that go astray."""
    drift: float = 0.0
    """Correlation of the speeds of successive shots."""


CASES = (
    Case("landing, speeds", (-6, -3, 0, 3, 6), 20),
    Case("landing, speeds, few shots", (-4, 0, 4), 5),
    Case("landing, speeds; height and drag unknown", (-6, -3, 0, 3, 6), 20, height=False, drag=False),
    Case("landing", (-6, -3, 0, 3, 6), 20, speeds=False),
    Case("landing; height unknown", (-6, -3, 0, 3, 6), 20, speeds=False, height=False),
    Case("plane, speeds, one distance", (0,), 100, planes_m=(4.0,)),
    Case("plane", (0,), 20, planes_m=(1, 2, 3, 4, 5), speeds=False),
    Case("landing, speeds, 5 % ricochets", (-6, -3, 0, 3, 6), 20, ricochets=0.05),
    Case("landing, 5 % ricochets", (-6, -3, 0, 3, 6), 20, speeds=False, ricochets=0.05),
    Case("landing, speeds that drift", (-6, -3, 0, 3, 6), 20, drift=0.7),
)


def fire(case: Case, generator: np.random.Generator) -> Shots:
    """Fire a set of shots with the true muzzle."""
    pitch = np.radians(np.repeat(case.pitch_deg, case.each * max(len(case.planes_m), 1)))
    speed = TRUTH["speed"] + TRUTH["speed_sd"] * _correlated(pitch.size, case.drift, generator)
    away = generator.standard_normal((pitch.size, 2)) * [TRUTH["pitch_sd"], TRUTH["yaw_sd"]]
    offset = np.array([TRUTH["pitch_offset"], TRUTH["yaw_offset"]])
    angle = offset + np.stack([pitch, np.zeros_like(pitch)], axis=1) + away
    velocity, astray = speed[:, None] * direction(angle), generator.random(pitch.size) < case.ricochets
    measured = speed if case.speeds else None
    if case.planes_m:
        plane = np.tile(np.repeat(np.array(case.planes_m, float), case.each), len(case.pitch_deg))
        hit = quadratic_crossing(np.zeros_like(velocity), velocity, plane, np.asarray(TRUTH["drag"]))
        return Shots(pitch, 0 * pitch, plane, measured, hit.lateral, "simulated", hit.height)
    ahead, lateral = _landing(velocity)
    distance = np.hypot(ahead, lateral)
    # A ricochet ends anywhere up to where the pellet would have landed.
    distance = np.where(astray, distance * generator.uniform(0.1, 0.8, pitch.size), distance)
    lateral = np.where(astray, distance * np.sin(generator.normal(0.0, 0.3, pitch.size)), lateral)
    return Shots(pitch, 0 * pitch, distance, measured, lateral, "simulated")


def _correlated(count: int, correlation: float, generator: np.random.Generator) -> Array:
    values = generator.standard_normal(count)
    for index in range(1, count):
        values[index] = correlation * values[index - 1] + np.sqrt(1 - correlation**2) * values[index]
    return values


def _landing(velocity: Array) -> tuple[Array, Array]:
    """Where pellets cross the ground, ahead and to the left [m]: the plane that they cross at its height is sought."""
    drag, muzzle = np.asarray(TRUTH["drag"]), np.zeros_like(velocity)
    ahead = 0.3 * velocity[:, 0]
    for _ in range(30):
        crossing = quadratic_crossing(muzzle, velocity, ahead, drag, steps=12)
        above = quadratic_crossing(muzzle, velocity, ahead + 1e-4, drag, steps=12).height - crossing.height
        step = -(crossing.height + TRUTH["height"]) / (above / 1e-4)
        ahead = ahead + np.clip(step, -0.5 * ahead, 2.0)
        if np.abs(step).max() < 1e-7:
            break
    return ahead, crossing.lateral


def identify(case: Case, shots: Shots) -> MuzzleIdentification:
    """Identify as a user would."""
    return identify_muzzle(
        shots, drag=TRUTH["drag"] if case.drag else None, height=TRUTH["height"] if case.height else None
    )


def measure(case: Case, sets: int) -> dict[str, Any]:
    """Return coverage, medians and processor time of one case."""
    generator = np.random.default_rng([SEED, CASES.index(case)])
    held: dict[str, list[bool]] = {}
    found: dict[str, list[float]] = {}
    times, lost, misfits = [], 0, 0
    for _ in range(sets):
        shots = fire(case, generator)
        start = time.process_time()
        result = identify(case, shots)
        times.append(time.process_time() - start)
        lost += int(np.count_nonzero(~result.kept))
        misfits += result.lack_of_fit.shown
        for name, (low, high) in result.muzzle.intervals.items():
            held.setdefault(name, []).append(low <= TRUTH[name] <= high)
            found.setdefault(name, []).append(getattr(result.muzzle, name))
    return {
        "case": asdict(case),
        "sets": sets,
        "coverage_percent": {name: round(100 * float(np.mean(inside)), 1) for name, inside in held.items()},
        "median": {name: float(np.median(values)) for name, values in found.items()},
        "shots_left_out_percent": round(100 * lost / (sets * len(shots)), 2),
        "lack_of_fit_shown_percent": round(100 * misfits / sets, 1),
        "median_cpu_s": round(float(np.median(times)), 3),
    }


def table_1() -> dict[str, str]:
    """Verdicts on the paper's Table I, by the flight model and by eq (5)."""
    rows = landing_table().rows
    pitch, yaw = (np.deg2rad([getattr(row, name) for row in rows]) for name in ("pitch_deg", "yaw_deg"))
    shots = Shots(pitch, -yaw, np.array([row.real_m for row in rows]), source="Table I")
    drag = assumed_conditions().drag
    flights = ("flat-fire", "eq-5")
    return {flight: identify_muzzle(shots, drag=drag, flight=flight).lack_of_fit.statement for flight in flights}


def main() -> None:
    """Measure, print and write."""
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else SETS
    results = []
    console = Console(width=150)
    for case in CASES:
        results.append(measure(case, sets))
        told = ", ".join(f"{name} {share:g}" for name, share in results[-1]["coverage_percent"].items())
        console.print(f"{case.name}: {told}; {results[-1]['median_cpu_s']:.3f} s", highlight=False)
    table = Table("case", *TRUTH, "left out", title=f"coverage of 95 % intervals [%], {sets} sets each")
    for result in results:
        shares = result["coverage_percent"]
        cells = (f"{shares[name]:g}" if name in shares else "given" for name in TRUTH)
        table.add_row(result["case"]["name"], *cells, f"{result['shots_left_out_percent']:g} %")
    console.print(table)
    verdicts = table_1()
    for statement in verdicts.values():
        console.print(statement, highlight=False)
    content = {"machine": describe_machine(), "seed": SEED, "truth": TRUTH, "cases": results, "table_1": verdicts}
    storage.write_json(RESULT, content)


if __name__ == "__main__":
    main()
