"""When a policy leaves the decision to a Kalman filter."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.guarded_policy import GuardedMemory, GuardedPolicy, controller_from_record, guarded
from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import PolicyController, policy_to_record
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.policy import read_policy, write_policy
from archerfish.sensing.interfaces import Command, Seen
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.multimodel_observation import multimodel_observer
from archerfish.sensing.tracked_observation import tracked_observer
from archerfish.targets.passing import Line

MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, 0.0), (0.0035, 0.0035), 0.019, 0.0)))
NOISE = TrackerNoise(*(np.asarray(each) for each in (4.0, 1e-3, 1e-3, 0.005, 0.001)))
PERIOD, AGE = 0.02, 0.03
SCALE = 0.1
"""Of the action in yaw [rad]."""
WAY = Line(np.array([3.0, -1.0, 0.1]), np.array([0.0, 1.0, 0.0]))
"""At 1 m/s: until a pellet arrives, 0.08 rad or so."""


RAMP = {"pitch_gain": 1.0, "yaw_gain": 1.0, "lead": 0.06}


def make_guarded(action: float, **ramp: float) -> GuardedPolicy:
    """One whose policy aims beside where the target is now, by always the same."""
    observer = multimodel_observer(MUZZLE, NOISE, PERIOD, (SCALE, SCALE), np.full(2, 1e3))
    layer = Layer(np.zeros((observer.size, 2)), np.array([0.0, action]))
    normaliser = Normaliser(np.zeros(observer.size), np.ones(observer.size), np.asarray(1.0))
    policy: GuardedPolicy = single_precision(
        guarded(PolicyController(observer, normaliser, (layer,)), PERIOD, RAMP | ramp)
    )
    return policy


def seen_of(way: Line, decision: int, shape: tuple[int, ...] = ()) -> Seen:
    ones = np.ones(shape)
    plate = way.position(np.asarray(PERIOD * decision - AGE)) + np.zeros((*shape, 1, 3))
    still = np.zeros((*shape, 2))
    return Seen(
        *single_precision(
            (PERIOD * (decision > 0) * ones, still, still, 0.004 * ones, still, plate, 0.0 * plate[..., 0])
        ),
        *single_precision((AGE * np.ones((*shape, 1)), np.ones((*shape, 1), bool), np.zeros((*shape, 4)), ones, ones)),
    )


def decisions(policy: GuardedPolicy, way: Line, count: int) -> tuple[list[Command], GuardedMemory]:
    memory, commands = policy.reset(seen_of(way, 0)), []
    for decision in range(count):
        memory, command = policy.step(memory, seen_of(way, decision))
        commands.append(command)
    return commands, memory


def needed(lead: float) -> float:
    """The action that leads as far as WAY takes at its middle, for pellets that leave after a time [s]."""
    middle = np.asarray(1.0)
    aim = intercept(lambda time: WAY.position(middle + time), np.asarray(lead), MUZZLE).angle
    return float(aim[1] - aim_at(WAY.position(middle), MUZZLE).angle[1]) / SCALE


@pytest.mark.parametrize("lead", [0.03, 0.06, 0.15])
def test_a_policy_that_leads_rightly_for_its_gimbal_decides_alone(lead: float) -> None:
    # Slow gimbals take commands that lead far: the filters' intercepts must lead as far.
    policy = make_guarded(needed(lead), lead=lead)
    commands, memory = decisions(policy, WAY, 80)
    assert not any(command.fallback for command in commands)
    assert min(memory.predictions.scores) > 0.85
    bare = policy.policy
    state = bare.reset(seen_of(WAY, 0))
    for decision, command in enumerate(commands):
        state, plain = bare.step(state, seen_of(WAY, decision))
        assert_allclose(command.angle, plain.angle, atol=1e-6)


def test_of_a_gimbal_with_another_gain_the_pointing_is_judged_not_the_command() -> None:
    # At 0.3 rad to the side, 20 % less command than angle.
    way = Line(np.array([3.0, 1.0, 0.1]), np.zeros(3))
    aim = aim_at(way.position(np.asarray(0.0)), MUZZLE).angle
    action = float(aim[1] / 1.2 - aim[1]) / SCALE
    commands, memory = decisions(make_guarded(action, yaw_gain=1.2), way, 60)
    assert not any(command.fallback for command in commands)
    assert min(memory.predictions.scores) > 0.85
    fell = [bool(command.fallback) for command in decisions(make_guarded(action), way, 60)[0]]
    assert any(fell)
    # And the filter's command is an intercept over the gain.
    commands, memory = decisions(make_guarded(-2.0, yaw_gain=1.2), way, 60)
    assert commands[-1].fallback
    assert_allclose(commands[-1].angle[1], aim[1] / 1.2, atol=1e-3)


def test_one_that_leads_the_wrong_way_falls_back_once_the_sights_show_it() -> None:
    policy = make_guarded(-1.5)
    commands, memory = decisions(policy, WAY, 80)
    fell = [bool(command.fallback) for command in commands]
    # Before the first pellet has arrived and is seen nobody knows better.
    first = fell.index(True)
    assert 0.25 < first * PERIOD < 0.8
    assert all(fell[first:])
    # What is commanded then is one filter's intercept, here both of them.
    fast, slow = policy.observer.intercepts(memory.policy, policy.lead)
    assert_allclose(fast.angle, slow.angle, atol=2e-3)
    assert_allclose(commands[-1].angle, fast.angle, atol=2e-3)


def test_it_decides_again_when_its_own_forecasts_are_as_good() -> None:
    policy, memory = make_guarded(0.0), None
    resting = Line(WAY.position(np.asarray(1.6)), np.zeros(3))
    fell = []
    for decision in range(240):
        # Zero action aims at where the target is now: wrong while it drives, right once it rests.
        seen = seen_of(WAY, decision) if decision < 80 else seen_of(resting, decision)
        memory = policy.reset(seen) if memory is None else memory
        memory, command = policy.step(memory, seen)
        fell.append(bool(command.fallback))
    assert any(fell[40:100])
    assert not any(fell[200:])


def test_what_is_wanted_while_the_gimbal_slews_is_no_forecast() -> None:
    policy = make_guarded(-1.5)
    slow = policy._replace(
        policy=policy.policy._replace(observer=policy.observer._replace(braking=np.full(2, 1e-6, np.float32)))
    )
    commands, memory = decisions(slow, WAY, 80)
    assert not any(command.fallback for command in commands)
    assert_allclose(memory.predictions.counts, 0.0)


@pytest.mark.parametrize("frame", ["stale at the pivot", "stale far away", "fresh far away"])
def test_one_sight_from_which_nothing_follows_is_forgotten(frame: str) -> None:
    policy = make_guarded(-1.5)
    place = np.zeros(3) if frame.endswith("pivot") else np.array([200.0, 0.0, 0.0])
    plain, memory, state = [], policy.reset(seen_of(WAY, 0)), policy.policy.reset(seen_of(WAY, 0))
    commands = []
    for decision in range(60):
        seen = seen_of(WAY, decision)
        if decision == 10:
            fresh = np.full_like(seen.fresh, frame.startswith("fresh"))
            seen = seen._replace(plate=seen.plate * 0.0 + place.astype(np.float32), fresh=fresh)
        with np.errstate(all="ignore"):
            memory, command = policy.step(memory, seen)
            state, bare = policy.policy.step(state, seen)
        commands.append(command.angle)
        plain.append(bare.angle)
    assert np.array_equal(np.isnan(commands), np.isnan(plain))


@pytest.mark.parametrize("shape", [(3,), (2, 3)])
def test_alone_it_decides_as_in_a_batch_and_in_jax(shape: tuple[int, ...], agree_in_jax) -> None:
    def last(policy, memory, seen):
        memory, command = policy.step(memory, seen)
        return command.angle, memory.predictions.scores, command.fallback

    def before(shape: tuple[int, ...], count: int) -> GuardedMemory:
        memory = policy.reset(seen_of(WAY, 0, shape))
        for decision in range(count):
            memory, _ = policy.step(memory, seen_of(WAY, decision, shape))
        return memory

    policy, at = make_guarded(-1.5), (0,) * len(shape)
    for count in (3, 40):
        found = agree_in_jax(last, policy, before(shape, count), seen_of(WAY, count, shape), atol=1e-5)
        alone = last(policy, before((), count), seen_of(WAY, count))
        for each, one in zip(found, alone, strict=True):
            assert each.shape == (*shape, *one.shape)
            assert_allclose(each[at], one, atol=1e-5)
        assert np.all(found[2] == (count == 40))


def test_it_remembers_for_as_long_as_a_slow_pellet_flies_far() -> None:
    slow = MUZZLE._replace(speed=np.asarray(np.float32(12.0)))
    way = Line(np.array([6.0, -1.0, 0.1]), np.array([0.0, 1.0, 0.0]))
    policy = make_guarded(-1.5)
    policy = policy._replace(policy=policy.policy._replace(observer=policy.observer._replace(muzzle=slow)))
    assert any(command.fallback for command in decisions(policy, way, 100)[0])


def test_policies_of_that_observation_are_guarded_if_the_record_knows_the_gimbal(tmp_path: Path) -> None:
    policy = make_guarded(0.3).policy
    tracked = tracked_observer(MUZZLE, NOISE, PERIOD, (SCALE, SCALE), np.full(2, 0.02))
    layer = Layer(np.zeros((tracked.size, 2)), np.zeros(2))
    plain = PolicyController(
        tracked, Normaliser(np.zeros(tracked.size), np.ones(tracked.size), np.asarray(1.0)), (layer,)
    )
    for each, ramp, kind in (
        (policy, RAMP, GuardedPolicy),
        (policy, {}, PolicyController),
        (plain, RAMP, PolicyController),
    ):
        record = policy_to_record(single_precision(each), period_s=PERIOD, command_limit="gate", training={}, ramp=ramp)
        write_policy(tmp_path / "policy.json", record)
        read = controller_from_record(read_policy(tmp_path / "policy.json"))
        assert isinstance(read, kind)
        assert read.observer.size == each.observer.size
