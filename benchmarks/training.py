"""Speed of training and evaluation, and the time until the history policy meets its bar under `box`.

The bar is 98/98/97/97 % (static) and 98/97/96/95 % (dynamic) of the oracle's hit rates, on the tuning's own draws,
never those of the evaluation. Speeds stand beside the machine's rate of matrix products, measured in the same run.
Writes benchmarks/results/training.json; exits with 1 if the bar is not met.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.command_limits import box_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import SPLIT, iterate, make_learner, sizes
from archerfish.learning.shards import claim_devices, placed
from archerfish.learning.training import CHUNK, trained_policy
from archerfish.learning.update import hyper
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from archerfish.sensing.observation import ACTION_SCALES, make_observer, observation_size
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.setting import make_scenario, make_world, paper_muzzle
from archerfish.simulation.shooting import ShootingWorld
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "training.json"
SEED = 0
ENGAGEMENTS = 200
"""Per cell, of every evaluation."""
EVALUATE_EVERY = 200_000
"""Decisions of training between two evaluations."""
BAR_PERCENT = (98, 98, 97, 97, 98, 97, 96, 95)
"""Of the oracle's hit rate: static, then dynamic, near to far."""
CLASSICAL = ("kalman", "kalman-lq", "oracle")
CONDITIONS = assumed_conditions()


@dataclass(frozen=True)
class Training:
    """How a training went."""

    policy: Any
    """At its end."""
    compile_seconds: float
    """To build the program and begin."""
    seconds: float
    """Of training, without compilation and evaluations."""
    steps: int
    """Decisions trained for."""
    evaluations: list[dict[str, Any]]
    """Steps, seconds of training so far, and shares of the oracle's hit rates [%] in the eight cells."""


def build_environment() -> ShootingEnvironment:
    """Build the history policy's environment under `box`, half of its targets standing still."""
    muzzle = paper_muzzle(CONDITIONS)
    world = make_world(
        **printed_plants(), muzzle=muzzle, limits=gate_limits(), command_limit="box", conditions=CONDITIONS
    )
    observer = make_observer("history", muzzle_from_record(muzzle), action_scale=ACTION_SCALES["box"])
    scenario = make_scenario(CONDITIONS, static_share=0.5)
    environment = ShootingEnvironment(
        world, scenario, single_precision(observer), np.asarray(CONDITIONS.decisions, np.int32)
    )
    arrays: ShootingEnvironment = jax.tree.map(jax.numpy.asarray, environment)
    return arrays


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return a result and the seconds that it took."""
    begun = time.perf_counter()
    result = jax.block_until_ready(function())
    return result, time.perf_counter() - begun


def hit_rates(world: ShootingWorld, controller: Any, trials: Trials) -> NDArray[np.float64]:
    """Hit rates in the eight cells."""
    hit = fight(world, controller, trials).hits(CONDITIONS.hit_radius)
    return np.asarray(hit.reshape(len(trials.suites), -1).mean(axis=1))


def train_and_judge(environment: ShootingEnvironment, config: PpoConfig, judge: Callable[[Any], Any]) -> Training:
    """Train, with the clock stopped for an evaluation now and then."""
    settings, size = hyper(config), sizes(config)
    per_call = CHUNK * size.environments * size.rollout
    begin_seconds = timed(lambda: make_learner(environment, config, jax.random.key(SEED)))[1]
    # Placed at once, as `archerfish train` does it: else the second call would be compiled anew.
    learner = placed(make_learner(environment, config, jax.random.key(SEED)), config.shards, SPLIT)
    first_seconds = timed(lambda: iterate(environment, settings, learner, size, CHUNK))[1]
    passed, evaluations = [], []
    for _ in track(range(config.steps // per_call), "training"):
        (learner, _), each = timed(partial(iterate, environment, settings, learner, size, CHUNK))
        passed.append(each)
        steps = per_call * len(passed)
        if steps // EVALUATE_EVERY > (steps - per_call) // EVALUATE_EVERY:
            shares = judge(trained_policy(environment.observer, learner))
            evaluations.append({"steps": steps, "seconds": round(sum(passed), 2), "percent_of_oracle": shares})
    return Training(
        policy=trained_policy(environment.observer, learner),
        compile_seconds=begin_seconds + first_seconds - min(passed),
        seconds=sum(passed),
        steps=per_call * len(passed),
        evaluations=evaluations,
    )


def network_flops(config: PpoConfig, inputs: int, outputs: int) -> int:
    """Floating-point operations of a network's matrix products per decision trained for, acting included.

    A hidden layer of h costs 2 (n h + h m) forward, and backward as much again for the weights and 2 h m for the
    hidden layer; the actor acts once, the critic judges the observation and the one that follows.
    """
    forward = 2 * config.hidden * (inputs + outputs)
    learning = 2 * forward + 2 * config.hidden * outputs
    return config.epochs * learning + (forward if outputs == 2 else 2 * forward)


def shots_per_second(world: ShootingWorld, controller: Any, trials: Trials) -> float:
    """Speed of an evaluation whose program has been built."""
    seconds = min(timed(lambda: fight(world, controller, trials))[1] for _ in range(3))
    return float(np.prod(trials.draws.shape[:2]) / seconds)


def first_to_meet_the_bar(evaluations: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the first evaluation with every cell at the bar."""
    meeting = (each for each in evaluations if np.all(np.array(each["percent_of_oracle"]) >= BAR_PERCENT))
    return next(meeting, None)


