from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.command_limits import gate_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import direction, muzzle_from_record
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits as limits_record
from archerfish.paper.gimbal import printed_plants
from archerfish.sensing.interfaces import Engagement, World, fire_always
from archerfish.simulation.setting import paper_muzzle
from archerfish.targets.motion import TargetMotion
from archerfish.targets.passing import Line
from archerfish.targets.still import Static
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.engagement_world import UNSEEN_M, Known, RobotWorld

from .made_robots import QUIET, changed

pytestmark = pytest.mark.filterwarnings("ignore:MuJoCo 4 is not installed")

PERIOD, OFFSET = 0.02, 0.0065
"""The infantry's camera stamps 6.5 ms early."""
LIMITS = gate_limits(limits_record())
KNOWN = Known(
    OFFSET,
    LIMITS,
    gimbal_model(**printed_plants(), period_s=PERIOD),
    muzzle_from_record(paper_muzzle(assumed_conditions())),
)


def world(description: RobotDescription, **known: Any) -> RobotWorld:
    return RobotWorld(description, KNOWN._replace(**known), PERIOD)


def engagements(motion: TargetMotion, batch: int, start: tuple[float, float] = (0.0, 0.0)) -> Engagement:
    return Engagement(motion, np.tile(np.array(start, np.float32), (batch, 1)), np.zeros(batch, np.int32))


def standing(batch: int, place: tuple[float, float, float] = (3.0, 0.5, 0.0), **options: Any) -> Engagement:
    return engagements(Static(np.tile(np.array(place, np.float32), (batch, 1))), batch, **options)


def normals(batch: int, steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((batch, steps, 5)).astype(np.float32)


def fought(robots: RobotWorld, met: Engagement, draws: np.ndarray, commands: Any = None) -> tuple[list[Any], list[Any]]:
    """All that is seen and all shots under given commands, shape (T, B, 2), or along the line of sight."""
    state, seen = robots.reset(met, draws)
    sights, shots = [seen], []
    for step in range(draws.shape[1]):
        angle = line_of_sight(seen.plate[:, 0]) if commands is None else commands[step]
        state, seen, shot = robots.step(state, fire_always(np.asarray(angle, np.float32)))
        sights.append(seen)
        shots.append(shot)
    return sights, shots


def turning(steps: int, batch: int) -> np.ndarray:
    """Commands that swing the yaw through the target's bearing, as fast as the limits allow."""
    yaw = 0.17 + 0.25 * np.sin(2.0 * np.pi * 1.5 * PERIOD * np.arange(steps))
    return np.broadcast_to(np.stack([0.0 * yaw, yaw], axis=-1)[:, None], (steps, batch, 2))


def test_a_robot_is_a_world_that_can_not_be_compiled(infantry) -> None:
    assert isinstance(world(infantry), World)
    assert not world(infantry).pure
    assert world(infantry).period_s == PERIOD


def test_equal_engagements_meet_equal_luck_and_others_other(infantry) -> None:
    met, draws = standing(3), normals(3, 6)
    draws[2] = draws[0]
    (sights, shots), (again, fired) = fought(world(infantry), met, draws), fought(world(infantry), met, draws)
    for one, other in zip((*sights, *shots), (*again, *fired), strict=True):
        for ours, theirs in zip(one, other, strict=True):
            assert np.array_equal(ours, theirs)
            assert np.array_equal(ours[0], ours[2])
    assert not np.array_equal(sights[-1].plate[0], sights[-1].plate[1])
    assert not np.array_equal(shots[-1].miss[0], shots[-1].miss[1])


def test_a_batch_is_its_members(infantry) -> None:
    met, draws = standing(3), normals(3, 5)
    together = fought(world(infantry), met, draws)[1][-1]
    for member in range(3):
        one = map_arrays(lambda each, member=member: each[member : member + 1], met)
        alone = fought(world(infantry), one, draws[member : member + 1])[1][-1]
        assert_allclose(alone.miss[0], together.miss[member], rtol=1e-9)


def test_commands_keep_the_limits_whatever_is_asked(infantry) -> None:
    wild = np.random.default_rng(1).uniform(-4.0, 4.0, (40, 4, 2))
    sights, _ = fought(world(infantry), standing(4), normals(4, 40), wild)
    asked = np.array([np.zeros((4, 2)), *(seen.command for seen in sights)], np.float64)
    record = limits_record()
    for axis, limit in enumerate((record.pitch, record.yaw)):
        assert np.all((asked[..., axis] >= limit.low - 1e-6) & (asked[..., axis] <= limit.high + 1e-6))
        assert np.abs(np.diff(asked[..., axis], axis=0)).max() / PERIOD <= limit.max_rate * 1.005
        acceleration = np.abs(np.diff(asked[..., axis], n=2, axis=0)).max() / PERIOD**2
        assert 0.9 * limit.max_acceleration < acceleration <= limit.max_acceleration * 1.005


def test_what_is_seen_has_the_ages_of_the_links(infantry) -> None:
    sights, _ = fought(world(changed(**QUIET)), standing(8), normals(8, 12))
    for seen in sights:
        # The infantry's camera: 30…40 ms, a frame each 12.5 ms; its feedback: 1…3 ms, a report each millisecond.
        assert np.all((seen.plate_age >= 0.030 - 1e-6) & (seen.plate_age <= 0.0525 + 1e-6))
        assert np.all((seen.gimbal_age >= 0.001 - 1e-6) & (seen.gimbal_age <= 0.0045 + 1e-6))
        assert {each.dtype for each in seen if each.dtype.kind == "f"} == {np.dtype(np.float32)}
    assert not sights[0].elapsed.any()
    assert_allclose([seen.elapsed for seen in sights[1:]], PERIOD)
    assert infantry.camera.latency_low_ms == 30


def test_a_moving_target_is_seen_where_it_was_at_the_exposure() -> None:
    line = Line(np.array([[3.0, -0.3, 0.1]]), np.array([[0.2, 0.7, 0.0]]))
    sights, _ = fought(world(changed(**QUIET)), engagements(line, 1), normals(1, 20), np.zeros((20, 1, 2)))
    for step, seen in enumerate(sights):
        assert_allclose(seen.plate[:, 0], line.position(step * PERIOD - seen.plate_age[:, 0]), atol=1e-3)


def test_a_right_time_offset_leaves_a_still_plate_still_and_a_wrong_one_moves_it() -> None:
    robot, steps = changed(**QUIET), 40
    away = {}
    for error in (0.0, 0.01):
        sights, _ = fought(world(robot, time_offset=OFFSET + error), standing(2), normals(2, steps), turning(steps, 2))
        away[error] = np.abs(np.array([seen.plate[:, 0, 1] for seen in sights[5:]]) - 0.5).max()
    assert away[0.0] < 0.002  # reports each millisecond, to a hundredth of a degree
    assert away[0.01] > 0.03  # some 2 rad/s for 10 ms at 3 m


def test_the_program_believes_the_record_not_the_description() -> None:
    # Another clock of the camera's that is recorded as it is shows the same; the same clock recorded wrongly does not.
    met, draws, commands = standing(2), normals(2, 10), turning(10, 2)
    truth, _ = fought(world(changed(**QUIET)), met, draws, commands)
    late = changed(**QUIET, camera__clock_offset_ms=20.0)
    recorded, _ = fought(world(late, time_offset=-0.020), met, draws, commands)
    for one, other in zip(truth, recorded, strict=True):
        assert_allclose(other.plate, one.plate, atol=1e-6)
        assert_allclose(other.plate_age, one.plate_age, atol=1e-6)
    wrong, _ = fought(world(changed(**QUIET), time_offset=OFFSET + 0.005), met, draws, commands)
    for one, other in zip(truth, wrong, strict=True):
        assert_allclose(other.plate_age, one.plate_age - 0.005, atol=1e-6)


def test_truth_is_what_was_handed_in(infantry) -> None:
    met = standing(2)
    told = world(infantry).truth(met)
    assert told.motion is met.motion
    assert told.gimbal is KNOWN.model
    assert told.muzzle is KNOWN.muzzle
    seen = world(infantry).reset(met, normals(2, 1))[1]
    assert_allclose(seen.muzzle_speed, KNOWN.muzzle.speed)


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.1, -0.6)])
def test_a_target_that_no_frame_has_shown_is_taken_to_be_ahead_of_the_barrel(start) -> None:
    # 72° to the left, of a camera that sees 50° to either side.
    met = standing(2, place=(1.0, 3.0, 0.0), start=start)
    sights, _ = fought(world(changed(**QUIET)), met, normals(2, 5), np.tile(np.array(start), (5, 2, 1)))
    for seen in sights:
        assert_allclose(seen.plate[:, 0], UNSEEN_M * np.tile(direction(np.array(start)), (2, 1)), atol=1e-6)
        assert_allclose(seen.plate_age, 1.0)
        assert not seen.fresh.any()


