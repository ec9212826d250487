import math
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.predictors import ConstantVelocity, Hold, ParabolaAware, Vertex
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.targets.parabola import Parabola
from archerfish.targets.passing import Line

from . import sights
from .sights import DT

sight, follow = partial(sights.sight, age=0.0), partial(sights.follow, age=0.0)
"""Sights that are not old."""

HALF_WIDTH = math.sqrt(0.04 / 3.0)
PARABOLA = ParabolaAware(np.asarray(3.0), np.asarray(HALF_WIDTH))
CYCLE = 4.0 * HALF_WIDTH


def parabola(speed: float = 0.3, phase: float = 0.1) -> Parabola:
    values = (np.array([4.0, -0.5, 0.1]), speed, phase, HALF_WIDTH, 3.0)
    return Parabola(*(np.asarray(each) for each in values))


def test_hold_expects_the_target_where_it_is_seen() -> None:
    path = parabola().position(DT * np.arange(5))
    assert_allclose(Hold().position_after(follow(Hold(), path), np.asarray(0.3)), path[-1])


def test_constant_velocity_leads_a_target_on_a_line() -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.1, 0.6, 0.0]))
    predictor = ConstantVelocity(TrackerNoise(*(np.asarray(each) for each in (1.0, 0.002, 0.002))))
    state = follow(predictor, line.position(DT * np.arange(30)))
    assert_allclose(
        predictor.position_after(state, np.asarray(0.2)), line.position(np.asarray(29 * DT + 0.2)), atol=1e-3
    )


def test_constant_velocity_carries_old_sights_to_now() -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.1, 0.6, 0.0]))
    predictor = ConstantVelocity(TrackerNoise(*(np.asarray(each) for each in (1.0, 0.002, 0.002))))
    ages = np.random.default_rng(52).uniform(0.03, 0.06, 60)

    def seen(step: int, elapsed: float = DT) -> Seen:
        return sight(line.position(np.asarray(DT * step - ages[step])), elapsed)._replace(
            plate_age=ages[step : step + 1]
        )

    state = predictor.step(predictor.reset(seen(0)), seen(0, elapsed=0.0))
    for step in range(1, 60):
        state = predictor.step(state, seen(step))
    for ahead in (0.0, 0.2):
        expected = line.position(np.asarray(59 * DT + ahead))
        assert_allclose(predictor.position_after(state, np.asarray(ahead)), expected, atol=1e-3)


def test_constant_velocity_goes_on_without_a_new_sight() -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.1, 0.6, 0.0]))
    predictor = ConstantVelocity(TrackerNoise(*(np.asarray(each) for each in (1.0, 0.002, 0.002))))
    state, last = follow(predictor, line.position(DT * np.arange(30))), sight(line.position(np.asarray(29 * DT)))
    for lost in range(1, 5):
        before = state.track
        state = predictor.step(state, last._replace(plate_age=np.array([DT * lost]), fresh=np.array([False])))
        assert_allclose(state.track.covariance, before.covariance, atol=1e-15)  # as of the same exposure
        assert_allclose(
            predictor.position_after(state, np.asarray(0.1)),
            line.position(np.asarray((29 + lost) * DT + 0.1)),
            atol=1e-3,
        )


# Phases: on the way left, about to turn at either end, on the way right.
@pytest.mark.parametrize("phase", [0.1, 0.3, 0.47, 0.6, 0.8, 0.97])
@pytest.mark.parametrize("speed", [0.05, 0.2, 0.35])
def test_a_parabola_is_known_exactly_after_a_few_frames(phase, speed) -> None:
    motion = parabola(speed, phase)
    times = DT * np.arange(5)
    state = follow(PARABOLA, motion.position(times))
    # Over one and a half cycles, turns included.
    for ahead in np.linspace(0.0, 1.5 * CYCLE / speed, 20):
        expected = motion.position(np.asarray(times[-1] + ahead))
        assert_allclose(PARABOLA.position_after(state, np.asarray(ahead)), expected, atol=1e-7)
    assert_allclose(PARABOLA.vertex(state), motion.vertex, atol=1e-6)


@pytest.mark.parametrize("phase", np.linspace(0.0, 0.95, 20))
@pytest.mark.parametrize("speed", [0.1, 0.35])
def test_a_parabola_stays_known_through_its_turns(phase, speed) -> None:
    motion = parabola(speed, phase)
    state = PARABOLA.reset(sight(motion.position(np.asarray(0.0))))
    state = PARABOLA.step(state, sight(motion.position(np.asarray(0.0)), elapsed=0.0))
    worst = []
    for step in range(1, 150):
        now = step * DT
        state = PARABOLA.step(state, sight(motion.position(np.asarray(now))))
        error = PARABOLA.position_after(state, np.asarray(0.3)) - motion.position(np.asarray(now + 0.3))
        worst.append(np.max(np.abs(error)))
    assert np.max(worst[2:]) < 1e-8


def test_a_target_that_stands_still_stays_where_it_is() -> None:
    path = np.tile([3.0, 0.2, 0.1], (6, 1))
    state = follow(PARABOLA, path)
    assert_allclose(PARABOLA.position_after(state, np.asarray(0.4)), path[0])
    assert_allclose(PARABOLA.vertex(state), path[0])


def test_vertex_waits_where_the_target_passes() -> None:
    predictor = Vertex(PARABOLA)
    state = follow(predictor, parabola().position(DT * np.arange(6)))
    assert_allclose(predictor.position_after(state, np.asarray(0.7)), [4.0, -0.5, 0.1], atol=1e-7)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(51)
    motion = Parabola(
        rng.uniform([2.0, -0.7, 0.0], [5.0, 0.7, 0.1], (*shape, 3)),
        *rng.uniform([[0.1], [0.0]], [[0.35], [1.0]], (2, max(1, math.prod(shape)))).reshape(2, *shape),
        *(np.full(shape, each) for each in (HALF_WIDTH, 3.0)),
    )
    noise = TrackerNoise(*(np.asarray(each) for each in (1.0, 0.002, 0.002)))
    predictors = (Hold(), ConstantVelocity(noise), PARABOLA, Vertex(PARABOLA))

    def ahead(predictors, path, time):
        return tuple(each.position_after(follow(each, path), time) for each in predictors)

    path = np.stack([motion.position(np.full(shape, DT * step)) for step in range(3)])
    # The vertex comes of quotients of squares of millimetres.
    for place in agree_in_jax(ahead, predictors, path, np.full(shape, 0.2), rtol=0, atol=2e-3):
        assert place.shape == (*shape, 3)
