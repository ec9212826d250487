from types import SimpleNamespace

import numpy as np
import pytest

from archerfish2.arrays import namespace, tree
from archerfish2.evaluation.rollout import count, run_engagements
from archerfish2.protocols import aim


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


def test_the_shots_are_the_same_whatever_of_the_two_is_compiled(conformance):
    (world, controller), drawn = conformance.build(), conformance.engagements((3,), 100)
    expected, counted = run_engagements(world, controller, *drawn), count(world, controller, *drawn)
    plain, aiming = in_numpy(world), in_numpy(controller)
    for pair in ((plain, controller), (world, aiming), (plain, aiming)):
        found, again = run_engagements(*pair, *drawn), count(*pair, *drawn)
        np.testing.assert_allclose(found.in_force, expected.in_force, atol=1e-4)
        assert again.yaw_acceleration == pytest.approx(counted.yaw_acceleration, rel=1e-2)
        for fired, hit in ((shots.fired, shots.fired & (shots.margin >= 0.0)) for shots in (found.shot, expected.shot)):
            np.testing.assert_array_equal([[fired, hit], counted[:2]], [again[:2]] * 2)


@pytest.mark.parametrize("kind", [lambda each: each, in_numpy])
def test_a_command_that_is_not_finite_is_refused(conformance, kind, refused):
    world, controller = conformance.build()[0], kind(NoNumbers(np.float32(2.0)))
    complaint = "commands a pitch of nan rad at decision 3, in 3 of 3 engagements"
    refused(complaint, count, world, controller, *conformance.engagements((3,), 5))
