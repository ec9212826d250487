import numpy as np
from scipy.optimize import least_squares

from archerfish.identification.modal_form import (
    free_numbers,
    section_poles,
    sections_from_numbers,
    sections_from_poles,
)
from archerfish.identification.pole_refinement import refine_poles
from archerfish.identification.simulation_fit import Structure, fit_linear_parameters
from archerfish.identification.state_space import plant_poles
from archerfish.records.recording import make_recording


def test_it_finds_the_true_poles_of_a_clean_recording_from_afar(white, resonant_plant, record):
    plant = resonant_plant()
    start = sections_from_poles(np.array([0.8 + 0.3j, 0.8 - 0.3j, 0.5, 0.1]))
    found = refine_poles(start, [record(plant, white[:, 0])], Structure(0, False))
    np.testing.assert_allclose(
        np.sort_complex(section_poles(found.sections)), np.sort_complex(plant_poles(plant)), atol=1e-5
    )


def test_it_reaches_the_minimum_that_scipy_finds(white, resonant_plant, record):
    recording = record(resonant_plant(), white[:, 0], noise=0.1)
    structure = Structure(0, True)
    start = sections_from_poles(np.array([0.85 + 0.25j, 0.85 - 0.25j, 0.6, 0.2]))

    def residuals(theta):
        return fit_linear_parameters(sections_from_numbers(theta), [recording], structure, with_slopes=False).residuals

    reference = least_squares(residuals, free_numbers(start), xtol=1e-12, ftol=1e-12)
    assert refine_poles(start, [recording], structure).fit.cost <= 2 * reference.cost * (1 + 1e-5)


def test_a_recording_of_an_unstable_plant_still_gives_a_stable_one(white):
    ramp = np.cumsum(np.cumsum(white[:, 0]))
    recording = make_recording(white[:, 0], ramp, 0.01)
    start = sections_from_poles(np.array([0.99, 0.9]))
    found = refine_poles(start, [recording], Structure(0, False))
    assert np.abs(section_poles(found.sections)).max() < 1
