import numpy as np
from numpy.testing import assert_allclose

from archerfish.sensing.host import (
    REMEMBERED_S,
    Reports,
    Sighting,
    angle_at,
    into_base,
    latest_sighting,
    no_frames,
    no_reports,
    with_frames,
    with_reports,
)

NAN = np.nan


def reported(stamps, angles, now: float | None = None) -> Reports:
    """Reports of one or more gimbals, with rates of ten times the angles."""
    stamps, angles = np.atleast_2d(np.asarray(stamps, float)), np.asarray(angles, float)
    angles = angles.reshape(*stamps.shape, 2)
    now = float(np.nanmax(stamps)) if now is None else now
    return with_reports(no_reports(len(stamps)), stamps, angles, 10.0 * angles, now)


def unseen(batch: int = 1) -> Sighting:
    return Sighting(np.tile([3.0, 0.0, 0.0], (batch, 1)), np.full(batch, -np.inf), np.zeros(batch, bool))


def sighted(before: Sighting, reports: Reports, exposed, found, position) -> Sighting:
    """The sight after frames that come at 0.1 s."""
    return latest_sighting(before, reports, with_frames(no_frames(len(exposed)), exposed, found, position, 0.1))


def turned(angle: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Pitch about the gimbal's y first, then yaw about z, as two matrices; muzzle up is a turn by −pitch about +y."""
    pitch, yaw = angle
    about_y = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ vector)


def test_angles_are_interpolated_between_reports_and_held_before_them() -> None:
    rng = np.random.default_rng(71)
    stamps = np.cumsum(rng.uniform(0.001, 0.01, (3, 20)), axis=1)
    angles = rng.uniform(-1.0, 1.0, (3, 20, 2))
    moments = rng.uniform(-0.05, 1.0, (3, 50)) * stamps[:, -1:]
    found = angle_at(reported(stamps, angles), moments)
    for trial in range(3):
        for axis in range(2):
            expected = np.interp(moments[trial], stamps[trial], angles[trial, :, axis])
            assert_allclose(found[trial, :, axis], expected, atol=1e-12)


def test_places_without_a_report_are_passed_over() -> None:
    stamps = [[NAN, 0.01, NAN, 0.02], [0.01, NAN, NAN, NAN]]
    angles = np.full((2, 4, 2), NAN)
    angles[0, 1], angles[0, 3], angles[1, 0] = (0.1, 0.2), (0.3, 0.6), (0.5, -0.5)
    reports = reported(stamps, angles)
    assert_allclose(angle_at(reports, np.array([[0.015], [0.01]]))[:, 0], [[0.2, 0.4], [0.5, -0.5]])
    assert_allclose(reports.rate[:, -1], [[3.0, 6.0], [5.0, -5.0]])
    assert_allclose(reports.stamp[:, -1], [0.02, 0.01])


def test_the_latest_report_is_kept_and_old_ones_are_forgotten() -> None:
    reports = reported([0.0, 0.1, 0.2], [[1, 1], [2, 2], [3, 3]])
    later = with_reports(reports, np.array([[0.4]]), np.array([[[4.0, 4.0]]]), np.zeros((1, 1, 2)), now=0.4)
    assert later.stamp.tolist() == [[0.2, 0.4]]
    silent = with_reports(reports, np.full((1, 2), NAN), np.full((1, 2, 2), NAN), np.full((1, 2, 2), NAN), now=9.0)
    assert silent.stamp.tolist() == [[0.2]]
    assert_allclose(silent.angle, [[[3.0, 3.0]]])
    assert later.stamp.min() > 0.4 - REMEMBERED_S


def test_reports_that_come_in_disorder_are_sorted() -> None:
    reports = reported([0.02, 0.01, 0.03], [[2, 2], [1, 1], [3, 3]])
    assert_allclose(angle_at(reports, np.array([[0.015, 0.025]])), [[[1.5, 1.5], [2.5, 2.5]]])


