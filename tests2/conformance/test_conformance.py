import dataclasses

import numpy as np
import pytest

from archerfish2.arrays import map_arrays
from archerfish2.evaluation import rollout

DECISIONS = 100


@pytest.fixture(scope="module")
def in_numpy(conformance):
    """Let the controller shoot in NumPy, one decision after the other: in_numpy(batch)."""

    def run(batch):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rollout, "has_jax", lambda: False)
            return rollout.run_engagements(*conformance.build(), *conformance.engagements(batch, DECISIONS))

    return run


def test_numpy_and_jax_have_equal_outcomes(conformance, in_numpy, batch) -> None:
    plain = in_numpy(batch)
    compiled = rollout.run_engagements(*conformance.build(), *conformance.engagements(batch, DECISIONS))
    assert map_arrays(np.shape, compiled) == map_arrays(np.shape, plain)
    for ours, theirs in ((plain.shot, compiled.shot), (plain.seen.frames, compiled.seen.frames)):
        for name, each in ours._asdict().items():
            np.testing.assert_allclose(getattr(theirs, name), each, atol=1e-3, err_msg=name)
    np.testing.assert_array_equal(compiled.shot.margin >= 0.0, plain.shot.margin >= 0.0)


def test_pellets_hit_all_four_plates_and_nothing_is_fired_long_after_the_last_detection(in_numpy) -> None:
    seen, _, in_force, shot = in_numpy((12,))
    assert np.bincount(shot.plate[shot.fired & (shot.margin >= 0.0)], minlength=4).min() > 30
    assert (shot.plate[~shot.fired] == -1).all()
    newest, age = np.where(seen.frames.found.any(-1), seen.frames.age, np.inf).min(-1), np.ones(12)
    for place in range(DECISIONS):
        age = np.minimum(age + seen.elapsed[:, place], newest[:, place])
        assert np.abs(age - 0.3).min() > 1e-4
        np.testing.assert_array_equal(shot.fired[:, place], age < 0.3)
    assert 0.3 < shot.fired.mean() < 0.7
    yaw = seen.base.yaw + 0.02 * seen.base.yaw_rate
    assert np.abs(in_force[..., 1] - yaw).max() < np.radians(75.001)


def test_places_of_frames_that_are_not_used_are_zeros(in_numpy) -> None:
    received, age, found, position, normal_yaw = in_numpy((12,)).seen.frames
    assert 0.8 < received.mean() < 0.95
    assert not any(each.any() for each in (found[~received], age[~received], position[~found], normal_yaw[~found]))
    assert position[found].all()


@pytest.mark.slow  # 15 s to compile
def test_gradients_are_finite_through_world_and_controller(conformance, quick_jit) -> None:
    jax = pytest.importorskip("jax")
    engagement, normals = conformance.engagements((2,), 4)

    def loss(parts, drawn):
        world, controller, engagement = parts
        state = world.begin(engagement, drawn)

        def step(carry, each):
            memory, command = controller.step(carry[1], world.see(carry[0]))
            state, shot = world.step(carry[0], command, each)
            return (state, memory), jax.numpy.maximum(shot.margin, -1.0)

        return jax.lax.scan(step, (state, controller.reset(world.see(state))), drawn.swapaxes(0, 1))[1].mean()

    world, controller, engagement = jax.tree.map(jax.numpy.asarray, (*conformance.build(), engagement))
    gradient = quick_jit(jax.grad(loss, allow_int=True))((world, controller, engagement), normals)
    assert all(np.isfinite(each).all() for each in jax.tree.leaves(gradient) if each.dtype == np.float32)
    early, late = (dataclasses.replace(controller, lead=controller.lead + by) for by in (-1e-3, 1e-3))
    low, high = (float(quick_jit(loss)((world, each, engagement), normals)) for each in (early, late))
    assert float(gradient[1].lead) == pytest.approx((high - low) / 2e-3, rel=0.05)
