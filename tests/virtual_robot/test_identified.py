"""The robot of the records: its plants tick by tick, its camera, link and muzzle, and that it needs no MuJoCo."""

from pathlib import Path

import numpy as np
import pytest

from archerfish.dynamics.linear_axis import advance, gimbal_angle, gimbal_model, rest_state
from archerfish.robot import Robot
from archerfish.studies.rehearse import emulated_robot, rehearse
from archerfish.task import Task
from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.firing_range import Plate
from archerfish.virtual_robot.identified import IdentifiedServo, described_by_records

FOLDER = Path(__file__).parents[1] / "infantry"
INFANTRY = Robot.load(FOLDER)
SEEDS = np.arange(2)


def resampled(plant, samples):
    """Return a plant that is sampled only every so many times; held commands give the same angles."""
    a, b = plant.A, plant.B
    for _ in range(samples - 1):
        a, b = a @ plant.A, plant.A @ b + plant.B
    period_s = samples * plant.sample_period_s
    return plant.replace(A=a, B=b, delay_samples=0, sample_period_s=period_s, draws={}, draw_delays=np.zeros(0, int))


def turned(robot, held_ticks=100):
    """Return the angles of a robot whose command steps at its second period [rad], (ticks, 2)."""
    servo = IdentifiedServo(robot, SEEDS)
    servo.reset(np.zeros((2, 2)))
    commands = np.zeros((4 * held_ticks, 2, 2))
    commands[held_ticks:] = [0.1, -0.3]
    # In two pieces, as the emulator runs it.
    angles = [servo.run(commands[:333]).angle, servo.run(commands[333:]).angle[1:]]
    return np.concatenate(angles)[:, 1]


def test_the_gimbal_moves_as_its_plants_do_over_a_decision_period():
    model = gimbal_model(INFANTRY.pitch, INFANTRY.yaw, 0.1)
    state = rest_state(model, np.zeros(2))
    angles = turned(INFANTRY)
    for period, command in enumerate([[0.0, 0.0], [0.1, -0.3], [0.1, -0.3], [0.1, -0.3]]):
        state = advance(model, state, np.array(command))
        np.testing.assert_allclose(angles[100 * (period + 1)], gimbal_angle(model, state), atol=1e-10)


def test_plants_that_are_sampled_more_slowly_are_divided_into_ticks():
    still = {"delay_samples": 0}
    fine = INFANTRY.replace(pitch=INFANTRY.pitch.replace(**still), yaw=INFANTRY.yaw.replace(**still))
    for samples in (4, 5):
        coarse = fine.replace(pitch=resampled(fine.pitch, samples), yaw=resampled(fine.yaw, samples))
        np.testing.assert_allclose(turned(coarse), turned(fine), atol=1e-9)


def test_a_plant_that_cannot_be_divided_steps_at_its_own_period():
    plant = INFANTRY.yaw.replace(
        A=[[-0.2]], B=[[1.2]], C=[[1.0]], delay_samples=0, sample_period_s=0.01, draws={}, draw_delays=np.zeros(0, int)
    )
    yaw = turned(INFANTRY.replace(yaw=plant))[:, 1]
    np.testing.assert_allclose(yaw[[100, 110, 120]], [0.0, -0.36, -0.288], atol=1e-12)
    assert yaw[105] == pytest.approx(-0.18)


def test_camera_link_and_muzzle_are_those_of_the_records():
    robot, sensing = (
        RobotBatch(
            described_by_records(INFANTRY, 0.06, (0.1, 0.0, 0.05)),
            2,
            SEEDS,
            servo=IdentifiedServo(INFANTRY, SEEDS),
        ),
        INFANTRY.sensing,
    )
    robot.reset(np.zeros((2, 2)), Plate(3.0))
    robot.send(np.full((2, 2), 0.05))
    received = robot.advance(4000)
    frames, reports = received.detections, received.feedback
    latency = (frames.received_s - frames.exposed_s)[np.isfinite(frames.received_s)] - sensing.camera.time_offset
    assert latency.mean() == pytest.approx(sensing.camera.latency, abs=4e-4)
    assert latency.std() == pytest.approx(sensing.camera.latency_jitter, rel=0.1)
    places = frames.position[frames.found]
    np.testing.assert_allclose(np.median(places[-100:], axis=0)[0], 3.0 - 0.1, atol=0.03)
    waited = np.nanmean(reports.received_s - reports.sampled_s)
    assert waited == pytest.approx(sensing.link.feedback_latency, abs=1e-4)
    flights = [robot.shoot(np.random.default_rng(seed).standard_normal((2, 3))) for seed in range(200)]
    speeds = np.concatenate([flight.muzzle_speed_measured for flight in flights])
    assert speeds.mean() == pytest.approx(INFANTRY.muzzle.speed, abs=0.05)
    assert np.std([flight.miss[:, 0] for flight in flights]) == pytest.approx(3.0 * INFANTRY.muzzle.yaw_sd, rel=0.15)


def test_it_is_rehearsed_with_through_bytes_without_mujoco_and_jax(run_python):
    code = f"""
from archerfish.studies.rehearse import rehearse
from archerfish.virtual_robot.emulator import Fault
found = rehearse("kalman", {str(FOLDER)!r}, seconds=4, tuning="start", faults=[Fault("hidden", 4.0, 9.0)])
print(found.virtual, sum(found.fired), sum(found.hits), found.violations, len(found.shots))
"""
    virtual, fired, hits, violations, shots = run_python(code, blocked=("mujoco", "jax")).split()
    assert (virtual, violations, shots) == ("identified", "{}", fired)
    assert 120 < int(fired) < 150  # none from 0.25 s after the plate was hidden on
    assert int(hits) > 0.85 * int(fired)


def test_a_robot_without_a_record_of_its_camera_is_refused(refused):
    refused(
        "has no sensing.json", emulated_robot, "identified", Robot.paper(), Task.load("any"), ["sp_vision_25"], None
    )
    refused("no record of its camera and link", rehearse, "kalman", "paper")
