import numpy as np
import pytest

from archerfish.identification.sensing.command_delay import command_delay, step_delays
from archerfish.records.sensing_logs import GimbalLog

QUANTUM = 2 * np.pi / 8192


def steps_log(sensing_recordings, delays, *, rate=1000.0, limit=67.0, quantum=QUANTUM, size=0.14):
    """Return a log of steps that each start after a delay of its own."""
    fine = sensing_recordings.Robot(acceleration=limit)
    tick = sensing_recordings.TICK
    count = round(0.6 / tick)
    command = np.concatenate([np.zeros(count), *(np.full(count, size * (1 - k % 2)) for k in range(len(delays)))])
    held_back = np.repeat([0.0, *delays], count)
    yaw = sensing_recordings.yaw_motion(fine, command, held_back)
    rows = np.arange(0, yaw.size, round(1 / (rate * tick)))
    measured = quantum * np.round(yaw[rows] / quantum) if quantum else yaw[rows]
    return GimbalLog(tick * rows, measured, np.zeros(rows.size), command[rows])


@pytest.mark.parametrize("limit", [67.0, 1e9])
@pytest.mark.parametrize("quantum", [0.0, QUANTUM])
def test_each_step_has_its_delay_saturated_or_not(sensing_recordings, limit, quantum):
    delays = 1e-3 * np.array([5, 9, 13, 7, 15, 11])
    found = step_delays(steps_log(sensing_recordings, delays, limit=limit, quantum=quantum))
    np.testing.assert_allclose(found, delays, atol=2e-3 if quantum else 5e-4)


def test_mean_and_jitter_of_a_link(sensing_recordings):
    delays = np.random.default_rng(2).uniform(0.005, 0.015, 30)
    found = command_delay([steps_log(sensing_recordings, delays)])
    assert found.steps == 30
    assert found.mean == pytest.approx(delays.mean(), abs=7e-4)
    assert found.interval[0] < 0.010 < found.interval[1]
    assert found.jitter_interval[0] < 0.01 / np.sqrt(12) < found.jitter_interval[1]


def test_a_slow_log_still_tells_to_a_part_of_its_period(sensing_recordings):
    delays = np.full(8, 0.012)
    found = command_delay([steps_log(sensing_recordings, delays, rate=200.0)])
    assert found.mean == pytest.approx(0.012, abs=1.5e-3)


def test_too_few_steps_tell_nothing(sensing_recordings):
    assert command_delay([steps_log(sensing_recordings, [0.01] * 3)]) is None
    assert command_delay([]) is None


def test_a_sweep_has_no_steps(sensing_recordings):
    gimbal, _ = sensing_recordings.sweep_recording(sensing_recordings.Robot(), np.random.default_rng(0), seconds=3.0)
    assert step_delays(gimbal) == []
