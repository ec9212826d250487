import numpy as np
import pytest

from archerfish.virtual_robot.referee import allowed, count_shots, fresh_referee, heat_at, heat_left

from .made_robots import QUIET, Resting, changed, resting_robot

RULES = changed().referee


def test_a_hand_worked_case() -> None:
    """Two robots: hits at 59 mm and at (36, 48) mm, that is at 60 mm; a miss at 61 mm, one that never arrives."""
    state = fresh_referee(2)
    for time, fired, miss in [
        (0.0, [True, True], [[0.059, 0.0], [0.0, 0.061]]),
        (0.2, [True, False], [[0.036, 0.048], [0.0, 0.0]]),
        (0.4, [True, True], [[np.nan, np.nan], [0.0, -0.01]]),
    ]:
        state = count_shots(RULES, state, time, np.array(fired), np.array(miss))
    assert state.shots.tolist() == [3, 2]
    assert state.hits.tolist() == [2, 1]


def test_heat_by_hand() -> None:
    """10 per shot, 30 per second lost: three shots 0.1 s apart leave 10 + 7 + 7 = 24 right after the last."""
    state, yes = fresh_referee(1), np.array([True])
    for time in (0.0, 0.1, 0.2):
        state = count_shots(RULES, state, time, yes, np.zeros((1, 2)))
    assert heat_at(RULES, state, 0.2)[0] == pytest.approx(24.0)
    assert heat_at(RULES, state, 0.5)[0] == pytest.approx(15.0)
    assert heat_at(RULES, state, 5.0)[0] == 0.0
    assert heat_left(RULES, state, 0.2)[0] == 23.0


def test_who_fires_too_fast_or_too_hot_is_held_back() -> None:
    state, yes = fresh_referee(1), np.array([True])
    assert allowed(RULES, state, 0.0).all()
    state = count_shots(RULES, state, 0.0, yes, np.zeros((1, 2)))
    assert not allowed(RULES, state, 0.09).any()
    assert allowed(RULES, state, 0.1).all()
    hot = state._replace(heat=np.array([256.0]))
    assert not allowed(RULES, hot, 0.1).any()
    assert allowed(RULES, hot, 0.3).all()


def test_without_cooling_or_heat_nothing_divides_by_zero() -> None:
    state = fresh_referee(1)
    assert heat_at(changed(referee__cooling_per_s=0.0).referee, state, 1.0)[0] == 0.0
    assert np.isinf(heat_left(changed(referee__heat_per_shot=0.0).referee, state, 1.0)[0])


def test_the_robot_enforces_the_rules_when_asked() -> None:
    free, held = (resting_robot(changed(), 1, "linear", enforce_referee=asked) for asked in (False, True))
    for robot in (free, held):
        for _ in range(50):
            robot.shoot(np.zeros((1, 3)))
            robot.advance(20)
    assert free.counts().shots[0] == 50
    assert held.counts().shots[0] == 10
    assert held.heat_left()[0] < 26


def test_shots_that_go_where_the_plate_is_are_hits() -> None:
    """Aimed without dispersion at the point where a drag-free pellet arrives, then 7 cm beside it."""
    drop = 0.5 * 9.81 * (2.84 / 18.0) ** 2
    calm = changed(
        **QUIET,
        muzzle__boresight_pitch_deg=0.0,
        muzzle__boresight_yaw_deg=0.0,
        muzzle__drag_per_m=0.0,
        muzzle__droop_per_shot_m_s=0.0,
    )
    for aside, hits in ((0.0, 1), (0.055, 1), (0.07, 0)):
        robot = resting_robot(calm, 1, "linear")
        robot.reset(np.zeros((1, 2)), Resting(1, (3.0, aside, -drop)))
        flight = robot.shoot(np.zeros((1, 3)))
        np.testing.assert_allclose(flight.miss, [[-aside, 0.0]], atol=2e-3)
        assert robot.counts().hits[0] == hits
        assert flight.flight_time[0] == pytest.approx(2.84 / 18.0, rel=1e-3)


def test_who_does_not_fire_has_no_flight() -> None:
    robot = resting_robot(changed(), 2, "linear")
    flight = robot.shoot(np.zeros((2, 3)), np.array([True, False]))
    assert flight.fired.tolist() == [True, False]
    assert np.isnan(flight.miss[1]).all()
    assert np.isnan(flight.flight_time[1])
    assert np.isnan(flight.muzzle_speed_measured[1])
    assert robot.counts().shots.tolist() == [1, 0]
