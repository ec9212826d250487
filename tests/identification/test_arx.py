import numpy as np
import pytest

from archerfish.identification.arx import fit_arx, impulse_response, realised_poles
from archerfish.identification.state_space import plant_poles, simulate


@pytest.mark.parametrize("inputs", [1, 2])
def test_a_noise_free_recording_gives_the_poles_exactly(white, inputs, resonant_plant, record):
    plant = resonant_plant(inputs=inputs)
    model = fit_arx([record(plant, white[:, :inputs], offset=3.0)], 4)
    found, true = np.sort_complex(np.roots(model.a)), np.sort_complex(plant_poles(plant))
    np.testing.assert_allclose(found, true, atol=1e-8)


def test_the_impulse_response_is_the_simulated_one(white, resonant_plant, record):
    plant = resonant_plant(inputs=2)
    model = fit_arx([record(plant, white)], 4)
    for channel in range(2):
        impulse = np.zeros((30, 2))
        impulse[0, channel] = 1.0
        np.testing.assert_allclose(impulse_response(model, 30)[:, channel], simulate(plant, impulse)[:, 0], atol=1e-8)


def test_recordings_are_experiments_of_their_own(white, resonant_plant, record):
    plant = resonant_plant()
    recordings = [
        record(plant, white[:300, 0], offset=1.0, initial_state=np.ones(4)),
        record(plant, white[300:, 0], offset=-5.0, initial_state=-np.ones(4)),
    ]
    found = np.sort_complex(np.roots(fit_arx(recordings, 4).a))
    np.testing.assert_allclose(found, np.sort_complex(plant_poles(plant)), atol=1e-8)


def test_an_impulse_response_is_realised_with_its_poles(resonant_plant):
    plant = resonant_plant()
    response = np.array([(plant.C @ np.linalg.matrix_power(plant.A, k) @ plant.B)[0] for k in range(60)])
    np.testing.assert_allclose(
        np.sort_complex(realised_poles(response, 4)), np.sort_complex(plant_poles(plant)), atol=1e-7
    )
