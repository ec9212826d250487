import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.validation.surprises import MEMORY, surprises

TIME = np.arange(6000) * 1e-3


@pytest.mark.parametrize("top_hz", [10, 50, 200])
def test_a_sweep_foretells_itself(top_hz):
    sweep = np.sin(2 * np.pi * (2 * TIME + (top_hz - 2) * TIME**2 / (2 * TIME[-1])))
    assert not surprises(sweep).any()


def test_what_can_be_foretold_of_coloured_noise_is_taken_off():
    rng = np.random.default_rng(0)
    innovations = rng.standard_normal(6000)
    found = surprises(lfilter([1], [1, -0.9], innovations))[MEMORY:]
    assert np.corrcoef(found, innovations[MEMORY:])[0, 1] > 0.95
    assert found.std() == pytest.approx(1.0, rel=0.05)


def test_noise_on_a_sweep_is_left():
    noise = 0.05 * np.random.default_rng(1).standard_normal(6000)
    found = surprises(np.sin(2 * np.pi * (2 * TIME + 4 * TIME**2)) + noise)[MEMORY:]
    assert np.corrcoef(found, noise[MEMORY:])[0, 1] > 0.8


def test_too_few_samples_hold_no_surprises():
    assert not surprises(np.random.default_rng(0).standard_normal(4 * MEMORY - 1)).any()
