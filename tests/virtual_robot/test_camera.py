import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from archerfish.virtual_robot.camera import detect
from archerfish.virtual_robot.frames import gimbal_axes, into_base, into_gimbal

from .made_robots import QUIET, changed


def seen(plate, angle, **values):
    camera = changed(**{**QUIET, **values}).camera
    plate, angle = np.atleast_2d(plate), np.atleast_2d(angle)
    return detect(camera, plate, angle, np.zeros((len(plate), 4)), np.full(len(plate), 0.5))


def test_the_gimbals_frame_is_yaw_to_the_left_then_muzzle_up() -> None:
    """Against SciPy: intrinsic rotation about z, then about −y."""
    rng = np.random.default_rng(0)
    angle, vector = rng.uniform(-1, 1, (50, 2)), rng.standard_normal((50, 3))
    turn = Rotation.from_euler("ZY", np.stack([angle[:, 1], -angle[:, 0]], axis=1))
    np.testing.assert_allclose(into_base(gimbal_axes(angle), vector), turn.apply(vector), atol=1e-12)
    np.testing.assert_allclose(into_gimbal(gimbal_axes(angle), vector), turn.inv().apply(vector), atol=1e-12)


def test_a_plate_on_the_barrels_line_is_straight_ahead() -> None:
    pitch, yaw = 0.1, -0.3
    plate = 4.0 * np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    np.testing.assert_allclose(seen(plate, [pitch, yaw]).position, [[4.0, 0.0, 0.0]], atol=1e-12)


def test_a_gimbal_that_turns_left_sees_a_resting_plate_go_right() -> None:
    found = seen([[3.0, 0.0, 0.0]] * 2, [[0.0, 0.1], [0.1, 0.0]])
    np.testing.assert_allclose(found.position[0], [3 * np.cos(0.1), -3 * np.sin(0.1), 0.0], atol=1e-12)
    np.testing.assert_allclose(found.position[1], [3 * np.cos(0.1), 0.0, -3 * np.sin(0.1)], atol=1e-12)


def test_mounting_and_misalignment_shift_and_turn_the_picture() -> None:
    found = seen([3.0, 0.0, 0.0], [0.0, 0.0], camera__forward_m=0.1, camera__up_m=0.05)
    np.testing.assert_allclose(found.position, [[2.9, 0.0, -0.05]], atol=1e-12)
    found = seen([3.0, 0.0, 0.0], [0.0, 0.0], camera__misalignment_yaw_deg=2.0, camera__misalignment_pitch_deg=1.0)
    bearing = np.arctan2(found.position[0, 1], found.position[0, 0])
    assert bearing == pytest.approx(np.radians(-2.0), rel=2e-3)
    assert found.position[0, 2] == pytest.approx(-3.0 * np.sin(np.radians(1.0)) * np.cos(np.radians(2.0)), rel=2e-3)


@pytest.mark.parametrize(
    ("plate", "visible"),
    [
        ((3.0, 3.0 * np.tan(np.radians(49.9)), 0.0), True),
        ((3.0, 3.0 * np.tan(np.radians(50.1)), 0.0), False),
        ((3.0, 0.0, -3.0 * np.tan(np.radians(22.4))), True),
        ((3.0, 0.0, -3.0 * np.tan(np.radians(22.6))), False),
        ((-3.0, 0.0, 0.0), False),
    ],
)
def test_a_plate_outside_the_picture_is_not_found(plate: tuple[float, float, float], visible: bool) -> None:
    found = seen(plate, [0.0, 0.0])
    assert found.found.tolist() == [visible]
    assert np.isfinite(found.position).all() == visible


def test_noise_is_lateral_in_metres_and_along_the_sight_in_percent() -> None:
    """20,000 frames: each sd is known to 0.5 %, false-alarm rate below 1e-6 at 3 %."""
    count = 20_000
    rng = np.random.default_rng(0)
    camera = changed(camera__bearing_sd_mrad=1.0, camera__miss_probability=0.1).camera
    plate = np.tile([4.0, 1.0, -0.5], (count, 1))
    found = detect(camera, plate, np.zeros((count, 2)), rng.standard_normal((count, 4)), rng.random(count))
    # Binomial sd 0.2 %; false-alarm rate below 1e-6 at 1.1 %.
    assert found.found.mean() == pytest.approx(0.9, abs=0.011)
    place = found.position[found.found]
    distance = np.linalg.norm(plate[0])
    along = plate[0] / distance
    sideways = np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    upwards = np.cross(along, sideways)
    error = place - plate[0]
    assert (error @ along).std() == pytest.approx(0.015 * distance, rel=0.03)
    assert (error @ sideways).std() == pytest.approx(np.hypot(0.005, 0.001 * distance), rel=0.03)
    assert (error @ upwards).std() == pytest.approx(0.005, rel=0.03)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=5 * 0.07 / np.sqrt(count))
