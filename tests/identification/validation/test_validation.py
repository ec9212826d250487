import numpy as np
import pytest

from archerfish.identification.validation.free_run import common_offset, fit_percent, free_run
from archerfish.records.errors import InputError
from archerfish.records.recording import make_recording


def test_the_fit_of_a_hand_calculation():
    measured = np.array([[0.0], [2.0], [4.0]])
    simulated = np.array([[0.0], [2.0], [3.0]])
    # ‖y − ŷ‖ = 1, ‖y − 2‖ = √8.
    assert fit_percent(measured, simulated).item() == pytest.approx(100 * (1 - 1 / np.sqrt(8)))


def test_perfect_is_100_and_the_mean_is_0():
    measured = np.random.default_rng(0).standard_normal((50, 2))
    np.testing.assert_allclose(fit_percent(measured, measured), 100)
    np.testing.assert_allclose(fit_percent(measured, np.broadcast_to(measured.mean(axis=0), (50, 2))), 0, atol=1e-12)


def test_a_constant_output_has_no_fit():
    with pytest.raises(InputError, match="constant"):
        fit_percent(np.ones((5, 1)), np.zeros((5, 1)))


def test_a_free_run_finds_the_initial_state(white, resonant_plant, record):
    plant = resonant_plant()
    recording = record(plant, white[:, 0], initial_state=np.array([5.0, -3.0, 2.0, 1.0]), offset=0.7)
    assert free_run(plant, recording, 0.7).fit_percent.item() == pytest.approx(100, abs=1e-6)
    assert free_run(plant, recording).fit_percent.item() < 90


def test_the_fit_shows_the_noise(white, resonant_plant, record):
    plant = resonant_plant()
    run = free_run(plant, record(plant, white[:, 0], noise=0.05))
    assert run.fit_percent.item() == pytest.approx(95, abs=0.5)


def test_the_offset_that_recordings_share_is_found(white, resonant_plant, record):
    plant = resonant_plant()
    recordings = [
        record(plant, part, offset=-1.5, noise=0.01, initial_state=np.full(4, 3.0), seed=seed)
        for seed, part in enumerate((white[:200, 0], white[200:, 0]))
    ]
    assert common_offset(plant, recordings).item() == pytest.approx(-1.5, abs=0.01)


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (
            make_recording(np.zeros((20, 2)), np.zeros(20), 0.01, input_names=("a", "b")),
            "has 2 inputs, the plant has 1",
        ),
        (make_recording(np.zeros(20), np.zeros(20), 0.02, source="slow.csv"), "slow.csv: is sampled every 0.02 s"),
    ],
)
def test_a_recording_of_something_else_is_refused(recording, message, resonant_plant):
    with pytest.raises(InputError, match=message):
        free_run(resonant_plant(), recording)
