import numpy as np
from numpy.testing import assert_allclose

from archerfish.dynamics.muzzle import direction
from archerfish.paper.frame import angles_from_paper, position_from_paper


def test_yaw_turns_round_and_pitch_stays() -> None:
    assert_allclose(angles_from_paper(10.0, 30.0), np.deg2rad([10.0, -30.0]))
    assert angles_from_paper(np.zeros((2, 3)), np.zeros((2, 3))).shape == (2, 3, 2)


def test_a_direction_is_the_same_by_angles_and_by_position() -> None:
    rng = np.random.default_rng(0)
    alpha, beta = rng.uniform(-80.0, 80.0, (2, 5))
    up, right = np.deg2rad(alpha), np.deg2rad(beta)
    # Eq (6) with the disturbance angles as the only ones, in the paper's frame.
    printed = np.stack([np.cos(up) * np.cos(right), np.cos(up) * np.sin(right), np.sin(up)], axis=-1)
    assert_allclose(position_from_paper(printed), direction(angles_from_paper(alpha, beta)), atol=1e-15)


def test_the_two_frames_have_opposite_handedness() -> None:
    assert np.linalg.det(position_from_paper(np.eye(3))) == -1.0
