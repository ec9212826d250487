import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.virtual_robot.lab.recorder import held_values, host_trace, play, receipt_trace, robot_trace
from archerfish.virtual_robot.lab.shooting import Plate, check_aim, shoot_plates
from archerfish.virtual_robot.lab.signals import REST_S, steps, sweep
from archerfish.virtual_robot.lab.timing import SteppingTarget, TimingPlan, record_timing, timing_length, timing_plan

from .made_robots import QUIET, changed, resting_robot

REST = round(REST_S * 1000)


def test_a_sweep_has_its_amplitude_and_its_frequencies() -> None:
    signal = sweep(0.02, 2.0, 50.0, 10.0)
    assert signal.size == 10_000 + 2 * REST
    assert np.abs(signal).max() == pytest.approx(0.02, rel=1e-4)
    assert np.all(signal[:REST] == 0.0)
    moving = signal[REST:-REST]
    crossings = np.flatnonzero(np.diff(np.sign(moving)))
    # Half a period between crossings: 2 Hz at first, 50 Hz at last; 26 Hz on average.
    assert np.diff(crossings)[0] == pytest.approx(250, rel=0.4)
    assert np.diff(crossings)[-1] == pytest.approx(10, abs=1)
    assert crossings.size == pytest.approx(2 * 26 * 10, abs=4)


def test_what_is_held_back_takes_another_course() -> None:
    forward, back = sweep(0.02, 2.0, 50.0, 10.0), sweep(0.02, 2.0, 50.0, 10.0, held_back=True)
    assert abs(np.corrcoef(forward, back)[0, 1]) < 0.2
    one, other = steps(0.03, 1.0), steps(0.03, 1.0, held_back=True)
    assert one.size == other.size
    for signal in (one, other):
        assert signal.max() == pytest.approx(0.03, rel=0.05)
        assert signal.min() == pytest.approx(-0.03, rel=0.05)
        assert np.unique(signal).size == 11
    assert not np.array_equal(one, other)


def test_a_value_holds_from_its_stamp_on() -> None:
    values = np.array([[1.0, 0.0], [2.0, 0.0]])
    held = held_values(np.array([1.0, 2.0]), values, np.array([0.5, 1.0, 1.5, 2.0, 9.0]), np.zeros(2))
    np.testing.assert_array_equal(held[:, 0], [0.0, 1.0, 1.0, 2.0, 2.0])


@pytest.mark.parametrize("rate", [1000, 500, 300])
def test_an_injected_log_holds_what_was_in_force(rate: int) -> None:
    robot = resting_robot(changed(link__feedback_rate_hz=rate, **QUIET), 1, "linear")
    commands = np.stack([np.zeros(500), 0.02 * np.sin(0.05 * np.arange(500))], axis=1)
    trace = robot_trace(play(robot, commands, "inject"), np.zeros(2), as_sent=True)
    within = trace.time < 0.4995
    ticks = np.rint(1000 * trace.time[within]).astype(int)
    np.testing.assert_allclose(trace.command[within], commands[ticks], atol=1e-12)
    assert np.sum(within) == pytest.approx(0.5 * rate, abs=1)


def test_over_the_link_the_robots_log_has_the_commands_that_it_received() -> None:
    description = changed(link__command_latency_low_ms=10, link__command_latency_high_ms=10)
    robot = resting_robot(description, 1, "linear")
    commands = np.zeros((300, 2))
    commands[100:, 1] = np.radians(1.0)
    session = play(robot, commands, "link")
    received, sent = (robot_trace(session, np.zeros(2), as_sent=each) for each in (False, True))
    moved = [trace.time[np.argmax(trace.command[:, 1] > 0)] for trace in (received, sent)]
    np.testing.assert_allclose(moved, [0.110, 0.100], atol=1e-9)


