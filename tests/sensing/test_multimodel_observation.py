import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import PolicyController, policy_from_record, policy_to_record
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.policy import read_policy, write_policy
from archerfish.sensing.interacting_models import ONWARD, STILL
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.multimodel_observation import MultimodelMemory, multimodel_observer
from archerfish.targets.passing import Line

from .sights import seen_at

MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, 0.0), (0.0035, 0.0035), 0.019, 0.0)))
NOISE = TrackerNoise(*(np.asarray(each) for each in (4.0, 1e-3, 1e-3, 0.005, 0.001)))
PERIOD, BRAKING = 0.02, np.array([0.01, 0.02])
OBSERVER = multimodel_observer(MUZZLE, NOISE, PERIOD, (0.03, 0.1), BRAKING)
FREE = OBSERVER._replace(braking=np.full(2, 1e3))
"""One whose command may jump."""


def remembered(observer, sights) -> MultimodelMemory:
    memory = observer.begin(sights[0])
    for seen in sights[1:]:
        memory = observer.remember(memory, seen)
    return memory


def lively(shape: tuple[int, ...], count: int = 4, seed: int = 82) -> list[Seen]:
    rng = np.random.default_rng(seed)
    plates = rng.uniform([2.0, -1.0, 0.0], [4.0, 1.0, 0.1], (1, *shape, 3)) + rng.normal(0.0, 0.02, (count, *shape, 3))
    fresh = rng.random((count, *shape, 1)) < 0.7
    return [seen_at(p, *rng.uniform(-0.2, 0.2, (2, *shape, 2)), fresh=f) for p, f in zip(plates, fresh, strict=True)]


def leaves(tree) -> list:
    found: list = []
    map_arrays(found.append, tree)
    return found


def member(tree, at: tuple[int, ...]):
    return map_arrays(lambda each: each[at], tree)


def test_the_layout_adds_up_to_the_observation() -> None:
    memory = OBSERVER.begin(seen_at((3.0, 0.2, 0.0)))
    assert OBSERVER.observe(memory).shape == (OBSERVER.size,)
    assert sum(count for _, count in OBSERVER.layout) == OBSERVER.size
    short = OBSERVER._replace(frames=np.ones(2), sights=np.ones(3))
    assert short.observe(short.begin(seen_at((3.0, 0.2, 0.0)))).shape == (short.size,)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape: tuple[int, ...], agree_in_jax) -> None:
    def everything(observer, views, action):
        memory = remembered(observer, views)
        return observer.observe(memory), observer.decode(memory, action)

    action = np.random.default_rng(83).normal(size=(*shape, 2))
    # Differences of nearly equal angles, magnified a hundred times.
    numbers, angle = agree_in_jax(everything, OBSERVER, tuple(lively(shape)), action, rtol=1e-3, atol=3e-3)
    assert numbers.shape == (*shape, OBSERVER.size)
    assert angle.shape == (*shape, 2)


@pytest.mark.parametrize("shape", [(3,), (2, 3)])
def test_the_memory_of_one_robot_is_that_in_a_batch(shape: tuple[int, ...]) -> None:
    together = remembered(OBSERVER, lively(shape))
    for at in np.ndindex(shape):
        alone = remembered(OBSERVER, [member(seen, at) for seen in lively(shape)])
        for one, other in zip(leaves(alone), leaves(member(together, at)), strict=True):
            assert_allclose(other, one, atol=1e-9)


def test_the_first_sight_seen_twice_changes_nothing() -> None:
    start = seen_at((3.0, 0.4, 0.0), angle=(0.05, 0.1), command=(0.05, 0.1), elapsed=0.0)
    memory = OBSERVER.begin(start)
    for one, other in zip(leaves(memory), leaves(OBSERVER.remember(memory, start)), strict=True):
        assert_allclose(other, one, atol=1e-12)


@pytest.mark.parametrize("age", [0.0, 0.045])
def test_zero_action_aims_at_where_the_target_is_now(age: float) -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.2, 0.6, 0.0]))
    times = PERIOD * np.arange(50)
    memory = remembered(OBSERVER, [seen_at(line.position(np.asarray(time - age)), age=age) for time in times])
    assert_allclose(FREE.decode(memory, np.zeros(2)), aim_at(line.position(times[-1]), MUZZLE).angle, atol=3e-4)
    moved = FREE.decode(memory, np.array([1.0, -0.5])) - FREE.decode(memory, np.zeros(2))
    assert_allclose(moved, [0.03, -0.05])


def test_the_models_tell_a_target_that_stands_from_one_that_drives_on() -> None:
    for speed, model in ((0.0, STILL), (1.0, ONWARD)):
        line = Line(np.array([3.0, -0.5, 0.1]), np.array([0.0, speed, 0.0]))
        memory = remembered(OBSERVER, [seen_at(line.position(np.asarray(PERIOD * step))) for step in range(40)])
        assert np.argmax(memory.models.probability) == model


def test_a_record_brings_the_same_policy_back(tmp_path) -> None:
    rng = np.random.default_rng(1)
    layer = Layer(rng.standard_normal((OBSERVER.size, 2)) / 10.0, 0.1 * rng.standard_normal(2))
    normaliser = Normaliser(0.1 * rng.standard_normal(OBSERVER.size), 0.1 + rng.random(OBSERVER.size), np.asarray(1.0))
    policy = single_precision(PolicyController(OBSERVER, normaliser, (layer,)))
    write_policy(tmp_path / "policy.json", policy_to_record(policy, period_s=PERIOD, command_limit="gate", training={}))
    read = policy_from_record(read_policy(tmp_path / "policy.json"))
    assert type(read.observer) is type(OBSERVER)
    views = [single_precision(seen) for seen in lively((3,))]
    commands = []
    for each in (policy, read):
        memory = each.reset(views[0])
        for seen in views:
            memory, command = each.step(memory, seen)
        commands.append(command.angle)
    assert_allclose(commands[1], commands[0], atol=1e-6)
