import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.sensing.stopping_way import overshoot

BRAKING = np.array([0.01, 0.02])


def test_a_command_that_brakes_from_now_on_ends_where_expected() -> None:
    # Braking in continuous time from 0.06 rad a decision by 0.01 (pitch), from −0.06 by 0.02 (yaw): 0.18 and −0.09 rad.
    command, before = np.array([0.30, -0.40]), np.array([0.24, -0.34])
    rest = command + np.array([0.18, -0.09])
    assert_allclose(overshoot(BRAKING, rest, command, before), 0.0, atol=1e-15)
    # By hand in ten thousand small steps a decision.
    steps, rate, place = 10_000, command - before, command.copy()
    for _ in range(10 * steps):
        place += rate / steps
        rate -= np.sign(rate) * np.minimum(BRAKING / steps, np.abs(rate))
    assert_allclose(place, rest, atol=1e-4)


def test_it_is_the_way_to_the_aim_for_a_command_that_stands() -> None:
    aim, command = np.array([0.1, -0.2]), np.array([0.05, 0.1])
    assert_allclose(overshoot(BRAKING, aim, command, command), aim - command)


def test_too_much_speed_ends_beyond_the_aim_on_either_side() -> None:
    for side in (1.0, -1.0):
        rest = overshoot(BRAKING, side * np.array([0.1, 0.1]), np.zeros(2), -side * np.array([0.06, 0.08]))
        assert np.all(side * rest < 0.0)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rest = agree_in_jax(overshoot, BRAKING, *np.random.default_rng(74).uniform(-0.1, 0.1, (3, *shape, 2)))
    assert rest.shape == (*shape, 2)
