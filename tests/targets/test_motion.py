"""Eq (7), sampled paths, drawn motions and their mixtures, a random process with habits, and a user's motion.

Bounds on shares are five standard deviations: were seeds free, one alarm in a million would be false.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.targets import kinds, mixture, motion, process
from archerfish.targets.distributions import LARGEST_SPEED
from archerfish.targets.mixture import MIXTURES
from archerfish.targets.motion import STEP_S, ZERO
from archerfish.targets.process import AXIS_UNIFORMS, LEGS, PROCESS_UNIFORMS, random_process
from archerfish.targets.user_motion import find_motion, user_target
from archerfish.task import StillOrMoving, Task

HALF_WIDTH = (0.04 / 3.0) ** 0.5
CYCLE, SWING = 4.0 * HALF_WIDTH / 0.3, tuple(np.asarray(each, np.float32) for each in (0.35, 0.115, 0.04))
PLACE = np.random.default_rng(6).uniform([1.0, -0.5, 0.2], [5.0, 0.5, 0.2], (400, 3))


class One(NamedTuple):
    place: Any
    speed: Any

    def position(self, time):
        return self.place + (self.speed * time)[..., None]


class Pair(One):
    plates = 2

    def at(self, time):
        both = motion.disc(self, self.place).at(time)
        return motion.Plates(*(motion.namespace(time).repeat(each, 2, axis=time.ndim) for each in both))


class Sudden(One):
    position = lambda self, time: 0.0 * time[..., None] if time.max() > 0.0 else self.place  # noqa: E731


FLAT = type("Flat", (One,), {"position": lambda self, time: time[..., None]})


def uniforms(*batch):
    return np.random.default_rng(5).random((*batch, mixture.path_uniforms("any")))


def parabola(phase=0.0):
    return motion.Parabola(*map(np.asarray, ([4.0, 0.5, 0.2], 0.3, phase, HALF_WIDTH, 3.0)))


def test_a_parabola_keeps_eq_7_and_turns_back_at_its_ends():
    x, y, z = np.moveaxis(parabola().position(np.linspace(0.0, 2.0 * CYCLE, 401)), -1, 0)
    assert_allclose(x, 3.0 * (y - 0.5) ** 2 + 4.0)
    assert_allclose([np.min(x), np.max(x), np.min(z), np.max(z)], [4.0, 4.04, 0.2, 0.2])
    assert_allclose(y[:201:50] - 0.5, HALF_WIDTH * np.array([-1.0, 0.0, 1.0, 0.0, -1.0]), atol=1e-12)
    assert_allclose(np.abs(np.diff(y)), 0.3 * CYCLE / 200.0)
    assert_allclose(parabola(0.3).position(np.asarray(0.2)), parabola().position(np.asarray(0.2 + 0.3 * CYCLE)))


@pytest.mark.parametrize("duration", [1.0, 3.0])
@pytest.mark.parametrize("name", [*kinds.KINDS, *mixture.MIXTURES])
def test_a_target_stays_in_front_and_is_no_faster_than_a_robot(name, duration):
    path = mixture.drawn_path(name, PLACE, uniforms(400), np.full(400, duration), SWING)
    places = path.places[:, duration + motion.FLIGHT_S + 1e-9 >= motion.TIMES]
    speed = np.max(np.linalg.norm(np.diff(places, axis=1), axis=-1)) / motion.STEP_S
    assert (speed > 0.1) == (name != "still")
    assert speed <= LARGEST_SPEED * (1.0 + 1e-9)
    most = PLACE[:, None, :1] * [mixture.LARGEST_FORWARD, mixture.LARGEST_LATERAL, 1e-12]
    assert np.all(np.abs(places - PLACE[:, None]) <= most * (1.0 + 1e-9))
    if name in ("still", "strafe", "stop-and-go", "singer"):
        assert_allclose(places[:, motion.ZERO], PLACE, atol=1e-12)


def test_numpy_and_jax_agree_at_several_times_at_once_as_at_each(batch, agree):
    def at(scenario, swing, place, drawn, duration, moving, times):
        moved = [each(drawn, duration) for each in kinds.KINDS.values()]
        moved += [kinds.eq_7(drawn, *SWING), mixture.varied(moved[2], drawn), process.random_process(drawn, duration)]
        discs = [motion.disc(mixture.path_about(place, each, duration), place) for each in moved]
        targets = [motion.disc(swing, place), *(StillOrMoving(place, moving, each) for each in discs)]
        return scenario.draw(drawn[..., :6]), [each.at(times) for each in targets]

    rng = np.random.default_rng(7)
    place, times = rng.uniform([2.0, -0.5, 0.1], [4.0, 0.5, 0.3], (*batch, 3)), rng.uniform(-0.3, 1.7, (4, *batch))
    swing, moving = motion.Parabola(place, *rng.uniform(0.1, 0.5, (4, *batch))), rng.random(batch) < 0.5
    given = Task.load("paper").scenario(9), swing, place, uniforms(*batch), np.ones(batch), moving
    _, ahead = agree(at, *given, times, atol=1e-4)
    for many, one in zip(ahead, at(*given, times[2])[1], strict=True):
        assert_allclose(many.position[2], one.position, atol=1e-4)
        assert_allclose(many.normal_yaw, np.full((4, *batch, 1), np.pi), rtol=1e-6)
    assert_allclose((ahead[1].position[..., 0, :] - place)[:, ~moving], 0.0, atol=1e-6)


@pytest.mark.parametrize("kind", [One, Pair])
def test_it_is_checked_once_and_moves_as_it_says_beside_targets_that_stand(kind):
    make = lambda place, speed, _: kind(place, speed)  # noqa: E731
    found, place, speed = find_motion(make), np.ones((4, 3)), np.arange(4.0)
    target = StillOrMoving(place, np.arange(4) > 1, user_target(found, place, speed, None))
    assert find_motion(make) is found
    moved = target.at(np.full((3, 4), 0.7)).position - place[:, None]
    assert moved.shape == (3, 4, target.plates, 3)
    assert_allclose(moved, 0.0 * moved + np.array([0.0, 0.0, 1.4, 2.1])[:, None, None])


def test_what_is_no_motion_is_refused(refused):
    pytest.importorskip("jax")
    flat = r"Flat has positions of shape \(2, 5, 1, 1\) at times \(2, 5\), expected \(2, 5, 1, 3\)"
    refused(flat, find_motion, lambda place, speed, _: FLAT(place, speed))
    refused(r"line \d+: TracerBoolConversionError", find_motion, lambda place, speed, _: Sudden(place, speed))
    short = r"returns a One, expected an object with position\(time\), each array as long as"
    refused(short, find_motion, lambda _, speed, __: One(np.zeros(3), speed))


ACCELERATION, HEADING, RATE, FORM, AXES = range(5)
LEFT, DWELL, DWELL_VARIES, SPEED, SPEED_VARIES, REST, KEEPS, LONG, OWN_DWELL = range(5, 14)  # of the first axis


@pytest.fixture(scope="module")
def two_legs():
    """Draw targets of which all legs last 2 s; return uniforms, displacements, and velocities of the first two legs."""
    uniforms = np.random.default_rng(8).random((4000, PROCESS_UNIFORMS))
    uniforms[:, [AXES, LEFT, DWELL, DWELL_VARIES, LONG]] = 1.0, 1.0, 1.0, 0.0, 1.0
    uniforms[:2500, REST] = np.repeat([0.5, 1.0], [2000, 500])
    moved = np.concatenate([random_process(each, np.ones(len(each))) for each in np.split(uniforms, 10)])
    return uniforms, moved, (moved[:, [100, 200]] - moved[:, [99, 199]]) / STEP_S  # at the ends of the legs


def check_share(found, share):
    assert abs(np.mean(found) - share) < 5.0 * (share * (1.0 - share) / len(found)) ** 0.5


def test_targets_drive_and_stand_as_often_and_as_fast_as_their_distributions_have_it(two_legs):
    uniforms, moved, velocity = two_legs
    speed = np.linalg.norm(velocity, axis=-1)
    drives = speed > 1e-9
    check_share(drives[:2000].ravel(), 1.0 - 0.9 * 0.5**1.57)
    check_share(drives[2000:2500].ravel(), 0.1)
    check_share(drives[2500:, 0], 1.0 - 0.9 / 2.57)
    assert speed[drives].min() > 0.1 - 1e-9
    assert speed[drives].max() < 2.5 + 1e-9
    check_share(speed[drives[:, 0], 0] < 1.0, 0.5)
    assert_allclose(moved[:, ZERO], 0.0)
    both, varies = np.all(drives, axis=1), uniforms[:, SPEED_VARIES]
    departs = np.abs(np.log(speed[both, 1] / speed[both, 0]))
    assert np.all(departs <= np.log(5.0) / 0.25 * varies[both] + 1e-9)  # where the distribution is steepest


def test_directions_change_by_the_habits(two_legs):
    uniforms, _, velocity = two_legs
    chosen = np.all(np.linalg.norm(velocity, axis=-1) > 1e-9, axis=1)
    uniforms, (first, then) = uniforms[chosen], np.moveaxis(velocity[chosen], 1, 0)
    sine = np.linalg.det(velocity[chosen]) / np.linalg.norm(first, axis=-1) / np.linalg.norm(then, axis=-1)
    line, steady = uniforms[:, FORM] < 0.6, uniforms[:, FORM] >= 0.8
    assert_allclose(sine[line], 0.0, atol=1e-9)
    assert np.all(np.abs(sine[~line & ~steady]) < np.sin(0.6))
    assert_allclose(np.abs(sine[steady]), np.abs(np.sin(2.0 * (3.0 * uniforms[steady, RATE] - 1.5))), atol=1e-9)
    check_share(np.sum(first * then, axis=-1)[line & (uniforms[:, KEEPS] > 0.5)] > 0.0, 0.75)


def test_legs_last_for_the_usual_dwell_of_the_target_or_for_their_own():
    uniforms = np.random.default_rng(9).random((40, PROCESS_UNIFORMS))
    uniforms[:, [ACCELERATION, AXES, LEFT, LONG]] = 1.0
    uniforms[:, [SPEED_VARIES, REST, KEEPS, FORM]] = 0.0
    uniforms[:, DWELL_VARIES] = np.repeat([0.0, 1.0], 20)
    usual = np.log(4.0) / np.log(20.0)  # 0.4 s, of 0.1 to 2 s
    uniforms[:20, DWELL] = usual
    uniforms[20:, OWN_DWELL : OWN_DWELL + LEGS] = usual
    moved = random_process(uniforms, np.ones(40))
    assert_allclose(moved[:, 60:], moved[:, 20:-40], atol=1e-9)  # to and fro from 0.1 s on: every 0.8 s it is the same
    uniforms[:, LONG] = 0.2
    moved = np.diff(random_process(uniforms, np.ones(40)), axis=1)
    assert_allclose(np.ptp(moved[:, 20:124], axis=1), 0.0, atol=1e-9)  # straight on until 2.2 s


def test_legs_longer_than_their_ramp_change_speed_at_the_targets_acceleration(two_legs):
    uniforms, moved, velocity = two_legs
    most = np.max(np.linalg.norm(np.diff(moved, 2, axis=1), axis=-1), axis=1) / STEP_S**2
    drawn = 3.0 * 5.0 ** uniforms[:, ACCELERATION]
    assert np.all(most <= drawn * (1.0 + 1e-9))
    long = np.linalg.norm(velocity[:, 1] - velocity[:, 0], axis=-1) > 2.0 * STEP_S * drawn
    assert_allclose(most[long], drawn[long])


@pytest.mark.parametrize(("axis", "other"), [(1, 0), (0, 1)])
def test_two_axes_have_legs_and_habits_of_their_own(axis, other):
    uniforms = np.random.default_rng(10).random((4000, PROCESS_UNIFORMS))
    uniforms[:, HEADING] = 0.5  # straight ahead
    changed = uniforms.copy()
    begin = LEFT + AXIS_UNIFORMS * (axis == 1)  # sideways the first, forward the second
    changed[:, begin : begin + AXIS_UNIFORMS] = np.random.default_rng(11).random((4000, AXIS_UNIFORMS))
    moved, again = (random_process(each, np.ones(4000)) for each in (uniforms, changed))
    two = uniforms[:, AXES] < 0.6
    assert_allclose(again[two][..., axis], moved[two][..., axis], atol=1e-9)
    assert np.mean(np.ptp(again[two][..., other] - moved[two][..., other], axis=1) > 0.01) > 0.9
    if axis == 1:
        check_share(np.any(again != moved, axis=(1, 2)), 0.6)


def test_half_of_the_axes_of_targets_with_two_and_a_quarter_of_the_lines_are_steady():
    uniforms = np.random.default_rng(13).random((4000, PROCESS_UNIFORMS))
    uniforms[:, [HEADING, FORM, DWELL, DWELL + AXIS_UNIFORMS]] = 0.5, 0.0, 0.0, 0.0  # usual legs of 0.1 s
    uniforms[:, [DWELL_VARIES, DWELL_VARIES + AXIS_UNIFORMS, REST, REST + AXIS_UNIFORMS]] = 0.0
    uniforms[:, [LEFT, LEFT + AXIS_UNIFORMS, KEEPS, KEEPS + AXIS_UNIFORMS]] = 1.0, 1.0, 0.0, 0.0
    moved = random_process(uniforms, np.ones(4000))
    steady = np.ptp(np.diff(moved[:, 15:65], axis=1), axis=1) < 1e-6  # for a second
    two = uniforms[:, AXES] < 0.6
    check_share(steady[two].ravel(), 0.5)
    check_share(steady[~two, 1], 0.25)
    for forward, sideways in itertools.product((False, True), repeat=2):
        check_share((steady[two, 0] == forward) & (steady[two, 1] == sideways), 0.25)


def test_two_axes_are_turned_by_at_most_45_degrees_from_the_line_of_sight():
    uniforms = np.random.default_rng(12).random((500, PROCESS_UNIFORMS))
    uniforms[:, AXES] = 0.0
    turned = random_process(uniforms, np.ones(500))
    straight = uniforms.copy()
    straight[:, HEADING] = 0.5
    angle = np.pi / 2.0 * (uniforms[:, HEADING] - 0.5)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    forward, sideways = np.moveaxis(random_process(straight, np.ones(500)), -1, 0)
    assert_allclose(turned[..., 0], cosine * forward + sine * sideways, atol=1e-9)
    assert_allclose(turned[..., 1], cosine * sideways - sine * forward, atol=1e-9)


@pytest.mark.parametrize("name", MIXTURES)
def test_a_training_mixes_the_motions_by_their_weights(name):
    counts = {"any": [4, 11, 9, 8, 7, 6, 48, 107], "kinds": [30, 15, 50, 10, 50, 6, 6, 20, 60]}[name]
    scenario, total = Task.load(name).scenario(), sum(counts)
    drawn = np.full((total, scenario.uniforms), 0.4)
    drawn[:, 6] = (np.arange(total) + 0.5) / total  # which kind: spaced evenly, so that no alarm is by accident
    places = scenario.draw(drawn).target.motion.places
    ends = np.flatnonzero([True, *np.any(np.abs(places[1:] - places[:-1]) > 1e-6, axis=(1, 2)), True])
    assert np.diff(ends).tolist() == counts
