import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import PolicyController, policy_from_record, policy_to_record
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord, read_policy, write_policy
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.observation import KINDS, make_observer
from archerfish.sensing.observers import AnyObserver
from archerfish.sensing.tracked_observation import tracked_observer
from archerfish.simulation.setting import paper_muzzle


def make_policy(kind: str) -> PolicyController:
    """A policy with random weights, as lively as a trained one."""
    rng, muzzle = np.random.default_rng(1), muzzle_from_record(paper_muzzle(assumed_conditions()))
    observer: AnyObserver
    if kind == "tracked":
        noise = TrackerNoise(*(np.asarray(each) for each in (3.0, 1e-3, 1e-3, 0.015, 0.0017)))
        observer = tracked_observer(muzzle, noise, 0.02, (0.03, 0.1), np.array([0.04, 0.02]))
    else:
        observer = make_observer(kind, muzzle, action_scale=(0.03, 0.1))
    sizes = (observer.size, 32, 2)
    layers = tuple(
        Layer(rng.standard_normal(pair) / np.sqrt(pair[0]), 0.1 * rng.standard_normal(pair[1]))
        for pair in itertools.pairwise(sizes)
    )
    normaliser = Normaliser(0.1 * rng.standard_normal(sizes[0]), 0.1 + rng.random(sizes[0]), np.asarray(1.0))
    controller: PolicyController = single_precision(PolicyController(observer, normaliser, layers))
    return controller


def record_of(policy: PolicyController) -> PolicyRecord:
    return policy_to_record(policy, period_s=0.02, command_limit="gate", training={"seed": 1})


@pytest.fixture(params=[*KINDS, "tracked"])
def policy(request: pytest.FixtureRequest) -> PolicyController:
    return make_policy(request.param)


def test_the_record_in_numpy_commands_what_the_policy_commands_in_jax(
    tmp_path: Path, policy: PolicyController, fight: Callable[..., Any]
) -> None:
    write_policy(tmp_path / "policy.json", record_of(policy))
    duel = fight(policy_from_record(read_policy(tmp_path / "policy.json")), steps=10)
    controller = jax.tree.map(jnp.asarray, policy)
    step = jax.jit(controller.step)
    moments = [map_arrays(lambda each, t=t: each[t], duel.seen) for t in range(10)]
    state = controller.reset(jax.tree.map(jnp.asarray, moments[0]))
    for moment, command in zip(moments, duel.command, strict=True):
        state, found = step(state, jax.tree.map(jnp.asarray, moment))
        np.testing.assert_allclose(found.angle, command, atol=1e-5)


def test_a_record_commands_exactly_what_the_policy_commanded_before_it_was_written(
    tmp_path: Path, policy: PolicyController, fight: Callable[..., Any]
) -> None:
    write_policy(tmp_path / "policy.json", record_of(policy))
    read = policy_from_record(read_policy(tmp_path / "policy.json"))
    np.testing.assert_allclose(fight(read, steps=10).command, fight(policy, steps=10).command, atol=1e-6)
    assert type(read.observer) is type(policy.observer)


def test_alone_it_commands_what_it_commands_in_a_batch(policy: PolicyController, fight: Callable[..., Any]) -> None:
    duel = fight(policy, steps=6, batch=3)
    for member in range(3):
        alone = [map_arrays(lambda each, t=t, m=member: each[t, m], duel.seen) for t in range(6)]
        state = policy.reset(alone[0])
        for moment, command in zip(alone, duel.command, strict=True):
            state, found = policy.step(state, moment)
            assert found.angle.shape == (2,)
            assert found.angle.dtype == np.float32
            assert bool(found.fire)
            np.testing.assert_allclose(found.angle, command[member], atol=1e-6)


def test_a_policy_without_action_aims_at_what_it_sees(fight: Callable[..., Any]) -> None:
    policy = make_policy("history")
    idle = policy._replace(actor=(*policy.actor[:-1], Layer(np.zeros_like(policy.actor[-1].weight), np.zeros(2, "f4"))))
    duel = fight(idle, steps=1)
    distance = np.linalg.norm(duel.seen.plate[0, :, 0], axis=-1)
    bearing = np.arctan2(duel.seen.plate[0, :, 0, 1], duel.seen.plate[0, :, 0, 0])
    np.testing.assert_allclose(duel.command[0, :, 1], bearing, atol=1e-6)
    # The drop over some metres at 18 m/s: g d² / (2 v²), a little more with drag.
    drop_angle = 9.81 * distance / (2 * 18.0**2)
    np.testing.assert_allclose(duel.command[0, :, 0], drop_angle, rtol=0.1)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"frames": 5}, "a policy of 5 frames must take .* numbers, got a network for"),
        ({"observation": "images"}, "observation must be one of history, paper, got 'images'"),
    ],
)
def test_a_record_that_does_not_fit_its_observation_is_refused(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        policy_from_record(replace(record_of(make_policy("history")), **change))
