"""What a computer makes of a robot's messages: angles at an exposure, and plates in O."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish.messages import Detections, Feedback
from archerfish.tracking.host import REMEMBERED_S, angle_at, from_camera, new_host, with_messages

NAN = np.nan
GUESS = np.array([[3.0, 0.0, 0.0]])


def feedback(sampled, angle):
    """Return reports with rates of ten times the angles."""
    sampled = np.atleast_2d(np.asarray(sampled, float))
    angle = np.asarray(angle, float).reshape(*sampled.shape, 2)
    return Feedback(sampled, sampled + 0.002, angle, 10.0 * angle)


def frames(exposed, position, found=True):
    exposed = np.atleast_2d(np.asarray(exposed, float))
    position = np.broadcast_to(np.asarray(position, float), (*exposed.shape, 3))
    found = np.broadcast_to(found, exposed.shape)
    return Detections(exposed, exposed + 0.03, found[..., None], position[..., None, :])


NO_REPORTS, NO_FRAMES = feedback(np.zeros((1, 0)), np.zeros((1, 0, 2))), frames(np.zeros((1, 0)), np.zeros((1, 0, 3)))


def begun(sampled, angle):
    given = feedback(sampled, angle)
    count = len(given.sampled_s)
    none = Detections(*(np.repeat(field, count, axis=0) for field in NO_FRAMES))
    return with_messages(new_host(np.repeat(GUESS, count, axis=0)), given, none, 0.0, float(np.nanmax(sampled)))


def rotation(angle):
    """Pitch about the gimbal's y first, then yaw about z; muzzle up is a turn by −pitch about +y."""
    pitch, yaw = angle
    about_y = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]) @ about_y


def test_angles_are_interpolated_between_reports_and_held_before_them():
    rng = np.random.default_rng(71)
    sampled = np.cumsum(rng.uniform(0.001, 0.01, (3, 20)), axis=1)
    angles, moments = rng.uniform(-1.0, 1.0, (3, 20, 2)), rng.uniform(-0.05, 1.0, (3, 50)) * sampled[:, -1:]
    found = angle_at(begun(sampled, angles).reports, moments)
    for trial in range(3):
        for axis in range(2):
            expected = np.interp(moments[trial], sampled[trial], angles[trial, :, axis])
            assert_allclose(found[trial, :, axis], expected, atol=1e-12)


def test_missing_reports_are_passed_over_late_ones_sorted_in_and_old_ones_forgotten():
    host = begun([[NAN, 0.01, NAN, 0.03]], [[[NAN, NAN], [0.1, 0.2], [NAN, NAN], [0.3, 0.6]]])
    late = feedback([[0.02, NAN, 0.04]], [[[0.5, 0.5], [NAN, NAN], [0.4, 0.8]]])
    host = with_messages(host, late, NO_FRAMES, 0.0, 0.04)
    found = angle_at(host.reports, np.array([[0.01, 0.02, 0.025, 0.04]]))[0]
    assert_allclose(found, [[0.1, 0.2], [0.5, 0.5], [0.4, 0.55], [0.4, 0.8]])
    assert_allclose(host.reports.rate, [[4.0, 8.0]])
    later = with_messages(host, feedback([[0.4]], [[[1.0, 1.0]]]), NO_FRAMES, 0.0, 0.4)
    assert later.reports.sampled_s.shape == (1, 1)
    assert later.reports.sampled_s.min() > 0.4 - REMEMBERED_S
    silent = with_messages(later, feedback([[NAN]], [[[NAN, NAN]]]), NO_FRAMES, 0.0, 9.0)
    assert silent.reports.sampled_s.tolist() == [[0.4]]
    assert_allclose(silent.reports.angle, [[[1.0, 1.0]]])


