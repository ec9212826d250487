"""Results of a run that never took place: figures of the right size, from a fixed seed."""

import numpy as np
import pytest
from numpy.typing import NDArray

from archerfish.evaluation.hit_rate import hit_rate, paired_difference, split_misses
from archerfish.evaluation.paper_results import (
    LackOfFit,
    LearningCurves,
    PaperFigures,
    StepResponse,
    Table1,
    Table1Row,
    TrainingRun,
)
from archerfish.evaluation.results import Cell, Comparison, Drop, Results
from archerfish.evaluation.robot_results import LandingRow, RobotIdentification, RobotStep
from archerfish.paper.conditions import Calibration, CalibrationCell
from archerfish.paper.tables import hit_rate_table, landing_table, printed_rate

ENGAGEMENTS, SHOTS = 60, 50
TIMES = 0.02 * np.arange(1, SHOTS + 1)

RATES = {
    "perfect": (1.0, 1.0, 1.0, 0.997, 1.0, 1.0, 1.0, 0.997),
    "oracle": (0.984, 0.994, 0.992, 0.975, 0.984, 0.994, 0.993, 0.974),
    "history": (0.981, 0.985, 0.978, 0.970, 0.980, 0.984, 0.972, 0.965),
    "kalman": (0.79, 0.79, 0.78, 0.77, 0.78, 0.75, 0.70, 0.63),
    "kalman-lq": (0.98, 0.99, 0.99, 0.96, 0.975, 0.955, 0.92, 0.83),
    "parabola-lq": (0.98, 0.99, 0.99, 0.96, 0.98, 0.99, 0.985, 0.955),
    "no-lead": (0.98, 0.99, 0.99, 0.96, 0.98, 0.945, 0.815, 0.635),
    "paper": (0.98, 0.985, 0.975, 0.955, 0.98, 0.935, 0.80, 0.635),
}
LIMITS = {"gate": 0.96, "box": 1.0, "los-2deg": 0.9}


def draw_hits(generator: np.random.Generator, rate: float) -> NDArray[np.bool_]:
    """Engagements of unequal luck whose early shots miss more often."""
    luck = 1.0 if rate == 1.0 else generator.beta(40 * rate, 40 * (1 - rate), (ENGAGEMENTS, 1))
    slewing = np.where(TIMES < 0.2, min(0.0, rate - 1), 0.0)
    return np.asarray(generator.random((ENGAGEMENTS, SHOTS)) < luck + slewing)


def make_labels() -> list[dict[str, object]]:
    return [
        {"table": table, "setting": "paper", "target": hit_rate_table(table).target, "range_m": row.range_m}
        for table in ("II", "III")
        for row in hit_rate_table(table).rows
    ]


def make_cells() -> tuple[list[Cell], list[Comparison]]:
    generator = np.random.default_rng(2024)
    cells, comparisons = [], []
    for limit, factor in LIMITS.items():
        for index, label in enumerate(make_labels()):
            label = {**label, "command_limit": limit}
            hits = {
                name: draw_hits(generator, rates[index] * (1.0 if name in {"perfect", "kalman"} else factor))
                for name, rates in RATES.items()
            }
            for name, hit in hits.items():
                seed = 0 if name in {"history", "paper"} else None
                cells.append(make_cell(label, name, seed, hit))
                if seed is not None:
                    comparisons += [
                        Comparison(
                            **label,
                            controller=name,
                            policy_seed=seed,
                            against=other,
                            **paired_difference(hit, hits[other])._asdict(),
                        )
                        for other in ("kalman", "kalman-lq", "oracle")
                    ]
    return cells, comparisons


def make_cell(label: dict[str, object], controller: str, seed: int | None, hit: NDArray[np.bool_]) -> Cell:
    slewing, settled = split_misses(hit, TIMES, 0.5)
    return Cell(
        **label,
        controller=controller,
        policy_seed=seed,
        **hit_rate(hit)._asdict(),
        misses_slewing=slewing,
        misses_settled=settled,
        paper=printed_rate(str(label["table"]), label["range_m"], controller),
        **make_bound(str(label["command_limit"]), controller),
    )


