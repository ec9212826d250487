import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.recursive_filter import recursion


@pytest.mark.parametrize("section", [np.array([-0.9]), np.array([-1.8, 0.9])])
@pytest.mark.parametrize("shape", [(1,), (2, 3), (400,), (400, 2)])
def test_a_recursion_is_the_filter(section, shape):
    signals = np.random.default_rng(0).standard_normal(shape)
    expected = lfilter([1.0], np.append(1.0, section), signals, axis=0)
    np.testing.assert_allclose(recursion(section, signals), expected, rtol=1e-10, atol=1e-10)


def test_nothing_stays_nothing():
    assert recursion(np.array([-0.9]), np.zeros((0, 2))).shape == (0, 2)
