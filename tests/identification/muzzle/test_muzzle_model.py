import numpy as np
import pytest

from archerfish.identification.muzzle.landing import landing_distance
from archerfish.identification.muzzle.model import MuzzleProblem, response
from archerfish.records.shots import Shots

VALUES = {"speed": 18.0, "pitch_offset": 0.01, "height": 0.4, "drag": 0.019}


def test_mean_and_spread_agree_with_random_shots():
    # A wide dispersion, so that the second order of the mean shows: 0.012 m against a standard error of 0.002 m.
    problem = MuzzleProblem(Shots(np.array([0.1]), np.zeros(1), np.ones(1)), {})
    answer, variances = response(problem, VALUES), np.array([0.8, 0.025]) ** 2
    draws = np.random.default_rng(1).standard_normal((2, 300_000))
    many = landing_distance(18.0 + 0.8 * draws[0], 0.11 + 0.025 * draws[1], 0.4, 0.019)
    assert abs(answer.shift(variances)[0]) > 0.01
    assert answer.mean[0] + answer.shift(variances)[0] == pytest.approx(many.mean(), abs=0.006)
    assert answer.sd(variances)[0] == pytest.approx(many.std(), rel=0.02)


def test_without_drag_the_height_on_a_plane_is_the_parabola():
    shots = Shots(np.array([0.0, 0.1]), np.zeros(2), np.array([3.0, 5.0]), hit_height=np.zeros(2))
    answer = response(MuzzleProblem(shots, {"height": 0.0}), VALUES | {"drag": 0.0})
    slope = np.array([0.01, 0.11])
    time = shots.distance / (18.0 * np.cos(slope))
    np.testing.assert_allclose(answer.mean, shots.distance * np.tan(slope) - 0.5 * 9.81 * time**2, rtol=1e-9)


def test_derivatives_are_those_of_the_parabola():
    shots = Shots(np.array([0.0]), np.zeros(1), np.array([4.0]), hit_height=np.zeros(1))
    problem = MuzzleProblem(shots, {"height": 0.0, "drag": 0.0})
    answer = response(problem, VALUES | {"drag": 0.0, "pitch_offset": 0.0})
    drop = 0.5 * 9.81 * (4 / 18) ** 2
    # z = D tan δ − g D² / (2 v² cos² δ): by log v twice the drop, by δ the distance.
    np.testing.assert_allclose(answer.design, [[2 * drop, 4.0]], rtol=1e-5)
    np.testing.assert_allclose(answer.scales[:, 0], [(2 * drop / 18) ** 2, 16.0], rtol=1e-5)
    np.testing.assert_allclose(answer.curvatures[0], [-6 * drop / 18**2], rtol=1e-4)


def test_measured_speeds_take_the_place_of_the_mean():
    speed = np.array([16.0, 20.0])
    problem = MuzzleProblem(Shots(np.zeros(2), np.zeros(2), np.ones(2), speed), {"speed": 18.0, "drag": 0.019})
    answer = response(problem, VALUES)
    np.testing.assert_allclose(answer.mean, landing_distance(speed, np.full(2, 0.01), 0.4, 0.019))
    assert problem.free == ("pitch_offset", "height")
    assert answer.scales.shape == (1, 2)
