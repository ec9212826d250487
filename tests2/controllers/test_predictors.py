"""Where predictors see a target go, against the paths that it follows."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.controllers.kalman import ConstantVelocity
from archerfish2.controllers.manoeuvring import Manoeuvring
from archerfish2.controllers.parabola import make_parabola_aware, make_parabola_filter, systematic_draw
from archerfish2.controllers.preview_aim import Hold
from archerfish2.targets.motion import Parabola
from archerfish2.task import Task
from archerfish2.tracking.interacting_models import ModelRates
from archerfish2.tracking.kalman_filter import TrackerNoise, measurement_covariance

WIDTH, REACH, SCATTER, DT, AGE = np.sqrt(0.04 / 3.0), 0.06, 0.003, 0.02, 0.04
NOISE = TrackerNoise(*(np.asarray(each) for each in (1.0, 1e-3, 1e-3, 0.015, 0.0017, 0.25)))
VELOCITY = ConstantVelocity(NOISE, np.asarray(1.0))
RATES = ModelRates(*(np.asarray(each) for each in (1.5, 0.1, 0.5)))
MODELS = Manoeuvring(NOISE, RATES, np.asarray(REACH), np.asarray(SCATTER))
EXACT, FILTER = make_parabola_aware(Task.load("paper")), make_parabola_filter(Task.load("paper"), SCATTER, NOISE)
PREDICTORS = {"hold": Hold(), "velocity": VELOCITY, "models": MODELS, "exact": EXACT, "filter": FILTER}


def parabola(speed, phase, vertex=(4.0, -0.5, 0.1)) -> Parabola:
    zero = 0.0 * np.asarray(speed)
    return Parabola(vertex + 0.0 * zero[..., None], speed + zero, phase + zero, WIDTH + zero, 3.0 + zero)


def driving(count: int, speed: float) -> np.ndarray:
    """Detections of a target at 3 m that drives left through y = 0 when the last decision is made."""
    lateral = speed * (DT * (np.arange(count) - count + 1) - AGE)
    return np.stack([np.full(count, 3.0), lateral, np.full(count, 0.1)], axis=-1)


@pytest.mark.parametrize("name", PREDICTORS)
def test_numpy_and_jax_agree(name, batch, agree, follow) -> None:
    found = np.random.default_rng(93).normal(0.0, 1e-3, (4, *batch, 3))
    found = found + np.expand_dims(parabola(0.3, 0.1).position(DT * np.arange(4)), tuple(range(1, found.ndim - 1)))

    def ahead(predictor, found, time):
        relative = follow(predictor, found)
        return predictor.position_after(relative, time), predictor.mean_after(relative, time)

    # The sharp choice of the best place magnifies rounding.
    for place in agree(ahead, PREDICTORS[name], found, np.full(batch, 0.2), rtol=0, atol=2e-3):
        assert place.shape == (*batch, 3)


@pytest.mark.parametrize("name", PREDICTORS)
def test_predictions_are_against_the_own_base_wherever_it_is_and_moves(name, follow) -> None:
    predictor, found, time = PREDICTORS[name], driving(20, 0.3), np.asarray(0.2)
    own, speed = np.array([0.5, -0.2, 0.2]), np.array([0.1, 0.3, 0.0])
    here, (elsewhere, moving) = (
        follow(predictor, found),
        (follow(predictor, found + own, own=(own, v)) for v in (0.0, speed)),
    )
    for predict in (predictor.mean_after, predictor.position_after):
        assert_allclose(predict(elsewhere, time), predict(here, time), atol=1e-6)
        # At the exposure the base was elsewhere, and so was the direction of the noise.
        assert_allclose(predict(moving, time), predict(here, time) - 0.2 * speed, atol=5e-3)


@pytest.mark.parametrize("name", PREDICTORS)
def test_slots_carry_no_identity_and_a_frame_may_show_nothing(name, follow, seen) -> None:
    # A second plate beside the first, in changing slots, and then a frame without any: only time passes.
    predictor, found, two = PREDICTORS[name], driving(20, 0.3), np.full((1, 2), True)
    state = predictor.reset(seen(found[0]))
    for step, place in enumerate(np.append(found[1:], found[-1:], axis=0), 1):
        both = np.stack([place, place + 0.5])[None, :: 1 - step % 2 * 2]
        both = {"position": both, "found": two} if step < 20 else {"position": 0.0 * both, "found": ~two}
        state = predictor.step(state, seen(place)._replace(frames=seen(place).frames._replace(**both)))
    late = predictor.against_pivot(state, seen(place).base)
    for predict in (predictor.mean_after, predictor.position_after):  # the models may change meanwhile
        assert_allclose(predict(late, np.asarray(0.1)), predict(follow(predictor, found), np.asarray(0.12)), atol=3e-3)


@pytest.mark.parametrize("phase", np.linspace(0.0, 0.95, 7))
def test_a_parabola_is_predicted_exactly_from_the_third_frame_through_all_turns(phase, seen) -> None:
    motion, worst = parabola(0.35, phase), []
    state = EXACT.reset(seen(motion.position(np.asarray(0.0)), age=0.0))
    for step in range(1, 150):
        state = EXACT.step(state, seen(motion.position(np.asarray(DT * step)), age=0.0))
        later = EXACT.position_after((state, seen(motion.vertex).base), np.asarray(0.3))
        worst.append(np.abs(later - motion.position(np.asarray(DT * step + 0.3))).max())
    assert max(worst[2:]) < 1e-8


def test_the_evidence_is_that_of_every_hypothesis_by_itself(follow) -> None:
    # The recursion against batch least squares for the middle: the likelihood of all frames at the best middle.
    grid = parabola(FILTER.speed[:, None] + 0.0 * FILTER.phase, FILTER.phase, np.zeros(3))
    own = np.stack([grid.position(DT * step + 0.0 * grid.speed)[..., :2] for step in range(12)])
    found = np.random.default_rng(91).normal(0.0, 0.01, (12, 3)) + parabola(0.2, 0.3).position(DT * np.arange(12))
    state, weights = follow(FILTER, found)[0], np.linalg.inv(measurement_covariance(NOISE, found))
    off = found[:, None, None, :2] - own
    best = np.einsum("ij,tjk,tvpk->vpi", np.linalg.inv(weights.sum(0)), weights, off)
    expected = FILTER.log_prior[:, None] - 0.5 * np.einsum("tvpi,tij,tvpj->vp", off - best, weights, off - best)
    assert_allclose(state.evidence, expected - expected.max(), atol=1e-6)
    assert_allclose(np.stack([state.depth, state.lateral], axis=-1), best, rtol=1e-8)
    weight, taken = np.exp(expected - expected.max()), np.zeros((48, 160))
    np.add.at(taken, systematic_draw(weight, 500), 1.0)
    assert np.abs(taken - 500 * weight / weight.sum()).max() <= 1.0 + 1e-9


def test_no_aim_hits_noticeably_more_of_targets_that_turn_at_random(follow) -> None:
    # 20,000 targets that turn back at 1.5 per second, counted at every aim.
    rng, time = np.random.default_rng(6), 0.25 + AGE
    first = rng.exponential(1.0 / 1.5, 20_000)
    second = first + rng.exponential(1.0 / 1.5, 20_000)
    driven = np.minimum(time, first) - np.clip(time, first, second) + first + np.maximum(time - second, 0.0)
    lateral = 0.35 * (driven - AGE) + 3.0 * SCATTER * rng.standard_normal(20_000)
    aim = MODELS.position_after(follow(MODELS, driving(40, 0.35)), np.asarray(0.25))[1]
    rates = [np.mean(np.abs(lateral - each) <= REACH) for each in (aim, *np.linspace(-0.1, 0.15, 101))]
    assert rates[0] > max(rates) - 0.03
