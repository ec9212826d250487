import numpy as np
import pytest

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.excitation.experiment_design import predict_experiment
from archerfish.identification.excitation.parallel_sections import modes, parallel_plant, second_order_plant
from archerfish.identification.excitation.signals import linear_sweep, staircase
from archerfish.identification.validation.frequency import plant_response
from archerfish.paper.gimbal import printed_plants
from archerfish.records.errors import InputError
from archerfish.records.plant import dc_gain
from archerfish.records.recording import make_recording

PERIOD = 0.01
PLANT = second_order_plant(5.0, 0.5, 0.03, PERIOD)
COMMANDS = [
    0.1 * linear_sweep(6.0, PERIOD, low_hz=0.5, high_hz=20.0),
    np.concatenate([np.zeros(20), staircase([0.1, 0.0, -0.1, 0.0], 0.5, PERIOD)]),
]
NOISE, BAND = 2e-3, (1.0, 20.0)


def estimates(seed):
    """Identify the plant from noisy logs; return DC gain, frequency, damping and the gain at five frequencies."""
    rng = np.random.default_rng(seed)
    logs = [
        make_recording(each, simulate(PLANT, each[:, None])[:, 0] + NOISE * rng.standard_normal(len(each)), PERIOD)
        for each in COMMANDS
    ]
    plant = identify_axis(logs, order=2, max_delay=4).plant
    mode = modes(parallel_plant(plant))[0]
    gains = np.abs(plant_response(plant, np.geomspace(*BAND, 5))[:, 0, 0])
    return [dc_gain(plant).item(), mode.frequency_hz, mode.damping, *gains]


def test_the_prediction_is_the_spread_of_real_identifications():
    found = np.array([estimates(seed) for seed in range(16)])
    foretold = predict_experiment(COMMANDS, PLANT, NOISE, BAND)
    mode = foretold.modes[0]
    expected = np.array([each.half_width for each in (foretold.dc_gain, mode.frequency, mode.damping, *foretold.gains)])
    # 16 draws tell a standard deviation to ±36 % at 95 %; over eight figures ±50 % is rarely passed.
    np.testing.assert_allclose(1.96 * found.std(axis=0, ddof=1), expected, rtol=0.5)
    truth = [each.value for each in (foretold.dc_gain, mode.frequency, mode.damping, *foretold.gains)]
    np.testing.assert_allclose(found.mean(axis=0), truth, atol=1e-12 + expected.max() / 2)


def test_half_the_noise_halves_every_interval():
    loud, quiet = (predict_experiment(COMMANDS, PLANT, noise, BAND) for noise in (2e-3, 1e-3))
    assert loud.dc_gain.half_width == pytest.approx(2 * quiet.dc_gain.half_width)
    assert loud.delay.half_width == pytest.approx(2 * quiet.delay.half_width)
    np.testing.assert_allclose(loud.bode.gain_half_width, 2 * quiet.bode.gain_half_width)


def test_four_times_the_logs_halve_every_interval():
    once, often = (predict_experiment(COMMANDS * times, PLANT, NOISE, BAND) for times in (1, 4))
    assert once.modes[0].frequency.half_width == pytest.approx(2 * often.modes[0].frequency.half_width)


def test_a_step_settles_the_dc_gain():
    sweep, both = (predict_experiment(COMMANDS[:count], PLANT, NOISE, BAND) for count in (1, 2))
    assert both.dc_gain.half_width < 0.7 * sweep.dc_gain.half_width
    assert both.known_band_hz[0] <= sweep.known_band_hz[0]


def test_the_printed_second_pair_of_pitch_is_not_identifiable_from_a_sweep():
    sweep = 0.01 * linear_sweep(10.0, 1e-3)
    foretold = predict_experiment([sweep], printed_plants()["pitch"], 1e-4, (2.0, 50.0))
    assert [mode.identifiable for mode in foretold.modes] == [True, False]
    assert foretold.modes[1].frequency.value == pytest.approx(400, rel=0.01)


def test_coherence_falls_where_noise_hides_the_motion():
    bode = predict_experiment(COMMANDS, PLANT, 0.05, BAND).bode
    shown = np.interp([4.0, 20.0], bode.frequency_hz, bode.coherence)
    assert shown[0] > 0.8
    assert shown[1] < 0.2


def test_what_cant_be_predicted_is_refused():
    with pytest.raises(InputError, match="noise must be > 0"):
        predict_experiment(COMMANDS, PLANT, 0.0, BAND)
    with pytest.raises(InputError, match="needs a command"):
        predict_experiment([], PLANT, NOISE, BAND)
