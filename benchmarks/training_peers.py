"""Training beside its peers in one run: Stable-Baselines3, SBX, Brax and RLtools, in the same environment.

Same environment (the paper's gimbal under `box`, history observation), network, batch, epochs and minibatches; one
learning rate where a tool has but one. Each trains in a process and an environment of its own, which the first run
makes. Policies are judged here, outside the clock, the same way for all: on the tuning's draws, against the paper's
PPO column in all eight cells of Tables II and III. Writes benchmarks/results/training_peers.json and exits with 1 if
a target is missed.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from adapter_agreement import transitions_that_differ
from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import PolicyController
from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import iterate, make_learner, sizes
from archerfish.learning.shards import claim_devices
from archerfish.learning.training import CHUNK
from archerfish.learning.update import hyper
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.tables import hit_rate_table
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from archerfish.simulation.environment import ShootingEnvironment
from environment_speed import environment_speeds
from machine import describe_machine, matrix_product_rate
from peers.environments import version
from peers.roster import Tool
from peers.training_protocol import Case, shooting_environment
from peers.training_roster import BRAX, DIFFERENCES, OURS, SB3, SBX, TRAINERS, WITHOUT_POLICY
from peers.training_running import UNSTEADY, Training, load_policy, train, train_side_by_side
from training import hit_rates, network_flops, shots_per_second, timed
from training_peers_tables import figures_table, growth_table, rates_table, targets_table

RESULT = Path(__file__).parent / "results" / "training_peers.json"
SEED = 0
CONDITIONS = assumed_conditions()
TABLES = ("II", "III")
SHORT = 4 * UNSTEADY
"""Iterations of a training that is only timed; ours and Brax's run four in a call."""
THREADS = (1, 2)
TOLD_THREADS = (SB3, BRAX)
"""Tools that are told how many threads, or for Brax devices, to use; both numbers are tried."""
ROUNDS = 3
"""Of short trainings, one tool after the other: rates are those of the fastest round, as what else the machine has to
do only slows one down; ratios are taken round by round, and the median counts."""


class Extent(NamedTuple):
    """How much is measured."""

    steps: int
    checkpoint_every: int
    engagements: int
    environments: tuple[int, ...]
    hidden: tuple[int, ...]
    seeds: tuple[int, ...]
    adapter_steps: int


FULL = Extent(1_024_000, 102_400, 200, (64, 4096), (64, 512), (1, 2), 5000)
QUICK = Extent(204_800, 102_400, 20, (64,), (64,), (2,), 300)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few minutes, small sizes, nothing written")
    parser.add_argument("--only", nargs="+", metavar="TOOL", help="tools beside Archerfish; nothing written")
    options = parser.parse_args()
    claim_devices(PpoConfig().shards)
    extent = QUICK if options.quick else FULL
    tools = [each for each in TRAINERS if not options.only or each.name in (OURS.name, *options.only)]
    console = Console(width=140)
    with tempfile.TemporaryDirectory() as name:
        content = measure(tools, extent, Path(name))
    console.print(rates_table(content["tools"]))
    console.print(growth_table("environments side by side", "tool", content["growth_with_environments"]))
    console.print(growth_table("neurons of the hidden layers", "tool", content["growth_with_hidden"]))
    console.print(growth_table("trainings at once, all together", "how", content["growth_with_seeds"]))
    console.print(figures_table(content["figures"]), targets_table(content["targets"]))
    if not options.quick and not options.only:
        write_json(RESULT, content)
    missed = [name for name, (least, reached) in content["targets"].items() if reached < least]
    if missed:
        sys.exit(f"missed: {'; '.join(missed)}")


