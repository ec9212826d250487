import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.targets.parabola import Parabola
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.robot import VirtualRobot

from .made_robots import QUIET, Resting, changed, resting_robot


def moving(batch: int, first: int = 0) -> Parabola:
    index = np.arange(first, first + batch)
    return Parabola(
        np.stack([2.0 + 0.3 * index, 0.1 * index - 0.3, 0.0 * index], axis=1),
        np.full(batch, 0.3),
        (0.13 * index) % 1.0,
        np.full(batch, 0.115),
        np.full(batch, 3.0),
    )


def played(
    description: RobotDescription, trials: range, physics: str, pieces: list[int], lead_s: float = 0.1
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Play ten decisions; return each trial's log of all messages, and the misses of its shots."""
    batch = len(trials)
    robot = VirtualRobot(description, batch, np.array(trials), physics=physics)
    heard = [robot.reset(np.zeros((batch, 2)), moving(batch, trials.start), lead_s=lead_s)]
    misses = []
    for decision in range(10):
        index = np.array(trials)
        robot.send(np.stack([0.02 * np.sin(decision + index), 0.1 * np.cos(0.5 * decision + index)], axis=1))
        heard += [robot.advance(ticks) for ticks in pieces]
        normals = np.stack([np.random.default_rng((trial, decision)).standard_normal(3) for trial in trials])
        flight = robot.shoot(normals)
        misses.append(np.concatenate([flight.miss, flight.muzzle_speed_measured[:, None]], axis=1))
    return [messages(heard, trial) for trial in range(batch)], list(np.stack(misses, axis=1))


def messages(heard, trial):
    """Return all that a trial's host heard as rows, without the padding."""
    parts = []
    for each in heard:
        report = [each.feedback_received[..., None], each.feedback_stamp[..., None], each.feedback_angle]
        reports = np.concatenate([*report, each.feedback_rate], axis=-1)[trial]
        frame = [each.frame_received[..., None], each.frame_stamp[..., None], each.frame_found[..., None]]
        frames = np.concatenate([*frame, each.frame_position], axis=-1)[trial]
        commands = np.concatenate([each.command_stamp[..., None], each.command_value], axis=-1)[trial]
        for rows in (reports, frames, commands):
            parts.append(np.pad(rows[~np.isnan(rows[:, 0])], ((0, 0), (0, 6 - rows.shape[1]))))
    return [np.concatenate(parts[kind::3]) for kind in range(3)]


def assert_same(one, other) -> None:
    for mine, theirs in zip(one[0], other[0], strict=True):
        for left, right in zip(mine, theirs, strict=True):
            np.testing.assert_array_equal(left, right)
    np.testing.assert_array_equal(one[1], other[1])


def test_a_batch_of_one_equals_the_same_trial_in_a_batch_of_eight(physics: str, infantry: RobotDescription) -> None:
    together = played(infantry, range(8), physics, [20])
    alone = played(infantry, range(5, 6), physics, [20])
    assert_same(alone, ([together[0][5]], [together[1][5]]))


@pytest.mark.parametrize("pieces", [[1] * 20, [7, 1, 12]])
def test_lockstep_equals_tick_by_tick(physics: str, pieces: list[int]) -> None:
    description = changed(link__command_loss=0.2, link__feedback_loss=0.1, link__feedback_rate_hz=300)
    assert_same(played(description, range(3), physics, [20]), played(description, range(3), physics, pieces))


def test_a_reset_repeats_the_same_trial(physics: str, infantry: RobotDescription) -> None:
    robot = VirtualRobot(infantry, 2, np.array([4, 9]), physics=physics)
    runs = []
    for _ in range(2):
        heard = [robot.reset(np.zeros((2, 2)), moving(2), lead_s=0.05)]
        robot.send(np.full((2, 2), 0.05))
        heard.append(robot.advance(100))
        runs.append([messages(heard, trial) for trial in range(2)])
    for first, second in zip(*runs, strict=True):
        for left, right in zip(first, second, strict=True):
            np.testing.assert_array_equal(left, right)


def test_other_seeds_are_other_trials(physics: str, infantry: RobotDescription) -> None:
    one, other = (played(infantry, range(k, k + 1), physics, [20])[0][0] for k in (0, 1))
    assert not np.array_equal(one[0][:50], other[0][:50])
    assert one[1][0, 0] != other[1][0, 0]


def test_the_number_of_places_depends_on_the_ticks_alone(infantry: RobotDescription) -> None:
    robot = resting_robot(infantry, 3, "linear")
    shapes = set()
    for _ in range(30):
        heard = robot.advance(20)
        shapes.add((heard.feedback_received.shape, heard.frame_received.shape))
    assert len(shapes) == 1
    ((feedback, frames),) = shapes
    assert feedback[1] >= 20
    assert frames[1] >= 2


def test_after_a_lead_the_host_has_seen_the_target_and_the_gimbal_rests(
    physics: str, infantry: RobotDescription
) -> None:
    robot = VirtualRobot(infantry, 4, np.arange(4), physics=physics)
    start = np.tile([-0.1, 0.3], (4, 1))
    heard = robot.reset(start, Resting(4, (3.0, 0.9, -0.3)), lead_s=0.15)
    assert robot.time == 0.0
    assert np.all(np.sum(heard.frame_found, axis=1) >= 7)
    assert np.all(np.sum(~np.isnan(heard.feedback_received), axis=1) >= 145)
    assert np.nanmax(heard.feedback_received) <= 1e-6
    assert np.nanmin(heard.feedback_stamp) == pytest.approx(-0.15)
    np.testing.assert_allclose(robot.truth().angle, start * [1.03, 1.0], atol=1.5e-3)
    assert np.abs(robot.truth().rate).max() < 0.05


def test_the_gimbal_holds_its_load_from_the_first_tick(physics: str) -> None:
    robot = VirtualRobot(changed(**QUIET), 1, np.array([0]), physics=physics)
    robot.reset(np.array([[-0.2, 0.0]]), Resting(1))
    robot.advance(100)
    assert robot.truth().angle[0, 0] == pytest.approx(-0.2 * 1.03, abs=1e-3)


def test_commands_take_effect_after_a_latency_between_the_limits() -> None:
    """2000 commands, 20 ms apart: uniform on 5…15 ms; mean known to 0.065 ms, false-alarm rate below 1e-6 at 0.33."""
    robot = resting_robot(changed(), 20, "linear")
    delays = []
    for _ in range(100):
        sent = robot.time
        robot.send(np.full((20, 2), 0.01))
        delays.append(robot.advance(20).command_stamp[:, 0] - sent)
    delays = np.array(delays)
    assert np.isfinite(delays).all()
    assert 0.005 <= delays.min() < 0.0052
    assert 0.0148 < delays.max() <= 0.015
    assert delays.mean() == pytest.approx(0.010, abs=3.3e-4)
    assert delays.std() == pytest.approx(0.010 / np.sqrt(12), rel=0.08)


def test_commands_that_are_sent_fast_never_overtake_each_other() -> None:
    robot = resting_robot(changed(link__command_quantum_deg=0.0), 10, "linear")
    stamps, values = [], []
    for k in range(200):
        robot.send(np.full((10, 2), 1e-4 * k))
        heard = robot.advance(2)
        stamps.append(heard.command_stamp)
        values.append(heard.command_value[..., 1])
    for trial in range(10):
        stamp, value = (np.concatenate([each[trial] for each in rows]) for rows in (stamps, values))
        known = ~np.isnan(stamp)
        assert np.all(np.diff(stamp[known]) >= 0.0)
        assert np.all(np.diff(value[known]) > 0.0)


def test_a_command_is_in_force_from_the_first_tick_after_its_receipt() -> None:
    robot = resting_robot(changed(link__command_latency_low_ms=7.3, link__command_latency_high_ms=7.3), 1, "linear")
    robot.send(np.array([[0.0, 0.1]]))
    robot.advance(8)
    assert robot.truth().command[0, 1] == 0.0
    heard = robot.advance(1)
    assert robot.truth().command[0, 1] == pytest.approx(np.radians(5.7))
    np.testing.assert_allclose(robot.advance(1).command_stamp, np.empty((1, 0)))
    assert heard.command_stamp[0, 0] == pytest.approx(0.0073)


def test_the_wire_rounds_and_the_firmware_bounds_a_command() -> None:
    robot = resting_robot(changed(), 2, "linear")
    robot.send(np.radians([[0.14, 0.16], [50.0, -90.0]]))
    value = np.degrees(robot.advance(20).command_value[:, 0])
    np.testing.assert_allclose(value, [[0.1, 0.2], [10.0, -75.0]], atol=1e-9)


def test_lost_messages_are_lost_at_their_rate() -> None:
    """4000 commands and 4000 reports: binomial sd below 0.8 %, false-alarm rate below 1e-6 at 4 %."""
    robot = resting_robot(
        changed(link__command_loss=0.3, link__feedback_loss=0.4, link__feedback_rate_hz=50), 40, "linear"
    )
    commands, reports = 0, 0
    for _ in range(100):
        robot.send(np.zeros((40, 2)))
        heard = robot.advance(20)
        commands += np.sum(~np.isnan(heard.command_stamp))
        reports += np.sum(~np.isnan(heard.feedback_stamp))
    assert commands / 4000 == pytest.approx(0.7, abs=0.04)
    assert reports / 4000 == pytest.approx(0.6, abs=0.04)


def test_reports_come_at_their_rate_late_and_in_steps() -> None:
    """8000 reports: mean latency known to 7 µs, false-alarm rate below 1e-6 at 40."""
    description = changed(link__feedback_rate_hz=200)
    robot = resting_robot(description, 20, "linear")
    robot.send(np.full((20, 2), 0.1))
    heard = [robot.advance(20) for _ in range(100)]
    received, stamp = (
        np.concatenate([getattr(each, name) for each in heard], axis=1)
        for name in ("feedback_received", "feedback_stamp")
    )
    angle = np.concatenate([each.feedback_angle for each in heard], axis=1)
    known = ~np.isnan(received)
    np.testing.assert_allclose(np.diff(stamp[0][known[0]]), 0.005, atol=1e-9)
    latency = (received - stamp)[known]
    assert latency.min() >= 0.001
    assert latency.max() <= 0.003
    assert latency.mean() == pytest.approx(0.002, abs=4e-5)
    steps = np.degrees(angle[known]) / 0.01
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


@pytest.mark.parametrize(("source", "gain"), [("imu", 1.03), ("encoder", 1.0)])
def test_reports_show_the_sensor_that_the_robot_has(source: str, gain: float) -> None:
    robot = resting_robot(changed(link__feedback_source=source), 1, "linear")
    robot.send(np.radians([[10.0, 0.0]]))
    robot.advance(1000)
    assert np.degrees(robot.advance(20).feedback_angle[0, 0, 0]) == pytest.approx(10.0 * gain, abs=0.06)


def test_frames_come_at_their_rate_late_and_stamped_by_their_own_clock() -> None:
    """3200 frames: latency uniform on 30…40 ms, mean known to 0.05 ms, false-alarm rate below 1e-6 at 0.26."""
    description = changed(camera__miss_probability=0.0, camera__stamp_jitter_ms=0.0)
    robot = resting_robot(description, 20, "linear")
    heard = [robot.advance(20) for _ in range(102)]
    received, stamp = (
        np.concatenate([getattr(each, name) for each in heard], axis=1) for name in ("frame_received", "frame_stamp")
    )
    known = ~np.isnan(received)
    assert np.all(np.abs(known.sum(axis=1) - 80 * (2.04 - 0.035)) < 2.0)
    exposure = stamp + 6.5e-3
    phases = []
    for trial in range(20):
        moments = exposure[trial][known[trial]]
        np.testing.assert_allclose(np.diff(moments), 1 / 80, atol=1e-9)
        phases.append(moments[0])
    assert 0 <= min(phases) < max(phases) < 1 / 80
    latency = (received - exposure)[known]
    assert latency.min() >= 0.030 - 1e-9
    assert latency.max() <= 0.040 + 1e-9
    assert latency.mean() == pytest.approx(0.035, abs=2.6e-4)


def test_the_stamps_jitter_by_their_standard_deviation() -> None:
    """3200 frames: sd of the intervals is √2 times that of the stamps, known to 2 %; false-alarm below 1e-6 at 10 %."""
    robot = resting_robot(changed(camera__stamp_jitter_ms=0.4), 20, "linear")
    heard = [robot.advance(20) for _ in range(102)]
    stamp = np.concatenate([each.frame_stamp for each in heard], axis=1)
    errors = np.concatenate([np.diff(row[~np.isnan(row)]) - 1 / 80 for row in stamp])
    assert errors.std() == pytest.approx(0.4e-3 * np.sqrt(2), rel=0.1)


def test_a_frame_shows_the_plate_from_where_the_gimbal_was_at_the_exposure(physics: str) -> None:
    robot = resting_robot(changed(**QUIET), 1, physics)
    angles, times, heard = [robot.truth().angle[0]], [0.0], []
    for k in range(400):
        robot.send(np.array([[0.0, 0.2 * np.sin(0.03 * k)]]))
        heard.append(robot.advance(1))
        angles.append(robot.truth().angle[0])
        times.append(robot.time)
    frames = np.concatenate([each.frame_position[0] for each in heard])
    stamps = np.concatenate([each.frame_stamp[0] for each in heard])
    known = ~np.isnan(stamps)
    yaw = np.interp(stamps[known] + 6.5e-3, times, np.array(angles)[:, 1])
    pitch = np.interp(stamps[known] + 6.5e-3, times, np.array(angles)[:, 0])
    assert np.ptp(yaw) > 0.2
    bearing = np.arctan2(frames[known, 1], frames[known, 0] * np.cos(pitch) - frames[known, 2] * np.sin(pitch))
    np.testing.assert_allclose(bearing, np.arctan2(0.3, 3.0) - yaw, atol=1e-6)


def test_an_injected_excitation_bypasses_the_link(physics: str) -> None:
    robot = resting_robot(changed(), 1, physics)
    sweep = np.zeros((50, 1, 2))
    sweep[:, 0, 1] = 0.01
    robot.advance(50, inject=sweep)
    np.testing.assert_allclose(robot.truth().command, [[0.0, 0.01]])
    robot.advance(50)
    np.testing.assert_allclose(robot.truth().command, [[0.0, 0.01]])


@pytest.mark.parametrize("command", [[[np.nan, 0.0]], [[0.0, np.inf]], [0.0, 0.0], [[0.0, 0.0]] * 2])
def test_a_command_that_no_wire_should_carry_is_refused(command: list[list[float]]) -> None:
    robot = resting_robot(changed(), 1, "linear")
    with pytest.raises(InputError, match=r"command must be finite angles of shape \(1, 2\)"):
        robot.send(np.array(command))


def test_bad_beginnings_are_refused(infantry: RobotDescription) -> None:
    with pytest.raises(InputError, match="batch must be at least 1"):
        VirtualRobot(infantry, 0, np.array([], int))
    robot = VirtualRobot(infantry, 1, np.array([0]), physics="linear")
    with pytest.raises(InputError, match="outside the commands"):
        robot.reset(np.radians([[20.0, 0.0]]), Resting(1))
    with pytest.raises(InputError, match="lead_s must be a whole number of ticks"):
        robot.reset(np.zeros((1, 2)), Resting(1), lead_s=0.0005)
