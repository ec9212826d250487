from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import norm

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.axis.open_structures import (
    mixture_deviations,
    mixture_interval,
    shares,
    weigh_structures,
)
from archerfish.identification.axis.structure_search import search_plant
from archerfish.identification.axis.uncertainty import Posterior, steady_gain
from archerfish.identification.excitation.signals import linear_sweep
from archerfish.identification.validation.frequency import plant_response
from archerfish.records.plant import dc_gain


class Weighed(NamedTuple):
    known: Posterior
    weight: float


def normal(mean, deviation, weight):
    """One parameter, normally distributed."""
    root = np.diag([0.0, deviation])
    return Weighed(Posterior(np.zeros(1), np.array([[mean]]), root, 1, False, 1.0), weight)


def parameter(known):
    return known.linear[:, 0]


def test_the_interval_of_one_structure_is_the_normal_one():
    ends = np.concatenate(mixture_interval([normal(2.0, 0.5, 1.0)], parameter))
    np.testing.assert_allclose(ends, [2 - 0.98, 2 + 0.98], atol=1e-3)


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_the_interval_of_several_structures_leaves_as_much_out_on_either_side(level):
    parts = [(0.0, 1.0, 0.7), (5.0, 0.1, 0.2), (-3.0, 2.0, 0.1)]
    low, high = mixture_interval([normal(*part) for part in parts], parameter, level)
    for end, probability in ((low, 0.5 - level / 2), (high, 0.5 + level / 2)):
        below = sum(weight * norm.cdf(end.item(), mean, deviation) for mean, deviation, weight in parts)
        assert below == pytest.approx(probability, abs=1e-9)


def test_structures_that_agree_have_the_interval_of_one():
    alone = np.concatenate(mixture_interval([normal(1.0, 0.2, 1.0)], parameter))
    both = np.concatenate(mixture_interval([normal(1.0, 0.2, 0.4), normal(1.0, 0.2, 0.6)], parameter))
    np.testing.assert_allclose(both, alone, atol=1e-9)


def test_deviations_of_poles_hold_how_far_the_structures_are_apart():
    pole = np.array([0.9 + 0.1j, 0.9 - 0.1j])
    moved = pole[::-1] + 0.03  # in another order
    still = np.zeros(2), np.zeros(2)
    real, imaginary = mixture_deviations([pole, moved], [(np.full(2, 0.01), np.full(2, 0.02)), still], [0.75, 0.25])
    np.testing.assert_allclose(real, np.sqrt(0.75 * 0.01**2 + 0.25 * 0.03**2))
    np.testing.assert_allclose(imaginary, np.sqrt(0.75) * 0.02)


@pytest.mark.parametrize("weights", [[1.0], [0.5, 0.5], [0.9, 0.06, 0.04], [0.333, 0.333, 0.334]])
def test_draws_are_dealt_out_by_weight(weights):
    found = shares(weights, 100)
    assert sum(found) == 100
    np.testing.assert_allclose(found, 100 * np.array(weights), atol=1)


@pytest.fixture
def noisy_sweep(second_order, record):
    return lambda seed: record(second_order(8.0, 0.5, 6), linear_sweep(10.0, 1e-3), noise=0.1, seed=seed)


def test_weights_fall_with_the_criterion_and_sum_to_one(noisy_sweep):
    recording = noisy_sweep(0)
    found = search_plant([recording], 2, 20, recording.outputs.std(axis=0))
    weighed = weigh_structures([found.best, *found.others])
    assert len(weighed) > 1
    assert sum(each.weight for each in weighed) == pytest.approx(1.0)
    first, second = weighed[:2]
    inflation = first.known.inflation
    ratio = np.exp(0.5 * (first.fitted.criterion(inflation) - second.fitted.criterion(inflation)))
    assert second.weight / first.weight == pytest.approx(ratio)


def test_intervals_hold_the_truth_where_the_delay_is_open(noisy_sweep, second_order):
    # For the chosen structure alone, with its neighbours out of sight, only half of them did at 30 Hz. Right 95 %
    # intervals hold the truth in fewer than 20 of 25 logs once in a thousand sets of logs.
    true = second_order(8.0, 0.5, 6)
    frequency = np.array([10.0, 30.0])
    gains = np.abs(plant_response(true, frequency)[:, 0, 0])
    held = np.zeros(3)
    for seed in range(25):
        result = identify_axis([noisy_sweep(seed)], 2)
        ((low, high),) = result.dc_gain_interval
        lows, highs = result.gain_interval(frequency)
        held += [low <= 1.0 <= high, *((lows <= gains) & (gains <= highs))]
    assert held.min() >= 20


def test_draws_have_the_delays_of_the_open_structures_in_no_order(noisy_sweep):
    result = identify_axis([noisy_sweep(1)], 2)
    delays = result.plant.draw_delays
    weights = {
        delay: sum(each.weight for each in result.structures if each.delay == delay) for delay in set(delays.tolist())
    }
    assert len(weights) > 1
    for delay, weight in weights.items():
        assert np.mean(delays == delay) == pytest.approx(weight, abs=0.03)
    assert np.any(np.diff(np.sort(delays)) != np.diff(delays))
    assert dc_gain(result.plant).item() == pytest.approx(steady_gain(result.parameters).item() * result.output_scale[0])