def measure(tools: Sequence[Tool], extent: Extent, folder: Path) -> dict[str, Any]:
    """Return everything that is written.

    Args:
      tools: who trains; ours first.
      extent: how much.
      folder: for what the trainings leave.
    """
    load, machine = os.getloadavg(), describe_machine()
    environment, config = shooting_environment(), PpoConfig(steps=extent.steps)
    trials = draw_trials(table_suites(CONDITIONS), extent.engagements, CONDITIONS.decisions, SEED, "tuning")
    figures = environment_figures(environment, config, extent)
    threads = {tool.name: fastest_threads(tool, config, folder) for tool in tools if tool in TOLD_THREADS}
    rounds = speed_rounds(tools, config, threads, folder)
    best: dict[str, Training] = {}
    described: dict[str, dict[str, Any]] = {}
    for tool in tools:
        best[tool.name] = max(rounds[tool.name], key=lambda each: each.steps_per_second if not each.problem else 0.0)
        described[tool.name] = describe_tool(tool, rounds[tool.name], best[tool.name])
        if not best[tool.name].problem and tool not in WITHOUT_POLICY:
            judged, learnt = learning_of(tool, best[tool.name].case, extent, environment, trials, folder)
            best[tool.name] = best[tool.name]._replace(policies=judged.policies)
            described[tool.name] |= learnt
    ours = best[OURS.name]
    ratios = {tool.name: ratio(rounds[OURS.name], rounds[tool.name]) for tool in tools}
    for name, each in described.items():
        each["ours_over_it"] = ratios[name]
    # What steps one environment after the other grows with nothing, and takes its time to show it.
    able = [tool for tool in tools if not best[tool.name].problem and tool not in WITHOUT_POLICY]
    figures |= learning_figures(ours, config, environment, trials)
    return {
        "machine": machine,
        "load_before": load,
        "load_after": os.getloadavg(),
        "provenance": provenance(SEED),
        "conditions": {
            "command_limit": "box",
            "stream": "tuning",
            "bar": "the paper's PPO column in all eight cells of Tables II and III",
            "seed": SEED,
            "ppo": asdict(config),
            "differences": DIFFERENCES,
            "extent": extent._asdict(),
        },
        "tools": described,
        "growth_with_environments": grown(able, config, best, "environments", extent.environments, folder),
        "growth_with_hidden": grown(able, config, best, "hidden", extent.hidden, folder),
        "growth_with_seeds": seeds_at_once(able, config, extent.seeds, folder),
        "figures": figures,
        "targets": targets(ratios, figures),
    }


def case_of(config: PpoConfig, iterations: int | None = None, **changes: Any) -> Case:
    """Return the training of a configuration, or a shorter one without policies."""
    shared = {name: getattr(config, name) for name in Case._fields if hasattr(config, name)}
    facts = {"learning_rate": config.actor_learning_rate, "seed": SEED, "threads": 1, "checkpoint_every": 0}
    case = Case(**{**shared, **facts, **changes})
    return case if iterations is None else case._replace(steps=iterations * case.batch)


def fastest_threads(tool: Tool, config: PpoConfig, folder: Path) -> int:
    """Return the number of threads, or devices, that a tool is fastest with."""
    rates = {each: train(tool, case_of(config, 2 * SHORT, threads=each), folder) for each in THREADS}
    return max(rates, key=lambda each: 0.0 if rates[each].problem else rates[each].steps_per_second)


def speed_rounds(
    tools: Sequence[Tool], config: PpoConfig, threads: Mapping[str, int], folder: Path
) -> dict[str, tuple[Training, ...]]:
    """Train for a short while by every tool in turn, and again; tool → its trainings."""
    found: dict[str, tuple[Training, ...]] = {tool.name: () for tool in tools}
    for number in range(ROUNDS):
        for tool in tools:
            slow = tool in WITHOUT_POLICY  # steps one environment after the other: minutes where others take seconds
            if slow and number:
                continue
            print(f"round {number + 1} of {ROUNDS}: {tool.name}", flush=True)
            case = case_of(config, SHORT if slow else 4 * SHORT, threads=threads.get(tool.name, 1))
            found[tool.name] += (train(tool, case, folder, folder / f"cache_{tool.name}"),)
    return found


