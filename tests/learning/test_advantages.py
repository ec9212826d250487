import jax.numpy as jnp
import numpy as np

from archerfish.learning.advantages import advantages


def column(*values: float) -> jnp.ndarray:
    return jnp.array(values)[:, None]


NOWHERE = column(0, 0, 0, 0).astype(bool)


def test_terminated_and_truncated_steps_by_hand() -> None:
    # γ = λ = 1/2. The second step terminates, the third truncates; V(s') of a truncated step is that of the final
    # observation (6), although the next row belongs to another episode.
    #
    #   t  r  V(s)  V(s')  ended       δ = r + γ V(s') − V(s)       A = δ + γ λ A[t+1]
    #   3  4   2     8                 4 + ½·8 − 2 = 6              6
    #   2  3   2     6     truncated   3 + ½·6 − 2 = 4              4        trace cut
    #   1  2   1     7     terminated  2 + 0   − 1 = 1              1        trace cut, no bootstrap
    #   0  1   1     1                 1 + ½·1 − 1 = ½              ½ + ¼·1 = ¾
    found = advantages(
        rewards=column(1, 2, 3, 4),
        values=column(1, 1, 2, 2),
        next_values=column(1, 7, 6, 8),
        terminated=column(0, 1, 0, 0).astype(bool),
        truncated=column(0, 0, 1, 0).astype(bool),
        discount=0.5,
        trace=0.5,
    )
    np.testing.assert_array_equal(found[:, 0], [0.75, 1, 4, 6])


def test_without_trace_they_are_temporal_differences() -> None:
    found = advantages(
        column(1, 2, 3, 4), column(5, 6, 7, 8), column(6, 7, 8, 9), NOWHERE, NOWHERE, discount=0.9, trace=0.0
    )
    np.testing.assert_allclose(found[:, 0], [1 + 5.4 - 5, 2 + 6.3 - 6, 3 + 7.2 - 7, 4 + 8.1 - 8], rtol=1e-6)


def test_with_a_full_trace_they_are_discounted_returns_less_the_value() -> None:
    rewards, values = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0])
    following = np.append(values[1:], 9.0)
    returns = [sum(0.9 ** (k - t) * rewards[k] for k in range(t, 4)) + 0.9 ** (4 - t) * 9.0 for t in range(4)]
    found = advantages(column(*rewards), column(*values), column(*following), NOWHERE, NOWHERE, discount=0.9, trace=1.0)
    np.testing.assert_allclose(found[:, 0], returns - values, rtol=1e-6)


def test_members_of_a_batch_do_not_mix() -> None:
    rng = np.random.default_rng(3)
    rewards, values, following = rng.standard_normal((3, 6, 4)).astype(np.float32)
    terminated, truncated = rng.random((2, 6, 4)) < 0.2
    arrays = (rewards, values, following, terminated, truncated)
    together = advantages(*map(jnp.asarray, arrays), 0.9, 0.95)
    for member in range(4):
        alone = advantages(*(jnp.asarray(each[:, member : member + 1]) for each in arrays), 0.9, 0.95)
        np.testing.assert_allclose(together[:, member], alone[:, 0], rtol=1e-6)
