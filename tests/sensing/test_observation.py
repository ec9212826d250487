import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.observation import (
    begin_memory,
    decode_action,
    make_observer,
    observation_size,
    observe,
    remember,
)

MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.0, 0.0), (0.0035, 0.0035), 0.019, 0.0)))
MIRROR = np.array([1.0, -1.0])


def seen_at(plate, angle=(0.0, 0.0), command=(0.0, 0.0)) -> Seen:
    plate, angle, command = (np.asarray(each, float) for each in (plate, angle, command))
    zero = np.zeros(plate.shape[:-1])
    return Seen(
        elapsed=zero + 0.02,
        angle=angle,
        rate=0.0 * angle,
        gimbal_age=zero,
        command=command,
        plate=plate[..., None, :],
        normal_yaw=zero[..., None],
        plate_age=zero[..., None],
        fresh=zero[..., None] == 0.0,
        base=np.zeros((*zero.shape, 4)),
        muzzle_speed=zero + 18.0,
        heat_left=zero + 1e6,
    )


def observed(observer, sights: list[Seen]) -> np.ndarray:
    memory = begin_memory(observer, sights[0])
    for seen in sights[1:]:
        memory = remember(observer, memory, seen)
    return observe(observer, memory)


@pytest.mark.parametrize(("kind", "frames", "size"), [("paper", 4, 6), ("history", 4, 35), ("history", 2, 21)])
def test_sizes(kind, frames, size) -> None:
    observer = make_observer(kind, MUZZLE, frames)
    assert observation_size(observer) == size
    assert observed(observer, [seen_at((3.0, 0.2, 0.0))]).shape == (size,)


def test_the_papers_six_numbers_are_two_gimbal_angles_and_one_target() -> None:
    first = seen_at((2.0, 0.0, 0.0), angle=(0.01, 0.02))
    second = seen_at((3.0, 4.0, 0.0), angle=(0.03, 0.04))
    six = observed(make_observer("paper", MUZZLE), [first, first, second])
    yaw, distance = np.arctan2(4.0, 3.0), 5.0
    assert_allclose(six, [0.02, 0.04, 0.06, 0.08, 2.0 * yaw, 0.5 * (distance - 3.0)])


def test_the_six_numbers_hold_no_velocity() -> None:
    now = seen_at((3.0, 0.1, 0.0))
    observer = make_observer("paper", MUZZLE)
    assert_allclose(
        observed(observer, [seen_at((3.0, -0.1, 0.0)), now]), observed(observer, [seen_at((3.0, 0.3, 0.0)), now])
    )


def test_the_history_begins_as_if_nothing_had_moved() -> None:
    observer = make_observer("history", MUZZLE)
    start = seen_at((3.0, 0.4, 0.0), angle=(0.05, 0.1), command=(0.05, 0.1))
    assert_allclose(observed(observer, [start]), observed(observer, [start] * 7))
    assert_allclose(observed(observer, [start])[8:-4], 0.0)  # neither asked for a move nor moved


def test_the_history_forgets_what_is_older_than_its_frames() -> None:
    observer = make_observer("history", MUZZLE, frames=3)
    sights = [seen_at((3.0, 0.01 * step, 0.0), angle=(0.0, 0.002 * step)) for step in range(6)]
    assert_allclose(observed(observer, sights), observed(observer, sights[-3:]), atol=1e-12)


def test_a_gimbal_on_target_has_no_error() -> None:
    plate = (4.0, 0.5, 0.1)
    on_target = seen_at(plate, angle=aim_at(np.array(plate), MUZZLE).angle)
    assert_allclose(observed(make_observer("history", MUZZLE), [on_target])[:4], 0.0, atol=1e-12)


def test_fine_and_coarse_error_are_scaled_as_documented() -> None:
    plate = np.array([4.0, 0.5, 0.1])
    error = np.array([0.01, -0.03])
    seen = seen_at(plate, angle=aim_at(plate, MUZZLE).angle - error)
    found = observed(make_observer("history", MUZZLE), [seen])
    assert_allclose(found[:2], 2.0 * error)
    assert_allclose(found[2:4], np.tanh(100.0 / 3.0 * error))