def describe_tool(tool: Tool, rounds: Sequence[Training], best: Training) -> dict[str, Any]:
    """Return the speed of a tool; its first round has compiled everything, the later ones have loaded it."""
    if best.problem:
        return {"problem": best.problem}
    warm = [each.compile_seconds for each in rounds[1:] if not each.problem]
    return {
        "version": version(tool),
        "threads": best.case.threads if tool in TOLD_THREADS else None,
        "steps_per_second": round(best.steps_per_second),
        "steps_per_second_of_rounds": [None if each.problem else round(each.steps_per_second) for each in rounds],
        "compile_seconds_cold": round(rounds[0].compile_seconds, 2),
        "compile_seconds_warm": round(min(warm), 2) if warm else None,
        "seconds_to_bar": None,
        "steps_to_bar": None,
        "peak_mib": round(best.peak_mib),
    }


def learning_of(
    tool: Tool, case: Case, extent: Extent, environment: ShootingEnvironment, trials: Trials, folder: Path
) -> tuple[Training, dict[str, Any]]:
    """Train for longer, and judge the policies on the way."""
    print(f"{tool.name}: training", flush=True)
    longer = case._replace(steps=extent.steps, checkpoint_every=extent.checkpoint_every)
    found = train(tool, longer, folder, folder / f"cache_{tool.name}")
    if found.problem:
        return found, {"problem_when_training_longer": found.problem}
    reached = [(steps, shares(environment, path, trials)) for steps, path in found.policies]
    bar = next((steps for steps, rates in reached if np.all(rates >= printed_bar())), None)
    return found, {
        "seconds_to_bar": None if bar is None else round(found.seconds_until(bar), 2),
        "steps_to_bar": bar,
        "hit_rates_percent": {steps: np.round(100 * rates, 2).tolist() for steps, rates in reached},
    }


def shares(environment: ShootingEnvironment, path: Path, trials: Trials) -> NDArray[np.float64]:
    """Return the hit rates of a policy's file in the eight cells."""
    mean, variance, layers = load_policy(path)
    normaliser = Normaliser(*(np.asarray(each, np.float32) for each in (mean, variance, 0.0)))
    actor = tuple(Layer(*(np.asarray(part, np.float32) for part in each)) for each in layers)
    return hit_rates(environment.world, PolicyController(environment.observer, normaliser, actor), trials)


def printed_bar() -> NDArray[np.float64]:
    """Return the paper's PPO column of Tables II and III, 0…1, shape (8,)."""
    return np.array([row.ppo_percent for name in TABLES for row in hit_rate_table(name).rows]) / 100


def environment_figures(environment: ShootingEnvironment, config: PpoConfig, extent: Extent) -> dict[str, float]:
    """Measure the environment alone, and the machine's matrix products."""
    print("environment alone", flush=True)
    speeds = environment_speeds(environment, config.environments, extent.adapter_steps)
    product = jax.jit(jnp.matmul)
    left, right = np.random.default_rng(0).standard_normal((2, 512, 512), dtype=np.float32)
    jax.block_until_ready(product(left, right))
    seconds = min(timed(lambda: product(left, right))[1] for _ in range(50))
    return {
        **{f"environment steps/s, {name}": round(rate) for name, rate in speeds.items()},
        "compiled over one at a time": speeds["compiled"] / speeds["Gymnasium, one at a time"],
        f"transitions that differ, of {4 * extent.adapter_steps}": transitions_that_differ(
            environment, 4, extent.adapter_steps
        ),
        "matrix product 512, NumPy [GFLOP/s]": matrix_product_rate(512),
        "matrix product 512, JAX [GFLOP/s]": 2 * 512**3 / seconds / 1e9,
    }


