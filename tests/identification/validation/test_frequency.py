import numpy as np
import pytest
from scipy.signal import dfreqresp, dlti

from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.identification.validation.frequency import (
    driven_band_hz,
    measured_response,
    natural_frequency_hz,
    plant_response,
)
from archerfish.records.recording import make_recording


def test_the_response_of_a_plant_agrees_with_scipy(resonant_plant):
    plant = resonant_plant(delay=2, feedthrough=0.3)
    frequency = np.array([0.5, 5.0, 30.0])
    angle = 2 * np.pi * frequency * plant.sample_period_s
    system = dlti(plant.A, plant.B, plant.C, plant.D, dt=plant.sample_period_s)
    expected = dfreqresp(system, angle)[1] * np.exp(-2j * angle)
    np.testing.assert_allclose(plant_response(plant, frequency)[:, 0, 0], expected, rtol=1e-9)


def test_white_input_measures_the_response_of_the_plant(resonant_plant, record):
    plant = resonant_plant()
    recording = record(plant, np.random.default_rng(2).standard_normal(40000), noise=0.01)
    measured = measured_response([recording])
    expected = plant_response(plant, measured.frequency_hz)[:, 0, 0]
    assert np.median(np.abs(measured.response - expected) / np.abs(expected)) < 0.02
    assert np.median(measured.coherence) > 0.99


def test_recordings_too_short_to_average_measure_nothing(resonant_plant, record):
    assert measured_response([record(resonant_plant(), np.random.default_rng(2).standard_normal(50))]) is None


def one_signal(signal):
    return make_recording(signal, signal, 1e-3)


def test_what_the_ends_of_a_sweep_leak_is_not_driven():
    sweep = linear_sweep(10.0, 1e-3)
    energy = np.abs(np.fft.rfft(sweep)) ** 2
    assert energy[1] > 0.01 * energy.max()  # the line at 0.1 Hz
    assert driven_band_hz([one_signal(sweep)]) == pytest.approx((2.0, 50.0), abs=0.3)


def test_a_step_drives_low_frequencies_whatever_its_mean():
    low, high = driven_band_hz([one_signal(step(1.0, 1e-3, start_s=0.5) + 100.0)])
    assert low == pytest.approx(1.0)
    assert 2.0 < high < 50.0


@pytest.mark.parametrize("amplitude", [1.0, 0.05])
def test_a_step_beside_a_sweep_drives_low_frequencies_however_early_and_small(amplitude):
    logs = [one_signal(linear_sweep(10.0, 1e-3)), one_signal(amplitude * step(1.5, 1e-3) + 3.0)]
    assert driven_band_hz(logs)[0] == pytest.approx(1 / 1.5)


def test_a_log_that_is_faint_beside_another_drives_nothing():
    dither = 1e-4 * np.random.default_rng(0).standard_normal(1000)
    assert driven_band_hz([one_signal(linear_sweep(10.0, 1e-3)), one_signal(dither)]) == pytest.approx((2, 50), abs=0.3)


def test_white_noise_drives_every_frequency():
    low, high = driven_band_hz([one_signal(np.random.default_rng(0).standard_normal(5000))])
    assert low == pytest.approx(0.2)
    assert high == pytest.approx(500, rel=0.01)


def test_the_natural_frequency_of_a_resonance():
    # 10 Hz, damping 0.5, sampled at 1 kHz.
    pole = np.exp(2 * np.pi * 10 * 1e-3 * (-0.5 + 1j * np.sqrt(0.75)))
    assert natural_frequency_hz(pole, 1e-3) == pytest.approx(10.0)
    assert natural_frequency_hz(0.0, 1e-3) == np.inf
