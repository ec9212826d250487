import numpy as np
import pytest
from scipy.signal import dlsim

from archerfish.identification.axis.state_space import balanced, free_responses, plant_poles, simulate
from archerfish.records.plant import PlantRecord, dc_gain


@pytest.mark.parametrize("inputs", [1, 2])
def test_simulation_agrees_with_scipy(white, inputs, resonant_plant):
    plant = resonant_plant(feedthrough=0.3, inputs=inputs)
    state = np.array([1.0, -2.0, 0.5, 0.0])
    system = (plant.A, plant.B, plant.C, plant.D, plant.sample_period_s)
    expected = dlsim(system, white[:, :inputs], x0=state)[1]
    np.testing.assert_allclose(simulate(plant, white[:, :inputs], state), expected, atol=1e-10)


def test_a_delay_shifts_the_response(resonant_plant):
    step = np.repeat([0.0, 1.0], 30)[:, None]
    plain, late = (simulate(resonant_plant(delay), step) for delay in (0, 4))
    np.testing.assert_allclose(late[4:], plain[:-4])


def test_free_responses_are_powers_of_the_state_matrix(resonant_plant):
    plant = resonant_plant()
    expected = [plant.C @ np.linalg.matrix_power(plant.A, count) for count in range(13)]
    np.testing.assert_allclose(free_responses(plant, 13), expected, atol=1e-13)


def test_balancing_keeps_the_responses_and_equalises_the_gramians(white, resonant_plant):
    plant = resonant_plant(feedthrough=0.3, inputs=2)
    found = balanced(plant)
    np.testing.assert_allclose(simulate(found, white), simulate(plant, white), atol=1e-9)
    np.testing.assert_allclose(dc_gain(found), dc_gain(plant))
    reach = sum(
        np.linalg.matrix_power(found.A, k) @ found.B @ found.B.T @ np.linalg.matrix_power(found.A, k).T
        for k in range(400)
    )
    np.testing.assert_allclose(reach, np.diag(np.diag(reach)), atol=1e-9 * reach.max())


def test_a_plant_that_is_not_minimal_is_left_as_it_is():
    plant = PlantRecord(np.diag([0.5, 0.4]), np.array([[1.0], [0.0]]), np.ones((1, 2)), np.zeros((1, 1)), 0, 0.01)
    assert balanced(plant) is plant


def test_poles_come_slowest_first(resonant_plant):
    np.testing.assert_allclose(plant_poles(resonant_plant()), [0.9 + 0.2j, 0.9 - 0.2j, 0.7, 0.3])
