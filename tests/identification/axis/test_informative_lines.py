import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.informative_lines import heard_band, mean_squared_gain, telling_lines, thinned
from archerfish.identification.axis.modal_form import sections_from_poles
from archerfish.identification.axis.pole_refinement import Problem, Refinement
from archerfish.identification.axis.simulation_fit import fit_linear_parameters
from archerfish.identification.axis.spectra import line_frequency_hz, spectrum
from archerfish.identification.excitation.signals import linear_sweep
from archerfish.records.recording import make_recording

PERIOD = 1e-3


def fitted(*logs, pole=0.9):
    """Fit the poles of a low-pass of first order to logs."""
    problem = Problem([spectrum(each, 0) for each in logs], False)
    sections = sections_from_poles(np.array([pole + 0j]))
    fit = fit_linear_parameters(sections, *problem)
    return problem, Refinement(sections, fit, fit.cost)


def low_pass_log(u, noise, seed=0, pole=0.9):
    y = lfilter([0.0, 1 - pole], [1.0, -pole], u)
    return make_recording(u, y + noise * np.random.default_rng(seed).standard_normal(u.size), PERIOD)


def white(count=4000, seed=1):
    return np.random.default_rng(seed).standard_normal(count)


def test_lines_beyond_a_sweep_tell_nothing():
    problem, refinement = fitted(low_pass_log(linear_sweep(5.0, PERIOD), 0.05))
    (chosen,) = telling_lines(problem, refinement)
    frequency = line_frequency_hz(problem.experiments[0], PERIOD)
    told = np.zeros(frequency.size, dtype=bool)
    told[chosen] = True
    assert told[(frequency > 2.0) & (frequency < 50.0)].all()
    assert not told[frequency > 100.0].any()


def test_lines_are_kept_where_a_poor_fit_is_silent_but_the_input_is_not():
    u = white()
    # The fit has no feedthrough: at high frequencies it falls to 0.01, and the truth stays at 0.05.
    output = low_pass_log(u, 0.0, pole=0.98).outputs[:, 0] + 0.05 * u
    problem, refinement = fitted(make_recording(u, output, PERIOD), pole=0.98)
    (chosen,) = telling_lines(problem, refinement)
    assert chosen.size > 0.95 * problem.experiments[0].lag.size


def test_some_lines_are_kept_of_a_log_that_is_drowned():
    loud = low_pass_log(white(), 0.01)
    quiet = make_recording(1e-6 * white(2000, 3), white(2000, 4), PERIOD)
    problem, refinement = fitted(loud, quiet)
    chosen = telling_lines(problem, refinement)[1]
    assert 20 <= chosen.size < 100
    energy = np.abs(problem.experiments[1].inputs[:, 0]) ** 2
    assert energy[chosen].mean() > energy.mean()


def test_the_mean_gain_for_white_noise_is_the_energy_of_the_impulse_response():
    problem, refinement = fitted(low_pass_log(white(40000), 0.01))
    response = 0.1 * 0.9 ** np.arange(200)
    assert mean_squared_gain(problem, refinement) == pytest.approx(np.sum(response**2), rel=0.05)


def test_each_input_has_its_own_mean_gain():
    u = np.column_stack([white(20000, 1), white(20000, 2)])
    y = lfilter([0.0, 0.1], [1.0, -0.9], u[:, 0]) + lfilter([0.0, 0.3], [1.0, -0.9], u[:, 1])
    problem, refinement = fitted(make_recording(u, y, PERIOD, input_names=("a", "b")))
    found = mean_squared_gain(problem, refinement)
    assert found[1] / found[0] == pytest.approx(9.0, rel=0.05)


def test_the_heard_band_of_white_noise_ends_where_the_gain_falls_below_the_noise():
    # |G|² = 0.01 / |1 − 0.9/z|² equals 0.05² at cos w = (1 + 0.81 − 4) / 1.8
    noise, frequency = 0.05, np.arange(1, 500.0)
    gain = np.abs(0.1 / (1 - 0.9 * np.exp(-2j * np.pi * frequency * PERIOD)))
    expected = frequency[gain > noise].max()
    problem, refinement = fitted(low_pass_log(white(20000), noise))
    low, high = (each / (2 * np.pi * PERIOD) for each in heard_band(problem, refinement))
    assert low < 1.0
    # Smoothed over 1 % of the lines, in each of which the power of noise scatters by its own size.
    assert high == pytest.approx(expected, rel=0.3)


def test_a_sweep_is_heard_where_it_goes_and_the_bands_of_several_logs_are_joined():
    low_sweep, high_sweep = (
        low_pass_log(linear_sweep(5.0, PERIOD, low_hz=low, high_hz=high), 0.02) for low, high in ((5, 20), (60, 90))
    )
    alone, both = (
        np.array(heard_band(*fitted(*logs))) / (2 * np.pi * PERIOD) for logs in ((low_sweep,), (low_sweep, high_sweep))
    )
    assert 15 < alone[1] < 60
    assert alone[0] < 5
    assert both[1] > 85


def test_nothing_is_heard_of_a_fit_without_response():
    problem, refinement = fitted(low_pass_log(white(), 0.1))
    silent = refinement.fit._replace(numerators=0 * refinement.fit.numerators)
    assert heard_band(problem, refinement._replace(fit=silent)) is None


def test_thinning_keeps_the_strongest_lines_and_some_of_all_others():
    whole = spectrum(low_pass_log(linear_sweep(5.0, PERIOD), 0.1), 0)
    (kept,) = thinned([whole], 200)
    assert kept.lag.size <= 200
    energy = np.sort(np.abs(whole.inputs[:, 0]) ** 2)[::-1]
    assert np.sum(np.abs(kept.inputs) ** 2 >= energy[99]) == 100
    bins = np.histogram(line_frequency_hz(kept, PERIOD), np.linspace(0, 500, 11))[0]
    assert bins.min() >= 5
    assert np.all(np.diff(line_frequency_hz(kept, PERIOD)) > 0)


def test_thinning_shares_the_lines_among_experiments_by_their_length():
    logs = [spectrum(low_pass_log(white(count), 0.1), 0) for count in (9000, 3000)]
    sizes = [each.lag.size for each in thinned(logs, 400)]
    assert sizes[0] == pytest.approx(300, abs=5)
    assert sizes[1] == pytest.approx(100, abs=5)


def test_few_lines_are_kept_whole():
    logs = [spectrum(low_pass_log(white(100), 0.1), 0) for _ in range(2)]
    assert [each.lag.size for each in thinned(logs, 1000)] == [50, 50]
