import numpy as np
import pytest
from scipy.signal import dfreqresp, dlti

from archerfish.identification.excitation import linear_sweep, step
from archerfish.identification.frequency import (
    beyond_band,
    excited_band_hz,
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


def test_the_excited_band_of_a_sweep_ends_with_it():
    sweep = linear_sweep(10.0, 1e-3, low_hz=5.0, high_hz=40.0)
    low, high = excited_band_hz([make_recording(sweep, sweep, 1e-3)])
    assert low <= 5.0
    assert high == pytest.approx(40.0, abs=2.5)


def test_a_step_excites_low_frequencies_whatever_its_mean():
    signal = step(1.0, 1e-3, start_s=0.5) + 100.0
    low, high = excited_band_hz([make_recording(signal, signal, 1e-3)])
    assert low <= 1.0
    assert 2.0 < high < 50.0


def test_the_natural_frequency_of_a_resonance():
    # 10 Hz, damping 0.5, sampled at 1 kHz.
    pole = np.exp(2 * np.pi * 10 * 1e-3 * (-0.5 + 1j * np.sqrt(0.75)))
    assert natural_frequency_hz(pole, 1e-3) == pytest.approx(10.0)
    assert natural_frequency_hz(0.0, 1e-3) == np.inf
    np.testing.assert_array_equal(beyond_band(np.array([pole, -0.5]), (2.0, 50.0), 1e-3), [False, True])
