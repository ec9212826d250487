"""Virtual robots through messages and shots: every stream of messages, the closed loop, and batches."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.camera import detect
from archerfish.virtual_robot.channel import Channel
from archerfish.virtual_robot.noise import NoiseStream

OFFSET_S = 6.5e-3  # from the stamp of a frame to its exposure


class Plates:
    """A plate for each seed, at a place of its own, which may swing sideways."""

    def __init__(self, seeds, place=(3.0, 0.3, 0.0), swing=0.0):
        self.places, self.swing = place + np.array(seeds)[:, None] * [0.1, -0.1, 0.0], swing

    def position(self, time):
        assert time.shape == self.places.shape[:1]
        return self.places + self.swing * np.sin(3.0 * time)[:, None] * [0.0, 1.0, 0.0]


@pytest.fixture
def robots(changed_robot):
    """Return robots that begin at rest under zero commands before plates."""

    def make(values=None, seeds=(0,), *, enforce_referee=False, **options):
        description = changed_robot(values, **options).description
        made = RobotBatch(description, len(seeds), np.array(seeds), enforce_referee=enforce_referee)
        made.reset(np.zeros((len(seeds), 2)), Plates(seeds))
        return made

    return make


def joined(received, trial):
    """Return a trial's reports, frames and commands, each a list of arrays without the padding."""
    kinds = []
    for parts in zip(*received, strict=True):
        fields = [np.concatenate(field, axis=1)[trial] for field in zip(*parts, strict=True)]
        kinds.append([field[~np.isnan(fields[1])] for field in fields])
    return kinds


def played(robot, seeds, pieces):
    """Play ten decisions; return all reports, frames and commands of each trial, and what became of its shots."""
    number, shots = np.array(seeds), []
    received = [robot.reset(np.zeros((len(seeds), 2)), Plates(seeds, swing=0.3), lead_s=0.1)]
    for decision in range(10):
        robot.send(np.stack([0.02 * np.sin(decision + number), 0.1 * np.cos(0.5 * decision + number)], axis=1))
        received += [robot.advance(ticks) for ticks in pieces]
        flight = robot.shoot(np.stack([np.sin(7.0 * decision + number + place) for place in range(3)], axis=1))
        shots.append([*flight.miss.T, flight.muzzle_speed_measured])
    return [[*joined(received, trial), np.array(shots)[..., trial]] for trial in range(len(seeds))]


def test_messages_arrive_in_order_after_their_latency_unless_they_are_lost():
    draws = np.random.default_rng(0)
    sent, (uniform, lost) = np.cumsum(draws.uniform(0.0, 0.01, (20, 500)), axis=1), draws.random((2, 20, 500))
    channel = Channel(20, 1, (5.0, 105.0))
    for part in (slice(200), slice(200, 500)):
        channel.send(sent[:, part], uniform[:, part], lost[:, part] < 0.1, sent[:, part, None])
    arrival, content = channel.take(9.0, 0)
    for row, kept in enumerate(lost >= 0.1):
        arrives = np.maximum.accumulate((sent + 5e-3 + 0.1 * uniform)[row, kept])
        assert_allclose(arrival[row, : kept.sum()], arrives, rtol=1e-12)
        assert_array_equal(content[row, : kept.sum(), 0], sent[row, kept])


def test_the_streams_of_a_trial_differ_by_purpose():
    first = [NoiseStream(np.array([1]), name).rows(0, 1)[0, 0, 0] for name in ("gyro", "camera", "speed")]
    assert len(set(first)) == 3


def test_a_trial_is_the_same_in_any_batch_in_any_pieces_and_after_another_reset(robots):
    values = {"link.command_loss": 0.2, "link.feedback_loss": 0.1, "link.feedback_rate_hz": 300}
    batch, alone = (robots(values, seeds, noisy=True) for seeds in (range(8), [5]))
    together = played(batch, range(8), [20])
    for found in (played(batch, range(8), [7, 1, 12])[5], played(alone, [5], [1] * 20)[0]):
        for kind, expected in zip(found, together[5], strict=True):
            for field, same in zip(kind, expected, strict=True):
                assert_array_equal(field, same)
    assert together[5][0][1][:9].tolist() != together[4][0][1][:9].tolist()


