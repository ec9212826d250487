import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from archerfish.evaluation.hit_rate import hit_rate, paired_difference, split_misses
from archerfish.records.errors import InputError

SHOTS = 50
REPETITIONS = 1500
THREE_SIGMA = 3 * math.sqrt(0.95 * 0.05 / REPETITIONS)
"""A true coverage of 95 % falls short of 0.95 − THREE_SIGMA once in 740 seeds; the seed is fixed."""


def engagements_with_hits(counts: list[int], shots: int = SHOTS) -> NDArray[np.bool_]:
    return np.arange(shots) < np.array(counts)[:, None]


def beta_binomial(
    generator: np.random.Generator, rate: float, correlation: float, engagements: int
) -> NDArray[np.bool_]:
    spread = 1 / correlation - 1
    rates = generator.beta(rate * spread, (1 - rate) * spread, (REPETITIONS, engagements, 1))
    return generator.random((REPETITIONS, engagements, SHOTS)) < rates


def test_counts_are_those_of_the_table() -> None:
    found = hit_rate(engagements_with_hits([50, 40, 30]))
    assert (found.hits, found.shots, found.engagements) == (120, 150, 3)
    assert found.rate == 0.8
    assert found.low < 0.8 < found.high


@pytest.mark.parametrize(("rate", "engagements"), [(0.5, 40), (0.8, 20), (0.95, 100), (0.99, 40), (0.99, 100)])
@pytest.mark.parametrize("correlation", [0.01, 0.1])
def test_interval_holds_the_true_rate_of_correlated_shots(rate: float, engagements: int, correlation: float) -> None:
    trials = beta_binomial(np.random.default_rng(7), rate, correlation, engagements)
    found = [hit_rate(hit) for hit in trials]
    held = np.mean([each.low <= rate <= each.high for each in found])
    assert held >= 0.95 - THREE_SIGMA


def test_interval_holds_a_rate_near_one_when_whole_engagements_fail() -> None:
    """Hardest of all: misses are so rare and so bunched that many samples have seen no bad engagement."""
    trials = beta_binomial(np.random.default_rng(7), 0.99, 0.3, 40)
    held = np.mean([each.low <= 0.99 <= each.high for each in map(hit_rate, trials)])
    assert held >= 0.95 - THREE_SIGMA


def test_interval_of_independent_shots_is_wilsons() -> None:
    hit = np.random.default_rng(3).random((2000, 1)) < 0.7
    found = hit_rate(hit)
    wilson = stats.binomtest(found.hits, found.shots).proportion_ci(method="wilson")
    assert found.low == pytest.approx(wilson.low, abs=2e-4)
    assert found.high == pytest.approx(wilson.high, abs=2e-4)


def test_shots_that_always_agree_count_as_one() -> None:
    outcome = np.random.default_rng(4).random((400, 1)) < 0.7
    once, fiftyfold = hit_rate(outcome), hit_rate(np.repeat(outcome, SHOTS, axis=1))
    assert fiftyfold.low == pytest.approx(once.low, abs=1e-3)
    assert fiftyfold.high == pytest.approx(once.high, abs=1e-3)


def test_without_a_miss_only_engagements_count() -> None:
    found = hit_rate(engagements_with_hits([SHOTS] * 500))
    assert found.high == 1.0
    # Wilson with 500 trials; the rule of three gives 1 − 3/500 = 0.994.
    assert found.low == pytest.approx(1 - 1.9647**2 / (500 + 1.9647**2), abs=1e-5)


def test_a_first_miss_does_not_narrow_the_interval_by_a_jump() -> None:
    none, one = (hit_rate(engagements_with_hits([SHOTS - misses] + [SHOTS] * 499)) for misses in (0, 1))
    assert 0.5 < (one.high - one.low) / (none.high - none.low) < 1


def test_interval_of_misses_mirrors_that_of_hits() -> None:
    hit = engagements_with_hits([50, 49, 31, 50])
    found, mirrored = hit_rate(hit), hit_rate(~hit)
    assert (mirrored.low, mirrored.high) == pytest.approx((1 - found.high, 1 - found.low))


