import numpy as np
import pytest

from archerfish2.arrays import leaves, map_arrays
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
    compiled = rollout.run_engagements(*conformance.build(), *conformance.engagements(batch, DECISIONS))
    plain = in_numpy(batch)
    assert map_arrays(np.shape, compiled) == map_arrays(np.shape, plain)
    for ours, theirs in zip(*(leaves((each.shot, each.seen.frames)) for each in (plain, compiled)), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-3)
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
    assert np.abs(in_force[..., 1] - seen.base.yaw - 0.02 * seen.base.yaw_rate).max() < np.radians(75.001)
