import numpy as np
import pytest

from archerfish.evaluation.hit_rate import hit_rate, paired_difference
from archerfish.evaluation.pooling import pooled_cells, pooled_differences
from archerfish.evaluation.results import Cell, Comparison

LABEL = {"table": "IV", "setting": "sentry", "target": "static", "command_limit": "gate"}


def cell(hit: np.ndarray, index: int) -> Cell:
    found, missed = hit_rate(hit), int((~hit).sum())
    label = {**LABEL, "range_m": (index + 1.0, index + 2.0), "controller": "kalman"}
    return Cell(**label, **found._asdict(), misses_slewing=missed, misses_settled=0)


def comparison(first: np.ndarray, second: np.ndarray, index: int) -> Comparison:
    label = {**LABEL, "range_m": (index + 1.0, index + 2.0), "controller": "history", "against": "kalman"}
    return Comparison(**label, **paired_difference(first, second)._asdict())


def test_one_cell_keeps_its_interval():
    alone = cell(np.random.default_rng(1).random((40, 50)) < 0.8, 0)
    assert pooled_cells([alone]) == pytest.approx((alone.rate, alone.low, alone.high), abs=1e-12)


def test_cells_of_unequal_size_count_by_their_shots():
    generator = np.random.default_rng(2)
    large, small = (generator.random((size, 50)) < rate for size, rate in ((60, 0.9), (20, 0.5)))
    found = pooled_cells([cell(large, 0), cell(small, 1)])
    assert found is not None
    assert found.value == pytest.approx((large.sum() + small.sum()) / (large.size + small.size))


def test_four_like_differences_halve_the_interval():
    same = Comparison(
        **LABEL, range_m=(1, 2), controller="history", against="kalman", difference=0.02, low=-0.01, high=0.07
    )
    assert pooled_differences([same] * 4) == pytest.approx((0.02, 0.02 - 0.03 / 2, 0.02 + 0.05 / 2))


def test_nothing_pools_to_nothing():
    assert pooled_cells([]) is None
    assert pooled_differences([]) is None


def test_the_intervals_hold_the_truth_about_as_often_as_they_say():
    # 400 runs of 4 cells: at a coverage of 94 % or more, fewer than 91 % held would be a false alarm of one in 100.
    generator, held = np.random.default_rng(5), np.zeros(2)
    rates = np.array([0.95, 0.9, 0.85, 0.7])
    for _ in range(400):
        luck = generator.beta(20 * rates, 20 * (1 - rates), (40, 4))
        first = generator.random((50, 40, 4)) < luck
        second = generator.random((50, 40, 4)) < luck - 0.05
        a, b = (np.moveaxis(each, 0, 1) for each in (first, second))
        rate = pooled_cells([cell(a[..., each], each) for each in range(4)])
        less = pooled_differences([comparison(a[..., each], b[..., each], each) for each in range(4)])
        assert rate is not None
        assert less is not None
        truth = float(np.mean(luck - np.clip(luck - 0.05, 0, 1)))
        held += [rate.low <= rates.mean() <= rate.high, less.low <= truth <= less.high]
    assert np.all(held / 400 > 0.91)
