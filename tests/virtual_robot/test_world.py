"""The virtual robot as a world: what its computer sees, and what becomes of its shots."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish.arrays import leaves
from archerfish.protocols import Engagement, aim
from archerfish.robot import Robot
from archerfish.targets.motion import disc
from archerfish.task import Task

PERIOD, OFFSET = 0.02, 0.0065  # the camera of infantry stamps its frames 6.5 ms early
INFANTRY = Robot.load(Path(__file__).parents[1] / "infantry")


class Line(NamedTuple):
    place: Any
    velocity: Any

    def position(self, time):
        return self.place + np.asarray(time)[..., None] * self.velocity


@pytest.fixture
def world(changed_robot):
    def make(*, offset=OFFSET, **options):
        camera = INFANTRY.sensing.camera.replace(time_offset=offset)
        known = INFANTRY.replace(sensing=INFANTRY.sensing.replace(camera=camera))
        return changed_robot(**options).world(known, "static")

    return make


def engaged(count, place=(3.0, 0.5, 0.0), velocity=(0.0, 0.0, 0.0), start=(0.0, 0.0)):
    line = Line(np.tile(place, (count, 1)), np.tile(velocity, (count, 1)))
    starts = np.tile(np.float32(start), (count, 1))
    return Engagement(disc(line, line.place), starts, np.zeros(count, int), np.ones(count))


def normals(count, decisions, seed=0):
    return np.random.default_rng(seed).standard_normal((count, decisions, 11)).astype(np.float32)


def shot(world, engagement, normals, commands):
    """Return all that is seen and all shots under commands, (T, 2) or (T, B, 2)."""
    state = world.begin(engagement, normals)
    seen, shots = [world.see(state)], []
    for place, command in enumerate(commands):
        angle = np.broadcast_to(np.float32(command), (*normals.shape[:1], 2))
        state, result = world.step(state, aim(angle), normals[:, place])
        seen.append(world.see(state))
        shots.append(result)
    return seen, shots


def swinging(decisions):
    """Return commands that swing the yaw through the target's bearing, as fast as the limits allow."""
    yaw = 0.17 + 0.25 * np.sin(2.0 * np.pi * 1.5 * PERIOD * np.arange(decisions))
    return np.stack([0.0 * yaw, yaw], axis=-1)


def test_equal_engagements_have_equal_noise_and_others_other(world):
    engagement, drawn, robots = engaged(3), normals(3, 6), world(noisy=True)
    drawn[2] = drawn[0]
    seen, shots = shot(robots, engagement, drawn, swinging(6))
    again, others = shot(robots, engagement, drawn, swinging(6))
    for one, other in zip(leaves((*seen, *shots)), leaves((*again, *others)), strict=True):
        assert_array_equal(one, other)
        assert_array_equal(one[0], one[2])
    assert not np.array_equal(shots[-1].miss[0], shots[-1].miss[1])


def test_commands_keep_the_limits_whatever_is_commanded(world):
    wild = np.random.default_rng(1).uniform(-4.0, 4.0, (40, 4, 2))
    seen, _ = shot(world(noisy=True), engaged(4), normals(4, 40), wild)
    in_force = np.array([np.zeros((4, 2)), *(step.command for step in seen)], np.float64)
    for axis, limit in enumerate((INFANTRY.limits.pitch, INFANTRY.limits.yaw)):
        angle = in_force[..., axis]
        assert limit.low - 1e-6 <= angle.min() <= angle.max() <= limit.high + 1e-6
        assert np.abs(np.diff(angle, axis=0)).max() / PERIOD <= 1.005 * limit.max_rate
        acceleration = np.abs(np.diff(angle, n=2, axis=0)).max() / PERIOD**2
        assert 0.9 * limit.max_acceleration < acceleration <= 1.005 * limit.max_acceleration


def test_what_is_seen_is_float32_and_as_old_as_the_links_make_it(world):
    seen, _ = shot(world(), engaged(8), normals(8, 12), np.zeros((12, 2)))
    for step in seen:
        # The camera of infantry: 30…40 ms, a frame each 12.5 ms; its feedback: 1…3 ms, a report each millisecond.
        age = step.frames.age[step.frames.received]
        assert np.all((age >= 0.030 - 1e-6) & (age <= 0.0525 + 1e-6))
        assert np.all((step.gimbal.age >= 0.001 - 1e-6) & (step.gimbal.age <= 0.0045 + 1e-6))
        assert {values.dtype for values in leaves(step)} == {np.dtype(np.float32), np.dtype(bool)}
    assert_allclose([step.elapsed[0] for step in seen], [0.0, *[PERIOD] * 12])
    assert_allclose(seen[0].barrel.speed, INFANTRY.muzzle.speed, rtol=1e-6)


