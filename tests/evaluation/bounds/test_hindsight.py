from itertools import product

import numpy as np
import pytest

from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.bounds.aim_problem import AimProblem, aim_problem
from archerfish.evaluation.bounds.hindsight import hindsight_bound, pitch_profile, yaw_profile
from archerfish.evaluation.bounds.reach import Interval, best_chance, reach, reach_chances
from archerfish.evaluation.bounds.trajectory import NEGLIGIBLE, Profile, profile, trajectory_bound
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import printed_plants
from archerfish.simulation.setting import paper_muzzle

CONDITIONS = assumed_conditions()
RADIUS = CONDITIONS.hit_radius


def oracle_chances(world, trials, problem: AimProblem) -> np.ndarray:
    """Chances of the oracle's shots, shape (engagements, shots)."""
    plants, muzzle = printed_plants(), muzzle_from_record(paper_muzzle(CONDITIONS))
    bench = Workbench(gimbal_model(**plants, period_s=CONDITIONS.control_period_s), muzzle, world.limits, CONDITIONS)
    oracle = make_controller("oracle", bench)
    state, seen = world.reset(trials.engagements, trials.draws)
    plan, aims = oracle.reset(seen, world.truth(trials.engagements)), []
    for _ in range(CONDITIONS.decisions):
        plan, command = oracle.step(plan, seen)
        state, seen, shot = world.step(state, command)
        aims.append(shot.angle)
    off = np.stack(aims, axis=-1) - problem.rest[..., None] - problem.wanted
    return best_chance(problem, off)


@pytest.mark.parametrize("limit", ["gate", "box"])
def test_no_plan_of_the_oracle_exceeds_the_bound_and_the_best_come_close(shooting, limit) -> None:
    world, trials = shooting(limit, 1)
    problem = aim_problem(world, trials.engagements, trials.draws, RADIUS)
    interval = reach(problem)
    flown = oracle_chances(world, trials, problem).sum(axis=-1)
    bounds, solved = zip(
        *(hindsight_bound(problem.pick(slice(each, each + 1)), interval, 16) for each in range(8)), strict=True
    )
    assert all(solved)
    assert np.all(flown <= np.array(bounds) + 1e-3)
    assert np.all(np.array(bounds) - flown < 0.7)
    # One trajectory for all shots is no better than one for each, but for the ε of shots that can't hit.
    assert np.all(np.array(bounds) <= reach_chances(problem, interval).sum(axis=-1) + 16 * NEGLIGIBLE)


def test_of_two_armors_apart_a_gimbal_that_turns_slowly_meets_one() -> None:
    """Two shots, aims that follow the commands at once: by brute force over the commands."""
    offset, wanted = np.linspace(-0.2, 0.2, 401), np.array([-0.1, 0.12])
    chance = np.clip(1.0 - (np.abs(offset) / 0.05) ** 2, 0.0, 1.0)
    shape = np.stack([chance, 0.9 * chance])
    level = Profile(np.full(2, -1.0), np.full(2, 1.0), np.zeros((2, 1)), np.ones((2, 1)))
    for step in (0.02, 0.06, 0.14, 0.2, 0.3):
        problem = _two_shots(wanted, step)
        interval = Interval(np.full((1, 2, 2), -1.0), np.full((1, 2, 2), 1.0))
        found, solved = trajectory_bound(
            problem, interval, (level, profile(np.stack([offset] * 2), shape)), np.array([1.0, 0.9])
        )
        grid = np.linspace(-0.3, 0.3, 301)
        best = max(
            np.interp(first - wanted[0], offset, shape[0]) + np.interp(second - wanted[1], offset, shape[1])
            for first, second in product(grid, grid)
            if abs(first) <= step + 1e-9 and abs(second - first) <= step + 1e-9
        )
        assert solved
        assert best - 1e-6 <= found <= best + 0.3


def _two_shots(wanted: np.ndarray, step: float) -> AimProblem:
    """A problem whose aims are the commands."""
    names = ("geometry", "response", "rest", "start", "low", "high", "step", "bend", "radius")
    problem = AimProblem(**dict.fromkeys(names, np.zeros((1, 2))))._replace(
        response=np.stack([np.eye(2)] * 2)[None],
        low=np.full((1, 2, 2), -1.0),
        high=np.full((1, 2, 2), 1.0),
        step=np.array([np.inf, step]),
        bend=np.full(2, np.inf),
    )

    class Wanted(AimProblem):
        @property
        def wanted(self) -> np.ndarray:
            return np.stack([0.0 * wanted, wanted])[None]

    return Wanted(*problem)


def test_supporting_lines_and_windows_lie_beyond_every_sample() -> None:
    offset = np.stack([np.linspace(-1.0, 1.0, 81)] * 2)
    chance = np.stack([np.exp(-((offset[0] / 0.3) ** 4)), 0.6 * np.exp(-(((offset[1] - 0.2) / 0.2) ** 2))])
    found = profile(offset, chance)
    inside = chance > NEGLIGIBLE
    assert np.all((offset >= found.low[:, None])[inside] & (offset <= found.high[:, None])[inside])
    lines = found.level[..., None] + found.slope[..., None] * offset[:, None]
    within = (offset >= found.low[:, None]) & (offset <= found.high[:, None])
    assert np.all((lines >= chance[:, None] - 1e-12) | ~within[:, None])
    # They fall below ε not far beyond the window, on both sides.
    assert np.all(np.min(lines, axis=1)[:, [0, -1]] < 0.0)


def test_profiles_of_both_axes_are_one_at_the_centre_and_nothing_beyond_the_armor(shooting) -> None:
    world, trials = shooting("gate", 1)
    problem = aim_problem(world, trials.engagements, trials.draws, RADIUS).pick(slice(0, 1))
    for each in (pitch_profile(problem, 5, np.zeros(5)), yaw_profile(problem, 5)):
        assert np.all(each.low < 0.0) and np.all(each.high > 0.0)
        assert np.all(each.level.min(axis=-1) > 0.97)
        # 6 cm, dispersion and the slack, seen from 1 to 2 m.
        assert np.all(each.high - each.low < 2 * 0.09 / problem.geometry.x[0, :5])
    wider = pitch_profile(problem, 5, np.full(5, 0.01))
    narrow = pitch_profile(problem, 5, np.zeros(5))
    np.testing.assert_allclose(wider.high, narrow.high + 0.01, atol=2e-3)
