"""Policies of the first edition, read into the second: what they see, command and hit."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.controllers.policy import policy_from_record
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.policy import read_policy
from archerfish.records.sensing import read_sensing
from archerfish.simulation.scenario import UNIFORMS, draw_engagement
from archerfish.simulation.setting import make_scenario, paper_muzzle
from archerfish.simulation.setting import make_world as make_first_world
from archerfish2.arrays import register
from archerfish2.controllers.policy.network import Layer, Normaliser
from archerfish2.controllers.policy.observation import ObserverFacts, make_observer
from archerfish2.controllers.policy.observer import Decisions, DetectionMemory, Memory
from archerfish2.controllers.policy.policy import Policy, PolicyFacts
from archerfish2.evaluation.draws import draw
from archerfish2.evaluation.run import count
from archerfish2.robot import Robot
from archerfish2.simulation.world import make_world
from archerfish2.task import Task
from archerfish2.tracking.interacting_models import ModelTracks
from archerfish2.tracking.kalman_filter import Track
from archerfish2.tracking.side_by_side import Tracks

pytestmark = pytest.mark.against_first
POLICIES = {"paper": "paper-box-0", "history": "history-gate-0", "tracked": "tracked-infantry-0",
            "multimodel": "any-infantry-0"}  # fmt: skip
SHOOTING = [
    ("paper", "box", "paper", "paper-box-0"),
    ("paper", "gate", "paper", "history-gate-0"),
    ("infantry", "gate", "paper", "tracked-infantry-0"),
    ("infantry", "gate", "any", "any-infantry-0"),
]
"""Robot, command limit, targets, policy."""
DECISIONS, HERE = 50, Path(__file__).parent
seen_of = runpy.run_path(str(HERE / "test_controllers.py"))["seen_of"]


def read_first(folder: Path) -> Policy:
    """Read a policy of the first edition, whose commands ignored the rate limit, without its fallback."""
    record = read_policy(folder / "policy.json")
    muzzle = record.muzzle
    facts = ObserverFacts(
        observation=(record.observation,),
        frames=record.frames or 2,
        period_s=record.period_s,
        action_scale=tuple(record.action_scale),
        largest_move=(1e6, 1e6),
        braking=tuple(record.braking),
        offset=(muzzle["pitch_offset"], muzzle["yaw_offset"]),
        tracker=record.tracker or None,
        **{name: muzzle[name] for name in ("speed", "drag", "length")},
    )
    layers = tuple(Layer(*each) for each in zip(record.weights, record.biases, strict=True))
    normaliser = Normaliser(record.mean, record.variance, np.float32(0.0))
    task = Task.load("paper").replace(command_limit=record.command_limit)
    return Policy(make_observer(facts), normaliser, layers, PolicyFacts(observer=facts, task=task, robot={}))


def memory_of(kind: str, theirs: Any, seen: Any) -> Memory:
    """The first edition's memory as the second's, after what was seen, whose plate is that of the latest detection."""
    place, base = seen.plate[..., 0, :], seen_of(seen).base
    own, zero = 0.0 * place, 0.0 * seen.elapsed
    if kind in ("paper", "history"):
        decisions = Decisions(theirs[..., 0:2], theirs[..., 5:7], theirs[..., 2:5])
        tracks = Tracks(place, None, zero, None, None, None, None)
        return Memory(tracks, decisions, None, (), seen.gimbal_age, base, zero)
    many = kind == "multimodel"
    tracks = Tracks(place, own, theirs.plate_age, Track(*(theirs.fast if many else theirs.track)), None, None, None)
    detections, histories = DetectionMemory(theirs.bearing, 0.0 * theirs.bearing), (theirs.history,) if not many else ()
    if many:
        models = ModelTracks(Track(*theirs.models.track), theirs.models.probability)
        tracks = tracks._replace(slow=Track(*theirs.slow), innovation=theirs.innovation, models=models)
        detections = detections._replace(distance=theirs.distance)
        histories = theirs.last_second, theirs.last_distances, theirs.habit
    decisions = Decisions(theirs.angle, theirs.command, None)
    return Memory(tracks, decisions, detections, histories, theirs.gimbal_age, base, theirs.clock)


def recorded(first: Any, sensing: Any, batch: tuple[int, ...]) -> list[Any]:
    """What the first edition's world shows its policy, decision by decision."""
    conditions = assumed_conditions()
    muzzle, limits = paper_muzzle(conditions), gate_limits()
    world = make_first_world(**printed_plants(), muzzle=muzzle, limits=limits, command_limit="gate",
                             conditions=conditions, sensing=sensing)  # fmt: skip
    rng = np.random.default_rng(33)
    uniforms = rng.random((*batch, UNIFORMS), np.float32)
    engagement = draw_engagement(make_scenario(conditions, (1.0, 5.0), 0.3), uniforms)
    normals = rng.standard_normal((*batch, DECISIONS, world.normals)).astype(np.float32)
    state, seen = world.reset(engagement, normals)
    memory, found = first.reset(seen), []
    for _ in range(DECISIONS):
        found.append(seen)
        memory, command = first.step(memory, seen)
        state, seen, _ = world.step(state, command)
    return found


