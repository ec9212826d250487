import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from archerfish.identification.axis.modal_form import (
    coefficient_slopes,
    free_numbers,
    section_poles,
    sections_from_numbers,
    sections_from_poles,
    stabilised,
    state_matrices,
)

POLES = [
    np.array([0.9 + 0.2j, 0.9 - 0.2j, 0.7, 0.3]),
    np.array([0.999, 0.99, -0.8]),
    np.array([0.5 + 0.5j, 0.5 - 0.5j]),
    np.array([0.0]),
    np.array([0.9, -0.9, 0.4 + 0.1j, 0.4 - 0.1j, 0.2]),
]


def in_order(poles):
    return poles[np.lexsort((poles.imag.round(9), poles.real.round(9)))]


@pytest.mark.parametrize("poles", POLES)
def test_sections_numbers_and_matrices_keep_the_poles(poles):
    sections = sections_from_poles(poles.astype(complex))
    again = sections_from_numbers(free_numbers(sections))
    A, _, _ = state_matrices(sections, np.ones((poles.size, 1, 1)))
    for found in (section_poles(sections), section_poles(again), np.linalg.eigvals(A)):
        np.testing.assert_allclose(in_order(found + 0j), in_order(poles + 0j), atol=1e-7)


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=7))
def test_any_numbers_give_a_stable_plant(numbers):
    assert np.abs(section_poles(sections_from_numbers(np.array(numbers)))).max() < 1


def test_slopes_agree_with_finite_differences():
    theta = np.array([0.3, -0.7, 1.2, 0.4, -0.2])

    def coefficients(theta):
        return np.concatenate(sections_from_numbers(theta))

    numeric = np.column_stack(
        [(coefficients(theta + step) - coefficients(theta - step)) / 2e-6 for step in 1e-6 * np.eye(5)]
    )
    np.testing.assert_allclose(coefficient_slopes(theta), numeric, atol=1e-9)


@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (3, 1), (1, 3)])
def test_matrices_have_the_transfer_function_of_the_sections(inputs, outputs):
    numerators = np.random.default_rng(0).standard_normal((3, inputs, outputs))
    A, B, C = state_matrices((np.array([-1.6, 0.73]), np.array([-0.5])), numerators)
    lag = np.exp(-0.4j)
    pair, single = 1 - 1.6 * lag + 0.73 * lag**2, 1 - 0.5 * lag
    expected = (numerators[0] * lag + numerators[1] * lag**2) / pair + numerators[2] * lag / single
    np.testing.assert_allclose(C @ np.linalg.solve(np.eye(3) / lag - A, B + 0j), expected.T, rtol=1e-12)


def test_several_inputs_and_several_outputs_have_no_such_form():
    with pytest.raises(ValueError, match="one input or one output"):
        state_matrices((np.array([-0.5]),), np.ones((1, 2, 2)))


def test_poles_outside_the_circle_are_mirrored_into_it():
    poles = np.array([2.0, 0.5, 0.6 + 0.9j, 0.6 - 0.9j, 1.0], dtype=complex)
    found = stabilised(poles)
    assert np.abs(found).max() <= 0.9995
    assert found[0] == pytest.approx(0.5)
    assert found[1] == 0.5
    assert np.angle(found[2]) == pytest.approx(np.angle(poles[2]))


def test_a_pole_at_zero_stays_there():
    np.testing.assert_array_equal(stabilised(np.array([0.0, 1e-300, 1e-200j], dtype=complex)), [0.0, 1e-300, 1e-200j])
