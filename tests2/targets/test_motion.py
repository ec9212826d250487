"""Eq (7), sampled paths, motions whose parameters are drawn, and a user's motion."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.targets import kinds, mixture, motion, process
from archerfish2.targets.distributions import LARGEST_SPEED
from archerfish2.targets.user_motion import find_motion, user_target
from archerfish2.task import StillOrMoving, Task

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
