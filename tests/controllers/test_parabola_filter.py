import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.parabola_filter import STANDING, ParabolaFilter, parabola_filter, systematic_draw
from archerfish.controllers.predictors import ConstantVelocity
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.paper.conditions import assumed_conditions
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.targets.parabola import Parabola

from .sights import AGE, DT, follow, sight

HALF_WIDTH, MAX_SPEED, REACH, SCATTER = math.sqrt(0.04 / 3.0), 0.35, 0.06, 0.003
CONDITIONS = assumed_conditions()


def noise(along: float = 0.0, across: float = 0.0, acceleration: float = 1.0) -> TrackerNoise:
    """In proportion to the distance, and a millimetre beside."""
    return TrackerNoise(*(np.asarray(each) for each in (acceleration, 1e-3, 1e-3, along, across)))


def built(along: float = 0.0, across: float = 0.0, speeds: int = 48, phases: int = 160) -> ParabolaFilter:
    return parabola_filter(CONDITIONS, SCATTER, noise(along, across), speeds, phases)


def parabola(speed: Any, phase: Any, vertex: Any = (4.0, -0.5, 0.1)) -> Parabola:
    vertex, speed, phase = (np.asarray(each, float) for each in (vertex, speed, phase))
    vertex = np.broadcast_to(vertex, (*speed.shape, 3))
    return Parabola(vertex, speed, phase, np.full(speed.shape, HALF_WIDTH), np.full(speed.shape, 3.0))


def sights(motion: Parabola, count: int) -> np.ndarray:
    return np.stack([motion.position(np.asarray(DT * step - AGE) + 0.0 * motion.speed) for step in range(count)])


def test_without_noise_the_path_is_predicted_after_a_whole_cycle() -> None:
    # The grid's speeds and phases are known to it exactly; one between them is off by half a step at most.
    for speed, seen_at, tolerance in ((0.35 * 34 / 47, 33 / 160, 1e-4), (0.35 * 33.5 / 47, 33.5 / 160, 0.01)):
        cycle = 4.0 * HALF_WIDTH / speed
        motion = parabola(speed, seen_at + AGE / cycle)
        count = round(cycle / DT) + 1
        state = follow(built(), sights(motion, count))
        now = DT * (count - 1)
        for ahead in np.linspace(0.0, 0.5, 11):
            expected = motion.position(np.asarray(now + ahead))
            for predict in (built().position_after, built().mean_after):
                place = predict(state, np.asarray(ahead))
                assert_allclose(place[:2], expected[:2], atol=tolerance)
                assert place[2] == pytest.approx(expected[2], abs=1e-9)


def test_a_still_target_stays_where_it_is() -> None:
    plates = np.tile([3.0, 0.2, 0.1], (40, 1))
    state = follow(built(), plates)
    for ahead in (0.0, 0.3, 0.6):
        assert_allclose(built().position_after(state, np.asarray(ahead)), plates[0], atol=2e-3)


def test_a_sight_that_is_not_new_changes_nothing() -> None:
    plates, filter_ = sights(parabola(0.25, 0.1), 20), built(0.01, 0.002)
    state = follow(filter_, plates)
    again = filter_.step(state, sight(plates[-1], age=AGE + DT, fresh=False))
    for name in ("depth", "lateral", "evidence", "covariance", "height", "height_variance"):
        assert_allclose(getattr(again, name), getattr(state, name))
    # But time has gone on: a period later is what was predicted.
    assert_allclose(
        filter_.position_after(again, np.asarray(0.1)), filter_.position_after(state, np.asarray(0.1 + DT)), atol=1e-9
    )


def test_a_place_that_no_frame_has_shown_is_forgotten_at_the_first_sight() -> None:
    # The guess's frame comes a second earlier, which shifts the grid of phases: only many draws agree closely.
    plates, filter_ = np.tile([2.0, 2.0, 0.1], (10, 1)), built(0.015, 0.0017)._replace(draws=np.ones(8192))
    guess = sight(np.array([3.0, 0.0, 0.0]), elapsed=0.0, age=1.0, fresh=False)
    state = filter_.step(filter_.reset(guess), guess)
    for plate in plates:
        state = filter_.step(state, sight(plate))
    expected = filter_.position_after(follow(filter_, plates), np.asarray(0.2))
    assert_allclose(filter_.position_after(state, np.asarray(0.2)), expected, atol=5e-4)


def test_an_age_is_the_time_that_the_prediction_begins_earlier() -> None:
    plates, filter_ = sights(parabola(0.25, 0.1), 40), built()
    state = filter_.step(filter_.reset(sight(plates[0], age=0.0)), sight(plates[0], elapsed=0.0, age=0.0))
    for plate in plates[1:]:
        state = filter_.step(state, sight(plate, age=0.0))
    old = follow(filter_, plates)
    assert_allclose(
        filter_.position_after(old, np.asarray(0.1)), filter_.position_after(state, np.asarray(0.1 + AGE)), atol=1e-9
    )


def covariance(plate: np.ndarray, along: float, across: float) -> np.ndarray:
    level = np.hypot(plate[0], plate[1])
    turn = np.array([[plate[0], -plate[1]], [plate[1], plate[0]]]) / level
    return turn @ np.diag([1e-6 + (along * level) ** 2, 1e-6 + (across * level) ** 2]) @ turn.T


