import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from archerfish.identification.modal_form import section_poles, sections_from_numbers, sections_from_poles
from archerfish.identification.pole_refinement import Problem, refine_poles
from archerfish.identification.spectra import spectrum
from archerfish.identification.uncertainty import (
    draw_parameters,
    heard_sections,
    interval,
    pole_deviations,
    posterior,
    standard_deviations,
    steady_gain,
    transfer,
)
from archerfish.records.recording import make_recording

POLE = 0.9 * np.exp(0.2j)
DENOMINATOR = np.array([1.0, -2 * POLE.real, abs(POLE) ** 2])
NUMERATORS = np.array([[0.0, 0.5, 0.2], [0.0, -0.1, 0.4]])
PAIR = sections_from_poles(np.array([POLE, POLE.conj()]))
LOGS = 60


def log(seed, colour, count=500, outputs=1, noise=0.1):
    """White input; each output under noise of its own, AR(1) with the coefficient `colour`."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    clean = np.column_stack([lfilter(numerator, DENOMINATOR, u) for numerator in NUMERATORS[:outputs]])
    disturbance = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], rng.standard_normal((count + 200, outputs)), axis=0)
    names = [f"y{index}" for index in range(outputs)]
    return make_recording(u, clean + noise * clean.std(axis=0) * disturbance[200:], 0.01, output_names=names)


def known(recording, feedthrough=False, scale=1.0):
    problem = Problem([spectrum(recording, 0, scale)], feedthrough)
    return posterior(problem, refine_poles(PAIR, problem))


def looked_at(parameters):
    """Steady gain, gain near the resonance, and the pole."""
    gains = np.abs(transfer(parameters, np.exp(-1j * np.array([0.0, 0.2])))[:, 0, 0])
    pole = section_poles(sections_from_numbers(parameters.free))[0]
    return np.array([*gains, pole.real, abs(pole.imag)])


def truth():
    lag = np.exp(-1j * np.array([0.0, 0.2]))
    gains = np.abs(np.polyval(NUMERATORS[0, ::-1], lag) / np.polyval(DENOMINATOR[::-1], lag))
    return np.array([*gains, POLE.real, POLE.imag])


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_errors_over_many_logs_are_as_large_as_the_covariance_says(colour):
    errors = []
    for seed in range(LOGS):
        found = known(log(seed, colour))
        errors.append((looked_at(found) - truth()) / standard_deviations(found, looked_at))
    # With normal errors the sum of their squares is χ² of 60 degrees. With the seeds fixed nothing here is left to
    # chance; for new ones each of the 8 bounds would be broken by a right covariance in one of 10⁴ runs, and a
    # covariance that is 30 % off (500 samples are not many) is let pass too.
    low, high = chi2.ppf([1e-4, 1 - 1e-4], LOGS)
    squares = np.sum(np.square(errors), axis=0)
    assert np.all(squares > low / 1.3)
    assert np.all(squares < high * 1.3)


def test_white_residuals_are_called_white_and_coloured_ones_coloured():
    inflations = [np.median([known(log(seed, colour)).inflation for seed in range(10)]) for colour in (0.0, 0.9)]
    assert inflations[0] == pytest.approx(1.0, abs=0.15)
    assert inflations[1] > 1.5


def test_a_longer_log_is_as_much_surer_as_it_is_longer():
    short, long = (standard_deviations(known(log(0, 0.0, count)), looked_at) for count in (1000, 16000))
    np.testing.assert_allclose(short / long, 4.0, rtol=0.25)


def test_a_second_output_makes_the_shared_pole_surer_by_its_own_information():
    recording = log(0, 0.0, 4000, outputs=2, noise=0.2)
    both = known(recording, scale=recording.outputs.std(axis=0))
    alone = []
    for output in range(2):
        single = make_recording(recording.inputs, recording.outputs[:, output], 0.01)
        alone.append(pole_deviations(known(single))[1][0])
    expected = 1 / np.sqrt(sum(deviation**-2 for deviation in alone))
    assert pole_deviations(both)[1][0] == pytest.approx(expected, rel=0.1)


def test_deviations_follow_from_the_covariance():
    found = known(log(0, 0.0))
    weights = np.random.default_rng(0).standard_normal(found.linear.size)
    place = slice(found.order, None)
    expected = np.sqrt(weights @ found.covariance[place, place] @ weights)
    assert standard_deviations(found, lambda at: at.linear[:, 0] @ weights).item() == pytest.approx(expected, rel=1e-6)


def test_an_interval_is_two_deviations_each_way():
    low, high = interval(np.array([1.0, -2.0]), np.array([0.5, 0.1]))
    np.testing.assert_allclose((low, high), ([1 - 0.98, -2 - 0.196], [1 + 0.98, -2 + 0.196]), atol=1e-3)


def test_the_transfer_function_is_that_of_the_parameters():
    recording = log(0, 0.0, noise=0.0)
    found = known(recording)
    lag = np.exp(-1j * np.array([0.0, 0.1, 3.0]))
    expected = np.polyval(NUMERATORS[0, ::-1], lag) / np.polyval(DENOMINATOR[::-1], lag)
    np.testing.assert_allclose(transfer(found, lag)[:, 0, 0], expected, rtol=1e-9)
    assert steady_gain(found).item() == pytest.approx(expected[0].real)


def test_a_mode_that_is_not_there_is_not_heard():
    three = sections_from_poles(np.array([POLE, POLE.conj(), 0.2]))
    problem = Problem([spectrum(log(0, 0.0), 0)], False)
    refinement = refine_poles(three, problem)
    assert heard_sections(posterior(problem, refinement), refinement.sections) == [True, False]


def test_draws_scatter_as_the_covariance_says():
    found = known(log(0, 0.0), feedthrough=True)
    draws = draw_parameters(found, np.zeros(2, dtype=bool), 4000, np.random.default_rng(0))
    points = np.array([np.concatenate([each.free, each.linear.T.reshape(-1)]) for each in draws])
    scale = np.sqrt(np.diag(found.covariance))
    expected = found.covariance / np.outer(scale, scale)
    # A correlation of 4000 draws scatters by 1/√4000 = 0.016 at most, a variance by √2 times that.
    np.testing.assert_allclose(np.cov((points / scale).T), expected, atol=0.1)
    np.testing.assert_allclose(points.mean(axis=0), [*found.free, *found.linear[:, 0]], atol=5 * scale.max() / 60)


def test_poles_that_are_held_stay_and_the_rest_is_drawn():
    found = known(log(0, 0.0))
    draws = draw_parameters(found, np.array([True, True]), 50, np.random.default_rng(0))
    for each in draws:
        np.testing.assert_array_equal(each.free, found.free)
    assert np.std([each.linear[0, 0] for each in draws]) > 0
