"""The first edition's virtual robot as a world of the second: what is stepped and not compiled fits the protocol."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.arrays import Array
from archerfish2.controllers.registry import make_controller
from archerfish2.evaluation import rollout, run
from archerfish2.evaluation.draws import draw
from archerfish2.protocols import Barrel, Base, Command, Engagement, Frames, GimbalFeedback, Seen, Shot, Truth
from archerfish2.robot import Robot
from archerfish2.task import Task

pytestmark = [pytest.mark.against_first, pytest.mark.filterwarnings("ignore:MuJoCo")]
pytest.importorskip("archerfish.virtual_robot")

from archerfish.controllers.roster import Workbench  # noqa: E402
from archerfish.controllers.roster import make_controller as make_first  # noqa: E402
from archerfish.dynamics.command_limits import gate_limits  # noqa: E402
from archerfish.dynamics.linear_axis import gimbal_model  # noqa: E402
from archerfish.dynamics.muzzle import muzzle_from_record  # noqa: E402
from archerfish.evaluation.suites import draw_trials, table_suites  # noqa: E402
from archerfish.evaluation.trial import fight  # noqa: E402
from archerfish.paper.conditions import assumed_conditions  # noqa: E402
from archerfish.paper.gimbal import gate_limits as limits_record  # noqa: E402
from archerfish.paper.gimbal import printed_plants  # noqa: E402
from archerfish.sensing import interfaces as first  # noqa: E402
from archerfish.simulation.setting import paper_muzzle  # noqa: E402
from archerfish.virtual_robot.description_file import load_robot  # noqa: E402
from archerfish.virtual_robot.engagement_world import Known, RobotWorld  # noqa: E402


class Running(NamedTuple):
    """Good for one step, for a robot is one object that changes with it."""

    robot: Any
    seen: first.Seen


class FirstRobot:
    """One plate, of which the robot's program keeps the latest frame; a base at rest."""

    compiled, normals, plants, name = False, 6, 1, "infantry"

    def __init__(self, world: RobotWorld, hit_radius: float) -> None:
        self.world, self.hit_radius, self.period_s = world, np.float32(hit_radius), world.period_s

    def begin(self, engagement: Engagement, normals: Array) -> Running:
        return Running(*self.world.reset(self._first(engagement), normals))

    def see(self, state: Running) -> Seen:
        seen, zero = state.seen, 0.0 * state.seen.elapsed
        origin, found = np.zeros((*zero.shape, 3), np.float32), seen.fresh[:, None]
        age = np.where(seen.fresh, seen.plate_age, np.float32(0.0))
        position = np.where(found[..., None], seen.plate[:, None], np.float32(0.0))
        frames = Frames(seen.fresh, age, found, position, np.where(found, seen.normal_yaw[:, None], np.float32(0.0)))
        gimbal, barrel = (
            GimbalFeedback(seen.angle, seen.rate, seen.gimbal_age),
            Barrel(seen.muzzle_speed, seen.heat_left),
        )
        return Seen(seen.elapsed, gimbal, seen.command, frames, Base(origin, origin, zero, zero), barrel)

    def step(self, state: Running, command: Command, normals: Array) -> tuple[Running, Shot]:
        old = first.Command(*command, fallback=np.zeros_like(command.fire))
        robot, seen, shot = self.world.step(state.robot, old)
        crosses, miss = shot.fired & ~np.isnan(shot.flight_time), np.float32(shot.miss)
        margin = np.where(crosses, self.hit_radius - np.linalg.norm(miss, axis=-1), np.float32(-1e3))
        plate = np.where(shot.fired, np.int32(0), np.int32(-1))
        return Running(robot, seen), Shot(shot.fired, plate, miss, margin, shot.flight_time, shot.angle)

    def truth(self, engagement: Engagement) -> Truth:
        old = self.world.truth(self._first(engagement))
        return Truth(engagement.target, old.gimbal, old.muzzle)

    def _first(self, engagement: Engagement) -> first.Engagement:
        return first.Engagement(engagement.target.motion, engagement.start, engagement.plant)


def test_eight_cells_on_the_virtual_robot(monkeypatch) -> None:
    conditions, limits, task = assumed_conditions(), gate_limits(limits_record()), Task(motion="paper")
    model, muzzle = gimbal_model(**printed_plants(), period_s=0.02), muzzle_from_record(paper_muzzle(conditions))
    robot, radius = (
        RobotWorld(load_robot("infantry"), Known(0.0065, limits, model, muzzle), 0.02),
        conditions.hit_radius,
    )
    theirs = make_first("kalman", Workbench(model, muzzle, limits, conditions))
    expected = fight(robot, theirs, draw_trials(table_suites(conditions), 2, 50, seed=0))
    world, drawn = FirstRobot(robot, radius), draw(task.cells(), 2, 0)
    controller = make_controller("kalman-paper", Robot.paper(), task)
    for compiled in (True, False):
        monkeypatch.setattr(run, "has_jax", lambda compiled=compiled: compiled)
        found = rollout.run_engagements(world, controller, *drawn)
        hit = found.shot.fired & (found.shot.margin >= 0.0)
        assert_array_equal(hit, expected.hits(radius))
        assert_array_equal(found.shot.fired, expected.fired)
        assert 100 < hit.sum() < 700
        # Limits add up what is rounded differently; the wire rounds commands more, so that all pellets are equal.
        assert_allclose(found.in_force, expected.command, atol=1e-6 if compiled else 2e-4)
        assert_array_equal(found.shot.miss, expected.miss)
        assert_array_equal(run.count(world, controller, *drawn).hit, hit)