def make_bound(limit: str, controller: str) -> dict[str, object]:
    """A bound on the rate of every cell but those of perfect aim."""
    if controller == "perfect":
        return {}
    if limit == "los-2deg":
        return {"bound": 0.951, "bound_error": 0.0, "bound_kind": "reach"}
    known = controller == "oracle"
    value = (0.9987 if known else 0.9965) - 0.03 * (limit == "gate")
    return {"bound": value, "bound_error": 0.0 if known else 0.002, "bound_kind": "hindsight" if known else "combined"}


def make_table1() -> Table1:
    rows = tuple(
        Table1Row(
            row.pitch_deg,
            row.yaw_deg,
            row.simulated_m,
            row.real_m,
            model := 1.03 * row.real_m,
            100 * (model / row.real_m - 1),
        )
        for row in landing_table().rows
    )
    statement = "No muzzle height and pitch offset bring the model within the paper's own 5 %."
    return Table1(rows, {"speed_m_s": 17.52, "height_m": 0.312}, LackOfFit(6.1, 11.8, statement))


def make_figures() -> PaperFigures:
    time = np.arange(0, 0.5, 0.005)
    steps = tuple(range(12_800, 1_000_001, 12_800))
    returns = [
        -25 * np.exp(-np.array(steps) / 1.5e5) - 1.2 + 0.1 * np.sin(np.arange(len(steps)) + seed) for seed in range(3)
    ]
    runs = tuple(TrainingRun(seed, (None, *each[1:].tolist())) for seed, each in enumerate(returns))
    response = {
        axis: StepResponse(
            tuple(time.tolist()),
            tuple((10 * (1 - np.exp(-time / lag))).tolist()),
            tuple((10.02 * (1 - np.exp(-time / lag))).tolist()),
            99.71,
        )
        for axis, lag in (("pitch", 0.02), ("yaw", 0.1))
    }
    return PaperFigures(response, LearningCurves(steps, runs), LearningCurves(steps, runs))


@pytest.fixture(scope="session")
def synthetic_results() -> Results:
    cells, comparisons = make_cells()
    calibration_cells = tuple(
        CalibrationCell(cell.table, cell.range_m, 100 * cell.rate, 100 * cell.rate - (cell.paper or 0.0))
        for cell in cells
        if cell.controller == "kalman" and cell.command_limit == "box"
    )
    return Results(
        seed=7,
        commit="0123456789abcdef0123456789abcdef01234567",
        versions={"python": "3.11.7", "numpy": "2.1.0"},
        durations={"identification": 12.3, "training": 151.0},
        conditions={
            "range_bins": [[1, 2], [2, 3]],
            "hit_radius": 0.06,
            "settled_after_s": 0.5,
            "dispersion": 0.00349,
            "mood": "fair",
        },
        calibration=Calibration(
            calibration_cells, 2.5, 3000, 4338, 358, "Muzzle speeds from 18 to 25 m/s fit as well."
        ),
        table1=make_table1(),
        identification={
            "pitch": {"order": 4, "step_fit_percent": 99.71, "remarks": ["One pair of poles lies beyond the sweep."]},
            "yaw": {"order": 4, "validation": [{"file": "validation.csv", "fit_percent": 98.9}]},
        },
        figures=make_figures(),
        cells=tuple(cells),
        comparisons=tuple(comparisons),
    )


WORLDS = {"identified-sentry": 0.0, "sentry": 0.01, "rusty": 0.08}
"""Setting → share of the hits that a robot loses against the simulator."""
ROBOT_CONTROLLERS = ("history", "paper", "kalman", "kalman-lq", "parabola-lq", "oracle")