def test_a_target_is_seen_as_soon_as_the_gimbal_turns_to_it() -> None:
    met = standing(1, place=(1.0, 3.0, 0.0))
    left = np.tile([0.0, 1.0], (25, 1, 1))
    sights, _ = fought(world(changed(**QUIET)), met, normals(1, 25), left)
    assert not sights[0].fresh.any()
    assert_allclose(sights[-1].plate, [[[1.0, 3.0, 0.0]]], atol=5e-3)
    assert sights[-1].plate_age < 0.06


def test_a_shot_that_never_reaches_the_armor_misses_by_far_and_one_that_is_withheld_flies_nowhere(infantry) -> None:
    behind = standing(1, place=(-3.0, 0.0, 0.0))
    robots = world(infantry)
    state, _ = robots.reset(behind, normals(1, 2))
    state, _, shot = robots.step(state, fire_always(np.zeros((1, 2), np.float32)))
    assert shot.fired.all()
    assert np.all(np.linalg.norm(shot.miss, axis=-1) > 100.0)
    held = fire_always(np.zeros((1, 2)))._replace(fire=np.array([False]))
    _, _, shot = robots.step(state, held)
    assert not shot.fired.any()
    assert np.isnan(shot.miss).all()
    assert np.isnan(shot.flight_time).all()


def test_aim_at_a_still_target_hits() -> None:
    # No dispersion, boresight or droop: the drop alone is aimed for, by hand g d² / 2 v².
    names = ("speed_sd_m_s", "droop_per_shot_m_s", "boresight_pitch_deg", "boresight_yaw_deg", "dispersion_pitch_deg",
             "dispersion_yaw_deg")  # fmt: skip
    exact = changed(**QUIET, **{f"muzzle__{name}": 0.0 for name in names})
    angle = np.array([9.81 * 3.0 / (2 * 18.0**2), 0.0])
    _, shots = fought(world(exact), standing(1, place=(3.0, 0.0, 0.0)), normals(1, 40), np.tile(angle, (40, 1, 1)))
    assert np.linalg.norm(shots[-1].miss) < 0.02
