"""The policy for any target against motions that neither its training nor the suite `motions` has.

Fourteen ways to move, made up to be unlike the drawn ones: two swings at once, speeds that rise and fall evenly, jumps,
figures of eight, plates of a robot that spins and drives, soft braking, and so on. In the simulator identified from the
robot's logs, at four ranges, in engagements of 1 s and of 3 s, with the policies and the settings of the classical
controllers that `motions.py` has left in runs/motions: run that first. Every policy meets the best classical
controller of each motion, by the rate itself, which favours the classical side.

Writes benchmarks/results/unseen_motions.json.
"""

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.evaluation_run import EvaluationTask, classical_entrant, make_ground, policy_entrant
from archerfish.cli.setting import Setting
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.evaluate import Ground, Outcome, cells, compete, suite_difference
from archerfish.evaluation.results import MOTION_TABLES
from archerfish.evaluation.suites import Suite, draw_trials
from archerfish.records import storage
from archerfish.records.policy import read_policy
from archerfish.simulation.setting import make_scenario
from archerfish.targets.drawn import ANY
from archerfish.targets.path import BEGIN_S, STEP_S, TIMES, path_about
from archerfish.targets.path import Path as TargetPath
from machine import describe_machine
from motions import CLASSICAL, COMMAND_LIMIT, RUNS, SEED, TRAININGS, TUNING_ENGAGEMENTS, WORKERS, kept_settings, records

RESULT = Path(__file__).parent / "results" / "unseen_motions.json"
ENGAGEMENTS = 100
CHANCES = 40
MOST_BEHIND = 2.0
"""Points by which a policy may be behind the best classical controller, anywhere."""
Floats = NDArray[np.floating[Any]]


class Draws(NamedTuple):
    """Uniform draws of a batch of targets, shape (B, CHANCES)."""

    chance: Floats

    def between(self, index: int, low: float, high: float) -> Floats:
        """Return a parameter, shape (B, 1)."""
        return np.asarray(low + (high - low) * self.chance[..., index, None])

    def side(self, index: int) -> Floats:
        """Return −1 or 1, shape (B, 1)."""
        return np.where(self.chance[..., index, None] < 0.5, -1.0, 1.0)

    def phase(self, index: int) -> Floats:
        """Return an angle [rad], shape (B, 1)."""
        return self.between(index, 0.0, 2.0 * math.pi)


def along(heading: Floats, way: Floats) -> Floats:
    """Return a level way along a line; zero is across the line of sight."""
    return np.stack([np.sin(heading) * way, np.cos(heading) * way], axis=-1)


def driven(speed: Floats) -> Floats:
    """Return the way of a speed at `TIMES`, zero at time zero."""
    way = np.cumsum(speed, axis=-1) * STEP_S
    return np.asarray(way - way[..., round(-BEGIN_S / STEP_S), None])


def swing(draws: Draws, first: int, amplitude: tuple[float, float], frequency: tuple[float, float]) -> Floats:
    """Return a sine of three draws."""
    size, rate = draws.between(first, *amplitude), draws.between(first + 1, *frequency)
    return np.asarray(size * np.sin(2.0 * math.pi * rate * TIMES + draws.phase(first + 2)))


def sideways(draws: Draws) -> Floats:
    """Return a heading that is mostly across."""
    return draws.between(0, -0.5, 0.5)


def two_swings(draws: Draws) -> Floats:
    """Swing in two sines at once."""
    return along(sideways(draws), swing(draws, 1, (0.1, 0.4), (0.2, 0.6)) + swing(draws, 4, (0.05, 0.15), (0.8, 1.6)))


def even_speeding(draws: Draws) -> Floats:
    """Drive at a speed that rises and falls evenly, to and fro."""
    turn = (TIMES / draws.between(1, 0.8, 2.0) + draws.between(2, 0.0, 1.0)) % 1.0
    return along(sideways(draws), driven(draws.between(3, 0.5, 2.0) * (2.0 * np.abs(2.0 * turn - 1.0) - 1.0)))


def to_and_from(draws: Draws) -> Floats:
    """Drive towards the gimbal and away."""
    turn = np.sign(np.sin(2.0 * math.pi * (TIMES / draws.between(1, 0.8, 2.0) + draws.between(2, 0.0, 1.0))))
    return along(draws.between(0, 1.3, 1.57), driven(draws.between(3, 0.4, 1.5) * turn))


def fast_line(draws: Draws) -> Floats:
    """Drive past the gimbal at 2.5 m/s."""
    return along(draws.between(0, -0.2, 0.2), draws.side(1) * 2.5 * TIMES)


def jumps(draws: Draws) -> Floats:
    """Go from one place to another in no time, as no robot does."""
    turn = np.sign(np.sin(2.0 * math.pi * (TIMES / draws.between(1, 0.4, 1.2) + draws.between(2, 0.0, 1.0))))
    return along(sideways(draws), draws.between(3, 0.1, 0.3) * turn)


