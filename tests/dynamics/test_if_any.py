import numpy as np
import pytest

from archerfish.dynamics.array_namespace import if_any


@pytest.mark.parametrize(("condition", "expected"), [([False, True], 1.0), ([False, False], 2.0)])
def test_one_of_two_is_chosen_in_numpy_and_jax(condition, expected):
    jax = pytest.importorskip("jax")
    chosen = np.asarray(condition)
    assert if_any(chosen, lambda: (np.float32(1.0),), lambda: (np.float32(2.0),)) == (expected,)

    def choose(condition):
        return if_any(condition, lambda: (jax.numpy.float32(1.0),), lambda: (jax.numpy.float32(2.0),))

    assert jax.jit(choose)(chosen) == (expected,)
    assert list(jax.vmap(choose)(chosen[:, None])[0]) == [1.0 if each else 2.0 for each in condition]