def test_the_history_tells_where_the_command_would_come_to_rest() -> None:
    plate, braking, move = np.array([4.0, 0.5, 0.0]), 0.01, 0.05
    aim = aim_at(plate, MUZZLE).angle
    moves = move - braking * np.arange(1, 6)  # slowing from one decision to the next, until it stands
    # Even braking in continuous time, d²/2b, takes half a move more than braking in steps.
    rest = aim[1] - moves.sum() - move / 2
    views = [seen_at(plate, command=(aim[0], rest - back)) for back in (move, 0.0)]
    observer = make_observer("history", MUZZLE, frames=2, braking=np.full(2, braking))
    assert_allclose(observed(observer, views)[-4:-2], 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", ["paper", "history"])
def test_left_and_right_are_mirror_images(kind) -> None:
    observer = make_observer(kind, MUZZLE)
    rng = np.random.default_rng(3)
    views = [(rng.uniform([2.0, -1.0, 0.0], [4.0, 1.0, 0.1]), *rng.uniform(-0.2, 0.2, (2, 2))) for _ in range(5)]
    here = observed(observer, [seen_at(*view) for view in views])
    there = observed(observer, [seen_at(p * [1, -1, 1], a * MIRROR, c * MIRROR) for p, a, c in views])
    assert_allclose(np.abs(here), np.abs(there), atol=1e-12)
    assert np.sum(np.sign(here) != np.sign(there)) >= 3  # the yaw numbers do


def test_a_zero_action_aims_at_where_the_target_is_seen() -> None:
    observer = make_observer("history", MUZZLE)
    plate = np.array([4.0, 0.5, 0.1])
    memory = begin_memory(observer, seen_at(plate))
    assert_allclose(decode_action(observer, memory, np.zeros(2)), aim_at(plate, MUZZLE).angle)


def test_an_action_is_an_offset_in_units_of_its_scale() -> None:
    observer = make_observer("history", MUZZLE)
    memory = begin_memory(observer, seen_at((4.0, 0.5, 0.1)))
    moved = decode_action(observer, memory, np.array([1.0, -0.5])) - decode_action(observer, memory, np.zeros(2))
    assert_allclose(moved, observer.action_scale * [1.0, -0.5])


def test_an_unknown_observation_is_refused() -> None:
    with pytest.raises(InputError, match="one of history, paper, got 'pixels'"):
        make_observer("pixels", MUZZLE)


def test_a_history_of_one_frame_is_refused() -> None:
    with pytest.raises(InputError, match="at least 2 for the history observation, got 1"):
        make_observer("history", MUZZLE, frames=1)


@pytest.mark.parametrize("kind", ["paper", "history"])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, kind, agree_in_jax) -> None:
    rng = np.random.default_rng(4)
    plates = rng.uniform([2.0, -1.0, 0.0], [4.0, 1.0, 0.1], (2, *shape, 3))
    first, second = (seen_at(plate, *rng.uniform(-0.2, 0.2, (2, *shape, 2))) for plate in plates)

    def everything(observer, first, second, action):
        memory = remember(observer, begin_memory(observer, first), second)
        return observe(observer, memory), decode_action(observer, memory, action)

    observer = make_observer(kind, MUZZLE)
    # Differences of nearly equal angles, magnified a hundred times.
    numbers, angle = agree_in_jax(everything, observer, first, second, rng.normal(size=(*shape, 2)), atol=2e-4)
    assert numbers.shape == (*shape, observation_size(observer))
    assert angle.shape == (*shape, 2)
    if shape:
        alone = observed(observer, [map_arrays(lambda each: each[0], seen) for seen in (first, second)])
        assert_allclose(numbers[0], alone, atol=2e-4)