def make_robot_labels() -> list[dict[str, object]]:
    return [
        {"table": table, "target": hit_rate_table(table).target, "range_m": row.range_m, "command_limit": "gate"}
        for table in ("IV", "V")
        for row in hit_rate_table(table).rows
    ]


def make_robot_parts() -> dict[str, tuple[object, ...]]:
    """Cells, comparisons and drops of a robot; every world loses some of the simulator's hits."""
    generator = np.random.default_rng(77)
    cells, comparisons, drops = [], [], []
    for index, place in enumerate(make_robot_labels()):
        simulated = {name: draw_hits(generator, RATES[name][index]) for name in ROBOT_CONTROLLERS}
        for setting, lost in WORLDS.items():
            label = {**place, "setting": setting}
            hits = {name: hit & (generator.random(hit.shape) > lost) for name, hit in simulated.items()}
            for name, hit in hits.items():
                seed = 0 if name in {"history", "paper"} else None
                cells.append(make_cell(label, name, seed, hit))
                named = {**label, "controller": name, "policy_seed": seed}
                comparisons += [
                    Comparison(**named, against=other, **paired_difference(hit, hits[other])._asdict())
                    for other in ("kalman", "kalman-lq", "parabola-lq", "oracle")
                    if seed is not None
                ]
                drops += [
                    Drop(
                        **named,
                        settled=settled,
                        **paired_difference(simulated[name][:, first:], hit[:, first:])._asdict(),
                    )
                    for settled, first in ((False, 0), (True, 24))
                    if setting != "identified-sentry"
                ]
    return {"cells": tuple(cells), "comparisons": tuple(comparisons), "drops": tuple(drops)}


def make_robot() -> RobotIdentification:
    facts = {"order": 2, "delay_ms": 3.0, "dc_gain": 1.03, "dc_gain_interval": [1.021, 1.039]}
    fits = {"held_back_sweep_fit_percent": 95.3, "held_back_step_fit_percent": 98.1}
    time = np.arange(0, 0.5, 0.02)
    steps = tuple(
        RobotStep(
            axis,
            size,
            tuple(time.tolist()),
            tuple((size * (1 - np.exp(-time / 0.08))).tolist()),
            tuple((size * (1 - np.exp(-time / 0.04))).tolist()),
            fit,
        )
        for axis, size, fit in (("pitch", 2.0, 93.2), ("pitch", -15.0, 33.4), ("yaw", 2.0, 96.1), ("yaw", 30.0, 41.7))
    )
    landings = tuple(
        LandingRow(
            round(row.pitch_deg + 0.12, 2),
            round(-row.yaw_deg - 0.02, 2),
            20,
            mean := 1.3 * row.real_m,
            mean - 0.05,
            mean + 0.05,
            0.98 * mean,
            -2.0,
        )
        for row in landing_table().rows
    )
    return RobotIdentification(
        "sentry",
        {"pitch": {**facts, **fits}, "yaw": {**facts, **fits}},
        {
            "sensing": {"camera_latency_ms": 35.1, "command_latency_ms": None, "frames_lost": 3},
            "muzzle": {"speed_m_s": 17.85, "speed_m_s_interval": [17.81, 17.89], "pitch_offset_deg": -0.06},
            "kalman": {"acceleration_sd_m_s2": 4.0, "extra_lead_s": 0.02},
            "kalman-lq": {"acceleration_sd_m_s2": 2.0, "extra_lead_s": 0.0, "velocity_decay": 0.64, "smoothing": 0.1},
            "imm-lq": {"turn_rate_1_s": 2.0},
        },
        landings,
        steps,
    )


@pytest.fixture(scope="session")
def robot_results(synthetic_results: Results) -> Results:
    """Of a run with a robot alone."""
    return Results(
        seed=3,
        commit=synthetic_results.commit,
        versions=synthetic_results.versions,
        conditions={"hit_radius": 0.06, "muzzle_speed": 17.85, "position_noise": 0.0, "kalman_position_sd": 0.002},
        robot=make_robot(),
        **make_robot_parts(),
    )
