import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.virtual_robot.noise import PURPOSES, NoiseStream, check_seeds


def stream(*seeds: int, purpose: str = "gyro", block: int = 8) -> NoiseStream:
    return NoiseStream(np.array(seeds), purpose, 2, "normal", block)


def test_a_trials_numbers_depend_on_its_seed_alone() -> None:
    alone, company = stream(7), stream(3, 7, 9)
    np.testing.assert_array_equal(alone.rows(0, 50)[:, 0], company.rows(0, 50)[:, 1])
    again = stream(7, 7).rows(0, 5)
    np.testing.assert_array_equal(again[:, 0], again[:, 1])


def test_rows_are_the_same_however_they_are_fetched() -> None:
    whole = stream(5, block=64).rows(0, 40)
    pieces = stream(5, block=4)
    np.testing.assert_array_equal(np.concatenate([pieces.rows(k, 5) for k in range(0, 40, 5)]), whole)
    singles = stream(5, block=3)
    np.testing.assert_array_equal(np.stack([singles.rows_at(np.array([[k]]))[0, 0] for k in range(40)]), whole[:, 0])


def test_each_trial_may_be_at_its_own_row() -> None:
    whole = stream(1, 2).rows(0, 20)
    found = stream(1, 2).rows_at(np.array([[3, 4], [10, 11]]))
    np.testing.assert_array_equal(found[0], whole[3:5, 0])
    np.testing.assert_array_equal(found[1], whole[10:12, 1])


def test_purposes_have_streams_of_their_own() -> None:
    drawn = [tuple(stream(1, purpose=purpose).rows(0, 1).ravel()) for purpose in PURPOSES]
    assert len(set(drawn)) == len(PURPOSES)


def test_long_runs_give_their_rows_back() -> None:
    noise = stream(1, block=16)
    for k in range(1000):
        noise.rows(k, 1)
    assert len(noise._rows) <= 32


@pytest.mark.parametrize("seeds", [[1], [1, 2, 3], [[1, 2]], [1.5, 2.0], [-1, 2]])
def test_seeds_that_are_not_one_whole_number_per_trial_are_refused(seeds: list[float]) -> None:
    with pytest.raises(InputError, match="seeds must be 2 whole numbers from 0 on"):
        check_seeds(np.array(seeds), 2)
