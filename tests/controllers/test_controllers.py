"""Controllers: filters against textbooks, what predictors see ahead, the program that keeps the limits, names."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.stats import multivariate_normal, norm

from archerfish.arrays import leaves, map_arrays
from archerfish.controllers.aiming.preview_program import make_preview
from archerfish.controllers.predictors import constant_velocity, hold, parabola
from archerfish.controllers.predictors import interacting_models as interacting
from archerfish.controllers.registry import NAMES, make_controller
from archerfish.controllers.tuning import tuning_at
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.linear_axis import advance, angle_then, gimbal_angle, rest_state
from archerfish.protocols import Barrel, Base, Frames, GimbalFeedback, Seen, Truth
from archerfish.robot import Robot
from archerfish.targets.motion import Parabola
from archerfish.task import Task
from archerfish.tracking import interacting_models, kalman_filter
from archerfish.tracking.detections import unwrapped
from archerfish.tracking.parabola_filter import parabola_rule

WIDTH, SCATTER, DT, AGE = np.sqrt(0.04 / 3.0), 0.003, 0.02, 0.04
NOISE = kalman_filter.TrackerNoise(*map(np.asarray, (1.0, 1e-3, 1e-3, 0.015, 0.0017, 0.25)))
RATES = interacting_models.ModelRates(*map(np.asarray, (1.5, 0.1, 0.5)))
TASK, ROBOT = Task.load("dynamic"), Robot.paper()
MODELS = interacting.InteractingModels(NOISE, RATES, np.asarray(0.06), np.asarray(SCATTER))
EXACT = parabola.make_parabola_aware(TASK)
FILTER = parabola.ParabolaFilter(parabola_rule(TASK), NOISE, np.asarray(0.06), np.asarray(SCATTER))
PREDICTORS = {"hold": hold.Hold(), "velocity": constant_velocity.ConstantVelocity(NOISE, np.asarray(1.0))}
PREDICTORS |= {"models": MODELS, "exact": EXACT, "filter": FILTER}
N, MODEL = 8, ROBOT.gimbal(DT)
LIMITS = CommandLimits(*(np.full(2, each) for each in (-0.35, 0.35, 8.0, 200.0, 1e6)))
STEPS = np.arange(40)[:, None]
# A target that drives left at 0.4 m/s and turns back at a step, seen with noise.
TURNING = np.random.default_rng(41).normal([3.0, -0.2, 0.1] + [0.0, 0.008, 0.0] * np.minimum(STEPS, 50 - STEPS), 0.004)


def seen(place, elapsed=0.02, age=0.04, own=(0.0, 0.0)):
    """What is seen of a plate, B + (3,), by a resting gimbal whose base is at a place and moves at a velocity."""
    zero, pair, here = 0.0 * place[..., 0], 0.0 * place[..., :2], place[..., :1] == place[..., :1]
    frames = Frames(here, zero[..., None] + age, here[..., None], place[..., None, None, :], zero[..., None, None])
    base, barrel = Base(*(0.0 * place + each for each in own), zero, zero), Barrel(zero, zero)
    return Seen(zero + elapsed, GimbalFeedback(pair, pair, zero), pair, frames, base, barrel)


def follow(predictor, places, **facts):
    """Return a predictor's estimate against the own pivot after places, (T,) + B + (3,), seen alike."""
    state = predictor.step(predictor.reset(seen(places[0], **facts)), seen(places[0], elapsed=0.0, **facts))
    for place in places[1:]:
        state = predictor.step(state, seen(place, **facts))
    return predictor.against_pivot(state, seen(places[-1], **facts).base)


def tracked(places):
    """Return the track of the plain filter after places."""
    track = kalman_filter.begin_track(NOISE, places[0])
    for place in places[1:]:
        track = kalman_filter.update(NOISE, kalman_filter.predict(NOISE, track, DT), place, np.asarray(True))
    return track


def eq_7(speed, phase, vertex=(4.0, -0.5, 0.1)):
    zero = 0.0 * np.asarray(speed)
    return Parabola(vertex + 0.0 * zero[..., None], speed + zero, phase + zero, WIDTH + zero, 3.0 + zero)