def test_a_hosts_logs_have_its_own_times() -> None:
    robot = resting_robot(changed(), 1, "linear")
    commands = np.zeros((300, 2))
    commands[100:, 1] = np.radians(1.0)
    session = play(robot, commands, "link")
    host, receipt = host_trace(session, np.zeros(2)), receipt_trace(session, np.zeros(2))
    np.testing.assert_allclose(np.diff(host.time), 0.005, atol=1e-9)
    assert np.all(np.diff(receipt.time) > 0)
    for trace in (host, receipt):
        # Answers can't come before the command has passed the link.
        asked = trace.time[np.argmax(trace.command[:, 1] > 0)]
        assert trace.time[np.argmax(trace.angle[:, 1] > 1e-3)] > asked + 0.005


def test_a_stepping_target_is_half_a_step_to_either_side() -> None:
    target = SteppingTarget(3.0, 0.4, np.array([1.0, 2.0]))
    place = target.position(np.array([0.0, 1.5, 2.5]))
    np.testing.assert_allclose(place, [[3.0, -0.2, 0.0], [3.0, 0.2, 0.0], [3.0, -0.2, 0.0]])


def test_timing_shows_the_latency_that_the_robot_has() -> None:
    description = changed(**QUIET)
    robot = resting_robot(description, 1, "linear")
    played: list[float] = []
    plan = TimingPlan(sweep_s=2.0, steps=4)
    logs = record_timing(robot, plan, "robot", 0, played.append)
    assert np.all(np.diff(played) > 0)
    assert played[-1] == pytest.approx(timing_length(plan), rel=0.2)
    np.testing.assert_allclose(logs.plate.received - logs.plate.stamp - 0.0065, 0.035, atol=0.0051)
    # The target's side, seen at the exposure, changes at the known moments.
    side = np.sign(logs.target.position[:, 1])
    turns = logs.target.stamp[1:][np.diff(side) != 0] + 0.0065
    assert np.all((turns - logs.moments >= 0) & (turns - logs.moments < 1 / 80 + 1e-6))


def test_a_robot_that_turns_less_far_is_asked_for_less() -> None:
    assert timing_plan(changed()) == TimingPlan()
    narrow = {"limits__yaw__low_deg": -10.0, "limits__yaw__high_deg": 8.0}
    plan = timing_plan(changed(**narrow))
    assert np.degrees(plan.amplitude) == pytest.approx(6.4)
    assert np.degrees(plan.step) == pytest.approx(6.4)


@pytest.mark.parametrize("name", ["sweep_s", "amplitude", "low_hz", "step", "distance", "target_step"])
def test_a_plan_that_does_nothing_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=rf"timing\.{name} must be > 0"):
        TimingPlan(**{name: 0.0})


def test_the_range_reports_what_a_tape_measures() -> None:
    calm = {
        **QUIET,
        "muzzle__speed_sd_m_s": 0.0,
        "muzzle__dispersion_pitch_deg": 0.0,
        "muzzle__dispersion_yaw_deg": 0.0,
    }
    straight = {"muzzle__boresight_pitch_deg": 0.0, "muzzle__boresight_yaw_deg": 0.0, "muzzle__drag_per_m": 0.0}
    robot = resting_robot(changed(**calm, **straight, muzzle__up_m=0.1, muzzle__left_m=0.05), 1, "linear")
    (shot,) = shoot_plates(robot, (3.0,), 0.0, 1, 0, 0)
    assert shot.plane_distance == pytest.approx(2.84)
    assert shot.lateral == pytest.approx(0.0, abs=2e-3)
    assert shot.hit_height == pytest.approx(-0.5 * 9.81 * (2.84 / 18) ** 2, abs=2e-3)


def test_aims_beyond_the_limits_are_refused() -> None:
    robot = changed()
    check_aim(robot, np.radians(10.0), np.radians(-75.0))
    with pytest.raises(InputError, match="the yaw 76° is beyond the limits of infantry"):
        check_aim(robot, 0.0, np.radians(76.0))


def test_a_plate_stands_straight_ahead() -> None:
    np.testing.assert_array_equal(Plate(2.0).position(np.zeros(3)), [[2.0, 0.0, 0.0]] * 3)
