import jax
import jax.numpy as jnp
import numpy as np

from archerfish.learning.held_gradient import held


def loss(rows: jax.Array, limit: float) -> jax.Array:
    tree = {"rows": rows, "whole": jnp.arange(3), "factor": jnp.array([1.0, 1.0, 1.0])}
    kept = held(tree, jnp.asarray(limit))
    return jnp.sum(kept["factor"] * kept["rows"][:, 0] * kept["rows"][:, 1])


def test_the_value_is_left_as_it_is() -> None:
    rows = jnp.array([[3.0, 4.0], [0.3, 0.4], [1.0, 2.0]])
    assert float(loss(rows, 1.0)) == float(loss(rows, np.inf))


def test_each_row_is_scaled_by_itself_to_at_most_the_limit() -> None:
    # By hand: the gradient of a b f by (a, b, f) is (b f, a f, a b), of norm √(16 + 9 + 144) = 13 for a = 3, b = 4.
    gradient = jax.grad(loss)(jnp.array([[3.0, 4.0], [0.3, 0.4], [0.0, 0.0]]), 1.0)
    np.testing.assert_allclose(gradient, [[4 / 13, 3 / 13], [0.4, 0.3], [0.0, 0.0]], rtol=1e-6)


def test_an_infinite_limit_leaves_the_gradient_as_it_is() -> None:
    gradient = jax.grad(loss)(jnp.array([[3.0, 4.0], [0.3, 0.4], [0.0, 0.0]]), np.inf)
    np.testing.assert_allclose(gradient, [[4.0, 3.0], [0.4, 0.3], [0.0, 0.0]], rtol=1e-6)
