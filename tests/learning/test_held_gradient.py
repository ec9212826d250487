import jax
import jax.numpy as jnp
import numpy as np

from archerfish.learning.held_gradient import held

ROWS = np.array([[3.0, 4.0], [0.3, 0.4], [0.0, 0.0]], np.float32)


def loss(rows: jax.Array, limit: float) -> jax.Array:
    kept = held(rows, jnp.asarray(limit))
    return jnp.sum(kept[:, 0] * kept[:, 1])


def test_the_value_is_left_as_it_is() -> None:
    np.testing.assert_array_equal(held(jnp.array(ROWS), jnp.asarray(1e-3)), ROWS)


def test_each_row_is_scaled_by_itself_to_at_most_the_limit() -> None:
    # By hand: the gradient of a b is (b, a), of norm 5 for a = 3, b = 4.
    gradient = jax.grad(loss)(jnp.array(ROWS), 1.0)
    np.testing.assert_allclose(gradient, [[0.8, 0.6], [0.4, 0.3], [0.0, 0.0]], rtol=1e-6)


def test_an_infinite_limit_leaves_the_gradient_as_it_is() -> None:
    gradient = jax.grad(loss)(jnp.array(ROWS), np.inf)
    np.testing.assert_allclose(gradient, ROWS[:, ::-1], rtol=1e-6)
