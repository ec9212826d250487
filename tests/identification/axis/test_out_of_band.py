import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.signal.windows import tukey

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.axis.informative_lines import mean_squared_gain
from archerfish.identification.axis.modal_form import sections_from_poles
from archerfish.identification.axis.out_of_band import out_of_band_prior, scaled_penalty
from archerfish.identification.axis.pole_refinement import Problem, refine_poles
from archerfish.identification.axis.spectra import spectrum
from archerfish.identification.axis.uncertainty import posterior, standard_deviations, steady_gain, transfer
from archerfish.identification.excitation.signals import linear_sweep
from archerfish.identification.validation.frequency import plant_response
from archerfish.records.recording import make_recording

PERIOD = 1e-3
POLE = np.exp(2 * np.pi * 15 * PERIOD * (-0.5 + 1j * np.sqrt(0.75)))
"""15 Hz, damping 0.5."""


def section(natural_hz, damping, gain):
    """Numerator and denominator of a resonance with the given steady gain."""
    pole = np.exp(2 * np.pi * natural_hz * PERIOD * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = np.array([1.0, -2 * pole.real, abs(pole) ** 2])
    return np.array([0.0, gain * a.sum()]), a


def log(u, noise=0.01, seed=0, modes=((15.0, 0.5, 1.0),)):
    y = sum(lfilter(*section(*mode), u) for mode in modes)
    return make_recording(u, y + noise * y.std() * np.random.default_rng([seed, 1]).standard_normal(u.size), PERIOD)


def refined(recording):
    problem = Problem([spectrum(recording, 0, recording.outputs.std(axis=0))], True)
    return problem, refine_poles(sections_from_poles(np.array([POLE, POLE.conj()])), problem)


def faded_sweep():
    """5–50 Hz, faded in and out: an abrupt end leaks so much to all frequencies that it is heard there."""
    return tukey(5000, 0.1) * linear_sweep(5.0, PERIOD, low_hz=5.0)


def squares(penalty, gains):
    """Penalty of gains at its points, one input and output."""
    return float(np.sum((penalty.rows[0] @ np.concatenate([gains.real, gains.imag]) - penalty.targets[0][:, 0]) ** 2))


@pytest.fixture
def swept():
    return refined(log(faded_sweep(), noise=0.1))


def bins_and_points_below(penalty):
    inside = np.abs(penalty.lag) < 1 - 1e-9
    return inside, ~inside


def test_a_transfer_function_that_keeps_the_wishes_costs_nothing(swept):
    penalty = out_of_band_prior(*swept)
    beyond, below = bins_and_points_below(penalty)
    frequency = -np.angle(penalty.lag)
    gains = np.where(below, 3.0 - 2j * frequency / frequency[below].max(), 0.0)
    gains[beyond & (frequency < 2 * np.pi * 5 * PERIOD)] = 7.0  # a bin below the band: that is the other wish's
    assert squares(penalty, gains) == pytest.approx(0.0, abs=1e-20)


def test_a_gain_beyond_the_band_costs_as_much_as_a_thousand_samples(swept):
    problem, refinement = swept
    penalty = out_of_band_prior(problem, refinement)
    beyond, _ = bins_and_points_below(penalty)
    gains = np.where(beyond & (-np.angle(penalty.lag) > 2 * np.pi * 100 * PERIOD), 1.0 + 0j, 0.0)
    variance = refinement.fit.misfit / refinement.fit.residuals.size
    expected = 1000 * variance * np.count_nonzero(gains) / np.count_nonzero(beyond)
    assert squares(penalty, gains * np.sqrt(mean_squared_gain(problem, refinement))) == pytest.approx(
        expected, rel=0.05
    )


def test_a_bend_below_the_band_costs(swept):
    penalty = out_of_band_prior(*swept)
    _, below = bins_and_points_below(penalty)
    frequency = -np.angle(penalty.lag)
    assert frequency[below].max() / (2 * np.pi * PERIOD) == pytest.approx(5.0, abs=1.0)
    slope = frequency / frequency[below].max()
    assert squares(penalty, np.where(below, slope + 0j, 0.0)) > 0.01
    assert squares(penalty, np.where(below, 1j * slope**2, 0.0)) > 0.01


def test_there_is_nothing_below_the_band_of_white_noise():
    penalty = out_of_band_prior(*refined(log(np.random.default_rng(0).standard_normal(5000))))
    _, below = bins_and_points_below(penalty)
    gains = np.where(below, np.random.default_rng(1).standard_normal(penalty.lag.size) + 0j, 0.0)
    assert squares(penalty, gains) == 0.0


def test_scaling_weighs_the_squares_by_the_square(swept):
    penalty = out_of_band_prior(*swept)
    weak = scaled_penalty(penalty, 0.1)
    gains = np.random.default_rng(0).standard_normal(penalty.lag.size) * (1 + 2j)
    assert squares(weak, gains) == pytest.approx(0.01 * squares(penalty, gains))
    assert weak.pull == pytest.approx(0.01 * penalty.pull)


def test_it_leaves_a_broadband_log_alone():
    problem, free = refined(log(np.random.default_rng(0).standard_normal(5000), noise=0.1))
    held = refine_poles(free.sections, problem._replace(penalty=out_of_band_prior(problem, free)))
    lag = np.exp(-2j * np.pi * np.array([0.0, 5.0, 15.0, 50.0]) * PERIOD)
    known, moved = posterior(problem, free), posterior(problem, held)
    deviation = standard_deviations(known, lambda at: np.abs(transfer(at, lag)))
    assert np.all(np.abs(np.abs(transfer(moved, lag)) - np.abs(transfer(known, lag))) < 0.5 * deviation)


def test_an_input_without_any_response_gets_no_wishes():
    recording = log(np.random.default_rng(0).standard_normal(3000))
    inputs = np.column_stack([recording.inputs, recording.inputs])
    twins = make_recording(inputs, recording.outputs, PERIOD, input_names=("a", "b"))
    problem, free = refined(twins)
    numerators = free.fit.numerators * np.array([1.0, 0.0])[:, None]
    fit = free.fit._replace(numerators=numerators, feedthrough=free.fit.feedthrough * [[1.0], [0.0]])
    penalty = out_of_band_prior(problem, free._replace(fit=fit))
    assert len(penalty.rows[1]) == 0
    assert len(penalty.rows[0]) > 0


@pytest.mark.parametrize("dither", [0.0, 0.02])
def test_a_large_gain_outside_the_band_is_found_where_the_log_shows_it(dither):
    # 50 times the steady gain at 120 Hz, and a sweep that ends at 50 Hz: its leakage, or a dither, tells.
    u = linear_sweep(5.0, PERIOD) + dither * np.random.default_rng(0).standard_normal(5000)
    result = identify_axis([log(u, 0.001, modes=((10.0, 0.5, 1.0), (120.0, 0.005, 0.5)))])
    frequency = np.array([120.0])
    numerators = [section(*mode) for mode in ((10.0, 0.5, 1.0), (120.0, 0.005, 0.5))]
    lag = np.exp(-2j * np.pi * 120.0 * PERIOD)
    true = abs(sum(np.polyval(b[::-1], lag) / np.polyval(a[::-1], lag) for b, a in numerators))
    assert np.abs(plant_response(result.plant, frequency)).item() == pytest.approx(true, rel=0.05)


def test_noise_in_a_broadband_log_is_not_taken_for_a_silent_end_of_the_band():
    # At ten times the noise's power the lines of white noise scatter from nothing to fifty times.
    for seed in range(5):
        problem, free = refined(log(np.random.default_rng(seed).standard_normal(600), noise=0.3, seed=seed))
        penalty = out_of_band_prior(problem, free)
        _, below = bins_and_points_below(penalty)
        assert -np.angle(penalty.lag[below]).min() <= 5 * 2 * np.pi / 600


def test_it_makes_the_steady_gain_of_a_sweep_surer():
    recording = log(faded_sweep(), noise=0.3)
    problem = Problem([spectrum(recording, 0, recording.outputs.std(axis=0))], True)
    free = refine_poles(sections_from_poles(np.array([POLE, POLE.conj(), 0.99, 0.5])), problem)
    held = problem._replace(penalty=out_of_band_prior(problem, free))
    fits = (problem, free), (held, refine_poles(free.sections, held))
    deviation, guided = (standard_deviations(posterior(*each), steady_gain).item() for each in fits)
    assert guided < 0.8 * deviation