@pytest.mark.parametrize(("missing", "hitting"), [(0.2, 0.9), (0.05, 0.95)])
def test_paired_interval_holds_the_true_difference(missing: float, hitting: float) -> None:
    generator = np.random.default_rng(11)
    a = beta_binomial(generator, 1 - missing, 0.1, 40)
    # b hits where a does, but for a share that changes from engagement to engagement.
    b = a & beta_binomial(generator, hitting, 0.1, 40)
    truth = (1 - missing) * (1 - hitting)
    found = [paired_difference(first, second) for first, second in zip(a, b, strict=True)]
    assert np.mean([each.low <= truth <= each.high for each in found]) >= 0.95 - THREE_SIGMA


def test_false_alarms_of_equal_controllers_stay_below_five_percent() -> None:
    generator = np.random.default_rng(12)
    a, b = (beta_binomial(generator, 0.98, 0.1, 40) for _ in range(2))
    found = [paired_difference(first, second) for first, second in zip(a, b, strict=True)]
    assert np.mean([each.low > 0 or each.high < 0 for each in found]) <= 0.05 + THREE_SIGMA


def test_paired_difference_is_scipys_t_interval_when_the_spread_is_real() -> None:
    generator = np.random.default_rng(13)
    a, b = generator.random((2, 200, SHOTS)) < np.array([0.8, 0.6])[:, None, None]
    expected = stats.ttest_rel(a.mean(axis=1), b.mean(axis=1)).confidence_interval(0.95)
    found = paired_difference(a, b)
    assert found.difference == pytest.approx(a.mean() - b.mean())
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-3)


def test_pairing_narrows_the_interval_when_engagements_are_unequal() -> None:
    generator = np.random.default_rng(14)
    a = generator.random((100, SHOTS)) < np.repeat([0.2, 1.0], 50)[:, None]
    b = a & (generator.random(a.shape) < 0.9)
    paired, shuffled = paired_difference(a, b), paired_difference(a, generator.permutation(b))
    assert paired.high - paired.low < 0.5 * (shuffled.high - shuffled.low)


def test_controllers_that_never_differed_are_not_declared_equal() -> None:
    hit = engagements_with_hits([SHOTS, 40] * 20)
    found = paired_difference(hit, hit)
    assert found.difference == 0
    assert found.low < 0 < found.high


def test_a_miss_at_half_a_second_is_settled() -> None:
    times = 0.02 * np.arange(SHOTS)
    hit = np.ones((2, SHOTS), dtype=bool)
    hit[0, [0, 24, 25]] = False
    hit[1, [24, 49]] = False
    assert split_misses(hit, times, 0.5) == (3, 2)
    assert split_misses(hit, np.cumsum(np.full(SHOTS, 0.02)) - 0.02, 0.5) == (3, 2)
    assert split_misses(hit, np.broadcast_to(times, hit.shape), 0.5) == (3, 2)


def gated(
    generator: np.random.Generator, rate: float, engagements: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], float]:
    """Hits and shots of a controller that fires the more, the better its chances in an engagement, and its true rate.

    Chances are beta distributed with a correlation of 0.1, and one decision in ten to nine in ten fire, by chance.
    """
    chance = generator.beta(9 * rate, 9 * (1 - rate), (REPETITIONS, engagements, 1))
    fired = generator.random((REPETITIONS, engagements, SHOTS)) < 0.1 + 0.8 * chance**2
    a, b = 9 * rate, 9 * (1 - rate)
    moments = np.cumprod([(a + k) / (a + b + k) for k in range(3)])
    truth = (0.1 * moments[0] + 0.8 * moments[2]) / (0.1 + 0.8 * moments[1])
    return fired & (generator.random(fired.shape) < chance), fired, float(truth)


def test_if_every_decision_fires_nothing_changes() -> None:
    a, b = beta_binomial(np.random.default_rng(21), 0.8, 0.1, 40)[:2]
    all_of_them = np.ones(a.shape, bool)
    assert hit_rate(a, all_of_them) == hit_rate(a)
    assert paired_difference(a, b, all_of_them, all_of_them) == paired_difference(a, b)
    times = 0.02 * np.arange(SHOTS)
    assert split_misses(a, times, 0.5, all_of_them) == split_misses(a, times, 0.5)


def test_a_decision_that_does_not_fire_is_no_shot() -> None:
    fired = np.random.default_rng(22).random((4, SHOTS)) < 0.3
    hit = fired & (np.arange(SHOTS) % 3 > 0)
    found = hit_rate(hit, fired)
    assert (found.hits, found.shots, found.engagements) == (hit.sum(), fired.sum(), 4)
    assert sum(split_misses(hit, 0.02 * np.arange(SHOTS), 0.5, fired)) == fired.sum() - hit.sum()


