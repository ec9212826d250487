import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.stopping_way import on_the_way
from archerfish.sensing.tracked_observation import TrackedObserver, tracked_observer
from archerfish.targets.passing import Line

from .sights import seen_at

MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, 0.0), (0.0035, 0.0035), 0.019, 0.0)))
NOISE = TrackerNoise(*(np.asarray(each) for each in (3.0, 1e-3, 1e-3, 0.005, 0.001)))
PERIOD, BRAKING = 0.02, np.array([0.01, 0.02])
OBSERVER = tracked_observer(MUZZLE, NOISE, PERIOD, (0.03, 0.1), BRAKING)
FREE = OBSERVER._replace(braking=np.full(2, 1e3))
"""One whose command may jump: it shows where the slow one is on its way to."""

YAW = [0, 1]
ODD = np.array([*YAW * 3, 0, 1, *YAW * 2, *YAW * 2, *YAW * 3, *YAW * 3, 0, 0, 0, 0, 0, 0, 1, *[1] * 8, *[1] * 12], bool)
"""Which numbers change their sign in the mirror: all that tell of yaw, but of no distance, age or pitch."""


def remembered(observer: TrackedObserver, sights: list[Seen]):
    memory = observer.begin(sights[0])
    for seen in sights[1:]:
        memory = observer.remember(memory, seen)
    return memory


def observed(sights: list[Seen]) -> np.ndarray:
    return np.asarray(OBSERVER.observe(remembered(OBSERVER, sights)))


def wandering(count: int, seed: int = 81) -> list[tuple[np.ndarray, ...]]:
    """Plate, gimbal and command of a lively engagement."""
    rng = np.random.default_rng(seed)
    plates = np.array([3.0, 0.4, 0.1]) + np.cumsum(rng.normal(0.0, 0.02, (count, 3)), axis=0)
    return list(zip(plates, *np.cumsum(rng.normal(0.0, 0.02, (2, count, 2)), axis=1), strict=True))


def test_the_size_is_that_of_the_observation() -> None:
    assert observed([seen_at((3.0, 0.2, 0.0))]).shape == (OBSERVER.size,) == ODD.shape
    short = OBSERVER._replace(frames=np.ones(2), sights=np.ones(3))
    assert short.observe(short.begin(seen_at((3.0, 0.2, 0.0)))).shape == (short.size,)


def test_left_and_right_are_mirror_images() -> None:
    views, mirror = wandering(6), np.array([1.0, -1.0])
    here = observed([seen_at(*view) for view in views])
    there = observed([seen_at(p * [1, -1, 1], a * mirror, c * mirror) for p, a, c in views])
    assert_allclose(there, np.where(ODD, -here, here), atol=1e-9)
    assert np.all(here[ODD] != 0.0)


def test_an_engagement_begins_as_if_nothing_had_moved() -> None:
    start = seen_at((3.0, 0.4, 0.0), angle=(0.05, 0.1), command=(0.05, 0.1))
    begun = observed([start])
    assert_allclose(begun[12:28], 0.0, atol=1e-15)  # neither asked for a move nor moved
    assert_allclose(begun[[7, 28]], 0.0, atol=1e-15)  # a target at rest
    assert_allclose(begun[34:], 0.0, atol=1e-12)  # that has always been where it is


def test_the_first_sight_seen_twice_changes_nothing() -> None:
    start = seen_at((3.0, 0.4, 0.0), angle=(0.05, 0.1), command=(0.05, 0.1), elapsed=0.0)
    memory = OBSERVER.begin(start)
    again = OBSERVER.remember(memory, start)
    before, after = [], []
    map_arrays(before.append, memory)
    map_arrays(after.append, again)
    for one, other in zip(before, after, strict=True):
        assert_allclose(other, one, atol=1e-15)


@pytest.mark.parametrize("age", [0.0, 0.045])
def test_zero_action_aims_at_where_the_target_is_now(age) -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.2, 0.6, 0.0]))
    times = PERIOD * np.arange(50)
    memory = remembered(OBSERVER, [seen_at(line.position(np.asarray(time - age)), age=age) for time in times])
    aim = aim_at(line.position(times[-1]), MUZZLE).angle
    assert_allclose(FREE.decode(memory, np.zeros(2)), aim, atol=3e-4)
    # That is a good deal ahead of where it was seen.
    assert abs(aim_at(line.position(np.asarray(times[-1] - 0.045)), MUZZLE).angle[1] - aim[1]) > 8e-3