def driving(count, speed):
    """Detections of a target at 3 m that drives left through y = 0 when the last decision is made."""
    lateral = speed * (DT * (np.arange(count) - count + 1) - AGE)
    return np.stack([np.full(count, 3.0), lateral, np.full(count, 0.1)], axis=-1)


def test_a_height_has_the_noise_of_the_camera_s_elevation():
    record = Robot.load(Path(__file__).parents[1] / "infantry").sensing
    record = record.replace(camera=record.camera.replace(elevation_sd=0.01))
    track = kalman_filter.begin_track(kalman_filter.noise_from_record(record, 1.0, 0.0), np.array([3.0, 4.0, 0.1]))
    assert track.height_variance == pytest.approx(1e-6 + 0.05**2)


def test_the_filter_is_that_of_any_textbook():
    step, push = np.eye(4) + DT * np.eye(4, k=2), np.vstack([DT**2 / 2 * np.eye(2), DT * np.eye(2)])
    angle, level = np.arctan2(*TURNING[:, 1::-1].T), np.hypot(*TURNING[:, :2].T)
    turn = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    variance = np.array([1e-6 + (0.015 * level) ** 2, 1e-6 + (0.0017 * level) ** 2]).T
    measured = turn * variance[:, None, :] @ turn.mT
    mean, covariance = np.append(TURNING[0, :2], [0.0, 0.0]), 0.25**2 * np.eye(4)
    covariance[:2, :2] = measured[0]
    for index in range(1, 40):
        mean, covariance = step @ mean, step @ covariance @ step.T + push @ push.T
        spread, place = covariance[:2, :2] + measured[index], TURNING[index]
        density = multivariate_normal(mean[:2], spread).logpdf(place[:2]) + np.log(2.0 * np.pi)
        before = kalman_filter.predict(NOISE, tracked(TURNING[:index]), DT)
        assert_allclose(kalman_filter.log_likelihood(NOISE, before, place), density, rtol=1e-7)
        axes = turn[index].T[::-1]  # left, outward
        off, variance = axes @ (place[:2] - mean[:2]), np.diag(axes @ spread @ axes.T)
        found = kalman_filter.innovation_by_axis(NOISE, before, place)
        assert_allclose(found, (off, variance), rtol=1e-6, atol=1e-9)
        density = norm(scale=variance[0] ** 0.5).logpdf(off[0]) + 0.5 * np.log(2.0 * np.pi)
        assert_allclose(kalman_filter.log_likelihood_across(NOISE, before, place), density, rtol=1e-6)
        gain = covariance[:, :2] @ np.linalg.inv(spread)
        mean, covariance = mean + gain @ (place[:2] - mean[:2]), covariance - gain @ covariance[:2]
    assert_allclose(tracked(TURNING).mean, mean, rtol=1e-8, atol=1e-11)
    assert_allclose(tracked(TURNING).covariance, covariance, rtol=1e-7, atol=1e-13)


def test_a_detection_straight_above_the_pivot_leaves_no_nan():
    above = np.array([0.0, 0.0, 1.0])
    track = kalman_filter.predict(NOISE, kalman_filter.begin_track(NOISE, above), DT)
    assert np.isfinite(kalman_filter.log_likelihood_across(NOISE, track, above))
    assert np.all(np.isfinite(kalman_filter.innovation_by_axis(NOISE, track, above)))
    assert np.all(np.isfinite(kalman_filter.update(NOISE, track, above, np.asarray(True)).covariance))


def test_models_that_never_change_are_the_plain_filter_and_changes_a_markov_process():
    never, step = interacting_models.ModelRates(*[np.asarray(0.0)] * 3), np.asarray(DT)
    tracks = interacting_models.begin_models(NOISE, never, TURNING[0])
    for place in TURNING[1:]:
        tracks = interacting_models.step_models(NOISE, never, tracks, step, place, np.asarray(True))
    assert_allclose(tracks.probability, [0.0, 1.0, 0.0], atol=1e-12)
    assert_allclose(tracks.track.mean[interacting_models.ONWARD], tracked(TURNING).mean, rtol=1e-12)
    turns = 1.5 * np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 1.0, -1.0]])
    found = interacting_models.transition_probabilities(RATES._replace(stop=np.asarray(0.0)), np.asarray(0.3))
    assert_allclose(found, expm(0.3 * turns), atol=1e-12)


