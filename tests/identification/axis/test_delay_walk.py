import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.delay_walk import colour, rounding
from archerfish.identification.axis.pole_refinement import Problem, refine_poles
from archerfish.identification.axis.spectra import spectrum
from archerfish.records.recording import make_recording

POLE = np.array([-0.95])


def logged(memory, seed, outputs=1):
    """Logs of a slow axis with white input under first-order noise, two of unlike length."""
    rng = np.random.default_rng(seed)
    for count in (1500, 700):
        u = rng.standard_normal(count)
        clean = lfilter([0.0, 0.05], [1.0, *POLE], u)
        noise = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal((count, outputs)), axis=0)
        names = [f"y{index}" for index in range(outputs)]
        yield make_recording(u, clean[:, None] + 0.1 * clean.std() * noise, 0.01, output_names=names)


@pytest.mark.parametrize("outputs", [1, 2])
def test_white_residuals_have_no_colour_and_slow_ones_on_a_slow_axis_do(outputs):
    for memory, low, high in ((0.0, 0.8, 1.2), (0.9, 3.0, 20.0)):
        problem = Problem([spectrum(each, 0) for each in logged(memory, 0, outputs)], False)
        assert low < colour(problem, refine_poles((POLE,), problem)) < high


def test_rounding_is_far_below_any_noise():
    problem = Problem([spectrum(each, 0) for each in logged(0.0, 0)], False)
    assert 0 < rounding(problem.experiments) < 1e-12 * refine_poles((POLE,), problem).cost