@pytest.mark.parametrize("kind", POLICIES)
def test_observations_and_commands_are_those_of_the_first_edition(kind, batch, reference, quick_jit) -> None:
    register()
    folder = reference / "policies" / POLICIES[kind]
    first, ours = policy_from_record(read_policy(folder / "policy.json")), read_first(folder)
    sensing = read_sensing(reference / "infantry" / "sensing.json") if "infantry" in POLICIES[kind] else None
    seen = recorded(first, sensing, batch)

    def theirs_decide(policy, memory, now):
        return policy.observer.observe(policy.observer.remember(memory, now)), policy.step(memory, now)[1].angle

    def ours_decide(policy, memory, now):
        view = policy.observer.view(policy.observer.remember(memory, now))
        return policy.observer.observe(view), policy.step(memory, now)[1].angle

    jax_first, jax_ours = quick_jit(theirs_decide), quick_jit(ours_decide)
    memory, before = first.reset(seen[0]), seen[0]
    for number, now in enumerate(seen):
        own = memory_of(kind, memory, before), seen_of(now)
        runs = (
            theirs_decide(first, memory, now),
            jax_first(first, memory, now),
            ours_decide(ours, *own),
            jax_ours(ours, *own),
        )
        for each in zip(*runs, strict=True):
            numpy, jax, numpy_2, jax_2 = (np.asarray(array) for array in each)
            scale = np.maximum(1.0, np.abs(numpy))
            # Between the two libraries the first edition's own rounding may be more than the bound.
            between = np.maximum(5e-5, 1.01 * np.abs(jax - numpy) / scale)
            for one, other, bound in ((numpy, numpy_2, 1e-6), (jax, jax_2, 1e-5), (numpy, jax_2, between)):
                assert one.shape == other.shape
                off = np.abs(one - other) / scale / bound
                assert np.all(off <= 1.0), f"decision {number}, of {bound}: {off.max():.2f} at {np.argmax(off)}"
        memory, before = first.step(memory, now)[0], now


@pytest.mark.parametrize(("name", "limit", "targets", "folder"), SHOOTING)
def test_policies_hit_where_they_hit_in_the_first_edition(name, limit, targets, folder, reference, shared) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        first = runpy.run_path(str(HERE / "write_outcomes.py"))
    theirs, folder = first["evaluation"](name, limit, targets, 1.0, 20), reference / "policies" / folder
    expected = first["hits"](first["make_ground"](theirs), policy_from_record(read_policy(folder / "policy.json")))
    robot = Robot.paper() if name == "paper" else Robot.load(HERE.parent / name)
    task = Task.load(targets).replace(command_limit=limit, lengths_s=(1.0,))
    world = make_world(robot, task)
    hit = count(world, read_first(folder), *draw(task.cells(), 20, 0, "evaluation", world.normals, world.plants)).hit
    differ = (hit != expected).reshape(len(task.cells()), -1).sum(axis=1)
    assert np.all(differ <= 1), f"{differ.tolist()} shots of each cell differ, of {hit.size // len(differ)}"
