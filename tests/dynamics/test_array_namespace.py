from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.array_namespace import lift, map_arrays, namespace, repeat, single_precision


class Pair(NamedTuple):
    left: object
    right: object


def test_plain_numbers_and_arrays_are_numpys() -> None:
    assert namespace(1.0) is np
    assert namespace(np.ones(2), 3) is np


def test_jax_wins_over_numpy() -> None:
    jnp = pytest.importorskip("jax.numpy")
    assert namespace(np.ones(2), jnp.ones(2)).__name__ == "jax.numpy"


def test_lift_adds_leading_dimensions_and_takes_none_away() -> None:
    assert lift(np.ones(2), np.ones((5, 4, 2))).shape == (1, 1, 2)
    assert lift(np.ones((4, 2)), np.ones(2)).shape == (4, 2)


def test_trees_keep_their_kinds() -> None:
    tree = Pair(np.ones(2), (np.zeros(1), Pair(np.ones(()), np.ones(3))))
    doubled = map_arrays(lambda a, b: a + b, tree, tree)
    assert isinstance(doubled, Pair)
    assert isinstance(doubled.right[1], Pair)
    assert_allclose(doubled.right[1].right, 2.0)


def test_single_precision_leaves_counts_alone() -> None:
    tree = single_precision(Pair(np.ones(2), np.arange(3)))
    assert tree.left.dtype == np.float32
    assert tree.right.dtype == np.arange(3).dtype


def test_repeat_is_a_loop_in_both(agree_in_jax) -> None:
    def fibonacci(pair: Pair) -> Pair:
        return repeat(lambda each: Pair(each.right, each.left + each.right), 10, pair)

    assert fibonacci(Pair(0, 1)) == (55, 89)
    agree_in_jax(fibonacci, Pair(np.zeros(3), np.ones(3)))
