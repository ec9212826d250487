import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import aim_at, line_of_sight
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.dynamics.linear_axis import rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.dynamics.pellet import GRAVITY
from archerfish.sensing.interfaces import Engagement, World, fire_always
from archerfish.simulation.shooting import DRAWS, miss_at_armor, plant_of
from archerfish.targets.parabola import Parabola
from archerfish.targets.passing import Line
from archerfish.targets.still import Static

PERIOD = 0.02


def static_engagement(place, start=(0.0, 0.0), plant: int = 0) -> Engagement:
    place = np.asarray(place, np.float32)
    shape = place.shape[:-1]
    start = np.broadcast_to(np.asarray(start, np.float32), (*shape, 2))
    return Engagement(Static(place), start, np.full(shape, plant, np.int32))


def still(*shape: int) -> np.ndarray:
    return np.zeros((*shape, DRAWS), np.float32)


def test_the_world_keeps_the_protocol(build_world) -> None:
    world = build_world()
    assert isinstance(world, World)
    assert world.pure
    assert world.period_s == pytest.approx(PERIOD)


def test_a_miss_by_hand() -> None:
    # No drag: 20 m/s at 30° to the left, 8.66 m ahead. The plane is reached after 0.5 s, at y = 5 m, 1.226 m below.
    # The armor leaves (8.66, 4.6, −1.2) at 1 m/s to the left when the pellet is fired, at t = 0.1 s.
    gun = Muzzle(*(np.asarray(each) for each in (20.0, 0.0, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0)))
    distance = 20.0 * math.cos(math.pi / 6) * 0.5
    armor = Line(np.array([distance, 4.6 - 0.1, -1.2]), np.array([0.0, 1.0, 0.0]))
    velocity = 20.0 * np.array([math.cos(math.pi / 6), 0.5, 0.0])
    miss, time = miss_at_armor(gun, armor, np.asarray(0.1), np.zeros(3), velocity)
    assert time == pytest.approx(0.5)
    assert_allclose(miss, [5.0 - 5.1, -0.5 * GRAVITY * 0.25 + 1.2])


def test_the_armor_of_a_miss_is_the_one_that_the_pellet_meets() -> None:
    # Against an armor that comes nearer: the pellet and it share x at the moment of the miss.
    gun = Muzzle(*(np.asarray(each) for each in (18.0, 0.0, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0)))
    armor = Line(np.array([4.0, 0.3, 0.0]), np.array([-2.0, 1.0, 0.0]))
    miss, time = miss_at_armor(gun, armor, np.asarray(0.0), np.zeros(3), np.array([18.0, 0.0, 0.0]))
    assert time == pytest.approx(4.0 / 20.0, rel=1e-3)  # they close at 20 m/s
    assert miss[0] == pytest.approx(-(0.3 + 0.2), abs=5e-4)


def test_a_gimbal_at_rest_on_target_hits_the_middle(build_world) -> None:
    world = build_world()
    place = np.array([4.0, 0.6, 0.2], np.float32)
    aim = aim_at(place, world.muzzle).angle
    # The printed pitch axis answers a command 1.031 times over; rest is where the gimbal really points at the aim.
    command = aim / np.sum(rest_state(world.gimbal, np.ones(2, np.float32)) * world.gimbal.angle, axis=-1)
    state = world.begin(static_engagement(place, command), still())
    following, shot = world.shoot(state, fire_always(command), still())
    assert_allclose(shot.miss, 0.0, atol=1e-5)
    assert_allclose(shot.angle, aim, atol=1e-6)
    assert following.time == pytest.approx(PERIOD)
    assert shot.fired


def test_dispersion_shifts_the_hit_by_its_angle(build_world) -> None:
    world = build_world()
    state = world.begin(static_engagement((4.0, 0.0, 0.0)), still())
    draws = np.array([2.0, -1.0, 0.0, 0.0, 0.0, 0.0], np.float32)
    (_, there), (_, straight) = (
        world.shoot(state, fire_always(np.zeros(2, np.float32)), each) for each in (draws, still())
    )
    # A departure at a slant takes a little longer to the plane; that falls a hundredth of a millimetre more.
    assert_allclose((there.miss - straight.miss), 4.0 * np.tan(world.muzzle.sd) * [-1.0, 2.0], atol=5e-5)