def eight(draws: Draws) -> Floats:
    """Drive a figure of eight."""
    angle = 2.0 * math.pi * draws.between(1, 0.3, 0.8) * TIMES + draws.phase(2)
    radius = draws.between(3, 0.15, 0.5)
    return np.stack([0.5 * radius * np.sin(2.0 * angle), radius * np.sin(angle)], axis=-1)


def pushes(draws: Draws) -> Floats:
    """Accelerate by one size, with a sign that is drawn again at even times, and some friction."""
    leg = np.minimum(((TIMES - BEGIN_S) / draws.between(1, 0.15, 0.4)).astype(int), 27)
    pushed = draws.between(2, 1.0, 5.0) * np.sign(np.take_along_axis(draws.chance[..., 6:34], leg, axis=-1) - 0.5)
    speed, speeds = np.zeros(draws.chance.shape[:-1]), []
    for index in range(len(TIMES)):
        speed = speed * (1.0 - STEP_S / 0.8) + STEP_S * pushed[..., index]
        speeds.append(speed)
    return along(sideways(draws), driven(np.stack(speeds, axis=-1)))


def weaving(draws: Draws) -> Floats:
    """Drive straight on, swinging."""
    line = along(sideways(draws), draws.side(1) * draws.between(2, 0.3, 1.5) * TIMES)
    return line + along(draws.between(3, -1.57, 1.57), swing(draws, 4, (0.03, 0.15), (0.6, 1.8)))


def creeping(draws: Draws) -> Floats:
    """Drive straight on, slower than any in the table."""
    return along(draws.between(0, -1.5, 1.5), draws.side(1) * draws.between(2, 0.05, 0.3) * TIMES)


def to_and_fro_with_rests(draws: Draws) -> Floats:
    """Drive there, rest, drive back, rest."""
    turn = (TIMES / draws.between(1, 0.9, 2.0) + draws.between(2, 0.0, 1.0)) % 1.0
    speed = np.select([turn < 0.3, turn < 0.5, turn < 0.8], [1.0, 0.0, -1.0], 0.0)
    smooth = np.apply_along_axis(lambda row: np.convolve(row, np.full(6, 1.0 / 6.0), "same"), -1, speed)
    return along(sideways(draws), driven(draws.between(3, 0.4, 1.8) * smooth))


def chirp(draws: Draws) -> Floats:
    """Swing quicker and quicker."""
    turns = draws.between(1, 0.2, 0.5) * TIMES + 0.5 * draws.between(2, 0.1, 0.4) * TIMES**2
    return along(sideways(draws), draws.between(3, 0.1, 0.3) * np.sin(2.0 * math.pi * turns + draws.phase(4)))


def spinning_and_driving(draws: Draws) -> Floats:
    """Show one plate of a robot that spins while it drives, always in sight."""
    angle = draws.between(1, 2.0, 6.0) * TIMES + draws.phase(2)
    circle = 0.2 * np.stack([-np.cos(angle), np.sin(angle)], axis=-1)
    return circle + along(draws.between(3, -0.5, 0.5), draws.between(4, -0.8, 0.8) * TIMES)


def wide_and_straight(draws: Draws) -> Floats:
    """Follow eq (7) without curvature, three to five times as wide."""
    width, speed = draws.between(1, 0.3, 0.6), draws.between(2, 0.1, 0.9)
    turn = (TIMES * speed / (4.0 * width) + draws.between(3, 0.0, 1.0)) % 1.0
    wave = np.where(turn < 0.25, 4.0 * turn, np.where(turn < 0.75, 2.0 - 4.0 * turn, 4.0 * turn - 4.0))
    return along(np.zeros_like(width), width * wave)


def soft_braking(draws: Draws) -> Floats:
    """Drive, and brake to a stand at some moment."""
    braked = draws.between(3, 1.0, 4.0) * np.maximum(TIMES - draws.between(2, -0.2, 2.0), 0.0)
    return along(sideways(draws), driven(draws.side(4) * np.maximum(draws.between(1, 0.5, 2.5) - braked, 0.0)))


WAYS: Mapping[str, Callable[[Draws], Floats]] = {
    each.__name__.replace("_", " "): each
    for each in (
        two_swings, even_speeding, to_and_from, fast_line, jumps, eight, pushes, weaving, creeping,
        to_and_fro_with_rests, chirp, spinning_and_driving, wide_and_straight, soft_braking,
    )
}  # fmt: skip


class _Empty(NamedTuple):
    """No arrays."""


def motion(name: str) -> Any:
    """Return a motion for `Scenario.motion`, as `targets.drawn` has them."""

    def path(place: Floats, chance: Floats, duration: Floats) -> TargetPath:
        way = WAYS[name](Draws(np.asarray(chance, np.float64)))
        return path_about(place, way.astype(np.float32), duration)

    return type("UnseenMotion", (_Empty,), {"path": staticmethod(path), "chances": CHANCES})()


