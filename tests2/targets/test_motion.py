"""Eq (7), sampled paths, and motions whose parameters are drawn: how far, how fast and from where they go."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.targets import mixture
from archerfish2.targets.distributions import LARGEST_SPEED
from archerfish2.targets.kinds import KINDS, driven, eq_7
from archerfish2.targets.motion import FLIGHT_S, STEP_S, TIMES, ZERO, Parabola, Path, StillOrMoving, disc
from archerfish2.task import Task

HALF_WIDTH = (0.04 / 3.0) ** 0.5
CYCLE, SWING = 4.0 * HALF_WIDTH / 0.3, tuple(np.asarray(each, np.float32) for each in (0.35, 0.115, 0.04))
PLACE = np.random.default_rng(6).uniform([1.0, -0.5, 0.2], [5.0, 0.5, 0.2], (400, 3))


def uniforms(*batch):
    return np.random.default_rng(5).random((*batch, mixture.path_uniforms("any")))


def parabola(phase=0.0):
    return Parabola(*map(np.asarray, ([4.0, 0.5, 0.2], 0.3, phase, HALF_WIDTH, 3.0)))


def test_a_parabola_keeps_eq_7_and_turns_back_at_its_ends():
    x, y, z = np.moveaxis(parabola().position(np.linspace(0.0, 2.0 * CYCLE, 401)), -1, 0)
    assert_allclose(x, 3.0 * (y - 0.5) ** 2 + 4.0)
    assert_allclose([np.min(x), np.max(x), np.min(z), np.max(z)], [4.0, 4.04, 0.2, 0.2])
    assert_allclose(y[:201:50] - 0.5, HALF_WIDTH * np.array([-1.0, 0.0, 1.0, 0.0, -1.0]), atol=1e-12)
    assert_allclose(np.abs(np.diff(y)), 0.3 * CYCLE / 200.0)
    assert_allclose(parabola(0.3).position(np.asarray(0.2)), parabola().position(np.asarray(0.2 + 0.3 * CYCLE)))


def test_a_path_is_linear_between_its_points_and_rests_outside():
    rng = np.random.default_rng(9)
    path = Path(rng.normal(size=(2, 5, 3)), rng.uniform(-0.3, 0.3, 2), rng.uniform(0.1, 0.5, 2))
    for time in (-1.0, -0.29, 0.1, 0.123, 1.9, 9.0):
        for member, found in enumerate(path.position(np.full(2, time))):
            moments = path.begin[member] + path.step[member] * np.arange(5)
            expected = [np.interp(time, moments, path.places[member, :, axis]) for axis in range(3)]
            assert_allclose(found, expected, atol=1e-12)


def test_a_driven_target_changes_its_speed_at_the_largest_acceleration():
    speed = np.diff(driven(np.asarray(1.0), np.array([-2.0]), np.array([0.5]), np.asarray(4.0))) / STEP_S
    assert_allclose(speed, np.interp(TIMES[:-1] + STEP_S / 2, [0.5, 1.0], [1.0, -1.0]), atol=1e-2)


@pytest.mark.parametrize("duration", [1.0, 3.0])
@pytest.mark.parametrize("name", [*KINDS, "any"])
def test_a_target_stays_in_front_and_is_no_faster_than_a_robot(name, duration):
    path = mixture.drawn_path(name, PLACE, uniforms(400), np.full(400, duration), SWING)
    places = path.places[:, duration + FLIGHT_S + 1e-9 >= TIMES]
    speed = np.max(np.linalg.norm(np.diff(places, axis=1), axis=-1)) / STEP_S
    assert (speed > 0.1) == (name != "still")
    assert speed <= LARGEST_SPEED * (1.0 + 1e-9)
    most = PLACE[:, None, :1] * [mixture.LARGEST_FORWARD, mixture.LARGEST_LATERAL, 1e-12]
    assert np.all(np.abs(places - PLACE[:, None]) <= most * (1.0 + 1e-9))
    assert name not in ("still", "strafe", "stop-and-go", "singer") or np.allclose(places[:, ZERO], PLACE, atol=1e-12)


def test_numpy_and_jax_agree_at_several_times_at_once_as_at_each(batch, agree):
    def at(scenario, swing, place, drawn, duration, moving, times):
        moved = [each(drawn, duration) for each in KINDS.values()]
        moved += [eq_7(drawn, *SWING), mixture.varied(moved[2], drawn)]
        paths = [StillOrMoving(place, moving, disc(mixture.path_about(place, each, duration), place)) for each in moved]
        return scenario.draw(drawn[..., :6]), [each.at(times) for each in (disc(swing, swing.vertex), *paths)]

    rng = np.random.default_rng(7)
    place, times = rng.uniform([2.0, -0.5, 0.1], [4.0, 0.5, 0.3], (*batch, 3)), rng.uniform(-0.3, 1.7, (4, *batch))
    swing, moving = Parabola(place, *rng.uniform(0.1, 0.5, (4, *batch))), rng.random(batch) < 0.5
    given = Task.load("paper").scenario(9), swing, place, uniforms(*batch), np.ones(batch), moving
    _, ahead = agree(at, *given, times, atol=1e-4)
    for many, one in zip(ahead, at(*given, times[2])[1], strict=True):
        assert_allclose(many.position[2], one.position, atol=1e-4)
        assert_allclose(many.normal_yaw, np.full((4, *batch, 1), np.pi), rtol=1e-6)
    assert_allclose((ahead[1].position[..., 0, :] - place)[:, ~moving], 0.0, atol=1e-6)