def test_reports_that_overtake_those_of_an_earlier_call_are_sorted_too() -> None:
    reports = reported([0.01, 0.03], [[1, 1], [3, 3]])
    late = np.array([[NAN, 0.02, 0.04]]), np.array([[[NAN, NAN], [2.0, 2.0], [4.0, 4.0]]])
    reports = with_reports(reports, *late, 10.0 * late[1], now=0.04)
    assert_allclose(angle_at(reports, np.array([[0.015, 0.025, 0.035]]))[0, :, 0], [1.5, 2.5, 3.5])
    assert_allclose(reports.rate[:, -1], [[40.0, 40.0]])


def test_what_reports_say_does_not_depend_on_how_many_places_are_empty() -> None:
    rng = np.random.default_rng(72)
    full, sparse = no_reports(2), no_reports(2)
    for call in range(30):
        stamps = 0.02 * call + np.sort(rng.uniform(0.0, 0.02, (2, 4)), axis=1)
        angles = rng.uniform(-1.0, 1.0, (2, 4, 2))
        now = 0.02 * (call + 1)
        full = with_reports(full, stamps, angles, -angles, now)
        empty = np.full((2, 3), NAN)
        stamps = np.concatenate([stamps[:, :2], empty, stamps[:, 2:], empty], axis=1)
        angles = np.concatenate([angles[:, :2], empty[..., None] + [0, 0], angles[:, 2:], empty[..., None] + [0, 0]], 1)
        sparse = with_reports(sparse, stamps, angles, -angles, now)
        moments = now - rng.uniform(0.0, min(now, 0.2), (2, 6))
        np.testing.assert_array_equal(angle_at(full, moments), angle_at(sparse, moments))
        np.testing.assert_array_equal(full.rate[:, -1], sparse.rate[:, -1])
    assert np.unique(sparse.stamp[0]).size <= 60


def test_of_several_frames_the_one_exposed_last_that_shows_the_plate_counts() -> None:
    reports = reported([0.0, 0.1], np.zeros((2, 2)))
    exposed = np.array([[0.03, 0.05, 0.04, NAN]])
    found = np.array([[True, False, True, False]])
    position = np.array([[[1.0, 0, 0], [NAN, NAN, NAN], [2.0, 0.1, 0.2], [NAN, NAN, NAN]]])
    sighting = sighted(unseen(), reports, exposed, found, position)
    assert_allclose(sighting.plate, [[2.0, 0.1, 0.2]])
    assert sighting.exposed.tolist() == [0.04]
    assert sighting.fresh.tolist() == [True]


def test_a_frame_older_than_the_last_one_changes_nothing() -> None:
    reports = reported([0.0, 0.1], np.zeros((2, 2)))
    before = Sighting(np.array([[2.0, 0.1, 0.2]]), np.array([0.06]), np.array([True]))
    for stamp in (0.05, 0.06, NAN):
        after = sighted(before, reports, np.array([[stamp]]), np.array([[True]]), np.ones((1, 1, 3)))
        assert_allclose(after.plate, before.plate)
        assert_allclose(after.exposed, before.exposed)
        assert not after.fresh.any()


def test_without_any_frame_the_last_sight_is_not_fresh() -> None:
    before = Sighting(np.array([[2.0, 0.1, 0.2]]), np.array([0.06]), np.array([True]))
    none = np.zeros((1, 0))
    after = sighted(before, reported([0.0], np.zeros((1, 2))), none, none.astype(bool), np.zeros((1, 0, 3)))
    assert_allclose(after.plate, before.plate)
    assert not after.fresh.any()


