import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.muzzle import Muzzle, direction, muzzle_from_record, pellet_at_muzzle
from archerfish.records.muzzle import MuzzleRecord

RECORD = MuzzleRecord(
    speed=18.0,
    speed_sd=0.2,
    pitch_offset=0.01,
    pitch_sd=0.004,
    yaw_offset=-0.02,
    yaw_sd=0.003,
    drag=0.019,
    length=0.15,
)
MUZZLE = muzzle_from_record(RECORD)


def test_the_record_gives_the_parameters() -> None:
    assert (MUZZLE.speed, MUZZLE.speed_sd, MUZZLE.drag, MUZZLE.length) == (18.0, 0.2, 0.019, 0.15)
    assert_allclose(MUZZLE.offset, [0.01, -0.02])
    assert_allclose(MUZZLE.sd, [0.004, 0.003])


@pytest.mark.parametrize(
    ("pitch_deg", "yaw_deg", "expected"),
    [
        (0, 0, [1, 0, 0]),
        (0, 90, [0, 1, 0]),
        (90, 0, [0, 0, 1]),
        (0, -90, [0, -1, 0]),
        (30, 0, [math.sqrt(0.75), 0, 0.5]),
    ],
)
def test_directions_are_forward_left_and_up(pitch_deg, yaw_deg, expected) -> None:
    assert_allclose(direction(np.radians([pitch_deg, yaw_deg])), expected, atol=1e-15)


def test_mean_pellet_leaves_at_the_gimbals_angles_plus_the_offsets() -> None:
    angle = np.array([0.1, 0.4])
    position, velocity = pellet_at_muzzle(MUZZLE, angle, np.zeros(2), np.zeros(3))
    assert_allclose(velocity, 18.0 * direction(np.array([0.11, 0.38])))
    assert_allclose(position, 0.15 * direction(angle))


def test_dispersion_has_the_moments_of_eq_6() -> None:
    # A false alarm needs a deviation of five standard errors: once in about 300,000 seeds for the six moments.
    count = 100_000
    draws = np.random.default_rng(11).standard_normal((count, 3))
    angle = np.array([-0.2, 0.5])
    _, velocity = pellet_at_muzzle(
        MUZZLE._replace(length=np.asarray(0.0)), np.tile(angle, (count, 1)), 0.0 * draws[:, :2], draws
    )
    speed = np.linalg.norm(velocity, axis=1)
    pitch, yaw = np.arcsin(velocity[:, 2] / speed), np.arctan2(velocity[:, 1], velocity[:, 0])
    for sample, mean, sd in ((speed, 18.0, 0.2), (pitch, -0.2 + 0.01, 0.004), (yaw, 0.5 - 0.02, 0.003)):
        assert sample.mean() == pytest.approx(mean, abs=5 * sd / math.sqrt(count))
        assert sample.std() == pytest.approx(sd, abs=5 * sd / math.sqrt(2 * count))


@pytest.mark.parametrize("rate", [(1.3, 0.0), (0.0, -2.0), (3.0, 5.0)])
def test_a_turning_gimbal_adds_the_muzzles_own_velocity(rate) -> None:
    angle, step = np.array([0.15, -0.6]), 1e-6
    (before, _), (_, velocity), (after, _) = (
        pellet_at_muzzle(MUZZLE, angle + shift * np.array(rate), np.array(rate), np.zeros(3))
        for shift in (-step, 0, step)
    )
    _, at_rest = pellet_at_muzzle(MUZZLE, angle, np.zeros(2), np.zeros(3))
    assert_allclose(velocity - at_rest, (after - before) / (2 * step), atol=1e-8)


def test_the_muzzles_own_velocity_is_omega_cross_r() -> None:
    angle, (pitch_rate, yaw_rate) = np.array([0.15, -0.6]), (3.0, 5.0)
    position, velocity = pellet_at_muzzle(MUZZLE, angle, np.array([pitch_rate, yaw_rate]), np.zeros(3))
    _, at_rest = pellet_at_muzzle(MUZZLE, angle, np.zeros(2), np.zeros(3))
    # Yaw turns about z; muzzle up is a turn about the axis to the right, −y, that yaw carries along.
    right = np.array([math.sin(angle[1]), -math.cos(angle[1]), 0.0])
    omega = np.array([0.0, 0.0, yaw_rate]) + pitch_rate * right
    assert_allclose(velocity - at_rest, np.cross(omega, position), atol=1e-12)


@pytest.mark.parametrize("per_pellet", [False, True])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, per_pellet, agree_in_jax) -> None:
    muzzle = MUZZLE
    if per_pellet:
        muzzle = Muzzle(*(np.broadcast_to(each, (*shape, *each.shape)) for each in MUZZLE))
    rng = np.random.default_rng(8)
    angle, rate = rng.uniform(-0.5, 0.5, (2, *shape, 2))
    position, velocity = agree_in_jax(pellet_at_muzzle, muzzle, angle, rate, rng.standard_normal((*shape, 3)))
    assert position.shape == velocity.shape == (*shape, 3)