def test_yaw_goes_on_beyond_half_a_turn():
    assert_allclose(unwrapped(np.array([3.0, -3.0]), np.array([-3.0, 9.4])), [3.0, 4.0 * np.pi - 3.0])


@pytest.mark.parametrize("name", PREDICTORS)
def test_numpy_and_jax_predict_alike(name, batch, agree):
    found = eq_7(0.3, 0.1).position(DT * np.arange(4)).reshape(4, *(1 for _ in batch), 3)
    found = found + np.random.default_rng(93).normal(0.0, 1e-3, (4, *batch, 3))

    def ahead(predictor, found, time):
        relative = follow(predictor, found)
        return predictor.position_after(relative, time), predictor.mean_after(relative, time)

    # The sharp choice of the best place magnifies rounding.
    places = agree(ahead, PREDICTORS[name], found, np.full(batch, 0.2), rtol=0, atol=2e-3)
    assert [each.shape for each in places] == [(*batch, 3)] * 2


@pytest.mark.parametrize("name", PREDICTORS)
def test_predictions_are_against_the_own_base_wherever_it_is_and_moves(name):
    predictor, found, time = PREDICTORS[name], driving(20, 0.3), np.asarray(0.2)
    own, speed = np.array([0.5, -0.2, 0.2]), np.array([0.1, 0.3, 0.0])
    here, *others = (follow(predictor, found + at, own=(at, v)) for at, v in ((0.0, 0.0), (own, 0.0), (own, speed)))
    for predict in (predictor.mean_after, predictor.position_after):
        assert_allclose(predict(others[0], time), predict(here, time), atol=1e-6)
        # At the exposure the base was elsewhere, and so was the direction of the noise.
        assert_allclose(predict(others[1], time), predict(here, time) - 0.2 * speed, atol=5e-3)


@pytest.mark.parametrize("name", PREDICTORS)
def test_slots_carry_no_identity_and_a_frame_may_show_nothing(name):
    # A second plate beside the first, in changing slots, and then a frame without any: only time passes.
    predictor, found = PREDICTORS[name], driving(20, 0.3)
    state = predictor.reset(seen(found[0]))
    for step, place in enumerate([*found[1:], found[-1]], 1):
        slots = np.stack([place, place + 0.5])[None, :: 1 - step % 2 * 2] * (step < 20)
        frames = seen(place).frames._replace(position=slots, found=np.full((1, 2), step < 20))
        state = predictor.step(state, seen(place)._replace(frames=frames))
    late = predictor.against_pivot(state, seen(place).base)
    for predict in (predictor.mean_after, predictor.position_after):  # the models may change meanwhile
        assert_allclose(predict(late, np.asarray(0.1)), predict(follow(predictor, found), np.asarray(0.12)), atol=3e-3)


@pytest.mark.parametrize("phase", np.linspace(0.0, 0.95, 7))
def test_a_parabola_is_predicted_exactly_from_the_third_frame_through_all_turns(phase):
    motion, worst = eq_7(0.35, phase), []
    state = EXACT.reset(seen(motion.position(np.asarray(0.0)), age=0.0))
    for step in range(1, 150):
        state = EXACT.step(state, seen(motion.position(np.asarray(DT * step)), age=0.0))
        later = EXACT.position_after((state, seen(motion.vertex).base), np.asarray(0.3))
        worst.append(np.abs(later - motion.position(np.asarray(DT * step + 0.3))).max())
    assert max(worst[2:]) < 1e-8


def problem(seed, batch=()):
    """State, command, its rate, path, yaw of the base."""
    rng = np.random.default_rng(seed)
    command = rng.uniform(-0.2, 0.2, (*batch, 2))
    state = rest_state(MODEL, command) * rng.uniform(0.8, 1.2, MODEL.input.shape)
    path = rng.uniform(-0.4, 0.4, 2) + np.cumsum(rng.normal(0.0, 0.01, (*batch, N, 2)), axis=-2)
    return state, command, rng.uniform(-1.0, 1.0, (*batch, 2)), path, np.linspace(0.0, 0.1, N) + 0.0 * path[..., 0]


