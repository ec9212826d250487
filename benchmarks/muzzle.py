"""How often the 95 % intervals of `identify_muzzle` hold the truth, over simulated sets of shots.

Pellets fly under 3-D quadratic drag, not by the model that is fitted. Each case is a kind of recording; two have 5 %
ricochets, one has speeds that drift in rapid fire.
`python benchmarks/muzzle.py [SETS]` (30 sets of each case if not given) prints coverage by case and pooled by quantity
(goal: 93–97 %), medians and the lack of fit of the paper's Table I, and writes results/muzzle.json.
"""

import json
import platform
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import quadratic_crossing
from archerfish.identification.muzzle.identify import MuzzleResult, identify_muzzle
from archerfish.logs.shots import Shots
from archerfish.paper.tables import landing_table
from archerfish.provenance import provenance
from archerfish.reports.table import Table, tables_text

RESULT = Path(__file__).parent / "results" / "muzzle.json"
SEED, SETS = 0, 30
TRUTH = {"speed": 18.0, "speed_sd": 0.5, "pitch_offset": 0.007, "pitch_sd": 0.006}
TRUTH |= {"yaw_offset": -0.004, "yaw_sd": 0.005, "height": 0.42, "drag": 0.019}
FIVE = (-6.0, -3.0, 0.0, 3.0, 6.0)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A kind of recording."""

    name: str
    pitch_deg: tuple[float, ...] = FIVE
    each: int = 20  # shots at each setting
    planes_m: tuple[float, ...] = ()  # distances of the target plane; none for landing points
    speeds: bool = True  # whether the speed of each shot is measured
    height: bool = True  # whether the height of the muzzle is given
    drag: bool = True  # whether the drag coefficient is given
    ricochets: float = 0.0  # share of shots that go astray
    drift: float = 0.0  # correlation of the speeds of successive shots


CASES = (
    Case("landing, speeds"),
    Case("landing, speeds, few shots", (-4, 0, 4), 5),
    Case("landing, speeds; height and drag unknown", height=False, drag=False),
    Case("landing", speeds=False),
    Case("landing; height unknown", speeds=False, height=False),
    Case("plane, speeds, one distance", (0,), 100, planes_m=(4.0,)),
    Case("plane", (0,), planes_m=(1, 2, 3, 4, 5), speeds=False),
    Case("landing, speeds, 5 % ricochets", ricochets=0.05),
    Case("landing, 5 % ricochets", speeds=False, ricochets=0.05),
    Case("landing, speeds that drift", drift=0.7),
)


def fire(case: Case, generator: np.random.Generator) -> Shots:
    """Fire a set of shots with the true muzzle."""
    pitch = np.radians(np.repeat(case.pitch_deg, case.each * max(len(case.planes_m), 1)))
    speed = TRUTH["speed"] + TRUTH["speed_sd"] * _correlated(pitch.size, case.drift, generator)
    away = generator.standard_normal((pitch.size, 2)) * [TRUTH["pitch_sd"], TRUTH["yaw_sd"]]
    angle = np.array([TRUTH["pitch_offset"], TRUTH["yaw_offset"]]) + np.stack([pitch, 0 * pitch], axis=1) + away
    velocity, astray = speed[:, None] * direction(angle), generator.random(pitch.size) < case.ricochets
    measured = speed if case.speeds else None
    if case.planes_m:
        plane = np.tile(np.repeat(np.array(case.planes_m, float), case.each), len(case.pitch_deg))
        hit = quadratic_crossing(0 * velocity, velocity, plane, np.asarray(TRUTH["drag"]))
        return Shots(pitch, 0 * pitch, plane, hit.height, measured, hit.lateral)
    ahead, lateral = _landing(velocity)
    distance = np.hypot(ahead, lateral)
    # A ricochet ends anywhere up to where the pellet would have landed.
    distance = np.where(astray, distance * generator.uniform(0.1, 0.8, pitch.size), distance)
    lateral = np.where(astray, distance * np.sin(generator.normal(0.0, 0.3, pitch.size)), lateral)
    return Shots(pitch, 0 * pitch, distance, None, measured, lateral)


def _correlated(count: int, correlation: float, generator: np.random.Generator) -> Array:
    values = generator.standard_normal(count)
    for index in range(1, count):
        values[index] = correlation * values[index - 1] + np.sqrt(1 - correlation**2) * values[index]
    return values


def _landing(velocity: Array) -> tuple[Array, Array]:
    """Return where pellets cross the ground, ahead and left [m]: the plane that they cross at its height is sought."""
    drag, muzzle, ahead = np.asarray(TRUTH["drag"]), 0 * velocity, 0.3 * velocity[:, 0]
    for _ in range(30):
        crossing = quadratic_crossing(muzzle, velocity, ahead, drag, steps=12)
        above = quadratic_crossing(muzzle, velocity, ahead + 1e-4, drag, steps=12).height - crossing.height
        step = -(crossing.height + TRUTH["height"]) / (above / 1e-4)
        ahead = ahead + np.clip(step, -0.5 * ahead, 2.0)
        if np.abs(step).max() < 1e-7:
            break
    return ahead, np.asarray(crossing.lateral)


def identify(case: Case, shots: Shots) -> MuzzleResult:
    """Identify as a user would."""
    height = TRUTH["height"] if case.height and not case.planes_m else None
    return identify_muzzle(shots, height_m=height, drag=TRUTH["drag"] if case.drag else "estimate")


def measure(case: Case, sets: int) -> dict[str, Any]:
    """Return counts of intervals that hold the truth, medians and processor time of one case."""
    generator = np.random.default_rng([SEED, CASES.index(case)])
    results, times = [], []
    for _ in range(sets):
        shots = fire(case, generator)
        start = time.process_time()
        results.append(identify(case, shots))
        times.append(time.process_time() - start)
    names = results[0].estimates
    held = {
        name: sum(each.estimates[name].low <= TRUTH[name] <= each.estimates[name].high for each in results)
        for name in names
    }
    return {
        "case": asdict(case),
        "sets": sets,
        "held": held,
        "median": {name: float(np.median([each.estimates[name].value for each in results])) for name in names},
        "left_out_percent": round(100 * float(np.mean([~each.used for each in results])), 2),
        "lack_of_fit_shown": sum(bool(each.lack_of_fit.p_value < 0.05) for each in results),
        "median_cpu_s": round(float(np.median(times)), 3),
    }


def main() -> None:
    """Measure, print and write."""
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else SETS
    cases = [measure(case, sets) for case in CASES]
    having = {name: [each["held"][name] for each in cases if name in each["held"]] for name in TRUTH}
    pooled = {name: round(100 * sum(held) / (sets * len(held)), 1) for name, held in having.items()}
    rows = [
        (each["case"]["name"], *(each["held"].get(name) for name in TRUTH), each["left_out_percent"]) for each in cases
    ]
    title = f"Intervals that hold the truth, of {sets}"
    print(
        tables_text([Table(title, ("case", *TRUTH, "left out [%]"), (*rows, ("pooled [%]", *pooled.values(), None)))])
    )
    names = list(TRUTH)[:4]
    medians = tuple((each["case"]["name"], *(each["median"][name] for name in names)) for each in cases)
    print(tables_text([Table("Medians", ("case", *names), (*medians, ("truth", *(TRUTH[name] for name in names))))]))
    table = landing_table().rows
    pitch, yaw = (np.radians([getattr(row, name) for row in table]) for name in ("pitch_deg", "yaw_deg"))
    table_1 = identify_muzzle(Shots(pitch, -yaw, np.array([row.real_m for row in table]))).lack_of_fit
    print(f"Table I: {table_1}")
    conditions = {"machine": platform.machine(), "system": platform.system(), **provenance(SEED)}
    content = {**conditions, "truth": TRUTH, "sets": sets, "pooled_percent": pooled, "cases": cases}
    RESULT.write_text(json.dumps(content | {"table_1": table_1._asdict()}, indent=1) + "\n")


if __name__ == "__main__":
    main()