def test_the_evidence_is_that_of_every_hypothesis_by_itself() -> None:
    # The recursion against batch least squares for the middle, in float64: the likelihood of all frames, both
    # coordinates, at the best middle; how sharply that is known is the same for all. The prior adds the rest.
    along, across, steps = 0.015, 0.004, 12
    rng = np.random.default_rng(91)
    plates = sights(parabola(0.2, 0.3, (4.0, 0.3, 0.1)), steps) + rng.normal(0.0, 0.01, (steps, 3)) * [1, 1, 0]
    filter_ = built(along, across)
    state = follow(filter_, plates)
    weights = [np.linalg.inv(covariance(plate, along, across)) for plate in plates]
    information = sum(weights)
    assert_allclose(state.covariance, np.linalg.inv(information), rtol=1e-9)
    expected, prior = np.empty((48, 160)), np.log(np.array([STANDING, *[(1.0 - STANDING) / 47] * 47]))
    for row, speed in enumerate(filter_.speed):
        for column, phase in enumerate(filter_.phase):
            own = parabola(speed, phase, (0.0, 0.0, 0.0)).position(DT * np.arange(steps))
            middles = plates[:, :2] - own[:, :2]
            best = np.linalg.solve(information, sum(w @ m for w, m in zip(weights, middles, strict=True)))
            expected[row, column] = prior[row] - 0.5 * sum(
                (m - best) @ w @ (m - best) for w, m in zip(weights, middles, strict=True)
            )
            if column % 40 == 0:
                assert_allclose([state.depth[row, column], state.lateral[row, column]], best, rtol=1e-9)
    assert_allclose(state.evidence, expected - expected.max(), atol=1e-6)


def test_middles_outside_of_where_they_may_lie_are_unlikely() -> None:
    # A target seen at the side of the box can't swing about a middle further out.
    side = CONDITIONS.max_lateral_offset + 0.9 * HALF_WIDTH
    state = follow(built(), np.tile([3.0, side, 0.0], (2, 1)))
    assert np.all(np.abs(state.drawn.lateral) < CONDITIONS.max_lateral_offset + 5e-3)


def test_a_systematic_draw_takes_each_hypothesis_as_often_as_it_weighs() -> None:
    rng, count = np.random.default_rng(94), 500
    weight = rng.random((2, 3, 6, 10)) ** 4
    row, column = systematic_draw(weight, np.ones(count))
    taken = np.zeros(weight.shape)
    np.add.at(taken, (*np.ogrid[:2, :3, :1][:2], row, column), 1.0)
    share = weight / weight.sum(axis=(-2, -1), keepdims=True)
    assert np.abs(taken - count * share).max() <= 1.0 + 1e-9


def test_it_meets_more_noisy_targets_than_constant_velocity() -> None:
    # Targets that turn about once a second, ages and noise of an identified robot, predicted 0.2 s ahead at several
    # moments. Constant velocity gets the best of several process noises. The margin is beyond five standard errors of
    # a paired difference of independent targets.
    rng = np.random.default_rng(92)
    count, along, across = 120, 0.015, 0.0017
    vertices = np.stack([rng.uniform(2.0, 5.0, count), rng.uniform(-0.5, 0.5, count), np.zeros(count)], axis=-1)
    motion = parabola(rng.uniform(0.15, MAX_SPEED, count), rng.random(count), vertices)
    clean = sights(motion, 40)
    distance = np.linalg.norm(clean, axis=-1, keepdims=True)
    ahead = clean / distance
    left = np.stack([-ahead[..., 1], ahead[..., 0], 0.0 * ahead[..., 0]], axis=-1)
    draws = rng.standard_normal((2, 40, count, 1))
    plates = clean + distance * (along * draws[0] * ahead + across * draws[1] * left)
    predictors = [built(along, across)]
    predictors += [ConstantVelocity(noise(along, across, each)) for each in (0.3, 1.0, 2.0, 4.0)]
    hits = []
    for predictor in predictors:
        state, met = predictor.reset(sight(plates[0])), []
        state = predictor.step(state, sight(plates[0], elapsed=0.0))
        for step, plate in enumerate(plates[1:], 1):
            state = predictor.step(state, sight(plate))
            if step % 4 == 0 and step >= 16:
                time = np.full(count, 0.2)
                expected = motion.position(time + DT * step)
                met.append(np.abs(predictor.position_after(state, time) - expected)[:, 1] <= REACH)
        hits.append(np.mean(met, axis=0))
    best = max(range(1, 5), key=lambda index: hits[index].mean())
    gain = hits[0] - hits[best]
    assert gain.mean() > 5.0 * gain.std() / math.sqrt(count)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(93)
    motion = parabola(rng.uniform(0.1, 0.35, shape), rng.random(shape))
    plates = sights(motion, 4) + rng.normal(0.0, 0.003, (4, *shape, 3))

    def ahead(predictor, plates, time):
        state = follow(predictor, plates)
        return predictor.position_after(state, time)

    predictor, time = built(0.01, 0.002), np.full(shape, 0.2)
    # The sharp choice of the best place magnifies rounding.
    place = agree_in_jax(ahead, predictor, plates, time, rtol=0, atol=1e-3)
    assert place.shape == (*shape, 3)
    if shape:
        first = (0,) * len(shape)
        alone = ahead(predictor, plates[(slice(None), *first)], np.asarray(0.2))
        assert_allclose(map_arrays(lambda each: each[first], place), alone, atol=1e-3)
