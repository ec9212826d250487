import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from archerfish.identification.axis.modal_form import section_poles, sections_from_numbers, sections_from_poles
from archerfish.identification.axis.pole_refinement import Problem, refine_poles
from archerfish.identification.axis.posterior_draws import draw_parameters
from archerfish.identification.axis.spectra import spectrum
from archerfish.identification.axis.uncertainty import (
    _wander,
    heard_sections,
    interval,
    pole_deviations,
    pole_slopes,
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
    problem = Problem([spectrum(log(0, 0.0), 0)], True)
    found = posterior(problem, refine_poles(PAIR, problem))
    draws = draw_parameters(found, np.zeros((0, 2)), problem, 4000, np.random.default_rng(0))
    points = np.array([np.concatenate([each.free, each.linear.T.reshape(-1)]) for each in draws])
    scale = np.sqrt(np.diag(found.covariance))
    expected = found.covariance / np.outer(scale, scale)
    # A correlation of 4000 draws scatters by 1/√4000 = 0.016 at most, a variance by √2 times that.
    np.testing.assert_allclose(np.cov((points / scale).T), expected, atol=0.1)
    np.testing.assert_allclose(points.mean(axis=0), [*found.free, *found.linear[:, 0]], atol=5 * scale.max() / 60)


REAL = sections_from_poles(np.array([0.9, 0.1]))


def real_poles(noise):
    """Log of poles at 0.9 and, hardly seen, at 0.1: both in one section."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(800)
    clean = lfilter([0.0, 0.1], np.poly([0.9, 0.1]), u)
    problem = Problem(
        [spectrum(make_recording(u, clean + noise * clean.std() * rng.standard_normal(800), 0.01), 0)], False
    )
    return problem, posterior(problem, refine_poles(REAL, problem))


def test_a_pole_that_is_held_stays_while_its_neighbour_moves_and_numerators_follow():
    problem, found = real_poles(0.3)
    poles = section_poles(sections_from_numbers(found.free))
    fast = np.argmin(np.abs(poles))
    drawn = draw_parameters(found, pole_slopes(found)[fast], problem, 200, np.random.default_rng(0))
    places = np.array([np.sort(section_poles(sections_from_numbers(each.free)).real) for each in drawn])
    # Held to first order: what is left is the curvature over the moves of the other one.
    assert places[:, 0].std() < 0.1 * places[:, 1].std()
    gains = [steady_gain(each).item() for each in drawn]
    assert np.std(gains) < 1.2 * standard_deviations(found, steady_gain).item()


def test_draws_keep_to_the_response_that_is_known_however_far_their_poles_go():
    # The fast pole is uncertain by more than it is: numerators that followed it by the tangent would leave the data.
    problem, found = real_poles(0.05)
    drawn = draw_parameters(found, np.zeros((0, 2)), problem, 200, np.random.default_rng(0))
    lag = np.exp(-1j * np.array([0.02, 0.1, 0.5]))

    def gain(at):
        return np.abs(transfer(at, lag)[:, 0, 0])

    spread = np.std([gain(each) for each in drawn], axis=0)
    np.testing.assert_allclose(spread, standard_deviations(found, gain), rtol=0.2)


@pytest.mark.parametrize("noise", [0.01, 0.02])
def test_draws_keep_to_the_steady_gain_where_modes_are_hardly_told_apart(noise):
    # A fast pair, a slow mode of two percent, and a fourth pole that the plant hasn't: each numerator alone is known a
    # million times worse than the response.
    rng, time = np.random.default_rng(1), 1e-3 * np.arange(4000)
    u = np.sin(2 * np.pi * (1 + 4 * time) * time) + ((time > 1) & (time < 2.5))
    pair, slow = np.array([0.97 + 0.03j, 0.97 - 0.03j]), 0.9985
    clean = lfilter([0.0, 0.00175], np.poly(pair).real, u) + lfilter([0.0, 2e-5], [1.0, -slow], u)
    drift = lfilter([1.0], [1.0, -0.9], rng.standard_normal(4000))
    log = make_recording(u, clean + noise * clean.std() / drift.std() * drift, 1e-3)
    problem = Problem([spectrum(log, 0)], False)
    found = posterior(problem, refine_poles(sections_from_poles(np.array([*pair, slow, 0.96])), problem))
    drawn = draw_parameters(found, np.zeros((0, 4)), problem, 200, np.random.default_rng(0))
    lag = np.exp(-1j * np.array([0.0, 0.01]))

    def gain(at):
        return np.abs(transfer(at, lag)[:, 0, 0])

    assert np.all(standard_deviations(found, gain) < 0.01 * gain(found))
    assert np.all(np.std([gain(each) for each in drawn], axis=0) < 2 * standard_deviations(found, gain))


def test_slopes_of_poles_are_those_of_the_quadratic_formula():
    _, found = real_poles(0.05)
    slopes = pole_slopes(found)
    step = 1e-5 * np.array([0.6, -0.8])
    sides = [section_poles(sections_from_numbers(found.free + sign * step)) for sign in (1, -1)]
    np.testing.assert_allclose(slopes[:, 0] @ step, (sides[0] - sides[1]).real / 2, rtol=1e-4)
    np.testing.assert_array_equal(slopes[:, 1], 0.0)


def test_a_slow_wander_is_as_strong_on_the_lowest_lines_as_those_above_foretell():
    rng = np.random.default_rng(0)
    line = np.arange(1, 2001)
    squares = (30.0 / line**2 + 0.01) * rng.chisquare(2, line.size) / 2
    found = _wander(squares, 61)
    assert found[:5] == pytest.approx(30.0 / line[:5] ** 2, rel=0.7)
    assert not _wander(rng.chisquare(2, line.size), 61).any()
