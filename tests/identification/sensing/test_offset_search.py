import numpy as np
import pytest

from archerfish.identification.sensing.gimbal_track import gimbal_track
from archerfish.identification.sensing.offset_search import STEP, search_offset
from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import GimbalLog

TIME = np.arange(0, 20, 0.002)
RNG = np.random.default_rng(0)
STAMPS = np.sort(RNG.uniform(0.5, 19.0, 1200))


def chirp(time):
    return 0.3 * np.sin(2 * np.pi * (0.2 * time + 0.05 * time**2))


def track(yaw):
    return gimbal_track(GimbalLog(TIME, yaw, np.zeros_like(yaw)), np.ones(TIME.size, dtype=bool))


def bearing(offset):
    azimuth = 0.1 - chirp(STAMPS + offset) + 0.002 * RNG.standard_normal(STAMPS.size)
    azimuth[::40] += 0.5  # something else than the plate
    return azimuth


@pytest.mark.parametrize("offset", [-0.3, 0.013, 0.4])
def test_the_offset_is_found_to_a_step_of_the_search(offset):
    best, scan = search_offset(track(chirp(TIME)), STAMPS, bearing(offset))
    assert best == pytest.approx(offset, abs=STEP)
    assert scan.offset[np.argmin(scan.misfit)] == best


def test_clocks_that_are_years_apart_are_aligned():
    best, _ = search_offset(track(chirp(TIME)), STAMPS + 1.7e9, bearing(0.25))
    assert best == pytest.approx(0.25 - 1.7e9, abs=STEP)


@pytest.mark.parametrize(
    ("yaw", "azimuth", "complaint"),
    [
        (chirp(TIME), -bearing(0.0), "moves with the yaw, not against it"),
        (np.degrees(chirp(TIME)), bearing(0.0), "in degrees; say --degrees"),
        (np.radians(chirp(TIME)), bearing(0.0), "as if in degrees; say --degrees if"),
        (2 * chirp(TIME), bearing(0.0), r"moves by -0\.49. times the yaw"),
        (chirp(TIME), RNG.standard_normal(STAMPS.size), "at no offset"),
        (0.3 * np.sin(2 * np.pi * 2 * TIME), 0.1 - 0.3 * np.sin(2 * np.pi * 2 * STAMPS), "repeats itself"),
    ],
)
def test_what_can_not_be_aligned_is_refused_with_the_reason(yaw, azimuth, complaint):
    with pytest.raises(InputError, match=complaint):
        search_offset(track(yaw), STAMPS, azimuth)


def test_a_periodic_sweep_is_aligned_within_half_a_period():
    yaw, azimuth = 0.3 * np.sin(2 * np.pi * 2 * TIME), -0.3 * np.sin(2 * np.pi * 2 * (STAMPS + 0.02))
    best, _ = search_offset(track(yaw), STAMPS, azimuth, max_offset=0.2)
    assert best == pytest.approx(0.02, abs=STEP)


def test_a_gimbal_log_that_is_too_short_is_refused():
    with pytest.raises(InputError, match="does not cover the detections"):
        search_offset(track(chirp(TIME)), STAMPS + 18, bearing(0.0), max_offset=1.0)
