import numpy as np
import pytest
from numpy.testing import assert_allclose

jax = pytest.importorskip("jax")

from archerfish.simulation.assembly import make_environment  # noqa: E402
from archerfish.simulation.environment import ShootingEnvironment  # noqa: E402
from archerfish.simulation.functional import reset, step  # noqa: E402

LENGTH = 6


@pytest.fixture(scope="module")
def environment() -> ShootingEnvironment:
    return make_environment(decisions=LENGTH)


def test_many_under_vmap_are_each_what_one_is_alone(environment: ShootingEnvironment, quick_jit) -> None:
    keys = jax.random.split(jax.random.key(0), 4)
    action = np.array([0.2, -0.4], np.float32)
    alone = [quick_jit(step)(quick_jit(reset)(key, environment)[0], action, key, environment)[1] for key in keys]

    @quick_jit
    def together(keys, environment):
        state, _ = jax.vmap(reset, (0, None))(keys, environment)
        return jax.vmap(step, (0, None, 0, None))(state, action, keys, environment)[1]

    for ours, theirs in zip(together(keys, environment), zip(*alone, strict=True), strict=True):
        assert_allclose(ours, np.stack(theirs), rtol=1e-4, atol=1e-4)


def test_it_runs_inside_a_scan_and_begins_anew_at_the_end(environment: ShootingEnvironment, quick_jit) -> None:
    @quick_jit
    def episode(key, environment):
        state, _ = reset(key, environment)
        keys = jax.random.split(key, 2 * LENGTH)
        return jax.lax.scan(lambda each, key: step(each, np.zeros(2), key, environment), state, keys)

    state, timesteps = episode(jax.random.key(1), environment)
    assert np.flatnonzero(timesteps.truncated).tolist() == [LENGTH - 1, 2 * LENGTH - 1]
    assert not timesteps.terminated.any()
    moved = np.any(timesteps.observation != timesteps.final_observation, axis=1)
    assert np.array_equal(moved, timesteps.truncated)
    assert int(state.step) == 0
    assert_allclose(timesteps.reward, -np.linalg.norm(timesteps.miss, axis=-1), rtol=1e-5)


def test_the_environment_may_be_mapped_over(environment: ShootingEnvironment, quick_jit) -> None:
    key, lengths = jax.random.key(2), np.array([1, LENGTH])
    axes = jax.tree.map(lambda _: None, environment)._replace(length=0)
    several = environment._replace(length=lengths)

    @quick_jit
    def ends(environment):
        def one(environment):
            return step(reset(key, environment)[0], np.zeros(2), key, environment)[1].truncated

        return jax.vmap(one, (axes,))(environment)

    assert ends(several).tolist() == [True, False]
