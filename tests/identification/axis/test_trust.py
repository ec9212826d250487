import numpy as np
import pytest

from archerfish.identification.axis.modal_form import free_numbers, sections_from_poles
from archerfish.identification.axis.trust import PoleTrust, pole_remarks, trusted_poles
from archerfish.identification.axis.uncertainty import Posterior

PERIOD = 1e-3


def pole(natural_hz, damping=0.1):
    return np.exp(2 * np.pi * natural_hz * PERIOD * (-damping + 1j * np.sqrt(1 - damping**2)))


def known(natural_hz, loose=1e-4, size=1.0):
    """Two pairs of poles; deviation of the free numbers, and numerators of the second with deviation 0.01."""
    place = pole(10.0)
    other = pole(natural_hz)
    sections = sections_from_poles(np.array([place, place.conj(), other, other.conj()]))
    linear = np.array([[1.0], [1.0], [size], [size]])
    spread = np.array([1e-4, 1e-4, loose, loose, 0.01, 0.01, 0.01, 0.01])
    return Posterior(free_numbers(sections), linear, np.diag(spread), 1, False, 1.0), sections


def judged(*arguments, band=(2.0, 50.0)):
    return trusted_poles(*known(*arguments), band, PERIOD)


def test_poles_in_the_band_that_matter_and_are_sharp_are_determined():
    found = judged(30.0)
    assert found.determined.all()
    assert found.held.shape == (0, 4)
    assert pole_remarks(found, PERIOD) == []


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((200.0,), "lies above the excited 2–50 Hz"),
        ((0.5,), "lies below the excited 2–50 Hz"),
        ((30.0, 1e-4, 0.001), "adds less to the output"),
        ((30.0, 1.0), "has a frequency that is uncertain by"),
    ],
)
def test_the_reason_is_said_why_a_pole_is_not_determined(arguments, reason):
    found = judged(*arguments)
    assert found.determined.sum() == 2
    # Two conjugate poles: real and imaginary parts of each, in the free numbers of the second section.
    assert found.held.shape == (4, 4)
    assert np.linalg.matrix_rank(found.held) == 2
    np.testing.assert_allclose(found.held[:, :2], 0.0, atol=1e-9)
    (remark,) = pole_remarks(found, PERIOD)
    assert reason in remark
    assert f"({arguments[0]:.3g} Hz)" in remark


@pytest.mark.parametrize("natural_hz", [70.0, 1.5])
def test_a_pole_just_outside_the_band_reaches_into_it(natural_hz):
    assert judged(natural_hz).determined.all()


def test_poles_come_slowest_first():
    found = judged(40.0)
    assert isinstance(found, PoleTrust)
    assert np.all(np.diff(np.abs(found.poles)) < 1e-9)
    assert found.poles[0].imag > 0
    np.testing.assert_allclose(found.poles[0], pole(10.0), rtol=1e-9)
