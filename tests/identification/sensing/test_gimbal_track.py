import numpy as np
import pytest

from archerfish.identification.sensing.gimbal_track import examine_feedback, gimbal_track, is_logged
from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import GimbalLog

TIME = np.arange(0, 10, 0.002)
YAW = 0.35 * np.sin(2 * np.pi * 0.7 * TIME)


def log(yaw, time=TIME):
    return GimbalLog(time, yaw, np.zeros_like(yaw), source="gimbal.csv")


def test_rate_and_quantum_are_those_of_the_encoder():
    step = 2 * np.pi / 8192
    feedback = examine_feedback(log(np.round(step * np.round(YAW / step), 6)))
    assert feedback.rate_hz == pytest.approx(500, rel=1e-6)
    assert feedback.quantum == pytest.approx(step, rel=1e-3)
    assert feedback.fresh.all()


def test_no_quantum_is_seen_in_a_smooth_angle():
    assert examine_feedback(log(YAW)).quantum is None


def test_held_feedback_is_found_and_only_fresh_samples_count():
    held = YAW[np.arange(TIME.size) // 5 * 5]
    feedback = examine_feedback(log(held))
    assert feedback.rate_hz == pytest.approx(100, rel=0.02)
    track = gimbal_track(log(held), feedback.fresh)
    at = np.linspace(1, 9, 500)
    truth = 0.35 * np.sin(2 * np.pi * 0.7 * at)
    # With the repetitions it would lag by 4 ms on average: 5 mrad.
    assert np.abs(track.angles(at)[:, 0] - truth).max() < 1e-3


@pytest.mark.parametrize("period", [0.001, 0.002, 0.01])
def test_angles_between_samples_are_exact_to_a_tenth_of_a_step(period):
    time = np.arange(0, 10, period)
    step = 2 * np.pi / 8192
    yaw = step * np.round(0.35 * np.sin(2 * np.pi * 0.7 * time) / step)
    at = np.random.default_rng(0).uniform(1, 9, 500)
    track = gimbal_track(log(yaw, time), np.ones(time.size, dtype=bool))
    error = track.angles(at)[:, 0] - 0.35 * np.sin(2 * np.pi * 0.7 * at)
    assert np.sqrt(np.mean(error**2)) < 0.35 * step
    assert abs(error.mean()) < 0.05 * step


def test_a_yaw_that_never_moves_is_refused():
    with pytest.raises(InputError, match=r"gimbal\.csv: the yaw is 0\.1 rad throughout"):
        examine_feedback(log(np.full(TIME.size, 0.1)))


def test_angles_outside_the_log_and_in_its_gaps_are_not_logged():
    kept = (TIME < 4.0) | (TIME > 4.3)
    gapped = log(YAW[kept], TIME[kept])
    track = gimbal_track(gapped, np.ones(gapped.time.size, dtype=bool))
    moments = np.array([-0.1, 0.01, 0.1, 3.9, 4.01, 4.2, 4.29, 4.4, 9.9, 9.99, 11.0])
    expected = [False, False, True, True, False, False, False, True, True, False, False]
    assert is_logged(gapped, track, moments).tolist() == expected


def test_a_slow_log_has_no_gaps_between_its_samples():
    time = np.arange(0, 10, 0.1)
    slow = log(np.sin(time), time)
    assert is_logged(slow, gimbal_track(slow, np.ones(time.size, dtype=bool)), np.arange(1.0, 9.0, 0.03)).all()
