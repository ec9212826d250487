import numpy as np
import pytest
from scipy import stats

from archerfish.evaluation.hit_rate import hit_rate
from archerfish.evaluation.seed_pooling import SeedSpread, pooled_trainings, seed_spread
from archerfish.records.errors import InputError

SHOTS = 50


def drawn(seed, trainings, cells=2, engagements=30, rate=0.8, between=0.0):
    """Hits of trainings whose true rates scatter, in engagements that are easy or hard for all of them."""
    rng = np.random.default_rng(seed)
    ease = rng.normal(0, 0.05, (1, cells, engagements))
    true = np.clip(rate + between * rng.standard_normal((trainings, 1, 1)) + ease, 0, 1)
    return rng.binomial(SHOTS, true)


def test_one_training_in_one_cell_has_the_interval_of_its_hits():
    hits = drawn(0, 1, cells=1)
    expected = hit_rate(np.arange(SHOTS) < hits[0, 0][:, None])
    found = pooled_trainings(hits, SHOTS)
    assert found.value == pytest.approx(expected.rate)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_trainings_that_meet_the_same_engagements_are_not_new_engagements():
    hits = drawn(0, 1)
    alone, thrice = pooled_trainings(hits, SHOTS), pooled_trainings(np.repeat(hits, 3, axis=0), SHOTS)
    assert thrice.value == pytest.approx(alone.value)
    assert thrice.high - thrice.low == pytest.approx(alone.high - alone.low, rel=0.05)


def test_the_usual_spread_is_the_median_of_the_configurations():
    found = seed_spread([[0.5, 0.7], [0.8, 0.82, 0.84], [0.1], [0.9, 0.9]])
    assert found == pytest.approx(SeedSpread(0.02, 4))
    assert seed_spread([[0.5], [0.6]]) is None


def test_the_spread_between_trainings_widens_the_interval_in_squares():
    hits = np.full((4, 1, 10), 40)
    narrow, wide = pooled_trainings(hits, SHOTS), pooled_trainings(hits, SHOTS, SeedSpread(0.05, 6))
    by_seed = stats.t.ppf(0.975, 6) * 0.05 / 2
    assert wide.value - wide.low == pytest.approx(np.hypot(narrow.value - narrow.low, by_seed))
    assert wide.high - wide.value == pytest.approx(np.hypot(narrow.high - narrow.value, by_seed))


def test_an_unsteady_configuration_has_its_own_spread():
    hits = np.stack([np.full((1, 10), 20), np.full((1, 10), 45)])
    own = np.std([0.4, 0.9], ddof=1)
    found, alone = pooled_trainings(hits, SHOTS, SeedSpread(0.01, 9)), pooled_trainings(hits, SHOTS)
    by_seed = stats.t.ppf(0.975, 9) * own / np.sqrt(2)
    assert found.value - found.low == pytest.approx(np.hypot(alone.value - alone.low, by_seed))


def test_the_interval_holds_the_rate_of_trainings_to_come():
    # Of 200 sweeps at 95 %, fewer than 180 hold the true rate with a probability below 0.3 %.
    held = 0
    for seed in range(200):
        groups = [drawn((seed, k), 4, between=0.03, rate=0.7) for k in range(5)]
        spread = seed_spread([list(each.mean(axis=(1, 2)) / SHOTS) for each in groups])
        found = pooled_trainings(groups[0], SHOTS, spread)
        held += found.low <= 0.7 <= found.high
    assert held >= 180


@pytest.mark.parametrize("hits", [np.zeros((0, 2, 3), int), np.full((1, 1, 2), 51), np.full((2, 2), 3)])
def test_what_are_no_hits_is_refused(hits):
    with pytest.raises(InputError, match="hits must be"):
        pooled_trainings(hits, SHOTS)
