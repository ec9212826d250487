import numpy as np
import pytest

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.delayed_gimbal import angle_and_rate
from archerfish.dynamics.linear_axis import gimbal_angle
from archerfish.evaluation.bounds.aim_problem import aim_problem
from archerfish.sensing.interfaces import fire_always


@pytest.mark.parametrize("robot", [False, True])
def test_the_linear_map_is_what_the_world_does(shooting, robot) -> None:
    world, trials = shooting(robot=robot)
    met = trials.engagements._replace(start=np.full((16, 2), 0.05, np.float32))
    problem = aim_problem(world, met, trials.draws, 0.06)
    rng = np.random.default_rng(3)
    state, seen = world.reset(met, trials.draws)
    commands, aims = [], []
    for shot in range(50):
        state, seen, _ = world.step(state, fire_always(rng.uniform(-0.3, 0.15, (16, 2)).astype(np.float32)))
        commands.append(seen.command)
        if robot:
            angle, rate = angle_and_rate(world.gimbal, met.plant, state[0].gimbal)
            aims.append(angle + problem.geometry.rate_share[:, shot, None] * rate)
        else:
            aims.append(gimbal_angle(world.gimbal, state[0].gimbal))
    moved = np.stack(commands, axis=-1) - problem.start[..., None]
    linear = problem.rest[..., None] + np.sum(problem.response * moved[:, :, None, :], axis=-1)
    np.testing.assert_allclose(linear, np.stack(aims, axis=-1), atol=2e-5)
    # And what the world lets through keeps the limits that the bounds know.
    history = np.pad(moved, ((0, 0), (0, 0), (2, 0)))
    assert np.all(np.abs(np.diff(history, n=1)) <= problem.step[:, None])
    assert np.all(np.abs(np.diff(history, n=2)) <= problem.bend[:, None])
    assert np.all((moved >= problem.low - 1e-6) & (moved <= problem.high + 1e-6))


def test_one_of_several_engagements_is_picked_whole(shooting) -> None:
    world, trials = shooting(robot=True)
    problem = aim_problem(world, trials.engagements, trials.draws, 0.06)
    alone = aim_problem(world, map_arrays(lambda each: each[3:4], trials.engagements), trials.draws[3:4], 0.06)
    for name, each in problem.pick(slice(3, 4))._asdict().items():
        map_arrays(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), each, getattr(alone, name))


def test_a_world_whose_axes_may_not_be_linear_is_refused(shooting) -> None:
    trials = shooting().trials
    with pytest.raises(TypeError, match="linear axes, got object"):
        aim_problem(object(), trials.engagements, trials.draws, 0.06)