def test_an_action_is_an_offset_in_units_of_its_scale() -> None:
    memory = OBSERVER.begin(seen_at((4.0, 0.5, 0.1)))
    moved = FREE.decode(memory, np.array([1.0, -0.5])) - FREE.decode(memory, np.zeros(2))
    assert_allclose(moved, [0.03, -0.05])


def test_without_a_new_sight_the_target_goes_on_as_it_went() -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([0.0, 0.6, 0.0]))
    sights = [seen_at(line.position(np.asarray(PERIOD * step - 0.04))) for step in range(40)]
    # The last sight ages, three decisions long.
    stale = [sights[-1]._replace(plate_age=np.array([0.04 + PERIOD * k]), fresh=np.array([False])) for k in (1, 2, 3)]
    memory = remembered(OBSERVER, sights + stale)
    now = np.asarray(PERIOD * 42)
    assert_allclose(FREE.decode(memory, np.zeros(2)), aim_at(line.position(now), MUZZLE).angle, atol=3e-4)
    # What is told of the speed and the ages: 0.6 m/s across, 100 ms, 3 ms, and that 0.84 s have gone.
    place = line.position(now)
    told = np.asarray(OBSERVER.observe(memory))
    assert told[7] == pytest.approx(5.0 * 0.6 * place[0] / np.hypot(*place[:2]), rel=0.01)
    assert_allclose(told[29:32], [2.0, 0.06, 0.84])


def test_error_and_rest_are_scaled_as_documented() -> None:
    aim = FREE.decode(OBSERVER.begin(seen_at((3.0, 0.4, 0.0))), np.zeros(2))
    error = np.array([0.01, -0.03])
    begun = observed([seen_at((3.0, 0.4, 0.0), angle=aim - error, command=aim - 2 * error)])
    assert_allclose(begun[:4], [*(2.0 * error), *np.tanh(100.0 / 3.0 * error)])
    assert_allclose(begun[8:12], [*(4.0 * error), *np.tanh(200.0 / 3.0 * error)])


def test_the_command_goes_the_fastest_way_to_what_is_wanted() -> None:
    memory = OBSERVER.begin(seen_at((3.0, 2.0, 0.0)))
    wanted = FREE.decode(memory, np.zeros(2))
    first = OBSERVER.decode(memory, np.zeros(2))
    # From rest it may move as far as it can brake within: N moves of b, b/2 … cover the way.
    assert_allclose(first, on_the_way(BRAKING, wanted, np.zeros(2)))
    assert np.all(np.abs(first) < np.abs(wanted))
    near = OBSERVER.begin(seen_at((3.0, 2.0, 0.0), command=wanted - 0.5 * BRAKING))
    assert_allclose(OBSERVER.decode(near, np.zeros(2)), wanted)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(82)
    plates = rng.uniform([2.0, -1.0, 0.0], [4.0, 1.0, 0.1], (3, *shape, 3))
    fresh = rng.random((3, *shape, 1)) < 0.7
    views = [seen_at(p, *rng.uniform(-0.2, 0.2, (2, *shape, 2)), fresh=f) for p, f in zip(plates, fresh, strict=True)]

    def everything(observer, views, action):
        memory = remembered(observer, views)
        return observer.observe(memory), observer.decode(memory, action)

    # Differences of nearly equal angles, magnified a hundred times.
    action = rng.normal(size=(*shape, 2))
    numbers, angle = agree_in_jax(everything, OBSERVER, tuple(views), action, rtol=1e-4, atol=1e-3)
    assert numbers.shape == (*shape, OBSERVER.size)
    assert angle.shape == (*shape, 2)
    if shape:
        alone = observed([map_arrays(lambda each: each[(0,) * len(shape)], seen) for seen in views])
        assert_allclose(numbers[(0,) * len(shape)], alone, rtol=1e-4, atol=1e-3)