def test_commands_come_into_force_late_in_steps_and_within_the_firmwares_range(robots):
    """2000 latencies, uniform on 5…15 ms: the mean is known to 0.065 ms, false alarms below 1e-6 at 0.33."""
    robot, delays = robots(seeds=range(20)), []
    for _ in range(100):
        sent = robot.time
        robot.send(np.full((20, 2), 0.01))
        delays.append(robot.advance(20).commands.received_s[:, 0] - sent)
    assert (np.min(delays), np.max(delays)) == (pytest.approx(0.005, abs=1e-4), pytest.approx(0.015, abs=1e-4))
    assert np.mean(delays) == pytest.approx(0.010, abs=3.3e-4)
    robot = robots({f"link.command_latency_{side}_ms": 7.3 for side in ("low", "high")})
    robot.reset(np.array([[-0.1, 0.0]]), Plates([0]))
    robot.send(np.radians([[50.0, 0.16]]))
    robot.advance(8)
    assert_allclose([*robot.truth().command, *robot.truth().angle], [[-0.1, 0.0], [-0.103, 0.0]], atol=1e-4)
    assert robot.advance(1).commands.received_s == pytest.approx(0.0073)
    assert_allclose(np.degrees(robot.truth().command), [[10.0, 0.2]])
    assert abs(robot.truth().torque[0, 1]) < 0.01  # the new torque is still on the bus
    robot.advance(1)
    assert robot.truth().torque[0, 1] > 0.05
    robot.advance(50, inject=np.tile([0.0, 0.01], (50, 1, 1)))
    robot.advance(50)
    assert_allclose(robot.truth().command, [[0.0, 0.01]])


@pytest.mark.parametrize(("source", "gain"), [("imu", 1.03), ("encoder", 1.0)])
def test_reports_come_at_their_rate_late_in_steps_from_the_sensor_and_lost_at_theirs(robots, source, gain):
    """4000 reports: the mean latency is known to 12 µs, the loss to 0.8 %; false alarms below 1e-6."""
    values = {"link.feedback_rate_hz": 200, "link.feedback_loss": 0.4, "link.feedback_source": f'"{source}"'}
    robot = robots(values, range(10))
    robot.send(np.full((10, 2), np.radians(8.0)))
    received = [robot.advance(20) for _ in range(100)]
    reports = zip(*(joined(received, trial)[0] for trial in range(10)), strict=True)
    sampled, arrived, angle, _ = map(np.concatenate, reports)
    assert np.abs(arrived - sampled - 0.002).max() <= 0.001 + 1e-12
    assert np.mean(arrived - sampled) == pytest.approx(0.002, abs=6e-5)
    assert len(arrived) / 4000 == pytest.approx(0.6, abs=0.04)
    assert_allclose(np.rint(np.degrees(angle) / 0.01), np.degrees(angle) / 0.01, atol=1e-6)
    assert np.degrees(angle[sampled > 1.5, 0]).mean() == pytest.approx(8.0 * gain, abs=0.06)


def test_frames_come_at_their_rate_late_and_stamped_by_their_own_clock(robots):
    """3200 frames at 80 Hz, 30…40 ms late, stamps known to 0.4 ms; false alarms below 1e-6 at the tolerances."""
    robot, phases, errors = robots({"camera.stamp_jitter_ms": 0.4}, range(20)), [], []
    received = [robot.advance(20) for _ in range(102)]
    assert len({batch.detections.received_s.shape for batch in received}) == 1
    for stamp, arrived, *_ in (joined(received, trial)[1] for trial in range(20)):
        assert abs(len(stamp) - 80 * (2.04 - 0.035)) < 2.0
        frame = np.arange(len(stamp)) / 80
        phases.append(np.mean(stamp + OFFSET_S - frame))
        errors.append(stamp + OFFSET_S - frame - phases[-1])
        assert np.abs(arrived - frame - phases[-1] - 0.035).max() < 0.005 + 2e-4
    assert (min(phases), max(phases)) == (pytest.approx(0.0, abs=2e-3), pytest.approx(1 / 80, abs=2e-3))
    assert np.concatenate(errors).std() == pytest.approx(0.4e-3, rel=0.1)


def test_a_frame_shows_the_plate_from_where_the_gimbal_was_at_the_exposure(robots):
    robot = robots()
    angles, received = [robot.truth().angle[0]], []
    for tick in range(400):
        robot.send(np.array([[0.05 * np.sin(0.02 * tick), 0.2 * np.sin(0.03 * tick)]]))
        received.append(robot.advance(1))
        angles.append(robot.truth().angle[0])
    stamp, _, _, position = joined(received, 0)[1]
    pitch, yaw = (np.interp(stamp + OFFSET_S, 1e-3 * np.arange(401), axis) for axis in np.transpose(angles))
    assert np.ptp(yaw) > 0.2
    turned = Rotation.from_euler("ZY", np.stack([yaw, -pitch], axis=1)).apply(position[:, 0])
    assert_allclose(turned, np.tile([3.0, 0.3, 0.0], (len(stamp), 1)), atol=1e-6)


