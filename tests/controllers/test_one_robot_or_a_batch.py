"""The same controller decides alike for one robot in NumPy and for a batch inside a compiled program."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import PolicyController
from archerfish.controllers.roster import CONTROLLERS, make_controller
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.sensing.observation import make_observer, observation_size

STEPS, BATCH = 5, 3
# `no-lead` and `vertex` differ from `kalman-lq` in their predictors alone, which have a test of their own.
NAMES = [*(CONTROLLERS.keys() - {"no-lead", "vertex"}), "policy"]


def random_policy(muzzle) -> PolicyController:
    observer = make_observer("history", muzzle)
    size, rng = observation_size(observer), np.random.default_rng(91)
    actor = tuple(Layer(rng.normal(0.0, 0.1, pair), np.zeros(pair[1])) for pair in ((size, 32), (32, 2)))
    normaliser = Normaliser(np.zeros(size), np.ones(size), np.asarray(1.0))
    return single_precision(PolicyController(observer, normaliser, actor))


def decide(controller, seen, truth) -> np.ndarray:
    """Commands of a controller on what was seen, shape (STEPS,) + B + (2,)."""
    state, commands = controller.reset(map_arrays(lambda each: each[0], seen), truth), []
    for step in range(STEPS):
        state, command = controller.step(state, map_arrays(lambda each, step=step: each[step], seen))
        commands.append(command.angle)
    return np.stack(commands)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_commands_are_the_same(name, bench, fight, quick_jit) -> None:
    jax = pytest.importorskip("jax")
    work = bench("gate")
    controller = random_policy(single_precision(work.muzzle)) if name == "policy" else make_controller(name, work)
    duel = fight(controller, "gate", static_share=0.0, batch=BATCH, steps=STEPS)

    @quick_jit
    def compiled(controller, seen, truth):
        first = map_arrays(lambda each: each[0], seen)
        _, commands = jax.lax.scan(controller.step, controller.reset(first, truth), seen)
        return commands.angle

    together = compiled(controller, duel.seen, duel.truth)
    assert together.dtype == np.float32
    assert_allclose(together, duel.command, atol=2e-4)
    for member in range(BATCH):
        motion = map_arrays(lambda each, member=member: each[member], duel.truth.motion)
        seen = map_arrays(lambda each, member=member: each[:, member], duel.seen)
        alone = decide(controller, seen, duel.truth._replace(motion=motion))
        assert alone.shape == (STEPS, 2)
        assert_allclose(alone, duel.command[:, member], atol=2e-4)