@pytest.mark.parametrize(("rate", "engagements"), [(0.5, 40), (0.8, 20)])
def test_interval_holds_the_true_ratio_where_the_number_of_shots_goes_with_the_chances(
    rate: float, engagements: int
) -> None:
    hit, fired, truth = gated(np.random.default_rng(23), rate, engagements)
    found = [hit_rate(*each) for each in zip(hit, fired, strict=True)]
    assert np.mean([each.low <= truth <= each.high for each in found]) >= 0.95 - THREE_SIGMA


@pytest.mark.parametrize("engagements", [20, 60])
def test_paired_interval_holds_the_difference_of_ratios_of_unequal_numbers_of_shots(engagements: int) -> None:
    generator = np.random.default_rng(24)
    hit, fired, truth = gated(generator, 0.7, engagements)
    # The other one fires at half of these decisions, and misses one in five of those hits.
    fired_b = fired & (generator.random(fired.shape) < 0.5)
    hit_b = hit & fired_b & (generator.random(fired.shape) < 0.8)
    found = [paired_difference(*each) for each in zip(hit, hit_b, fired, fired_b, strict=True)]
    held = np.mean([each.low <= 0.2 * truth <= each.high for each in found])
    assert held >= 0.95 - THREE_SIGMA


def test_engagements_without_a_shot_change_no_interval() -> None:
    hit, fired, _ = gated(np.random.default_rng(25), 0.8, 30)
    silent = np.zeros((70, SHOTS), bool)
    more, more_fired = np.concatenate([hit[0], silent]), np.concatenate([fired[0], silent])
    assert hit_rate(more, more_fired)[3:] == hit_rate(hit[0], fired[0])[3:]
    ours, theirs = (paired_difference(*each) for each in ((hit[0], hit[0], fired[0], fired[0]),
                                                          (more, more, more_fired, more_fired)))  # fmt: skip
    assert ours == pytest.approx(theirs)


@pytest.mark.parametrize("shooting", [0, 1])
def test_shots_in_fewer_than_two_engagements_leave_everything_open(shooting: int) -> None:
    fired = np.zeros((5, SHOTS), bool)
    fired[:shooting] = True
    found = hit_rate(fired, fired)
    assert (found.hits, found.shots, found.low, found.high) == (shooting * SHOTS, shooting * SHOTS, 0.0, 1.0)
    assert math.isnan(found.rate) == (shooting == 0)
    against = paired_difference(fired, np.zeros((5, SHOTS), bool), fired, np.ones((5, SHOTS), bool))
    assert (against.low, against.high) == (-1.0, 1.0)
    assert math.isnan(against.difference) == (shooting == 0)


def test_hits_without_shots_are_refused() -> None:
    hit = np.ones((3, SHOTS), bool)
    with pytest.raises(InputError, match="150 decisions hit without firing"):
        hit_rate(hit, ~hit)
    with pytest.raises(InputError, match=r"fired must be booleans of shape \(3, 50\), got bool of shape \(2, 50\)"):
        hit_rate(hit, hit[:2])
    with pytest.raises(InputError, match=r"got float64 of shape \(3, 50\)"):
        hit_rate(hit, np.ones((3, SHOTS)))


@pytest.mark.parametrize(
    ("hit", "message"),
    [
        (np.ones((4, 5)), "booleans of shape .* got float64"),
        (np.ones(5, dtype=bool), r"got bool of shape \(5,\)"),
        (np.ones((1, 5), dtype=bool), "hit has 1 engagements of 5 shots"),
        (np.ones((3, 0), dtype=bool), "3 engagements of 0 shots"),
    ],
)
def test_what_is_no_table_of_hits_is_refused(hit: NDArray[np.bool_], message: str) -> None:
    with pytest.raises(InputError, match=message):
        hit_rate(hit)


def test_unequal_tables_are_refused() -> None:
    hit = np.ones((3, SHOTS), dtype=bool)
    with pytest.raises(InputError, match=r"same engagements, got shapes \(3, 50\) and \(2, 50\)"):
        paired_difference(hit, hit[:2])
    with pytest.raises(InputError, match=r"shot_time must have shape \(50,\)"):
        split_misses(hit, np.zeros(49), 0.5)