def measure(training: Training, config: PpoConfig, inputs: int, machine: dict[str, Any]) -> dict[str, Any]:
    """Turn a training into figures."""
    met = first_to_meet_the_bar(training.evaluations)
    rate = training.steps / training.seconds
    gflops = rate * sum(network_flops(config, inputs, outputs) for outputs in (2, 1)) / 1e9
    return {
        "compile_seconds": round(training.compile_seconds, 2),
        "steps": training.steps,
        "training_seconds": round(training.seconds, 2),
        "steps_per_second": round(rate),
        "learning_gflops": round(gflops, 1),
        "learning_per_matrix_product_rate": round(gflops / machine["matrix_product_gflops"], 3),
        "steps_to_bar": None if met is None else met["steps"],
        "seconds_to_bar": None if met is None else met["seconds"],
    }


def main() -> None:
    """Measure, print and write."""
    claim_devices(PpoConfig().shards)
    machine, environment, config = describe_machine(), build_environment(), PpoConfig()
    world = environment.world
    trials = draw_trials(table_suites(CONDITIONS), ENGAGEMENTS, CONDITIONS.decisions, SEED, "tuning")
    controllers = {name: make_controller(name, workbench()) for name in CLASSICAL}
    oracle = hit_rates(world, controllers["oracle"], trials)

    def judge(policy: Any) -> list[float]:
        return [round(float(each), 2) for each in 100 * hit_rates(world, policy, trials) / oracle]

    training = train_and_judge(environment, config, judge)
    figures = measure(training, config, observation_size(environment.observer), machine)
    controllers["history"] = training.policy
    speeds = {name: round(shots_per_second(world, each, trials)) for name, each in controllers.items()}
    show(figures | {f"shots/s, {name}": speed for name, speed in speeds.items()}, training.evaluations)
    conditions = {"seed": SEED, "stream": "tuning", "command_limit": "box", "engagements": ENGAGEMENTS}
    conditions |= {"bar_percent": BAR_PERCENT, "ppo": asdict(config)}
    content = {"machine": machine, "conditions": conditions, "provenance": provenance(SEED), **figures}
    write_json(RESULT, {**content, "shots_per_second": speeds, "evaluations": training.evaluations})
    if figures["seconds_to_bar"] is None:
        sys.exit("the history policy did not meet the bar")


def workbench() -> Workbench:
    """Collect what the classical controllers are built from."""
    plants = printed_plants()
    model = gimbal_model(plants["pitch"], plants["yaw"], CONDITIONS.control_period_s)
    return Workbench(model, muzzle_from_record(paper_muzzle(CONDITIONS)), box_limits(gate_limits()), CONDITIONS)


def show(figures: dict[str, Any], evaluations: list[dict[str, Any]]) -> None:
    """Print the figures, and how the policy came to its bar."""
    console = Console(width=120)
    table = Table("figure", "value", title="training and evaluation")
    for name, value in figures.items():
        table.add_row(name.replace("_", " "), "—" if value is None else f"{value:,}")
    console.print(table)
    progress = Table("steps", "seconds", "% of the oracle", title=f"bar {' '.join(map(str, BAR_PERCENT))}")
    for each in evaluations:
        shares = " ".join(f"{share:6.2f}" for share in each["percent_of_oracle"])
        progress.add_row(f"{each['steps']:,}", f"{each['seconds']:.1f}", shares)
    console.print(progress)


if __name__ == "__main__":
    main()
