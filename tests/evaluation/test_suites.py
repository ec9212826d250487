import numpy as np
import pytest

from archerfish.evaluation.suites import PURPOSES, draw_trials, table_suites
from archerfish.paper.conditions import assumed_conditions

CONDITIONS = assumed_conditions()
SUITES = table_suites(CONDITIONS)


def test_there_is_one_suite_for_each_cell_of_tables_ii_and_iii() -> None:
    bins = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0))
    expected = [(table, target, each) for table, target in (("II", "static"), ("III", "dynamic")) for each in bins]
    assert [(suite.table, suite.target, suite.range_m) for suite in SUITES] == expected


def test_engagements_lie_in_the_range_of_their_suite_and_move_as_it_says() -> None:
    trials = draw_trials(SUITES, engagements=200, decisions=3, seed=0)
    vertex = trials.engagements.motion.vertex.reshape(8, 200, 3)
    speed = trials.engagements.motion.speed.reshape(8, 200)
    for index, suite in enumerate(SUITES):
        low, high = suite.range_m
        assert low <= vertex[index, :, 0].min() < low + 0.1
        assert high - 0.1 < vertex[index, :, 0].max() <= high
        assert np.abs(vertex[index, :, 1]).max() <= CONDITIONS.max_lateral_offset
        assert np.all(speed[index] == 0) if suite.target == "static" else np.all(speed[index] > 0)
        assert speed[index].max() <= CONDITIONS.max_lateral_speed
    assert trials.draws.shape == (1600, 3, 6)


def test_the_same_seed_draws_the_same_for_every_controller() -> None:
    once, again = (draw_trials(SUITES, 5, 4, seed=3) for _ in range(2))
    np.testing.assert_array_equal(once.draws, again.draws)
    np.testing.assert_array_equal(once.engagements.motion.vertex, again.engagements.motion.vertex)


def test_no_two_streams_share_a_draw() -> None:
    streams = [draw_trials(SUITES, 20, 10, seed, purpose) for purpose in PURPOSES for seed in (0, 1)]
    for arrays in ([each.draws for each in streams], [each.engagements.motion.vertex for each in streams]):
        pooled = np.concatenate([np.unique(each) for each in arrays])
        # 28,800 draws in float32: some coincide by chance, a shared stream would repeat a sixth of them or more.
        assert len(np.unique(pooled)) > 0.98 * len(pooled) - 1
    assert set(PURPOSES) == {"evaluation", "tuning", "calibration", "stopping"}


def test_suites_of_one_trial_do_not_share_their_draws() -> None:
    draws = draw_trials(SUITES, 20, 10, seed=0).draws.reshape(8, -1)
    assert np.abs(np.corrcoef(draws)[np.triu_indices(8, 1)]).max() < 0.15


@pytest.mark.parametrize("plants", [1, 4])
def test_engagements_choose_among_the_plants_of_the_world(plants: int) -> None:
    trials = draw_trials(table_suites(CONDITIONS, plants), 100, 1, seed=0)
    assert set(np.unique(trials.engagements.plant)) == set(range(plants))
