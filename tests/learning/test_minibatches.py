import jax
import numpy as np
import pytest
from scipy import stats

from archerfish.learning.minibatches import shuffled_minibatches


@pytest.mark.parametrize(("rows", "parts"), [(32, 2), (100, 4), (12_800, 8), (1, 1)])
def test_every_epoch_meets_every_row_once(rows: int, parts: int) -> None:
    dealt = np.asarray(shuffled_minibatches(jax.random.key(0), rows, 3, parts))
    assert dealt.shape == (3, parts, rows // parts)
    for epoch in dealt.reshape(3, rows):
        np.testing.assert_array_equal(np.sort(epoch), np.arange(rows))


def test_epochs_and_keys_differ() -> None:
    first, second = (np.asarray(shuffled_minibatches(jax.random.key(seed), 1000, 2, 1))[:, 0] for seed in (0, 1))
    orders = [*first, *second]
    assert all(np.mean(a == b) < 0.01 for i, a in enumerate(orders) for b in orders[:i])


def test_a_row_comes_to_any_place_equally_often() -> None:
    # χ² of 8 rows × 8 places over 4000 shuffles; 49 degrees of freedom, false alarm for one seed in a thousand.
    places = np.asarray(shuffled_minibatches(jax.random.key(3), 8, 4000, 1))[:, 0]
    counts = np.array([np.bincount(places[:, place], minlength=8) for place in range(8)])
    statistic = np.sum((counts - 500.0) ** 2 / 500.0)
    assert statistic < stats.chi2.ppf(0.999, 49)
