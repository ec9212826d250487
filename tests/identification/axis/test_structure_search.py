import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.modal_form import section_poles
from archerfish.identification.axis.structure_search import search_plant
from archerfish.identification.excitation.signals import linear_sweep
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
        assert found.best.delay == delay
        assert found.best.problem.feedthrough or not feedthrough
        assert found.best.refinement.fit.misfit / 600 < 1.1 * 0.02**2


def test_no_delay_beyond_the_longest_is_tried(resonant_plant, record, white):
    found = searched([record(resonant_plant(6), white[:, 0], noise=0.02)], max_delay=4)
    assert found.delays[1] <= 4
    assert max(each.delay for each in (found.best, *found.others)) <= 4


@pytest.fixture
def noisy_sweep(second_order, record):
    """Sweep of an 8 Hz axis with six samples of delay under 10 % noise, which leaves the delay open."""
    return lambda seed: record(second_order(8.0, 0.5, 6), linear_sweep(10.0, 1e-3), noise=0.1, seed=seed)


def test_a_noisy_log_leaves_structures_open_and_the_true_delay_among_them(noisy_sweep):
    for seed in range(5):
        found = searched([noisy_sweep(seed)], order=2)
        structures = (found.best, *found.others)
        assert len({each.delay for each in structures}) > 1
        assert any(each.delay == 6 and not each.problem.feedthrough for each in structures)
        criteria = [each.criterion() for each in structures]
        assert criteria == sorted(criteria)


def test_the_delay_is_chosen_among_all_that_a_log_leaves_open(noisy_sweep):
    # Six samples of delay, of which the neighbours with feedthrough explain the log about as well: with the parameter
    # more that it costs them, the true delay without feedthrough is the best in most logs.
    found = [searched([noisy_sweep(seed)], order=2).best for seed in range(10)]
    assert sum(each.delay == 6 and not each.problem.feedthrough for each in found) >= 6


def test_a_clean_log_leaves_nothing_open_but_what_holds_the_plant(resonant_plant, record, white):
    found = searched([record(resonant_plant(6), white[:, 0])])
    assert (found.best.delay, found.best.problem.feedthrough) == (6, False)
    assert all(each.problem.feedthrough and each.delay in (6, 7) for each in found.others)


def test_a_resonance_at_high_frequency_is_found_under_coloured_noise():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(3000)
    slow, fast = 0.97 * np.exp(0.08j), 0.95 * np.exp(1.5j)
    y = sum(lfilter([0.0, 1.0], [1.0, -2 * pole.real, abs(pole) ** 2], u) for pole in (slow, fast))
    noise = lfilter([1.0], [1.0, -0.95], rng.standard_normal(3000))
    found = searched([make_recording(u, y + 0.1 * y.std() / noise.std() * noise, 0.01)])
    for pole in (slow, fast):
        assert np.abs(section_poles(found.best.refinement.sections) - pole).min() < 5e-3


def test_without_an_excited_band_to_hold_on_to_the_prior_yields(resonant_plant, record, white):
    # A clean log of white noise: nothing is out of band, and nothing may be traded for the wishes.
    found = searched([record(resonant_plant(), white[:, 0])])
    assert found.best.refinement.fit.misfit < 1e-20


def test_guesses_from_logs_of_unlike_loudness_agree_on_one_plant(resonant_plant, record):
    # Each log scaled by itself would have another gain, and no common model.
    plant = resonant_plant(1)
    u = np.random.default_rng(3).standard_normal((2, 400)) * [[1.0], [0.01]]
    logs = [record(plant, part) for part in u]
    logs[1] = record(plant, np.cumsum(u[1]))
    found = searched(logs)
    assert found.best.delay == 1
    np.testing.assert_allclose(
        np.sort_complex(section_poles(found.best.refinement.sections)), [0.3, 0.7, 0.9 - 0.2j, 0.9 + 0.2j], atol=1e-8
    )