def test_a_controller_is_told_what_it_may_know(build_world) -> None:
    world = build_world()
    state = world.begin(static_engagement([(4.0, 0.6, 0.2)] * 3, (0.05, 0.1)), still(3))
    seen = world.see(state)
    assert_allclose(seen.elapsed, 0.0)
    assert_allclose(seen.command, [[0.05, 0.1]] * 3)
    assert_allclose(seen.plate, [[[4.0, 0.6, 0.2]]] * 3)
    assert seen.fresh.all()
    assert_allclose(seen.muzzle_speed, 18.0)
    later = world.see(world.shoot(state, fire_always(np.full((3, 2), 0.15, np.float32)), still(3))[0])
    assert_allclose(later.elapsed, PERIOD)
    assert_allclose(later.command, 0.15)
    assert np.all(later.rate > 0.0)
    assert {name: value.shape for name, value in later._asdict().items()} == {
        "elapsed": (3,),
        "angle": (3, 2),
        "rate": (3, 2),
        "gimbal_age": (3,),
        "command": (3, 2),
        "plate": (3, 1, 3),
        "normal_yaw": (3, 1),
        "plate_age": (3, 1),
        "fresh": (3, 1),
        "base": (3, 4),
        "muzzle_speed": (3,),
        "heat_left": (3,),
    }


def test_the_world_applies_the_limits_whatever_is_asked(build_world) -> None:
    wild = np.random.default_rng(101).uniform(-4.0, 4.0, (60, 20, 2)).astype(np.float32)
    for limit, low, high in (
        ("box", [-25, -75], [10, 75]),
        ("gate", [-25, -75], [10, 75]),
        ("los-2deg", [-25, -2], [10, 2]),
    ):
        world = build_world(limit)
        state = world.begin(static_engagement([(4.0, 0.0, 0.0)] * 20), still(20))
        commands = [np.zeros((20, 2))] * 2
        for wish in wild:
            state, shot = world.shoot(state, fire_always(wish), still(20))
            commands.append(state.command)
            assert np.all(shot.angle >= world.angle_low)
            assert np.all(shot.angle <= world.angle_high)
        assert np.all(np.array(commands) >= np.radians(low) - 1e-6)
        assert np.all(np.array(commands) <= np.radians(high) + 1e-6)
        if limit == "gate":
            acceleration = np.diff(np.array(commands, np.float64), n=2, axis=0) / PERIOD**2
            assert np.all(np.abs(acceleration) <= world.limits.max_acceleration * 1.005)


def test_measurement_noise_lies_along_and_across_the_line_of_sight(build_world) -> None:
    # Five standard errors: a false alarm once in about 600,000 seeds for the three.
    count, along_sd, across_sd = 20_000, 0.05, 0.004
    world = build_world(noise=(along_sd, across_sd))
    place = np.array([3.0, -2.0, 0.4], np.float32)
    draws = np.random.default_rng(102).standard_normal((count, DRAWS)).astype(np.float32)
    plate = world.see(world.begin(static_engagement([place] * count), draws)).plate[:, 0]
    along = place / np.linalg.norm(place)
    left = np.array([2.0, 3.0, 0.0]) / math.sqrt(13.0)
    for axis, sd in ((along, along_sd), (left, across_sd), (np.cross(along, left), across_sd)):
        assert np.std((plate - place) @ axis) == pytest.approx(sd, abs=5 * sd / math.sqrt(2 * count))


def test_the_first_two_sights_have_noise_of_their_own(build_world) -> None:
    world = build_world(noise=(0.01, 0.01))
    draws = np.random.default_rng(103).standard_normal((4, 10, DRAWS)).astype(np.float32)
    state, first = world.reset(static_engagement([(4.0, 0.0, 0.0)] * 4), draws)
    state, second, _ = world.step(state, fire_always(first.angle))
    _, third, _ = world.step(state, fire_always(first.angle))
    assert np.all(first.plate != second.plate)
    assert np.all(second.plate != third.plate)


