from typing import Any

import numpy as np
import pytest

from archerfish2.arrays import namespace, tree
from archerfish2.errors import InputError
from archerfish2.evaluation.rollout import count, run_engagements
from archerfish2.protocols import aim


class InNumPy:
    """A world or a controller that can't be compiled."""

    compiled = False

    def __init__(self, inside):
        self.inside = inside

    def __getattr__(self, name):
        return getattr(self.inside, name)


@tree()
class NoNumbers:
    """Commands NaN from a decision on."""

    place: Any

    def reset(self, seen, truth=None):
        return 0.0 * seen.elapsed

    def step(self, state, seen):
        return state + 1.0, aim(seen.command + namespace(state).where(state < self.place, 0.0, float("nan"))[:, None])


def test_the_shots_are_the_same_whatever_of_the_two_is_compiled(conformance):
    (world, controller), drawn = conformance.build(), conformance.engagements((3,), 100)
    expected, counted = run_engagements(world, controller, *drawn), count(world, controller, *drawn)
    for pair in ((InNumPy(world), controller), (world, InNumPy(controller)), (InNumPy(world), InNumPy(controller))):
        found, again = run_engagements(*pair, *drawn), count(*pair, *drawn)
        np.testing.assert_allclose(found.in_force, expected.in_force, atol=1e-4)
        assert again.yaw_acceleration == pytest.approx(counted.yaw_acceleration, rel=1e-2)
        for shots in (found.shot, expected.shot):
            np.testing.assert_array_equal([shots.fired, shots.fired & (shots.margin >= 0.0)], again[:2])
            np.testing.assert_array_equal(again[:2], counted[:2])


@pytest.mark.parametrize("kind", [lambda each: each, InNumPy])
def test_a_command_that_is_not_finite_is_refused(conformance, kind):
    world, controller = conformance.build()[0], kind(NoNumbers(np.float32(2.0)))
    with pytest.raises(InputError, match=r"commands a pitch of nan rad at decision 3, in 3 of 3 engagements"):
        count(world, controller, *conformance.engagements((3,), 5))
