"""Rollouts in the conformance world, compiled and not."""

from types import SimpleNamespace

import numpy as np
import pytest

from archerfish.arrays import leaves, map_arrays, namespace, tree
from archerfish.evaluation import rollout, run
from archerfish.protocols import aim


def in_numpy(inside):
    """Return a world or a controller as one that can't be compiled."""
    names = [name for name in dir(inside) if not name.startswith("_")]
    return SimpleNamespace(**{name: getattr(inside, name) for name in names} | {"compiled": False})


@tree()
class NoNumbers:
    """Commands NaN from a decision on."""

    place: float

    def reset(self, seen, truth=None):
        return 0.0 * seen.elapsed

    def step(self, state, seen):
        return state + 1.0, aim(seen.command + namespace(state).where(state < self.place, 0.0, float("nan"))[:, None])


def test_numpy_and_jax_have_equal_outcomes(conformance, batch, monkeypatch):
    given = *conformance.build(), *conformance.engagements(batch, 100)
    compiled = rollout.run_engagements(*given)
    monkeypatch.setattr(run, "has_jax", lambda: False)
    plain = rollout.run_engagements(*given)
    assert map_arrays(np.shape, compiled[:-1]) == map_arrays(np.shape, plain[:-1])
    for ours, theirs in zip(*(leaves((each.shot, each.seen.frames)) for each in (plain, compiled)), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-3)
    np.testing.assert_array_equal(compiled.shot.margin >= 0.0, plain.shot.margin >= 0.0)


def test_pellets_hit_all_plates_and_none_is_fired_long_after_the_last_detection(conformance, monkeypatch):
    monkeypatch.setattr(run, "has_jax", lambda: False)
    shots = rollout.run_engagements(*conformance.build(), *conformance.engagements((12,), 100))
    seen, in_force, shot = shots.seen, shots.in_force, shots.shot
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


def test_the_shots_are_the_same_whatever_of_the_two_is_compiled(conformance):
    (world, controller), drawn = conformance.build(), conformance.engagements((3,), 100)
    expected, counted = rollout.run_engagements(world, controller, *drawn), run.count(world, controller, *drawn)
    plain, aiming = in_numpy(world), in_numpy(controller)
    for pair in ((plain, controller), (world, aiming), (plain, aiming)):
        found, again = rollout.run_engagements(*pair, *drawn), run.count(*pair, *drawn)
        np.testing.assert_allclose(found.in_force, expected.in_force, atol=1e-4)
        assert again.yaw_acceleration == pytest.approx(counted.yaw_acceleration, rel=1e-2)
        for fired, hit in ((shots.fired, shots.fired & (shots.margin >= 0.0)) for shots in (found.shot, expected.shot)):
            np.testing.assert_array_equal([[fired, hit], counted[:2]], [again[:2]] * 2)


def test_a_compiled_command_that_is_not_finite_is_refused(conformance, refused):
    world, controller = conformance.build()[0], NoNumbers(np.float32(2.0))
    complaint = "commands a pitch of nan rad at decision 3, in 3 of 3 engagements"
    refused(complaint, run.count, world, controller, *conformance.engagements((3,), 5))


def test_a_trajectory_is_a_row_per_decision_for_a_data_frame(conformance, monkeypatch):
    monkeypatch.setattr(run, "has_jax", lambda: False)
    shots = rollout.run_engagements(*conformance.build(), *conformance.engagements((3,), 20))
    rows = shots.to_dicts()
    assert [(row["engagement"], row["decision"]) for row in rows] == list(np.ndindex(3, 20))
    np.testing.assert_allclose([row["command_yaw_rad"] for row in rows], shots.command.angle[..., 1].ravel())
    np.testing.assert_allclose([row["target_z_m"] for row in rows], shots.target[..., 2].ravel())
    assert [row["hit"] for row in rows] == shots.hit.ravel().tolist()


def test_an_engagement_that_is_not_there_is_not_drawn(conformance, monkeypatch, refused):
    monkeypatch.setattr(run, "has_jax", lambda: False)
    shots = rollout.run_engagements(*conformance.build(), *conformance.engagements((3,), 20))
    refused("plot: engagement must be 0…2, got 9", shots.plot, 9)
