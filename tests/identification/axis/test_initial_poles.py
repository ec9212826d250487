import numpy as np
import pytest

from archerfish.identification.axis.initial_poles import (
    fit_arx,
    impulse_response,
    initial_poles,
    realised_poles,
    subspace_poles,
)
from archerfish.identification.axis.lag_factor import factor_lags
from archerfish.identification.axis.state_space import plant_poles, simulate
from archerfish.records.recording import make_recording


def assert_poles(found, plant, atol=1e-7):
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(plant_poles(plant)), atol=atol)


@pytest.mark.parametrize("inputs", [1, 2])
def test_a_noise_free_recording_gives_the_poles_of_an_arx_model_exactly(white, inputs, resonant_plant, record):
    plant = resonant_plant(inputs=inputs)
    factor = factor_lags([record(plant, white[:, :inputs], offset=3.0)], 4)
    assert_poles(np.roots(fit_arx(factor, 4).a), plant, 1e-8)


@pytest.mark.parametrize("inputs", [1, 2])
@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("horizon", [10, 20])
def test_a_noise_free_recording_gives_the_poles_by_subspace_exactly(
    white, inputs, delay, horizon, resonant_plant, record
):
    plant = resonant_plant(delay, feedthrough=0.3, inputs=inputs)
    factor = factor_lags([record(plant, white[:, :inputs], offset=3.0)], 4)
    assert_poles(subspace_poles(factor, 4, horizon, delay), plant)


def test_outputs_that_share_their_poles_give_them_together(white, resonant_plant):
    # Each output misses one mode, so that no one of them has all poles.
    plant = resonant_plant()
    states = np.empty((600, 4))
    state = np.zeros(4)
    for index, push in enumerate(white[:, 0]):
        states[index], state = state, plant.A @ state + plant.B[:, 0] * push
    _, vectors = np.linalg.eig(plant.A)
    modes = states @ np.linalg.inv(vectors).T
    outputs = np.column_stack([modes[:, 0].real + modes[:, 2].real, modes[:, 1].real + modes[:, 3].real])
    recording = make_recording(white[:, 0], outputs, 0.01, output_names=("angle", "rate"))
    factor = factor_lags([recording], 4)
    assert_poles(subspace_poles(factor, 4, 10, 0), plant)


def test_the_impulse_response_is_the_simulated_one(white, resonant_plant, record):
    plant = resonant_plant(inputs=2)
    model = fit_arx(factor_lags([record(plant, white)], 4), 4)
    for channel in range(2):
        impulse = np.zeros((30, 2))
        impulse[0, channel] = 1.0
        np.testing.assert_allclose(impulse_response(model, 30)[:, channel], simulate(plant, impulse)[:, 0], atol=1e-8)


def test_recordings_are_experiments_of_their_own(white, resonant_plant, record):
    plant = resonant_plant()
    factor = factor_lags(
        [
            record(plant, white[:300, 0], offset=1.0, initial_state=np.ones(4)),
            record(plant, white[300:, 0], offset=-5.0, initial_state=-np.ones(4)),
        ],
        4,
    )
    assert_poles(np.roots(fit_arx(factor, 4).a), plant, 1e-8)
    assert_poles(subspace_poles(factor, 4, 10, 0), plant)


def test_the_model_of_one_output_knows_nothing_of_the_other(white, resonant_plant, record):
    plant = resonant_plant()
    alone = record(plant, white[:, 0])
    both = make_recording(alone.inputs, np.hstack([white[:, 1:], alone.outputs]), 0.01, output_names=("other", "angle"))
    assert_poles(np.roots(fit_arx(factor_lags([both], 4), 4, output=1).a), plant, 1e-8)


def test_an_impulse_response_is_realised_with_its_poles(resonant_plant):
    plant = resonant_plant()
    response = np.array([(plant.C @ np.linalg.matrix_power(plant.A, k) @ plant.B)[0] for k in range(60)])
    assert_poles(realised_poles(response, 4), plant)


@pytest.mark.parametrize("order", [1, 2, 4, 8])
def test_guesses_come_for_every_delay_and_have_the_order(white, order, resonant_plant, record):
    guesses = list(
        initial_poles(factor_lags([record(resonant_plant(2), white[:, 0], noise=0.1)], order), order, (0, 2, 8))
    )
    assert {delay for delay, _ in guesses} == {0, 2, 8}
    for _, poles in guesses:
        assert poles.shape == (order,)
        np.testing.assert_allclose(np.sort_complex(poles.conj()), np.sort_complex(poles))
