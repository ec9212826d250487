"""Controllers with a model of the plant: their program against SciPy, their observer, their shots."""

import dataclasses
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import nnls

from archerfish2.controllers.preview import make_preview
from archerfish2.controllers.preview_aim import angle_then
from archerfish2.dynamics.command_limits import CommandLimits
from archerfish2.dynamics.linear_axis import advance, gimbal_angle, rest_state
from archerfish2.robot import Robot

PERIOD, N, MODEL = 0.02, 8, Robot.paper().gimbal(0.02)
LIMITS = CommandLimits(*(np.full(2, each) for each in (-0.35, 0.35, 8.0, 200.0, 1e6)))


def problem(seed: int, batch: tuple[int, ...] = ()) -> tuple[np.ndarray, ...]:
    """State, command, its rate, path, yaw of the base."""
    rng = np.random.default_rng(seed)
    command = rng.uniform(-0.2, 0.2, (*batch, 2))
    state = rest_state(MODEL, command) * rng.uniform(0.8, 1.2, MODEL.input.shape)
    path = rng.uniform(-0.4, 0.4, 2) + np.cumsum(rng.normal(0.0, 0.01, (*batch, N, 2)), axis=-2)
    return state, command, rng.uniform(-1.0, 1.0, (*batch, 2)), path, np.linspace(0.0, 0.1, N) + 0.0 * path[..., 0]


def by_active_set(axis: int, state, command, rate, path, base_yaw) -> np.ndarray:
    """The program by stepping the plant, as a least-distance problem that Lawson and Hanson's NNLS solves exactly."""

    def angles(begun, commands):
        states = itertools.accumulate(commands, lambda each, u: advance(MODEL, each, np.full(2, u)), initial=begun)
        return np.array([gimbal_angle(MODEL, each)[axis] for each in states])[1:]

    one, now = np.eye(N), command[axis]
    difference, response = one - np.eye(N, k=-1), np.stack([angles(0.0 * state, each) for each in one], axis=1)
    right = (path[:, axis] - angles(state, np.zeros(N))) @ response + 1e-3 * now * one[0]
    inverse = np.linalg.inv(np.linalg.cholesky(response.T @ response + 1e-3 * difference.T @ difference).T)
    optimum, rows = inverse @ inverse.T @ right, np.concatenate([one, difference, difference @ difference])
    middle = np.array([axis * base_yaw, now * one[0], (now + PERIOD * rate[axis]) * one[0] - now * one[1]])
    spans, inequality = np.array([[0.35], [8.0 * PERIOD], [200.0 * PERIOD**2]]), np.vstack([rows, -rows])
    bound = np.concatenate([(middle - spans).ravel(), (-middle - spans).ravel()]) - inequality @ optimum
    system, wanted = np.vstack([(inequality @ inverse).T, bound]), np.eye(N + 1)[-1]
    residual = system @ nnls(system, wanted)[0] - wanted
    return optimum - inverse @ residual[:-1] / residual[-1]


@pytest.mark.parametrize("seed", range(6))
def test_the_program_is_solved_within_all_its_bounds(seed) -> None:
    preview = dataclasses.replace(make_preview(MODEL, LIMITS, PERIOD, N, 1e-3), iterations=3000)
    found = preview.track(*problem(seed))
    for axis in range(2):  # the last commands hardly matter to the angles
        assert_allclose(found[:2, axis], by_active_set(axis, *problem(seed))[:2], atol=5e-4)


def test_numpy_and_jax_solve_the_program_alike(batch, agree) -> None:
    preview, arguments = make_preview(MODEL, LIMITS, PERIOD, N, 1e-3), problem(1, batch)
    assert agree(lambda preview, *each: preview.track(*each), preview, *arguments, atol=1e-4).shape == (*batch, N, 2)


def test_past_angles_are_those_of_scipys_hermite_spline(batch, agree) -> None:
    rng = np.random.default_rng(54)
    past, age = rng.normal(0.0, 0.3, (*batch, 5, 2, 2)), rng.uniform(0.0, 0.12, batch)
    found = agree(angle_then, past, age, np.asarray(PERIOD))
    for index in np.ndindex(batch):
        spline = CubicHermiteSpline(PERIOD * np.arange(-4, 1), past[index][::-1, 0], past[index][::-1, 1])
        assert_allclose(found[index], spline(-min(age[index], 4 * PERIOD)), atol=1e-6)


CASES = ["kalman static gate", "kalman-lq static gate", "imm-lq static gate", "no-lead static box",
         "parabola-lq dynamic box", "oracle static gate", "oracle dynamic gate"]  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_without_dispersion_every_late_shot_hits(shoot, case) -> None:
    name, motion, limit = case.split()
    seen, command, shot, _ = shoot(name, limit, motion)
    assert shot.margin[30:].min() > 0.0
    if name == "oracle":  # its plan keeps the limits, and nothing is cut off
        assert_allclose(seen.command[1:], command.angle[:-1], atol=5e-3)
