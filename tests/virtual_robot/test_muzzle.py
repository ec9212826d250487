import numpy as np
import pytest

from archerfish.virtual_robot.muzzle import after_shot, deficit_at, launch, rested_wheels

from .made_robots import changed, resting_robot

PLAIN = {
    "muzzle__boresight_pitch_deg": 0.0,
    "muzzle__boresight_yaw_deg": 0.0,
    "muzzle__forward_m": 0.0,
}


def test_droop_by_hand() -> None:
    """0.03 m/s per shot, regained with 150 ms: the second of two shots 150 ms apart lacks 0.03/e."""
    muzzle, yes = changed().muzzle, np.array([True])
    wheels = rested_wheels(1)
    assert deficit_at(muzzle, wheels, 0.0)[0] == 0.0
    wheels = after_shot(muzzle, wheels, 1.0, yes)
    assert deficit_at(muzzle, wheels, 1.15)[0] == pytest.approx(0.03 / np.e)
    wheels = after_shot(muzzle, wheels, 1.15, yes)
    assert deficit_at(muzzle, wheels, 1.15)[0] == pytest.approx(0.03 + 0.03 / np.e)
    resting = after_shot(muzzle, wheels, 2.0, np.array([False]))
    assert deficit_at(muzzle, resting, 1.15)[0] == pytest.approx(0.03 + 0.03 / np.e)


def test_rapid_fire_settles_at_the_geometric_sum() -> None:
    """Every 20 ms: the deficit before a shot is 0.03/(exp(20/150) − 1)."""
    robot = resting_robot(changed(muzzle__speed_sd_m_s=0.0, muzzle__speed_sensor_sd_m_s=0.0), 1, "linear")
    speeds = []
    for _ in range(100):
        speeds.append(robot.shoot(np.zeros((1, 3))).muzzle_speed_measured[0])
        robot.advance(20)
    assert speeds[0] == pytest.approx(18.0)
    assert speeds[-1] == pytest.approx(18.0 - 0.03 / np.expm1(20 / 150), abs=1e-6)
    assert np.all(np.diff(speeds) < 0)


def test_normals_move_elevation_azimuth_and_speed_by_their_standard_deviations() -> None:
    muzzle = changed(**PLAIN).muzzle
    normals = np.eye(3) * np.array([1.0, 1.0, 2.0])
    shot = launch(muzzle, np.zeros(3), np.zeros((3, 2)), np.zeros((3, 2)), normals)
    elevation = np.arcsin(shot.velocity[:, 2] / np.linalg.norm(shot.velocity, axis=1))
    azimuth = np.arctan2(shot.velocity[:, 1], shot.velocity[:, 0])
    np.testing.assert_allclose(np.degrees(elevation), [0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(azimuth), [0.0, 0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(shot.speed, [18.0, 18.0, 18.4])


def test_the_boresight_turns_with_the_barrel() -> None:
    muzzle = changed(**{**PLAIN, "muzzle__boresight_yaw_deg": 1.0}).muzzle
    shot = launch(muzzle, np.zeros(1), np.radians([[8.0, 30.0]]), np.zeros((1, 2)), np.zeros((1, 3)))
    azimuth = np.degrees(np.arctan2(shot.velocity[0, 1], shot.velocity[0, 0]))
    # Raised by 8°, the same angle at the barrel is wider on the ground by 1/cos 8°.
    assert azimuth == pytest.approx(30.0 + 1.0 / np.cos(np.radians(8.0)), abs=1e-3)


def test_a_turning_barrel_throws_the_pellet_aside() -> None:
    """ω × r at 0.16 m: 2 rad/s of yaw give 0.32 m/s to the left, 3 rad/s of pitch 0.48 m/s up."""
    muzzle = changed(**{**PLAIN, "muzzle__forward_m": 0.16}).muzzle
    shot = launch(muzzle, np.zeros(1), np.zeros((1, 2)), np.array([[3.0, 2.0]]), np.zeros((1, 3)))
    np.testing.assert_allclose(shot.velocity, [[18.0, 0.32, 0.48]], atol=1e-12)
    np.testing.assert_allclose(shot.position, [[0.16, 0.0, 0.0]])
    assert shot.speed[0] == 18.0


def test_the_sensor_shows_the_speed_with_its_noise() -> None:
    """400 shots: the sensor's sd is known to 3.5 %, false-alarm rate below 1e-6 at 20 %."""
    robot = resting_robot(changed(muzzle__droop_per_shot_m_s=0.0), 400, "linear")
    normals = np.random.default_rng(0).standard_normal((400, 3))
    error = robot.shoot(normals).muzzle_speed_measured - (18.0 + 0.2 * normals[:, 2])
    assert error.std() == pytest.approx(0.05, rel=0.2)
    assert abs(error.mean()) < 5 * 0.05 / 20


def test_a_shot_at_the_ground_lands_where_the_height_says() -> None:
    robot = resting_robot(changed(**PLAIN, muzzle__drag_per_m=0.0, muzzle__droop_per_shot_m_s=0.0), 2, "linear")
    shot = robot.shoot_down(np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    angle = shot.angle[:, 0]
    rise = 18.0 * np.sin(angle)
    time = (rise + np.sqrt(rise**2 + 2 * 9.81 * 0.45)) / 9.81
    np.testing.assert_allclose(shot.distance, 18.0 * np.cos(angle) * time, rtol=1e-6)
    assert shot.lateral[0] == pytest.approx(0.0, abs=1e-9)
    assert shot.lateral[1] == pytest.approx(shot.distance[1] * np.sin(np.radians(0.2)), rel=1e-3)
