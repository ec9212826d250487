import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from archerfish.identification.axis.pole_pairing import nearest_poles


@pytest.mark.parametrize("order", [1, 2, 3, 5, 8])
def test_poles_are_paired_with_the_least_sum_of_distances(order):
    rng = np.random.default_rng(order)
    for _ in range(50):
        real, imaginary = rng.standard_normal((2, 2, order))
        poles, others = real + 1j * imaginary
        expected = linear_sum_assignment(np.abs(poles[:, None] - others))[1]
        np.testing.assert_array_equal(nearest_poles(poles, others), expected)


def test_two_poles_with_the_same_nearest_one_share_out_what_there_is():
    poles, others = np.array([0.9 + 0.1j, 0.9 - 0.1j]), np.array([0.9 + 0.01j, 0.1 + 0j])
    assert nearest_poles(poles, others).tolist() == [0, 1]