def learning_figures(
    ours: Training, config: PpoConfig, environment: ShootingEnvironment, trials: Trials
) -> dict[str, float]:
    """Set the arithmetic of our training against the machine's, and measure the speed of an evaluation."""
    flops = sum(network_flops(config, environment.observed, outputs) for outputs in (2, 1))
    mean, variance, layers = load_policy(ours.policies[-1][1])
    actor = tuple(Layer(*each) for each in layers)
    policy = PolicyController(environment.observer, Normaliser(mean, variance, np.float32(0.0)), actor)
    gflops, products = flops * ours.steps_per_second / 1e9, matrix_product_rate(512)
    return {
        "network operations per decision": flops,
        "training [GFLOP/s]": gflops,
        "training over matrix product 512": gflops / products,
        "evaluation shots/s, history": round(shots_per_second(environment.world, policy, trials)),
    }


def grown(
    tools: Sequence[Tool],
    config: PpoConfig,
    best: dict[str, Training],
    setting: str,
    values: Sequence[int],
    folder: Path,
) -> dict[str, dict[str, float | None]]:
    """Return the steps per second of each tool with each value of a setting."""
    rates: dict[str, dict[str, float | None]] = {}
    for tool in tools:
        print(f"{tool.name}: {setting}", flush=True)
        threads = best[tool.name].case.threads
        cases = {str(value): case_of(config, 2 * SHORT, threads=threads, **{setting: value}) for value in values}
        done = {value: train(tool, case, folder) for value, case in cases.items()}
        rates[tool.name] = {value: None if each.problem else each.steps_per_second for value, each in done.items()}
    return rates


def seeds_at_once(
    tools: Sequence[Tool], config: PpoConfig, seeds: Sequence[int], folder: Path
) -> dict[str, dict[str, float | None]]:
    """Return the steps per second of several trainings at once, all together."""
    rates: dict[str, dict[str, float | None]] = {
        f"{OURS.name}, vmap": {str(count): vmapped_rate(config, count) for count in seeds}
    }
    for tool in tools:
        print(f"{tool.name}: processes", flush=True)
        row: dict[str, float | None] = {}
        for count in seeds:
            cases = [case_of(config, 2 * SHORT)._replace(seed=seed) for seed in range(count)]
            done = train_side_by_side(tool, cases, folder, one_thread=count > 1)
            row[str(count)] = None if any(each.problem for each in done) else sum(e.steps_per_second for e in done)
        rates[f"{tool.name}, processes"] = row
    return rates


def vmapped_rate(config: PpoConfig, count: int) -> float:
    """Return the steps per second of our trainings with several seeds in one program, all together."""
    environment: ShootingEnvironment = jax.tree.map(jnp.asarray, shooting_environment())
    settings, size = hyper(config), sizes(config)
    learners = jax.vmap(lambda key: make_learner(environment, config, key))(
        jax.random.split(jax.random.key(SEED), count)
    )
    advance = jax.jit(jax.vmap(lambda learner: iterate(environment, settings, learner, size, CHUNK)[0]))
    learners = jax.block_until_ready(advance(learners))
    seconds = min(timed(lambda: advance(learners))[1] for _ in range(UNSTEADY))
    return CHUNK * config.batch * count / seconds


def ratio(ours: Sequence[Training], theirs: Sequence[Training]) -> float | None:
    """Return by how much we were faster, the median over the rounds; None where the other never ran."""
    pairs = [
        one.steps_per_second / other.steps_per_second
        for one, other in zip(ours, theirs, strict=False)
        if not one.problem and not other.problem
    ]
    return median(pairs) if pairs else None


def targets(ratios: dict[str, float | None], figures: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Return what was to be reached and what was; of tools that could not be run, nothing."""
    trained = {
        f"training over {tool.name}": (least, reached)
        for tool, least in ((SB3, 5.0), (SBX, 2.0), (BRAX, 2.0))
        if (reached := ratios.get(tool.name)) is not None
    }
    return trained | {
        "training over matrix product 512": (0.35, figures["training over matrix product 512"]),
        "environment steps/s, compiled": (8e6, figures["environment steps/s, compiled"]),
        "compiled over one at a time": (20.0, figures["compiled over one at a time"]),
    }


if __name__ == "__main__":
    main()
