import numpy as np
import pytest

from archerfish.identification.modal_form import sections_from_poles, state_matrices
from archerfish.identification.simulation_fit import Structure, delayed, fit_linear_parameters
from archerfish.identification.state_space import plant_poles, simulate
from archerfish.records.plant import PlantRecord


@pytest.mark.parametrize("inputs", [1, 2])
@pytest.mark.parametrize("delay", [0, 3])
def test_the_true_poles_leave_no_residual_and_give_the_plant_back(white, inputs, delay, resonant_plant, record):
    plant = resonant_plant(delay, feedthrough=0.4, inputs=inputs)
    recordings = [
        record(plant, white[:400, :inputs], offset=2.0, initial_state=np.ones(4)),
        record(plant, white[400:, :inputs], offset=-1.0),
    ]
    sections = sections_from_poles(plant_poles(plant))
    fit = fit_linear_parameters(sections, recordings, Structure(delay, True))
    A, C = state_matrices(sections)
    again = PlantRecord(A, fit.B, C, fit.D, delay, plant.sample_period_s)
    assert np.abs(fit.residuals).max() < 1e-9
    np.testing.assert_allclose(fit.offsets, [2.0, -1.0], atol=1e-8)
    np.testing.assert_allclose(fit.D, plant.D, atol=1e-9)
    fresh = np.random.default_rng(3).standard_normal((100, inputs))
    np.testing.assert_allclose(simulate(again, fresh), simulate(plant, fresh), atol=1e-8)


def test_slopes_are_those_of_the_projected_residual_at_the_solution(white, resonant_plant, record):
    # At zero residual Kaufman's derivative is exact: −∂r/∂a equals the slopes.
    plant = resonant_plant()
    recording = record(plant, white[:, 0], initial_state=np.ones(4))
    sections = sections_from_poles(plant_poles(plant))
    fit = fit_linear_parameters(sections, [recording], Structure(0, False))
    for index in range(4):
        sides = []
        for step in (1e-6, -1e-6):
            moved = np.concatenate(sections)
            moved[index] += step
            pair = fit_linear_parameters((moved[:2], moved[2:]), [recording], Structure(0, False), with_slopes=False)
            sides.append(pair.residuals)
        np.testing.assert_allclose(fit.slopes[:, index], -(sides[0] - sides[1]) / 2e-6, atol=1e-4)


def test_equal_poles_do_not_break_the_fit(white, resonant_plant, record):
    sections = (np.array([-1.0, 0.25]), np.array([-1.0, 0.25]))
    fit = fit_linear_parameters(sections, [record(resonant_plant(), white[:, 0])], Structure(0, True))
    assert np.all(np.isfinite(fit.B))
    assert np.all(np.isfinite(fit.slopes))


def test_inputs_before_the_recording_are_taken_as_held():
    inputs = np.array([[5.0], [6.0], [7.0]])
    np.testing.assert_array_equal(delayed(inputs, 2)[:, 0], [5, 5, 5])
    np.testing.assert_array_equal(delayed(inputs, 0), inputs)