def test_noise_in_what_is_seen_leaves_the_score_alone(build_world) -> None:
    draws = np.zeros((5, DRAWS), np.float32)
    draws[:, 3:] = np.random.default_rng(104).standard_normal((5, 3))
    shots = []
    for noise in ((0.0, 0.0), (0.1, 0.1)):
        world = build_world(noise=noise)
        state = world.begin(static_engagement([(4.0, 0.2, 0.0)] * 5), still(5))
        shots.append(world.shoot(state, fire_always(np.zeros((5, 2), np.float32)), draws)[1])
    assert_allclose(shots[0].miss, shots[1].miss)


def test_an_engagement_names_its_plant(build_world) -> None:
    world = build_world(draws=3)
    engagement = static_engagement([(4.0, 0.2, 0.0)] * 3)._replace(plant=np.array([2, 0, 1], np.int32))
    state = world.begin(engagement, still(3))
    _, shot = world.shoot(state, fire_always(np.full((3, 2), 0.02, np.float32)), still(3))
    # A plant of thrice the gain answers a step from zero thrice as strongly.
    assert_allclose(shot.angle[:, 1] / shot.angle[1, 1], [3.0, 1.0, 2.0], rtol=1e-4)
    assert plant_of(world, engagement).transition.shape[:2] == (3, 2)
    assert world.truth(engagement).gimbal.input.shape[:2] == (3, 2)


def test_without_draws_all_share_one_plant(build_world) -> None:
    world = build_world()
    assert plant_of(world, static_engagement([(4.0, 0.2, 0.0)] * 3)) is world.gimbal


def parabolas(shape: tuple[int, ...]) -> Engagement:
    rng = np.random.default_rng(105)
    motion = Parabola(
        rng.uniform([2.0, -0.7, 0.0], [5.0, 0.7, 0.1], (*shape, 3)),
        rng.uniform(0.1, 0.35, shape),
        rng.uniform(0.0, 1.0, shape),
        *(np.full(shape, each) for each in (0.115, 3.0)),
    )
    return single_precision(Engagement(motion, np.zeros((*shape, 2)), rng.integers(0, 2, shape, dtype=np.int32)))


def fight(world, engagements, draws):
    """Follow the line of sight; what is seen last, and the last shot."""
    state, seen = world.reset(engagements, draws)
    for _ in range(draws.shape[-2]):
        state, seen, shot = world.step(state, fire_always(line_of_sight(seen.plate[..., 0, :])))
    return seen, shot


def test_the_same_draws_give_the_same_engagement(build_world) -> None:
    world, engagements = build_world(noise=(0.01, 0.01)), parabolas((4,))
    draws = np.random.default_rng(106).standard_normal((4, 2, DRAWS)).astype(np.float32)
    for ours, theirs in zip(fight(world, engagements, draws), fight(world, engagements, draws), strict=True):
        for found, expected in zip(ours, theirs, strict=True):
            assert np.array_equal(found, expected)


def test_a_batch_is_its_members(build_world) -> None:
    world, engagements = build_world(draws=2), parabolas((3,))
    draws = np.random.default_rng(107).standard_normal((3, 2, DRAWS)).astype(np.float32)
    together = fight(world, engagements, draws)[1]
    for member in range(3):
        one = map_arrays(lambda each, member=member: each[member], engagements)
        assert_allclose(fight(world, one, draws[member])[1].miss, together.miss[member], atol=1e-5)


@pytest.mark.parametrize(("shape", "draws"), [((), 2), ((3,), 2), ((2, 3), 2), ((2, 3), 0)])
def test_numpy_and_jax_agree(shape, draws, build_world, agree_in_jax) -> None:
    world = build_world("gate", draws, noise=(0.01, 0.01))
    normals = np.random.default_rng(108).standard_normal((*shape, 1, DRAWS))
    _, shot = agree_in_jax(fight, world, parabolas(shape), normals, rtol=1e-4, atol=2e-5)
    assert shot.miss.shape == (*shape, 2)
    assert shot.fired.shape == shape