def test_a_frame_waits_for_a_report_from_after_its_exposure() -> None:
    # The gimbal turns at 2 rad/s, and its report of 0.05 s comes after the frame of 0.045 s.
    plate, rate = np.array([3.0, 0.4, 0.2]), np.array([0.0, 2.0])
    stamps = np.array([0.0, 0.02, 0.04])
    reports = reported(stamps, stamps[:, None] * rate)
    seen = np.linalg.solve(_rotation(0.045 * rate), plate)
    frames = with_frames(no_frames(1), np.array([[0.045]]), np.array([[True]]), seen[None, None], 0.08)
    waiting = latest_sighting(unseen(), reports, frames)
    assert not waiting.fresh.any()
    assert waiting.exposed.tolist() == [-np.inf]
    later = with_reports(reports, np.array([[0.05]]), 0.05 * rate[None, None], rate[None, None], 0.09)
    sighting = latest_sighting(waiting, later, frames)
    assert sighting.fresh.all()
    assert_allclose(sighting.plate[0], plate, atol=1e-12)


def test_old_frames_are_forgotten() -> None:
    one = np.array([[True]])
    frames = with_frames(no_frames(1), np.array([[0.1]]), one, np.ones((1, 1, 3)), 0.1)
    later = with_frames(frames, np.array([[0.5]]), one, 2.0 * np.ones((1, 1, 3)), 0.5)
    assert later.exposed.tolist() == [[0.5]]
    assert_allclose(later.position, [[[2.0, 2.0, 2.0]]])


def test_members_of_a_batch_have_frames_of_their_own() -> None:
    reports = reported([[0.0, 0.1]] * 2, np.zeros((2, 2, 2)))
    exposed, found = np.array([[0.02, 0.05], [0.06, 0.03]]), np.array([[True, True], [False, False]])
    sighting = sighted(unseen(2), reports, exposed, found, np.ones((2, 2, 3)) * [[[1.0], [2.0]]])
    assert_allclose(sighting.plate, [[2.0, 2.0, 2.0], [3.0, 0.0, 0.0]])
    assert sighting.exposed.tolist() == [0.05, -np.inf]
    assert sighting.fresh.tolist() == [True, False]


def test_places_turn_by_pitch_then_yaw() -> None:
    # Muzzle straight up: ahead becomes up, up becomes backward. Yaw to the left by a right angle: ahead becomes left.
    ahead, up = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    assert_allclose(into_base(ahead, np.array([np.pi / 2, 0.0])), [0, 0, 1], atol=1e-15)
    assert_allclose(into_base(up, np.array([np.pi / 2, 0.0])), [-1, 0, 0], atol=1e-15)
    assert_allclose(into_base(ahead, np.array([0.0, np.pi / 2])), [0, 1, 0], atol=1e-15)
    rng = np.random.default_rng(72)
    angles, places = rng.uniform(-1.0, 1.0, (2, 3, 2)), rng.uniform(-2.0, 4.0, (2, 3, 3))
    for index in np.ndindex(2, 3):
        expected = turned(angles[index], places[index])
        assert_allclose(into_base(places, angles)[index], expected, atol=1e-12)


def test_a_turning_gimbal_leaves_a_still_plate_still_and_a_wrong_offset_does_not() -> None:
    plate, rate = np.array([3.0, 0.4, 0.2]), np.array([0.3, 2.0])
    stamps = 0.002 * np.arange(60)
    reports = reported(stamps, stamps[:, None] * rate)
    exposures = np.array([0.0213, 0.0338, 0.0463, 0.0588])
    seen = np.array([np.linalg.solve(_rotation(moment * rate), plate) for moment in exposures])
    for error, farthest in ((0.0, 1e-12), (0.004, 0.04)):
        places = []
        for moment, position in zip(exposures, seen, strict=True):
            frame = (np.array([[moment + error]]), np.array([[True]]), position[None, None])
            places.append(sighted(unseen(), reports, *frame).plate[0])
        off = np.linalg.norm(np.array(places) - plate, axis=1)
        assert np.all(off <= farthest)
        # 2 rad/s for 4 ms at 3 m are 24 mm.
        assert np.all(off >= 0.6 * 6 * error)


def _rotation(angle: np.ndarray) -> np.ndarray:
    return np.stack([turned(angle, each) for each in np.eye(3)], axis=1)