def test_a_moving_target_is_seen_where_it_was_at_the_exposure(world):
    engagement = engaged(1, (3.0, -0.3, 0.1), (0.2, 0.7, 0.0))
    seen, _ = shot(world(), engagement, normals(1, 20), np.zeros((20, 2)))
    for place, step in enumerate(seen):
        if step.frames.received.all():
            expected = engagement.target.motion.position(place * PERIOD - step.frames.age[:, 0])
            assert_allclose(step.frames.position[:, 0, 0], expected, atol=1e-3)


def test_the_computer_has_the_record_and_not_the_description(world):
    # Another clock that is recorded as it is shows the same; the same clock recorded wrongly does not.
    arguments = engaged(2), normals(2, 10), swinging(10)
    right, _ = shot(world(), *arguments)
    other, _ = shot(world(offset=-0.020, values={"camera.clock_offset_ms": 20.0}), *arguments)
    wrong, _ = shot(world(offset=OFFSET + 0.005), *arguments)
    for one, two, three in zip(right, other, wrong, strict=True):
        assert_allclose(two.frames.position, one.frames.position, atol=1e-6)
        both = one.frames.received & three.frames.received
        assert_allclose(three.frames.age[both], one.frames.age[both] - 0.005, atol=1e-6)
    truth = world().truth(arguments[0])
    assert truth.target is arguments[0].target
    assert_allclose(truth.muzzle.speed, INFANTRY.muzzle.speed)


def test_a_target_is_not_seen_until_the_gimbal_turns_to_it(world):
    # 72° to the left, of a camera that sees 50° to either side.
    engagement = engaged(2, (1.0, 3.0, 0.0), start=(0.1, -0.6))
    seen, _ = shot(world(), engagement, normals(2, 5), [(0.1, -0.6)] * 5)
    assert not any(step.frames.received.any() or step.frames.position.any() for step in seen)
    seen, _ = shot(world(), engagement, normals(2, 40), [(0.0, 1.2)] * 40)
    position = seen[-1].frames.position[:, 0, 0]
    assert_allclose(position, [[1.0, 3.0, 0.0]] * 2, atol=5e-3)


def test_a_shot_that_reaches_no_armor_misses_and_one_that_is_withheld_flies_nowhere(world):
    robots, drawn = world(), normals(1, 2)
    state = robots.begin(engaged(1, (-3.0, 0.0, 0.0)), drawn)
    state, result = robots.step(state, aim(np.zeros((1, 2), np.float32)), drawn[:, 0])
    assert result.fired.all()
    assert_array_equal(result.miss, [[1e3, 1e3]])
    assert_array_equal(result.margin, [-1e3])
    held = aim(np.zeros((1, 2), np.float32))._replace(fire=np.array([False]))
    _, result = robots.step(state, held, drawn[:, 1])
    assert not result.fired.any()
    assert result.plate.tolist() == [-1]
    assert np.isnan(result.miss).all() and np.isnan(result.flight_time).all()


def test_aim_at_a_still_target_hits_by_the_drop_of_the_pellet_by_hand(world):
    drop = [9.81 * 3.0 / (2 * 18.0**2), 0.0]
    _, shots = shot(world(exact=True), engaged(1, (3.0, 0.0, 0.0)), normals(1, 40), [drop] * 40)
    assert np.linalg.norm(shots[-1].miss) < 0.02
    assert shots[-1].margin == pytest.approx(0.06 - np.linalg.norm(shots[-1].miss), abs=1e-6)


def test_records_without_sensing_and_a_period_between_ticks_are_refused(changed_robot, refused):
    virtual = changed_robot()
    refused("paper has no sensing.json, without which no frame can be placed; identify", virtual.world)
    assert virtual.world(INFANTRY, Task(motion="paper", period_s=0.025)).period_s == 0.025
    assert repr(virtual.world(INFANTRY)) == "RobotWorld(virtual infantry, decisions every 0.02 s)"
