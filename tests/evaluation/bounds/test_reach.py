from itertools import product

import numpy as np
import pytest

from archerfish.evaluation.bounds.aim_problem import AimProblem, aim_problem
from archerfish.evaluation.bounds.reach import reach, reach_chances

BEND = 0.02


def short(shooting, *, step: float = np.inf, high: float = 1.0) -> AimProblem:
    """The first four shots of one engagement, with limits of our own."""
    world, trials = shooting("gate", 1)
    problem = aim_problem(world, trials.engagements, trials.draws, 0.06).pick(slice(4, 5))
    bounds = np.full((1, 2, 4), high)
    return problem._replace(
        geometry=type(problem.geometry)(*(each[:, :4] for each in problem.geometry)),
        response=problem.response[..., :4, :4],
        low=-bounds,
        high=bounds,
        step=np.full(2, step),
        bend=np.full(2, BEND),
    )


def sequences(values: np.ndarray) -> np.ndarray:
    """Commands of all sequences of bends from some values, shape (n, 4)."""
    bends = np.array(list(product(values, repeat=4)))
    return np.cumsum(np.cumsum(bends, axis=-1), axis=-1)


def test_with_the_acceleration_alone_the_interval_is_that_of_all_corners(shooting) -> None:
    problem = short(shooting)
    found = reach(problem)
    for axis in range(2):
        # A linear function has its extremes at corners of the box of bends.
        aims = sequences(np.array([-BEND, BEND])) @ problem.response[0, axis].T
        np.testing.assert_allclose(found.low[0, axis], aims.min(axis=0), atol=1e-9)
        np.testing.assert_allclose(found.high[0, axis], aims.max(axis=0), atol=1e-9)


@pytest.mark.parametrize(("step", "high"), [(0.03, 1.0), (np.inf, 0.05), (0.03, 0.05)])
def test_with_all_limits_the_interval_is_that_of_all_commands(shooting, step, high) -> None:
    problem = short(shooting, step=step, high=high)
    # Out of reach, so that every programme is solved.
    problem = problem._replace(geometry=problem.geometry._replace(aim=problem.geometry.aim + 9.0))
    commands = sequences(np.linspace(-BEND, BEND, 17))
    moved = np.diff(commands, axis=-1, prepend=0.0)
    commands = commands[np.all((np.abs(commands) <= high + 1e-9) & (np.abs(moved) <= step + 1e-9), axis=-1)]
    found = reach(problem)
    for axis in range(2):
        aims = commands @ problem.response[0, axis].T
        assert np.all(found.high[0, axis] >= aims.max(axis=0) - 1e-9)
        # The grid of commands misses the very extreme by its spacing.
        np.testing.assert_allclose(found.high[0, axis], aims.max(axis=0), rtol=0.05)


@pytest.mark.parametrize(("limit", "robot"), [("gate", False), ("los-2deg", False), ("gate", True), ("box", True)])
def test_no_command_leads_out_of_the_interval(shooting, limit, robot) -> None:
    world, trials = shooting(limit, robot=robot)
    problem = aim_problem(world, trials.engagements, trials.draws, 0.06)
    interval, rng, tried = reach(problem), np.random.default_rng(1), 0
    for _ in range(20):
        low, high = np.maximum(problem.low, -1.0), np.minimum(problem.high, 1.0)
        commands = np.zeros_like(low)
        before = [np.zeros(low.shape[:2])] * 2
        for shot in range(low.shape[-1]):
            wanted = rng.uniform(low[..., shot], high[..., shot])
            rate = np.clip(wanted - before[1], -problem.step, problem.step)
            change = np.clip(rate - (before[1] - before[0]), -problem.bend, problem.bend)
            commands[..., shot] = 2 * before[1] - before[0] + change
            before = [before[1], commands[..., shot]]
        kept = np.all((commands >= low - 1e-12) & (commands <= high + 1e-12), axis=(1, 2))
        aims = np.sum(problem.response * commands[:, :, None, :], axis=-1)[kept]
        first, last = (np.broadcast_to(each, low.shape)[kept] for each in interval)
        assert np.all((aims >= first - 1e-9) & (aims <= last + 1e-9))
        tried += len(aims)
    assert tried > 20


def test_chances_within_reach_grow_with_what_is_allowed(shooting) -> None:
    chances = {}
    for limit in ("box", "gate"):
        world, trials = shooting(limit)
        problem = aim_problem(world, trials.engagements, trials.draws, 0.06)
        chances[limit] = reach_chances(problem, reach(problem))
        assert np.all((chances[limit] >= 0.0) & (chances[limit] <= 1.0))
        # After half a second everything can be reached, and dispersion alone is left.
        assert np.all(chances[limit][:, 25:] > 0.98)
    assert np.all(chances["box"] >= chances["gate"] - 1e-9)
    assert chances["box"][:, :5].mean() > chances["gate"][:, :5].mean() + 0.5
