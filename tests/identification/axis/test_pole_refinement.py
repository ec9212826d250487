import numpy as np
import pytest
from scipy.optimize import least_squares

from archerfish.identification.axis.modal_form import (
    free_numbers,
    section_poles,
    sections_from_numbers,
    sections_from_poles,
)
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_all, refine_poles
from archerfish.identification.axis.simulation_fit import Penalty, fit_linear_parameters
from archerfish.identification.axis.spectra import spectrum
from archerfish.identification.axis.state_space import plant_poles
from archerfish.records.recording import make_recording

NEAR = np.array([0.85 + 0.25j, 0.85 - 0.25j, 0.6, 0.2])


@pytest.fixture
def noisy(white, resonant_plant, record):
    return Problem([spectrum(record(resonant_plant(), white[:, 0], noise=0.1), 0)], True)


def test_it_finds_the_true_poles_of_a_clean_recording_from_afar(white, resonant_plant, record):
    plant = resonant_plant()
    start = sections_from_poles(np.array([0.8 + 0.3j, 0.8 - 0.3j, 0.5, 0.1]))
    found = refine_poles(start, Problem([spectrum(record(plant, white[:, 0]), 0)], False))
    np.testing.assert_allclose(
        np.sort_complex(section_poles(found.sections)), np.sort_complex(plant_poles(plant)), atol=1e-5
    )


@pytest.mark.parametrize("pull", [None, 0.5])
def test_it_reaches_the_minimum_that_scipy_finds(noisy, pull):
    if pull is not None:
        rows = (np.array([[3.0, 0.0]]),)
        noisy = noisy._replace(penalty=Penalty(np.ones(1, complex), rows, (np.ones((1, 1)),), pull))
    start = sections_from_poles(NEAR)

    def residuals(theta):
        fit = fit_linear_parameters(sections_from_numbers(theta), *noisy, with_slopes=False)
        return np.append(fit.residuals, np.sqrt(pull or 0.0) * theta)

    reference = least_squares(residuals, free_numbers(start), xtol=1e-12, ftol=1e-12)
    assert refine_poles(start, noisy, Effort(1e-6)).cost <= 2 * reference.cost * (1 + 1e-6)


def test_more_effort_never_costs_more(noisy):
    start = sections_from_poles(NEAR)
    costs = [refine_poles(start, noisy, Effort(1e-6, steps)).cost for steps in range(6)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_the_best_of_several_starts_comes_first(noisy):
    starts = [sections_from_poles(poles) for poles in (np.array([0.1, 0.2, 0.3, 0.4]), NEAR)]
    found = refine_all(starts, noisy, Effort(1.0, 2))
    assert found[0].cost <= found[1].cost
    assert found[0].cost == pytest.approx(refine_poles(starts[1], noisy, Effort(1.0, 2)).cost)


def test_a_recording_of_an_unstable_plant_still_gives_a_stable_one(white):
    ramp = np.cumsum(np.cumsum(white[:, 0]))
    problem = Problem([spectrum(make_recording(white[:, 0], ramp, 0.01), 0)], False)
    found = refine_poles(sections_from_poles(np.array([0.99, 0.9])), problem)
    assert np.abs(section_poles(found.sections)).max() < 1
