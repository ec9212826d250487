import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.modal_form import section_poles
from archerfish.identification.axis.structure_search import search_plant
from archerfish.records.recording import make_recording


def searched(recordings, order=4, max_delay=20):
    spread = np.sqrt(np.mean([each.outputs.var(axis=0) for each in recordings], axis=0))
    return search_plant(recordings, order, max_delay, spread)


@pytest.mark.parametrize("feedthrough", [0.0, 0.5])
@pytest.mark.parametrize("delay", [0, 3, 5, 9, 13, 17])
def test_delays_between_the_first_guesses_are_found_too(resonant_plant, record, delay, feedthrough):
    for seed in range(2):
        u = np.random.default_rng(seed).standard_normal(600)
        found = searched([record(resonant_plant(delay, feedthrough), u, noise=0.02, seed=seed)])
        assert found.delay == delay
        assert found.problem.feedthrough or not feedthrough
        assert found.refinement.fit.misfit / 600 < 1.1 * 0.02**2


def test_no_delay_beyond_the_longest_is_tried(resonant_plant, record, white):
    found = searched([record(resonant_plant(6), white[:, 0], noise=0.02)], max_delay=4)
    assert max(found.sketches) <= 4
    assert found.delay <= 4


def test_the_best_sketch_is_that_of_the_delay_found(resonant_plant, record, white):
    # Or of the next one: with feedthrough it holds the same plant.
    found = searched([record(resonant_plant(6), white[:, 0], noise=0.02)])
    assert min(found.sketches, key=lambda each: found.sketches[each]) in (found.delay, found.delay + 1)
    assert found.sketch_rows >= 500


def test_a_resonance_at_high_frequency_is_found_under_coloured_noise():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(3000)
    slow, fast = 0.97 * np.exp(0.08j), 0.95 * np.exp(1.5j)
    y = sum(lfilter([0.0, 1.0], [1.0, -2 * pole.real, abs(pole) ** 2], u) for pole in (slow, fast))
    noise = lfilter([1.0], [1.0, -0.95], rng.standard_normal(3000))
    found = searched([make_recording(u, y + 0.1 * y.std() / noise.std() * noise, 0.01)])
    for pole in (slow, fast):
        assert np.abs(section_poles(found.refinement.sections) - pole).min() < 5e-3


def test_without_an_excited_band_to_hold_on_to_the_prior_yields(resonant_plant, record, white):
    # A clean log of white noise: nothing is out of band, and nothing may be traded for the wishes.
    found = searched([record(resonant_plant(), white[:, 0])])
    assert found.refinement.fit.misfit < 1e-20


def test_guesses_from_logs_of_unlike_loudness_agree_on_one_plant(resonant_plant, record):
    # Each log scaled by itself would have another gain, and no common model.
    plant = resonant_plant(1)
    u = np.random.default_rng(3).standard_normal((2, 400)) * [[1.0], [0.01]]
    logs = [record(plant, part) for part in u]
    logs[1] = record(plant, np.cumsum(u[1]))
    found = searched(logs)
    assert found.delay == 1
    np.testing.assert_allclose(
        np.sort_complex(section_poles(found.refinement.sections)), [0.3, 0.7, 0.9 - 0.2j, 0.9 + 0.2j], atol=1e-8
    )
