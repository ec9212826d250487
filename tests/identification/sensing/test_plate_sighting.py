import numpy as np
from scipy.spatial.transform import Rotation

from archerfish.identification.sensing.plate_sighting import Sighting, sighted_position, spherical


def test_a_plate_is_seen_as_by_rotation_matrices():
    sighting = Sighting(*(np.array(each) for each in (0.3, 3.0, 0.1, -0.02, 0.05, 0.02, -0.04)))
    yaw, pitch = np.array([0.0, 0.4, -0.5]), np.array([0.1, -0.1, 0.0])
    for seen, at_yaw, at_pitch in zip(sighted_position(sighting, yaw, pitch), yaw, pitch, strict=True):
        # Muzzle up is a negative rotation about y; the camera rolls about its own x.
        camera = Rotation.from_euler("ZYX", [at_yaw, -(at_pitch + 0.02), -0.04])
        plate = Rotation.from_euler("Z", 0.3).apply([3.0, 0.0, 0.0])
        np.testing.assert_allclose(seen, camera.inv().apply(plate) + np.array([0.1, -0.02, 0.05]), atol=1e-12)


def test_spherical_of_the_axes():
    found = spherical(np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]))
    np.testing.assert_allclose(found, [[0, 0, 2], [np.pi / 2, 0, 2], [0, np.pi / 2, 2]])
