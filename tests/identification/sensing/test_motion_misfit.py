import numpy as np
import pytest

from archerfish.identification.sensing.gimbal_track import examine_feedback, gimbal_track
from archerfish.identification.sensing.motion_misfit import motion_misfit
from archerfish.identification.sensing.plate_alignment import align_plate


@pytest.fixture(scope="module")
def sweep(sensing_recordings):
    robot, rng = sensing_recordings.Robot(), np.random.default_rng(0)
    gimbal, seen = sensing_recordings.sweep_recording(robot, rng)
    track = gimbal_track(gimbal, examine_feedback(gimbal).fresh)
    return track, seen, align_plate(track, seen.time, seen.position, -robot.clock)


def test_a_good_alignment_leaves_nothing_that_moves_with_the_gimbal(sweep):
    track, _, alignment = sweep
    found = motion_misfit(track, alignment)
    assert not found.shown
    assert found.p_value > 1e-3
    assert found.share < 0.02


def test_a_lens_that_bends_the_bearing_is_found(sweep):
    """A barrel distortion of 6 % at 45°: half a degree at 20°, which no time offset and no mounting explains."""
    track, seen, alignment = sweep
    azimuth = np.arctan2(seen.position[:, 1], seen.position[:, 0])
    reach = np.hypot(seen.position[:, 0], seen.position[:, 1])
    bent = azimuth * (1 - 0.1 * azimuth**2)
    position = np.stack([reach * np.cos(bent), reach * np.sin(bent), seen.position[:, 2]], axis=1)
    found = motion_misfit(track, align_plate(track, seen.time, position, alignment.offset))
    assert found.shown
    assert found.share > 0.05
