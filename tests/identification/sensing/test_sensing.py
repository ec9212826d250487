from dataclasses import replace

import numpy as np
import pytest

from archerfish.identification.sensing.estimate import identify_sensing
from archerfish.records.errors import InputError
from archerfish.records.sensing import sensing_values
from archerfish.records.sensing_logs import Detections

SEEDS = range(5)


@pytest.fixture(scope="module")
def found(sensing_recordings):
    """Recordings of a few robots, and what was identified from them."""
    return [identified(sensing_recordings, seed) for seed in SEEDS]


def identified(simulator, seed, **robot):
    rng = np.random.default_rng(seed)
    truth = simulator.Robot(clock=rng.uniform(-0.5, 0.5), latency=rng.uniform(0.015, 0.06), **robot)
    gimbal, plate = simulator.sweep_recording(truth, rng, seconds=12.0)
    steps, target, moments = simulator.step_recording(truth, rng, steps=14)
    return truth, identify_sensing([gimbal, steps], [plate, target], moments)


def test_offset_and_latency_are_within_the_bars(found):
    for truth, result in found:
        camera = result.sensing.camera
        assert camera.time_offset == pytest.approx(truth.feedback_delay - truth.clock, abs=2e-3)
        assert camera.latency == pytest.approx(truth.latency, abs=5e-3)
        assert camera.latency_basis == "exposure"


def test_intervals_hold_the_truth(found):
    covered = [
        low <= true <= high
        for truth, result in found
        for name, true in (
            ("camera.time_offset", truth.feedback_delay - truth.clock),
            ("camera.latency", truth.latency),
            ("camera.rate_hz", truth.fps),
            ("camera.elevation_sd", truth.across / result.sensing.camera.noise_range),
            ("camera.range_sd", truth.along),
            ("camera.stamp_jitter", truth.stamp_jitter),
            ("camera.miss_probability", truth.missed),
            ("link.command_delay", 0.010 + truth.feedback_delay),
            ("link.feedback_delay", truth.feedback_delay),
        )
        for low, high in [result.sensing.intervals[name]]
    ]
    assert len(covered) == 45
    assert sum(covered) >= 37  # 0.05 % by chance if the intervals hold 95 %


def test_noise_is_told_from_jitter_and_from_what_is_not_the_plate(found):
    for truth, result in found:
        camera = result.sensing.camera
        assert camera.bearing_sd * camera.noise_range == pytest.approx(truth.across, rel=0.12)
        assert camera.range_sd == pytest.approx(truth.along, rel=0.1)
        assert camera.outlier_share == pytest.approx(truth.outliers, abs=0.01)
        assert result.sensing.link.feedback_quantum == pytest.approx(truth.quantum, rel=1e-3)
        assert sensing_values(result.sensing)["link.feedback_rate_hz"] == pytest.approx(truth.log_rate, rel=1e-3)


def test_a_full_set_of_recordings_leaves_nothing_missing(found):
    for _, result in found:
        (stamps,) = result.missing  # these recordings have none of commands and feedback
        assert "Give --commands and --feedback" in stamps
        assert any("sum of command and feedback delay" in remark for remark in result.remarks)


@pytest.fixture(scope="module")
def sweep(sensing_recordings):
    return sensing_recordings.sweep_recording(sensing_recordings.Robot(), np.random.default_rng(9), seconds=8.0)


def test_a_sweep_alone_tells_the_latency_less_the_feedback_delay(sensing_recordings, sweep):
    truth, (gimbal, plate) = sensing_recordings.Robot(), sweep
    result = identify_sensing([gimbal], [plate])
    camera = result.sensing.camera
    assert (camera.latency_basis, result.sensing.link.command_delay) == ("feedback", None)
    assert camera.latency == pytest.approx(truth.latency - truth.feedback_delay, abs=1e-3)
    assert any("less the feedback's delay" in sentence and "--target-steps" in sentence for sentence in result.missing)
    assert any("steps of the command" in sentence for sentence in result.missing)


def test_without_receipts_or_with_a_clock_of_its_own_the_latency_is_left_out(sweep):
    gimbal, plate = sweep
    unreceived = Detections(plate.time, plate.position)
    for result, cause in (
        (identify_sensing([gimbal], [unreceived]), "no receipts are logged"),
        (identify_sensing([gimbal], [plate], gimbal_clock="own"), "a clock of its own"),
    ):
        assert result.sensing.camera.latency is None
        assert cause in result.missing[0]


def test_frames_stamped_on_receipt_have_the_latency_as_their_offset(sweep):
    gimbal, plate = sweep
    late = Detections(plate.receive, plate.position, plate.receive)
    camera = identify_sensing([gimbal], [late]).sensing.camera
    assert camera.time_offset == pytest.approx(-0.032, abs=1e-3)
    assert camera.latency == pytest.approx(0.032, abs=1e-3)
    assert camera.latency_jitter == pytest.approx(0.002, rel=0.2)
    assert camera.bearing_sd == pytest.approx(0.00172, rel=0.15)


def test_drifting_clocks_are_told(sweep):
    gimbal, plate = sweep
    result = identify_sensing([gimbal], [replace(plate, time=plate.time * (1 - 2e-4))])
    assert result.alignment.drift == pytest.approx(2e-4, abs=4 * result.alignment.drift_sd)
    assert any("drift apart" in remark for remark in result.remarks)


def test_residuals_scatter_by_the_estimated_noise(sweep):
    gimbal, plate = sweep
    alignment = identify_sensing([gimbal], [plate]).alignment
    whitened = alignment.residual[alignment.inlier, 1] / np.sqrt(alignment.spread.variance[1])
    assert whitened.std() == pytest.approx(1.0, abs=0.02)


def test_a_noise_that_no_detector_has_is_doubted(sweep):
    gimbal, plate = sweep
    several = replace(plate, position=plate.position + np.outer(np.arange(len(plate.time)) % 3 - 1, [0.0, 0.0, 0.4]))
    assert any("one plate, at rest" in remark for remark in identify_sensing([gimbal], [several]).remarks)


def test_what_can_not_be_used_is_refused(sweep):
    gimbal, plate = sweep
    for arguments, complaint in (
        (([], [plate]), "needs the gimbal log"),
        (([gimbal], []), "got 0 logs of detections, expected 1"),
        (([gimbal], [plate, plate]), "moments of the target's steps are missing"),
        (([gimbal], [plate], np.arange(5.0)), "expected 2"),
        (([gimbal], [replace(plate, receive=plate.receive + 5)]), "stamp receipts and the gimbal log by one clock"),
    ):
        with pytest.raises(InputError, match=complaint):
            identify_sensing(*arguments)