def test_a_camera_beside_the_barrel_sees_plates_in_its_view_with_noise_across_and_along_its_line(changed_robot):
    """20,000 frames: each sd is known to 0.5 %, false alarms below 1e-6 at 3 %."""
    values = {"forward_m": 0.1, "up_m": 0.05, "misalignment_yaw_deg": 2, "misalignment_pitch_deg": 1}
    camera = changed_robot({f"camera.{name}": value for name, value in values.items()}).description.camera
    mount, turn = [0.1, 0.0, 0.05], Rotation.from_euler("ZY", [2.0, -1.0], degrees=True)
    seen = np.array([(3.0, 3.0 * np.tan(np.radians(yaw)), 3.0 * np.tan(np.radians(pitch))) for yaw, pitch in
                     ((49.9, 0.0), (50.1, 0.0), (0.0, -22.4), (0.0, -22.6))] + [(-3.0, 0.0, 0.0)])  # fmt: skip
    found = detect(camera, turn.apply(seen) + mount, np.zeros((5, 2)), np.zeros((5, 3)), np.full(5, 0.5))
    assert_allclose(found, np.where(np.array([[1], [0], [1], [0], [0]]), seen, np.nan), atol=1e-12)
    noisy, draws = {"camera.bearing_sd_mrad": 1, "camera.miss_probability": 0.1}, np.random.default_rng(0)
    plate, camera = np.array([4.0, 1.0, -0.5]), changed_robot(noisy, noisy=True).description.camera
    error = detect(camera, np.tile(plate, (20_000, 1)), np.zeros((20_000, 2)), draws.standard_normal((20_000, 3)),
                   draws.random(20_000)) - plate  # fmt: skip
    error, distance = error[~np.isnan(error[:, 0])], np.linalg.norm(plate)
    assert len(error) / 20_000 == pytest.approx(0.9, abs=0.011)
    along, sideways = plate / distance, np.array([-1.0, 4.0, 0.0]) / np.hypot(1.0, 4.0)
    spread = [(error @ axis).std() for axis in (along, sideways, np.cross(along, sideways))]
    assert_allclose(spread, [0.015 * distance, np.hypot(0.005, 0.001 * distance), 0.005], rtol=0.03)


def test_shots_arrive_by_hand_kick_the_barrel_and_are_measured_with_the_sensors_noise(robots):
    """Without drag, from a muzzle at 0.16 m; 399 readings: the sd is known to 3.5 %, false alarms below 1e-6."""
    values = {"muzzle.drag_per_m": 0, "gimbal.pitch.friction_n_m": 0, "gimbal.pitch.recoil_n_m_s": 7e-3}
    robot, fire, time = robots(values, range(400), exact=True), np.arange(400) > 0, 2.84 / 18.0
    robot.retarget(Plates(np.zeros(400), (3.0, 0.055, -0.5 * 9.81 * time**2)))
    flight = robot.shoot(np.zeros((400, 3)), fire)
    assert_allclose(flight.flight_time[1:], time, rtol=1e-3)
    assert_allclose(flight.miss[1:], np.tile([-0.055, 0.0], (399, 1)), atol=2e-3)
    assert np.isnan([flight.flight_time[0], flight.muzzle_speed_measured[0], *flight.miss[0]]).all()
    assert (flight.muzzle_speed_measured[1:] - 18.0).std() == pytest.approx(0.05, rel=0.2)
    landing = robot.shoot_down(np.zeros((400, 3)), fire)
    assert not np.any(landing.muzzle_speed_measured == flight.muzzle_speed_measured)
    robot.advance(2)
    inertia = 0.001 + 0.0078 + 0.786 * (0.025**2 + 0.01**2)
    assert_allclose(robot.truth().rate[1:, 0] - robot.truth().rate[0, 0], 2 * 7e-3 / inertia, rtol=0.02)


def test_rapid_fire_settles_at_the_geometric_sum_and_an_enforced_rate_withholds_shots(robots):
    for enforced, rate in ((False, 50), (True, 10)):
        robot, speeds = robots({"muzzle.speed_sensor_sd_m_s": 0}, noisy=True, enforce_referee=enforced), []
        for _ in range(100):
            speeds.append(robot.shoot(np.zeros((1, 3))).muzzle_speed_measured[0])
            robot.advance(20)
        fired = np.array(speeds)[~np.isnan(speeds)]
        assert len(fired) == 2 * rate
        assert_allclose(fired[[0, -1]], [18.0, 18.0 - 0.03 / np.expm1(1.0 / rate / 0.15)], atol=1e-6)


def test_what_no_robot_can_do_is_refused(robots, refused):
    robot = robots()
    refused("batch must be at least 1", RobotBatch, robot.description, 0, np.array([], int))
    for seeds in ([1], [[1, 2]], [1.5, 2.0], [-1, 2]):
        refused("seeds must be 2 whole numbers from 0 on", RobotBatch, robot.description, 2, np.array(seeds))
    refused("outside the commands", robot.reset, np.radians([[20.0, 0.0]]), Plates([0]))
    refused("lead_s must be a whole number of ticks", robot.reset, np.zeros((1, 2)), Plates([0]), lead_s=0.0005)
    for command in ([[np.nan, 0.0]], [[0.0, np.inf]], [0.0, 0.0], [[0.0, 0.0]] * 2):
        refused(r"command must be finite angles of shape \(1, 2\)", robot.send, np.array(command))