@dataclass(frozen=True)
class Job:
    """One controller or policy against all motions, for one length."""

    setting: Setting
    seconds: float
    engagements: int
    controller: str = ""
    tuning: Any = None
    policy: str = ""


def make_unseen(job: Job) -> Ground:
    """Draw the engagements: the same for all."""
    task = EvaluationTask(job.setting, COMMAND_LIMIT, 1, SEED, target=ANY, seconds=job.seconds)
    ground, conditions = make_ground(task), task.conditions
    world: Any = ground.world
    suites = tuple(
        Suite(
            MOTION_TABLES[job.seconds],
            "dynamic",
            range_m,
            make_scenario(conditions, range_m, plants=world.plants, motion=motion(name)),
            name,
        )
        for name in WAYS
        for range_m in conditions.range_bins
    )
    trials = draw_trials(suites, job.engagements, conditions.decisions, SEED, normals=world.normals)
    return replace(ground, trials=trials)


def shoot(job: Job, advance: Callable[[float, str], None]) -> Outcome:
    """Let one of them shoot."""
    if job.policy:
        entrant = policy_entrant(read_policy(Path(job.policy)))
    else:
        tuning = {job.controller: job.tuning}
        task = EvaluationTask(job.setting, COMMAND_LIMIT, 1, SEED, tuning=tuning, target=ANY, seconds=job.seconds)
        entrant = classical_entrant(task, job.controller)
    (outcome,) = compete(make_unseen(job), [entrant])
    advance(1.0, entrant.name)
    return outcome


def compared(ground: Ground, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Compare every policy with the best classical controller of each motion, in every cell."""
    shot = cells(ground, outcomes)
    count = len(ground.trials.suites)
    by_name = {each.name: each for each in outcomes if each.policy_seed is None}
    rates = {name: [cell.rate for cell in shot if cell.controller == name] for name in by_name}
    rows = []
    for index, suite in enumerate(ground.trials.suites):
        same = [other for other in range(count) if ground.trials.suites[other].motion == suite.motion]
        rival = max(by_name, key=lambda name, same=same: sum(rates[name][other] for other in same))  # type: ignore[misc]
        for place, outcome in enumerate(outcomes):
            if outcome.policy_seed is not None:
                found = suite_difference(suite, outcome, by_name[rival], index)
                cell = shot[count * place + index]
                rows.append(
                    {
                        "motion": suite.motion, "range_m": suite.range_m, "table": suite.table,
                        "policy_seed": outcome.policy_seed, "against": rival, "rate": cell.rate,
                        "fallback_share": cell.fallbacks / (cell.shots + cell.withheld), **found._asdict(),
                    }
                )  # fmt: skip
    return rows


def show(rows: list[dict[str, Any]]) -> None:
    """Print a line per motion and length: the mean over ranges and trainings, and the least cell."""
    table = Table("motion", "length", "against", "mean", "least", "fell back")
    for motion_name in WAYS:
        for length in MOTION_TABLES.values():
            mine = [row for row in rows if (row["motion"], row["table"]) == (motion_name, length)]
            mean, least = (100 * float(each([row["difference"] for row in mine])) for each in (np.mean, np.min))
            share = 100 * float(np.mean([row["fallback_share"] for row in mine]))
            table.add_row(motion_name, length, mine[0]["against"], f"{mean:+.1f}", f"{least:+.1f}", f"{share:.1f} %")
    console = Console(width=120)
    console.print(table)
    behind = [row for row in rows if 100 * row["difference"] < -MOST_BEHIND]
    console.print(f"behind by more than {MOST_BEHIND:g} points: {len(behind)} of {len(rows)} cells")


def main() -> None:
    """Run everything; `--quick` with too little to be quoted, and without a file."""
    quick = "--quick" in sys.argv[1:]
    keep_compiled()
    setting = records(WORKERS)
    settings = kept_settings(setting, TUNING_ENGAGEMENTS)
    count = 4 if quick else ENGAGEMENTS
    plain = [Job(setting, seconds, count) for seconds in MOTION_TABLES]
    names = [RUNS / "policies" / f"{ANY}-{seed}" / "policy.json" for seed in TRAININGS]
    shooters = [
        *(replace(each, controller=name, tuning=settings[name][ANY].tuning) for each in plain for name in CLASSICAL),
        *(replace(each, policy=str(name)) for each in plain for name in names),
    ]
    tasks: list[Task] = [(shoot, job, 1.0) for job in shooters]
    found = run_tasks("shooting", "controllers", tasks, WORKERS)
    rows = []
    for each in plain:
        mine = [outcome for job, outcome in zip(shooters, found, strict=True) if job.seconds == each.seconds]
        rows += compared(make_unseen(each), mine)
    show(rows)
    if not quick:
        conditions = {**describe_machine(), "engagements_per_cell": ENGAGEMENTS, "seed": SEED, "trainings": TRAININGS}
        storage.write_json(RESULT, {"conditions": conditions, "differences": rows})


if __name__ == "__main__":
    main()
