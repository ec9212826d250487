"""Whether an exported policy decides as its source does, and how long a decision takes.

Trains a policy of each kind of observation, exports it, and lets NumPy, JAX and ONNX Runtime run it: on the frames of
10⁵ decisions in the simulator that it was trained in, all three from the same memory and each with its own; on 10⁵
first frames with every number at an edge; then one decision at a time, NumPy and ONNX Runtime (one thread) in turn, in
one process. Writes benchmarks/results/export.json; exits with 1 if any two commands from the same memory differ by more
than the bar. Carried on for 50 decisions, the last bits of float32 grow: reported, not judged.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from archerfish.controllers.guarded_policy import GuardedPolicy, controller_from_record
from archerfish.controllers.policy import PolicyController, policy_to_record
from archerfish.deployment.export import export_policy
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.learning.config import PpoConfig
from archerfish.learning.training import train, trained_policy
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.policy import read_policy, write_policy
from archerfish.records.provenance import provenance
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.records.storage import write_json
from archerfish.sensing.interfaces import Seen
from archerfish.simulation.assembly import make_environment
from archerfish.simulation.environment import ShootingEnvironment
from export_agreement import commands_of_sequences, first_commands, inputs_of, largest_differences, packed, runtime
from export_inputs import edge_frames
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "export.json"
SEED = 0
BAR_RAD = 1e-5
LIMIT = "gate"
CONDITIONS = assumed_conditions()
SENSING = SensingRecord(
    CameraRecord(
        rate_hz=80.0,
        time_offset=0.0,
        stamp_jitter=0.0,
        bearing_sd=0.0017,
        elevation_sd=0.0016,
        range_sd=0.06,
        noise_range=4.0,
        miss_probability=0.02,
        outlier_share=0.0,
    ),
    LinkRecord(feedback_rate_hz=1000.0),
)
"""A camera and a link for the tracked observation: late and noisy as on a robot."""


class Extent(NamedTuple):
    """How much is measured."""

    steps: int
    """Decisions of each training."""
    engagements: int
    """Per cell of eight, of 50 decisions each."""
    edges: int
    """First frames."""
    timed: int
    """Decisions one at a time."""


FULL, QUICK = Extent(2_000_000, 250, 100_000, 20_000), Extent(51_200, 5, 2_000, 500)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a minute, small sizes, nothing written")
    quick = parser.parse_args().quick
    extent, machine = QUICK if quick else FULL, describe_machine()
    with tempfile.TemporaryDirectory() as folder:
        kinds = {kind: measure(kind, extent, Path(folder)) for kind in ("history", "paper", "tracked")}
    content = {
        "machine": machine,
        "provenance": provenance(SEED),
        "command_limit": LIMIT,
        "extent": extent._asdict(),
        "bar_rad": BAR_RAD,
        "kinds": kinds,
    }
    console = Console(width=140)
    console.print(agreement_table(kinds), latency_table(kinds))
    if not quick:
        write_json(RESULT, content)
    apart = {kind: max(max(found[name].values()) for name in ("same_memory", "edges")) for kind, found in kinds.items()}
    if max(apart.values()) > BAR_RAD:
        sys.exit(f"apart by more than {BAR_RAD:g} rad: {apart}")


def measure(kind: str, extent: Extent, folder: Path) -> dict[str, Any]:
    """Train, export and compare a policy of one kind."""
    print(f"{kind}: training", flush=True)
    environment = make_environment(
        command_limit=LIMIT, observation=kind, sensing=SENSING if kind == "tracked" else None
    )
    learner = train(environment, PpoConfig(steps=extent.steps), SEED).learner
    record = policy_to_record(
        trained_policy(environment.observer, learner), period_s=CONDITIONS.control_period_s, command_limit=LIMIT
    )
    write_policy(folder / f"{kind}.json", record)
    told = export_policy(folder / f"{kind}.json", folder / f"{kind}.onnx")
    policy: PolicyController | GuardedPolicy = single_precision(
        controller_from_record(read_policy(folder / f"{kind}.json"))
    )
    session = runtime(folder / f"{kind}.onnx")
    print(f"{kind}: comparing", flush=True)
    frames = met_frames(policy, environment, extent)
    edges = edge_frames(extent.edges, SEED, signed_zeros=kind != "tracked")
    with np.errstate(all="ignore"):  # at the pivot there is no direction
        return {
            "decisions": int(np.prod(frames.elapsed.shape)),
            "same_memory": largest_differences(commands_of_sequences(policy, session, frames, carried=False)),
            "own_memory": largest_differences(commands_of_sequences(policy, session, frames, carried=True)),
            "edge_frames": extent.edges,
            "edges": largest_differences(first_commands(policy, session, edges)),
            "file_bytes": told["bytes"],
            "latency_us": latencies(policy, session, frames, extent.timed),
        }


def met_frames(policy: PolicyController, environment: ShootingEnvironment, extent: Extent) -> Seen:
    """Let a policy shoot in its simulator and return what it saw, arrays of shape (T, B) first."""
    trials = draw_trials(table_suites(CONDITIONS), extent.engagements, CONDITIONS.decisions, SEED, "tuning")
    world = jax.tree.map(jnp.asarray, environment.world)
    shooting, seen = jax.jit(world.reset)(*jax.tree.map(jnp.asarray, (trials.engagements, _draws(world, trials))))
    advance, memory, frames = jax.jit(world.step), None, []
    for _ in range(CONDITIONS.decisions):
        frames.append(jax.tree.map(np.asarray, seen))
        memory = policy.reset(frames[-1]) if memory is None else memory
        memory, command = policy.step(memory, frames[-1])
        shooting, seen, _ = advance(shooting, jax.tree.map(jnp.asarray, command))
    stacked: Seen = map_arrays(lambda *each: np.stack(each), *frames)
    return stacked


def _draws(world: Any, trials: Any) -> Any:
    """Draw the normals of all steps: a world with noise in what is seen takes more than the muzzle alone."""
    shape = (*trials.draws.shape[:-1], world.normals)
    return np.random.default_rng(SEED).standard_normal(shape, dtype=np.float32)


def latencies(policy: PolicyController, session: Any, frames: Seen, count: int) -> dict[str, dict[str, float]]:
    """Return the time of a decision of one robot [µs], the two engines taking turns.

    Args:
      policy: in NumPy.
      session: the same, exported.
      frames: arrays of shape (T, B) first, of which one member is taken.
      count: decisions.
    """
    # One robot has no batch in NumPy, and a batch of one in ONNX Runtime.
    alone = [map_arrays(lambda each, at=at: each[at, 0], frames) for at in range(len(frames.elapsed))]
    memory = policy.reset(alone[0])
    state = packed(map_arrays(lambda each: np.asarray(each)[None], memory))
    feeds = [
        inputs_of(session, map_arrays(lambda each: each[None], seen), np.array([at == 0]), state)
        for at, seen in enumerate(alone)
    ]
    times: dict[str, list[float]] = {"NumPy": [], "ONNX Runtime": []}
    for index in range(count):
        at = index % len(alone)
        begun = time.perf_counter()
        memory, _ = policy.step(memory, alone[at])
        between = time.perf_counter()
        state = session.run(["angle_command", "next_state"], {**feeds[at], "state": state})[1]
        times["NumPy"].append(between - begun)
        times["ONNX Runtime"].append(time.perf_counter() - between)
    return {
        name: {f"p{rank}": round(1e6 * float(np.percentile(each, rank)), 1) for rank in (50, 99)}
        for name, each in times.items()
    }


def agreement_table(kinds: dict[str, Any]) -> Table:
    """Lay out the largest differences."""
    pairs = list(next(iter(kinds.values()))["edges"])
    table = Table(title="largest difference of two commands [µrad]")
    for column in ("policy", "inputs", *pairs):
        table.add_column(column, justify="left" if column in ("policy", "inputs") else "right")
    for kind, found in kinds.items():
        rows = {
            "same_memory": f"{found['decisions']:,} decisions, same memory",
            "own_memory": "the same, each with its own memory",
            "edges": f"{found['edge_frames']:,} edge frames",
        }
        for name, words in rows.items():
            table.add_row(kind, words, *(f"{1e6 * found[name][pair]:.2f}" for pair in pairs))
    return table


def latency_table(kinds: dict[str, Any]) -> Table:
    """Lay out the times of a decision."""
    table = Table(title="a decision at batch 1 [µs]")
    for column in ("policy", "engine", "p50", "p99"):
        table.add_column(column, justify="right" if column.startswith("p5") or column == "p99" else "left")
    for kind, found in kinds.items():
        for engine, each in found["latency_us"].items():
            table.add_row(kind, engine, f"{each['p50']:.0f}", f"{each['p99']:.0f}")
    return table


if __name__ == "__main__":
    main()
