import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.initial_poles import fit_arx
from archerfish.identification.axis.lag_factor import factor_lags
from archerfish.identification.axis.modal_form import section_poles
from archerfish.identification.axis.pole_pursuit import pursue_poles
from archerfish.identification.axis.pole_refinement import Problem, refine_all
from archerfish.identification.axis.spectra import spectrum
from archerfish.records.recording import make_recording

STRONG, WEAK = 0.98 * np.exp(0.1j), 0.985 * np.exp(1.0j)


def two_resonances():
    """A resonance with a hundred times the power of the other, under coloured noise."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(4000)
    y = sum(
        gain * lfilter([0.0, 1.0], [1.0, -2 * pole.real, abs(pole) ** 2], u)
        for pole, gain in ((STRONG, 1), (WEAK, 0.8))
    )
    noise = lfilter([1.0], [1.0, -0.95], rng.standard_normal(4000))
    return make_recording(u, y + 0.1 * y.std() / noise.std() * noise, 0.01)


def distance(poles, pole):
    return np.abs(poles - pole).min()


def test_a_weak_resonance_is_found_beside_a_strong_one():
    recording = two_resonances()
    guesses = list(pursue_poles(Problem([spectrum(recording, 0)], True), 4))
    arx = np.roots(fit_arx(factor_lags([recording], 4), 4).a)
    assert distance(arx, STRONG) > 0.05  # where equation error is led by the noise
    assert min(distance(section_poles(each), WEAK) for each in guesses) < 0.1
    best = refine_all(guesses, Problem([spectrum(recording, 0)], True))[0]
    for pole in (STRONG, WEAK):
        assert distance(section_poles(best.sections), pole) < 2e-3


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_guesses_have_the_order_and_are_stable(order):
    for sections in pursue_poles(Problem([spectrum(two_resonances(), 0)], True), order):
        poles = section_poles(sections)
        assert poles.size == order
        assert np.abs(poles).max() < 1