def by_sequential_programming(axis, state, command, rate, path, base_yaw):
    """The program by stepping the plant, with SciPy's solver."""

    def angles(commands):
        states = itertools.accumulate(commands, lambda each, u: advance(MODEL, each, np.full(2, u)), initial=state)
        return np.array([gimbal_angle(MODEL, each)[axis] for each in states])[1:]

    def room(commands):
        steps = np.diff([now - DT * rate[axis], now, *commands])
        used = (commands - axis * base_yaw) / 0.35, steps[1:] / (8.0 * DT), np.diff(steps) / (200.0 * DT**2)
        return np.concatenate([1.0 - np.concatenate(used), 1.0 + np.concatenate(used)])

    now, options = command[axis], {"ftol": 1e-13, "maxiter": 500}
    cost = lambda u: 1e3 * np.sum((angles(u) - path[:, axis]) ** 2) + np.sum(np.diff([now, *u]) ** 2)  # noqa: E731
    bounds = {"type": "ineq", "fun": room}
    return minimize(cost, np.full(N, now), method="SLSQP", constraints=bounds, options=options).x


@pytest.mark.parametrize("seed", range(6))
def test_the_program_is_solved_within_all_its_bounds(seed):
    preview = dataclasses.replace(make_preview(MODEL, LIMITS, DT, N, 1e-3), iterations=3000)
    found = preview.track(*problem(seed))
    for axis in range(2):  # the last commands hardly matter to the angles
        assert_allclose(found[:2, axis], by_sequential_programming(axis, *problem(seed))[:2], atol=5e-4)


def test_numpy_and_jax_solve_the_program_alike(batch, agree):
    preview, arguments = make_preview(MODEL, LIMITS, DT, N, 1e-3), problem(1, batch)
    assert agree(lambda preview, *each: preview.track(*each), preview, *arguments, atol=1e-4).shape == (*batch, N, 2)


def test_past_angles_are_those_of_scipys_hermite_spline(batch, agree):
    rng = np.random.default_rng(54)
    past, age = rng.normal(0.0, 0.3, (*batch, 5, 2, 2)), rng.uniform(0.0, 0.12, batch)
    found = agree(angle_then, past, age, np.asarray(DT))
    for index in np.ndindex(batch):
        spline = CubicHermiteSpline(DT * np.arange(-4, 1), past[index][::-1, 0], past[index][::-1, 1])
        assert_allclose(found[index], spline(-min(age[index], 4 * DT)), atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_one_robot_decides_as_a_batch_does_in_float32(name):
    def decide(target, members):
        truth, commands = Truth(target, ROBOT.gimbal(0.02), ROBOT.muzzle_model()), []
        moments = [seen(target.at(np.full(members, time)).position[..., 0, :]) for time in np.arange(0.0, 0.1, 0.02)]
        state = controller.reset(moments[0], truth)
        for moment in moments:
            state, command = controller.step(state, moment)
            commands.append(command.angle)
        return np.array(commands)

    scenario, controller = TASK.scenario(), make_controller(name, ROBOT, TASK)
    target = scenario.draw(np.random.default_rng(21).random((4, scenario.uniforms))).target
    assert_allclose(decide(map_arrays(lambda each: each[1], target), ()), decide(target, (4,))[:, 1], atol=2e-4)
    assert {each.dtype.str for each in leaves(controller) if each.dtype.kind == "f"} == {"<f4"}


def test_what_cannot_be_built_is_refused(refused):
    refused("one length", make_controller, "oracle", ROBOT, TASK.replace(lengths_s=(1.0, 3.0)))
    refused("is a ndarray, expected reset", make_controller, np.zeros(3), ROBOT, TASK)
    refused("smoothing: expected float >= 1e-100, got -1.0", tuning_at("kalman-lq").replace, smoothing=-1.0)
