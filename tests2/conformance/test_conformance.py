import numpy as np

from archerfish2.arrays import leaves, map_arrays
from archerfish2.evaluation import rollout


def test_numpy_and_jax_have_equal_outcomes(conformance, batch, monkeypatch) -> None:
    given = *conformance.build(), *conformance.engagements(batch, 100)
    compiled = rollout.run_engagements(*given)
    monkeypatch.setattr(rollout, "has_jax", lambda: False)
    plain = rollout.run_engagements(*given)
    assert map_arrays(np.shape, compiled) == map_arrays(np.shape, plain)
    for ours, theirs in zip(*(leaves((each.shot, each.seen.frames)) for each in (plain, compiled)), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-3)
    np.testing.assert_array_equal(compiled.shot.margin >= 0.0, plain.shot.margin >= 0.0)


def test_pellets_hit_all_plates_and_none_is_fired_long_after_the_last_detection(conformance, monkeypatch) -> None:
    monkeypatch.setattr(rollout, "has_jax", lambda: False)
    seen, _, in_force, shot = rollout.run_engagements(*conformance.build(), *conformance.engagements((12,), 100))
    assert np.bincount(shot.plate[shot.fired & (shot.margin >= 0.0)], minlength=4).min() > 30
    assert (shot.plate[~shot.fired] == -1).all()
    assert 0.8 < seen.frames.received.mean() < 0.95
    newest, age = np.where(seen.frames.found.any(-1), seen.frames.age, np.inf).min(-1), np.ones(12)
    for place in range(100):
        age = np.minimum(age + seen.elapsed[:, place], newest[:, place])
        assert np.abs(age - 0.3).min() > 1e-4
        np.testing.assert_array_equal(shot.fired[:, place], age < 0.3)
    assert 0.3 < shot.fired.mean() < 0.7
    assert np.abs(in_force[..., 1] - seen.base.yaw - 0.02 * seen.base.yaw_rate).max() < np.radians(75.001)