def test_yaw_goes_on_where_that_of_the_wire_wraps():
    true = np.linspace(3.0, 3.6, 13)
    wrapped = np.stack([0.0 * true, (true + np.pi) % (2.0 * np.pi) - np.pi], axis=-1)
    host = begun(0.01 * np.arange(6), wrapped[:6])
    host = with_messages(host, feedback(0.01 * np.arange(6, 13), wrapped[6:]), NO_FRAMES, 0.0, 0.12)
    assert_allclose(angle_at(host.reports, np.array([0.01 * np.arange(13)]))[0, :, 1], true)


def test_of_several_frames_the_latest_that_shows_the_plate_counts_and_older_ones_change_nothing():
    host = begun([0.0, 0.1], np.zeros((2, 2)))
    position = [[[1.0, 0, 0], [9.0, 9.0, 9.0], [2.0, 0.1, 0.2], [NAN, NAN, NAN]]]
    given = frames([[0.03, 0.05, 0.04, NAN]], position, [[True, False, True, False]])
    host = with_messages(host, NO_REPORTS, given, 0.0, 0.1)
    assert_allclose(host.plate.position, [[2.0, 0.1, 0.2]])
    assert (host.plate.exposed_s.tolist(), host.plate.is_new.tolist()) == ([0.04], [True])
    for exposed in (0.035, 0.04, NAN):
        after = with_messages(host, NO_REPORTS, frames([[exposed]], [7.0, 7.0, 7.0]), 0.0, 0.1)
        assert_allclose(after.plate.position, host.plate.position)
        assert not after.plate.is_new.any()


def test_a_frame_waits_for_a_report_from_after_its_exposure():
    # The gimbal turns at 2 rad/s, and its report of 0.05 s comes after the frame of 0.045 s.
    plate, rate = np.array([3.0, 0.4, 0.2]), np.array([0.0, 2.0])
    sampled = np.array([0.0, 0.02, 0.04])
    seen = rotation(0.045 * rate).T @ plate
    waiting = with_messages(begun(sampled, sampled[:, None] * rate), NO_REPORTS, frames([[0.045]], seen), 0.0, 0.08)
    assert_array_equal(waiting.plate.position, GUESS)
    assert not waiting.plate.is_new.any()
    host = with_messages(waiting, feedback([[0.05]], 0.05 * rate), NO_FRAMES, 0.0, 0.09)
    assert host.plate.is_new.all()
    assert_allclose(host.plate.position[0], plate, atol=1e-12)


@pytest.mark.parametrize(("error", "farthest"), [(0.0, 1e-12), (0.004, 0.04)])
def test_a_turning_gimbal_leaves_a_still_plate_still_and_a_wrong_offset_does_not(error, farthest):
    plate, rate = np.array([3.0, 0.4, 0.2]), np.array([0.3, 2.0])
    sampled = 0.002 * np.arange(60)
    host = begun(sampled, sampled[:, None] * rate)
    for moment in (0.0213, 0.0338, 0.0463, 0.0588):
        given = frames([[moment - 0.5]], rotation(moment * rate).T @ plate)  # a camera whose clock is 0.5 s behind
        away = with_messages(host, NO_REPORTS, given, 0.5 + error, 0.12).plate.position[0] - plate
        assert 0.6 * 6 * error <= np.linalg.norm(away) <= farthest  # 2 rad/s for 4 ms at 3 m are 24 mm


def test_places_turn_by_pitch_then_yaw():
    assert_allclose(from_camera(np.array([1.0, 0, 0]), np.array([np.pi / 2, 0.0])), [0, 0, 1], atol=1e-15)
    assert_allclose(from_camera(np.array([0, 0, 1.0]), np.array([np.pi / 2, 0.0])), [-1, 0, 0], atol=1e-15)
    assert_allclose(from_camera(np.array([1.0, 0, 0]), np.array([0.0, np.pi / 2])), [0, 1, 0], atol=1e-15)
    rng = np.random.default_rng(72)
    angles, places = rng.uniform(-1.0, 1.0, (2, 3, 2)), rng.uniform(-2.0, 4.0, (2, 3, 3))
    for index in np.ndindex(2, 3):
        assert_allclose(from_camera(places, angles)[index], rotation(angles[index]) @ places[index], atol=1e-12)
