import numpy as np
import pytest

from archerfish.identification.sensing.target_steps import step_latency
from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import Detections

PERIOD = 1 / 80
MOMENTS = 2.0 + 1.1 * np.arange(20) + np.random.default_rng(5).uniform(0, 0.1, 20)


def recording(latency=0.035, clock=0.4, jitter=0.0, size=0.3, noise=0.005, seed=0):
    rng = np.random.default_rng(seed)
    exposed = np.arange(0.0, 26.0, PERIOD) + rng.uniform(0, PERIOD)
    position = np.tile([3.0, 0.0, 0.0], (exposed.size, 1))
    position[:, 1] = size * (np.searchsorted(MOMENTS, exposed) % 2)
    position += noise * rng.standard_normal(position.shape)
    received = exposed + latency + jitter * rng.standard_normal(exposed.size)
    return Detections(exposed + clock, position, received, "target.csv")


def test_without_jitter_the_latency_is_bracketed_by_the_frames_around_the_steps():
    detections = recording()
    since = detections.receive[None] - MOMENTS[:, None]
    new = (detections.time - 0.4)[None] > MOMENTS[:, None]
    lowest = max(row[~mask].max() for row, mask in zip(since, new, strict=True))
    highest = min(row[mask].min() for row, mask in zip(since, new, strict=True))
    found = step_latency(detections, MOMENTS, PERIOD)
    assert found.steps == 20
    assert found.latency == pytest.approx(0.5 * (lowest + highest), abs=3e-4)
    assert lowest - 1e-3 < found.interval[0] < 0.035 < found.interval[1] < highest + 1e-3


def test_the_interval_holds_the_latency_as_often_as_it_says():
    found = [step_latency(recording(jitter=0.004, seed=seed), MOMENTS, PERIOD) for seed in range(12)]
    assert max(abs(each.latency - 0.035) for each in found) < 0.004
    assert sum(each.interval[0] <= 0.035 <= each.interval[1] for each in found) >= 8  # 2e-4 by chance


@pytest.mark.parametrize(
    ("detections", "moments", "complaint"),
    [
        (Detections(recording().time, recording().position, None, "target.csv"), MOMENTS, "name its column with --rec"),
        (recording(size=0.01), MOMENTS, "0 of 20 target steps can be used"),
        (recording(), MOMENTS[:4], "4 of 4 target steps can be used, expected at least 5"),
        (recording(), MOMENTS + 100, "0 of 20 target steps"),
    ],
)
def test_what_can_not_tell_the_latency_is_refused(detections, moments, complaint):
    with pytest.raises(InputError, match=complaint):
        step_latency(detections, moments, PERIOD)
