"""Motions whose parameters are drawn: how far, how fast and from where they go."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.paper.conditions import assumed_conditions
from archerfish.simulation.scenario import LONG_S, SHORT, engagement_length
from archerfish.simulation.setting import make_scenario
from archerfish.targets.circle import circle_way
from archerfish.targets.distributions import LARGEST_FORWARD, LARGEST_LATERAL, LARGEST_SPEED, draw_parameters
from archerfish.targets.drawn import ANY, CHANCES, DRAWN, MIXTURE, WAYS, drawn_motion
from archerfish.targets.legs import driven, leg_ends
from archerfish.targets.parabola import parabola_way
from archerfish.targets.path import BEGIN_S, FLIGHT_S, STEP_S, TIMES, Path, path_about
from archerfish.targets.singer import FORWARD_SHARE, KNOT_S, singer_way
from archerfish.targets.strafe import strafe_way

COUNT = 400
BEGIN_AT_PLACE = ("still", "strafe", "stop-and-go", "singer")
ZERO = int(np.argmin(np.abs(TIMES)))


def chances(*shape: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).random((*shape, CHANCES))


def drawn(name: str, duration: float, count: int = COUNT) -> tuple[np.ndarray, np.ndarray]:
    """Places and positions at `TIMES` as far as they count, (count, 3) and (count, N, 3)."""
    rng = np.random.default_rng(6)
    place = np.stack([rng.uniform(1.0, 5.0, count), rng.uniform(-0.5, 0.5, count), np.full(count, 0.2)], axis=-1)
    motion = drawn_motion(name)
    chance = np.random.default_rng(5).random((count, motion.chances))
    path = motion.path(place, chance, np.full(count, duration))
    return place, path.places[:, duration + FLIGHT_S + 1e-9 >= TIMES]


@pytest.mark.parametrize("duration", [1.0, 3.0])
@pytest.mark.parametrize("name", DRAWN)
def test_a_target_stays_in_front_and_is_no_faster_than_a_robot(name: str, duration: float) -> None:
    place, places = drawn(name, duration)
    assert np.all(np.isfinite(places))
    assert_allclose(places[..., 2], 0.2)
    speed = np.linalg.norm(np.diff(places, axis=1), axis=-1) / STEP_S
    assert np.max(speed) <= LARGEST_SPEED * (1.0 + 1e-9)
    way = np.abs(places - place[:, None])
    assert np.all(way[..., 0] <= LARGEST_FORWARD * place[:, None, 0] * (1.0 + 1e-9))
    assert np.all(way[..., 1] <= LARGEST_LATERAL * place[:, None, 0] * (1.0 + 1e-9))
    assert (np.max(speed) > 0.1) == (name != "still")


@pytest.mark.parametrize("name", BEGIN_AT_PLACE)
def test_some_begin_at_their_place(name: str) -> None:
    place, places = drawn(name, 1.0)
    assert_allclose(places[:, ZERO], place, atol=1e-12)


def test_a_target_that_passes_is_at_its_place_once() -> None:
    place, _ = drawn("pass", 1.0)
    chance = chances(COUNT)
    path = drawn_motion("pass").path(place, chance, np.full(COUNT, 1.0))
    # The first draw is of the motion, the fifth of when it passes.
    assert_allclose(path.position(chance[:, 4]), place, atol=1e-9)


def test_parabolas_and_circles_keep_their_shape() -> None:
    chance = chances(COUNT)
    half_width, _, rise = draw_parameters("parabola", chance)
    way = parabola_way(chance, np.asarray(1.0))
    assert np.all(np.abs(way[..., 1]) <= half_width[:, None] * (1.0 + 1e-9))
    assert_allclose(way[..., 0], rise[:, None] * (way[..., 1] / half_width[:, None]) ** 2, atol=1e-12)
    radius, _ = draw_parameters("circle", chance)
    assert_allclose(
        np.linalg.norm(circle_way(chance, np.asarray(1.0)), axis=-1), radius[:, None] + np.zeros(len(TIMES))
    )


def test_a_still_target_is_still() -> None:
    place, places = drawn("still", 3.0)
    assert_allclose(places, place[:, None] + np.zeros_like(places))


def test_any_mixes_the_motions_by_their_weights() -> None:
    motion, place = drawn_motion(ANY), np.tile([3.0, 0.0, 0.2], (2000, 1))
    chance = np.random.default_rng(5).random((2000, motion.chances))
    # Neither slower nor swaying.
    chance[:, CHANCES] = 0.5
    chance[:, 0] = (np.arange(2000) + 0.5) / 2000
    mixed = motion.path(place, chance, np.asarray(1.0)).places
    begun = 0.0
    for name, weight in MIXTURE.items():
        share = weight / sum(MIXTURE.values())
        mine = (chance[:, 0] >= begun) & (chance[:, 0] < begun + share)
        assert np.mean(mine) == pytest.approx(share, abs=1e-3)
        if name in WAYS:
            alone = drawn_motion(name).path(place[mine], chance[mine], np.asarray(1.0)).places
            assert_allclose(mixed[mine], alone, atol=1e-12)
        begun += share


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
@pytest.mark.parametrize("name", DRAWN)
def test_numpy_and_jax_agree(name: str, shape: tuple[int, ...], agree_in_jax) -> None:
    def positions(place, chance, duration, time):
        return drawn_motion(name).path(place, chance, duration).position(time)

    rng = np.random.default_rng(7)
    place = rng.uniform([2.0, -0.5, 0.1], [4.0, 0.5, 0.3], (*shape, 3))
    time = rng.uniform(-0.3, 1.7, shape)
    chance = np.random.default_rng(5).random((*shape, drawn_motion(name).chances))
    found = agree_in_jax(positions, place, chance, np.ones(shape), time, atol=1e-4)
    assert found.shape == (*shape, 3)
    if shape:
        first = (0,) * len(shape)
        alone = positions(place[first], chance[first], np.asarray(1.0), time[first])
        assert_allclose(found[first], alone, atol=1e-4)


def test_a_path_is_linear_between_its_points_and_rests_outside() -> None:
    places = np.random.default_rng(8).normal(size=(2, 5, 3))
    path = Path(places, np.array([-0.3, 0.1]), np.array([0.02, 0.5]))
    for time in (-1.0, -0.29, 0.1, 0.123, 1.9, 9.0):
        found = path.position(np.full(2, time))
        for member in range(2):
            moments = path.begin[member] + path.step[member] * np.arange(5)
            expected = [np.interp(time, moments, places[member, :, axis]) for axis in range(3)]
            assert_allclose(found[member], expected, atol=1e-12)


def test_many_moments_of_a_batch_of_paths_at_once() -> None:
    path = Path(np.random.default_rng(9).normal(size=(1, 3, 5, 3)), np.zeros((1, 3)), np.full((1, 3), 0.1))
    times = np.linspace(0.0, 0.4, 12).reshape(4, 3)
    ahead = path.position(times)
    assert ahead.shape == (4, 3, 3)
    assert_allclose(ahead[2], path.position(times[2:3])[0])


def test_a_path_that_would_go_too_far_keeps_its_shape() -> None:
    way = np.stack([0.0 * TIMES, 2.0 * TIMES], axis=-1)
    path = path_about(np.array([1.0, 0.0, 0.2]), way, np.asarray(1.0))
    end = float(np.max(TIMES[TIMES <= 1.0 + FLIGHT_S + 1e-9]))
    assert_allclose(path.position(np.asarray(end)), [1.0, LARGEST_LATERAL, 0.2], atol=1e-3)
    assert_allclose(path.position(np.asarray(0.5 * end)), [1.0, 0.5 * LARGEST_LATERAL, 0.2], atol=1e-3)


def test_legs_end_at_equal_times_or_without_memory() -> None:
    chance, mean = np.random.default_rng(10).random((4000, 6)), np.full(4000, 0.5)
    equal = leg_ends(mean, np.zeros(4000), chance, np.full(4000, 0.25))
    assert_allclose(equal - BEGIN_S, 0.5 * (0.25 + np.arange(6)) + np.zeros((4000, 1)))
    lengths = np.diff(leg_ends(mean, np.ones(4000), chance, np.ones(4000)), axis=-1)
    # 20,000 draws of mean and standard deviation 0.5: 5 standard errors are 0.018, a false alarm in 10⁶.
    assert np.mean(lengths) == pytest.approx(0.5, abs=0.018)
    assert np.std(lengths) == pytest.approx(0.5, abs=0.03)


def test_a_strafing_target_turns_at_random_times_within_its_acceleration() -> None:
    chance = chances(COUNT)
    speed, _, _, _, acceleration = draw_parameters("strafe", chance)
    way = strafe_way(chance, np.asarray(3.0))
    pull = np.linalg.norm(np.diff(way, n=2, axis=1), axis=-1) / STEP_S**2
    assert np.all(np.max(pull, axis=-1) <= acceleration * (1.0 + 1e-6))
    velocity = np.linalg.norm(np.diff(way, axis=1), axis=-1) / STEP_S
    assert np.all(np.max(velocity, axis=-1) <= speed * (1.0 + 1e-6))
    turns = np.array([TIMES[int(np.argmax(each > 0.5))] for each in pull])
    assert len(np.unique(turns)) > 20


def test_a_change_of_velocity_takes_the_time_that_it_needs() -> None:
    way = driven(np.asarray(1.0), np.array([-2.0]), np.array([0.5]), np.asarray(4.0))
    assert way[ZERO] == 0.0
    velocity = np.diff(way) / STEP_S
    middle = TIMES[:-1] + STEP_S / 2
    assert_allclose(velocity, np.interp(middle, [0.5, 1.0], [1.0, -1.0]), atol=1e-2)


def test_manoeuvres_of_singer_have_their_standard_deviation_at_all_times() -> None:
    count = 4000
    chance = chances(count)
    chance[:, 2:4] = 0.5  # of the standard deviation, and of the time constant
    sd, memory = (float(each) for each in draw_parameters("singer", chance[0])[2:])
    way = singer_way(chance, np.asarray(3.0))
    second = np.diff(way, n=2, axis=1) / STEP_S**2
    every = round(KNOT_S / STEP_S)
    at_knots = second[:, every - 1 :: every]
    # A second difference weighs the acceleration at a knot with 0.95, and those before and after with 0.025 each.
    kept = np.exp(-KNOT_S / memory)
    seen = sd * np.sqrt(0.95**2 + 2 * 0.025**2 + 4 * 0.95 * 0.025 * kept + 2 * 0.025**2 * kept**2)
    # A standard deviation of 4,000 draws is off by 1.1 %; 5 of these at 36 of them is a false alarm in 5 · 10⁴ seeds.
    assert at_knots.shape[1] >= 18
    for axis, share in ((0, FORWARD_SHARE), (1, 1.0)):
        assert_allclose(np.std(at_knots[..., axis], axis=0), share * seen, rtol=5.0 / np.sqrt(2.0 * count))


def test_most_engagements_are_short() -> None:
    scenario = make_scenario(assumed_conditions(), motion=drawn_motion(ANY), short=SHORT)
    scenario = scenario._replace(lengths=np.array([SHORT[1], LONG_S], np.float32))
    uniforms = np.zeros((1000, scenario.uniforms), np.float32)
    uniforms[:, 4] = (np.arange(1000) + 0.5) / 1000
    lengths = engagement_length(scenario, uniforms)
    assert np.mean(lengths == SHORT[1]) == pytest.approx(SHORT[0])
    assert set(np.unique(lengths)) == {SHORT[1], LONG_S}
