"""Camera and link: simulated recordings with known truth, SciPy, counts by hand, and logs that people stamp by 1970."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from archerfish.cli.identify_sensing import IdentifySensing
from archerfish.errors import InputError
from archerfish.identification.sensing.alignment import gimbal_track, rough_offset, spherical
from archerfish.identification.sensing.identify import identify_sensing
from archerfish.identification.sensing.stamp_faults import coarse_stamps, delay_changes, slow_changes, written_once
from archerfish.identification.sensing.timing import command_delays, frame_timing, step_latency
from archerfish.identification.statistics import mean_estimate, scatter_estimate
from archerfish.logs.timing import DetectionLog, GimbalLog, read_detections, read_gimbal_log
from archerfish.records.sensing import SensingRecord

TICK, QUANTUM, FEEDBACK_S = 0.001, 2 * np.pi / 8192, 0.003
TIME, GRID = np.arange(0, 20, 0.002), np.arange(1600) / 80


def moved(command, delays, limit):
    """Return the yaw of a saturating second-order axis whose commands are held back, at every tick."""
    arrival = np.arange(command.size) + np.round(delays / TICK).astype(int)
    newest = np.zeros(command.size, dtype=int)
    np.maximum.at(newest, arrival[arrival < command.size], np.flatnonzero(arrival < command.size))
    yaw, angle, rate = [], float(command[0]), 0.0
    for wanted in command[np.maximum.accumulate(newest)].tolist():
        yaw.append(angle)
        torque = min(max(41.0**2 * (wanted - angle) - 1.5 * 41.0 * rate, -limit), limit)
        angle += TICK * (rate + 0.5 * TICK * torque)
        rate += TICK * torque
    return np.array(yaw)


def logged(command, delays, rng, *, rate=500.0, quantum=QUANTUM, limit=67.0):
    """Return the yaw at every tick, and its log."""
    yaw = moved(command, delays, limit)
    rows = np.arange(20, yaw.size, round(1 / (rate * TICK)))
    stamps = TICK * rows + 2e-5 * rng.standard_normal(rows.size)
    measured = np.interp(stamps - FEEDBACK_S, TICK * np.arange(yaw.size), yaw)
    measured = quantum * np.round(measured / quantum) if quantum else measured
    return yaw, GimbalLog(stamps, measured, 0.0 * measured, command[rows], "gimbal.csv")


def seen(truth, start, yaw, rng, lateral=np.zeros_like):
    """Return the detections of a plate at 80 frames a second: noisy, some missed, some of something else."""
    exposed = np.arange(start + rng.uniform(0, 1 / 80), TICK * yaw.size - 0.2, 1 / 80)
    exposed += 3e-4 * rng.standard_normal(exposed.size)
    plate = np.array([3.0, 0.2, 0.1]) + np.outer(lateral(exposed), [0, 1, 0])
    turned = Rotation.from_euler("Z", np.interp(exposed, TICK * np.arange(yaw.size), yaw)[:, None]).inv().apply(plate)
    position = Rotation.from_euler("YX", [-0.02, -0.04]).inv().apply(turned - [0.1, 0.02, 0.05])
    ahead = position / np.linalg.norm(position, axis=1, keepdims=True)
    noise = 0.005 * rng.standard_normal(position.shape)
    noise += (0.045 * rng.standard_normal((exposed.size, 1)) - np.sum(noise * ahead, 1, keepdims=True)) * ahead
    noise[rng.random(exposed.size) < 0.01] += rng.uniform(-1, 1, 3)
    stamps = exposed + truth.clock + 3e-4 * rng.standard_normal(exposed.size)
    received = np.maximum.accumulate(exposed + truth.latency + 0.002 * rng.standard_normal(exposed.size))
    kept = rng.random(exposed.size) >= 0.05
    return DetectionLog(stamps[kept], (position + noise)[kept], received[kept], "plate.csv")


def recordings(seed, seconds=12.0, steps=14):
    """Simulate a sweep before a plate at rest, then steps of the command and of a target."""
    rng = np.random.default_rng(seed)
    truth = SimpleNamespace(clock=rng.uniform(-0.5, 0.5), latency=rng.uniform(0.015, 0.06))
    time = np.arange(0, seconds, TICK)
    sweep = np.radians(20) * np.sin(2 * np.pi * (0.2 * time + 0.9 * time**2 / seconds))
    yaw, truth.sweep = logged(sweep, rng.uniform(0.005, 0.015, time.size), rng)
    changes = np.round((1.0 + 0.6 * np.arange(steps) + rng.uniform(0, 0.02, steps)) * 500) / 500
    truth.moments = changes[-1] + 2.0 + 1.2 * np.arange(steps) + rng.uniform(0, 0.1, steps)
    count = np.searchsorted(changes, np.arange(0, truth.moments[-1] + 1.5, TICK) + TICK / 2)
    still, truth.steps = logged(np.radians(8) * (count % 2), rng.uniform(0.005, 0.015, steps + 1)[count], rng)
    truth.plate = seen(truth, 0.1, yaw, rng)
    truth.target = seen(truth, changes[-1] + 1, still, rng, lambda at: 0.3 * (np.searchsorted(truth.moments, at) % 2))
    return truth


@pytest.fixture(scope="module")
def found():
    made = [recordings(seed) for seed in range(5)]
    steps = [{"steps": [each.steps], "target": each.target, "target_steps": each.moments} for each in made]
    return [(each, identify_sensing(each.sweep, each.plate, **more)) for each, more in zip(made, steps, strict=True)]


@pytest.fixture(scope="module")
def sweep():
    return recordings(10, seconds=8.0, steps=1)


def test_offset_and_delays_are_found_and_their_intervals_have_the_truth(found):
    covered = []
    for truth, result in found:
        camera, link = result.record.camera, result.record.link
        assert (camera.latency_basis, link.feedback_quantum) == ("exposure", pytest.approx(QUANTUM, rel=1e-3))
        assert camera.bearing_sd * camera.noise_range == pytest.approx(0.005, rel=0.12)
        assert camera.outlier_share == pytest.approx(0.01, abs=0.01)
        true = {"time_offset": FEEDBACK_S - truth.clock, "latency": truth.latency, "rate_hz": 80.0, "range_sd": 0.045}
        true |= {"elevation_sd": 0.005 / camera.noise_range, "stamp_jitter": 3e-4, "latency_jitter": 0.002}
        true = {f"camera.{name}": value for name, value in true.items()} | {"camera.miss_probability": 0.05}
        true |= {"link.command_delay": 0.01 + FEEDBACK_S, "link.feedback_delay": FEEDBACK_S}
        for name, value in true.items():
            low, high = result.record.intervals[name]
            covered.append(low <= value <= high)
    assert sum(covered) >= 42  # all but 4 in 10,000 sets of independent intervals that have 95 %


def test_a_full_set_leaves_only_the_commands_stamps_missing(found, tmp_path, has_units):
    _, result = found[0]
    has_units(result.report, 1)
    assert ["timing_commands.csv" in each for each in result.report.next_steps] == [True, False]
    assert result.report.usable
    result.save(tmp_path)
    assert SensingRecord.load(tmp_path / "sensing.json").camera.latency == result.record.camera.latency
    assert (len(result.plot().axes), result.counts["target steps"]) == (1, (14, 14))


def test_a_sweep_alone_gives_the_latency_less_the_feedbacks_delay(sweep):
    result = identify_sensing(sweep.sweep, sweep.plate)
    assert (result.record.camera.latency_basis, result.record.link.command_delay) == ("feedback", None)
    assert result.record.camera.latency == pytest.approx(sweep.latency - FEEDBACK_S, abs=1e-3)
    assert ("less the delay of the gimbal's feedback" in result.report.known[0], result.report.doubts) == (True, ())
    named = [re.findall(r"timing_(\w+)", each) for each in result.report.next_steps]
    assert named == [["target", "moments"], ["steps"], ["commands"], []]
    own_clock = identify_sensing(sweep.sweep, sweep.plate, gimbal_clock="own")
    for alone in (own_clock, identify_sensing(sweep.sweep, sweep.plate._replace(receive=None))):
        assert (alone.record.camera.latency, alone.report.usable) == (None, True)
        assert alone.report.headline.startswith("with care")
        assert "latency is unknown" in alone.report.doubts[0]


def test_frames_stamped_on_receipt_have_the_latency_as_their_offset(sweep):
    late = sweep.plate._replace(time=sweep.plate.receive)
    camera = identify_sensing(sweep.sweep, late).record.camera
    assert_allclose([camera.time_offset, -camera.latency], FEEDBACK_S - sweep.latency, atol=1e-3)
    assert_allclose([camera.latency_jitter, camera.bearing_sd * camera.noise_range], [0.002, 0.005], rtol=0.2)


def test_what_moves_with_the_gimbal_is_in_doubt_and_what_is_no_plate_is_not_usable(sweep):
    plate = sweep.plate
    assert identify_sensing(sweep.sweep, plate).report.doubts == ()
    result = identify_sensing(sweep.sweep, plate._replace(time=plate.time * (1 - 4e-4), receive=None))
    assert result.alignment.drift == pytest.approx(4e-4, rel=0.25)
    assert "clock drift (411 ppm)" in " ".join(result.report.doubts)
    azimuth, _, reach = spherical(plate.position).T
    bent = azimuth * (1 - 0.1 * azimuth**2)  # a barrel distortion of half a degree at 20°
    position = np.column_stack([reach * np.cos(bent), reach * np.sin(bent), plate.position[:, 2]])
    assert "lens" in identify_sensing(sweep.sweep, plate._replace(position=position)).report.doubts[0]
    several = plate.position + np.outer(np.arange(len(plate.time)) % 3 - 1, [0, 0, 0.4])
    report = identify_sensing(sweep.sweep, plate._replace(position=several)).report
    assert not report.usable
    assert ("show one plate" in report.reasons[0], "again" in report.next_steps[0]) == (True, True)


def test_moments_by_another_clock_make_the_record_not_usable(found):
    truth, _ = found[0]
    late = identify_sensing(truth.sweep, truth.plate, target=truth.target, target_steps=truth.moments + 0.02)
    assert late.record.link.feedback_delay == pytest.approx(FEEDBACK_S - 0.02, abs=3e-3)
    assert (late.report.usable, "by one clock" in late.report.reasons[0]) == (False, True)


def test_what_can_not_be_used_is_refused(sweep, refused):
    gimbal, plate = sweep.sweep, sweep.plate
    refused("without the other", identify_sensing, gimbal, plate, target=plate)
    refused(r"plate\.csv: .*by one clock", identify_sensing, gimbal, plate._replace(receive=plate.receive + 5))
    refused("frame: expected camera or optical or base, got optic", identify_sensing, gimbal, plate, frame="optic")
    refused("gimbal_clock: expected receipt or own", identify_sensing, gimbal, plate, gimbal_clock="mine")
    millimetres = plate._replace(position=1e3 * plate.position)
    refused(r"plate\.csv: .*; give positions in metres", identify_sensing, gimbal, millimetres)
    refused("has 19 detections", identify_sensing, gimbal, DetectionLog(plate.time[:19], plate.position[:19]))


@pytest.mark.parametrize("decimals", [(2, 2, 1), (3, 3, 0)])
def test_coordinates_of_few_digits_have_their_rounding_as_noise(sweep, decimals):
    exact = sweep.plate.position
    position = np.stack([each.round(n) for each, n in zip(exact.T, decimals, strict=True)], axis=1)
    found, rounded = (identify_sensing(sweep.sweep, sweep.plate._replace(position=each)) for each in (exact, position))
    assert rounded.record.camera.time_offset == pytest.approx(found.record.camera.time_offset, abs=1e-3)


def test_stamps_since_1970_change_nothing(shared):
    folder = shared("data/cases/sensing_epoch")
    gimbal, plate = read_gimbal_log(folder / "sweep.csv"), read_detections(folder / "plate.csv")
    estimates = []
    for shift in (-1.7e9, 1e5 - 1.7e9, 0.0):
        moved_plate = plate._replace(time=plate.time + shift, receive=plate.receive + shift)
        result = identify_sensing(gimbal._replace(time=gimbal.time + shift), moved_plate)
        estimates.append([each[:3] for each in result.estimates.values()])
        assert_allclose(result.estimates["camera.time_offset"][:3], [6.99e-3, 6.92e-3, 7.06e-3], atol=1e-5)
        assert_allclose(result.estimates["camera.latency"][:3], [30e-3, 29.81e-3, 30.19e-3], atol=1e-5)
        assert (result.record.camera.stamp_jitter < 4e-4, result.report.doubts) == (True, ())
    assert_allclose(estimates[1:], [estimates[0]] * 2, rtol=1e-3, atol=2e-7)
    alone = identify_sensing(gimbal, plate._replace(time=plate.time - 1.7e9)).record.camera  # one clock of the two
    assert alone.time_offset - 1.7e9 == pytest.approx(6.99e-3, abs=1e-5)


def test_the_command_line_writes_what_python_gives(tmp_path, sweep):
    plate, texts = sweep.plate, {"fmt": "%.17g", "delimiter": ",", "comments": ""}
    gimbal, seen = np.column_stack(sweep.sweep[:4]), np.column_stack([plate.time, plate.position, plate.receive])
    gimbal[:, 1:] = np.degrees(gimbal[:, 1:])
    np.savetxt(tmp_path / "sweep.csv", gimbal, header="time_s,yaw,pitch,yaw_command", **texts)
    seen[:, [2, 3]] *= -1  # into the optical frame
    np.savetxt(tmp_path / "plate.csv", seen, header="time_s,z,x,y,receive_s", **texts)
    files = tmp_path / "sweep.csv", tmp_path / "plate.csv"
    ending = IdentifySensing(*files, frame="optical", degrees=True, out=tmp_path / "out").run()
    expected = identify_sensing(sweep.sweep, sweep.plate)
    record = SensingRecord.load(tmp_path / "out" / "sensing.json")
    for name, estimate in expected.estimates.items():
        part, field = name.split(".")
        assert getattr(getattr(record, part), field) == pytest.approx(estimate.value, rel=1e-9)
    assert list(record.provenance["inputs"]) == ["sweep.csv", "plate.csv"]
    assert expected.report.headline in ending.found


def track(yaw, time=TIME):
    return gimbal_track(GimbalLog(time, yaw, 0 * yaw, source="gimbal.csv"))


def test_rate_and_step_of_the_feedback_are_the_encoders():
    yaw = 0.35 * np.sin(2 * np.pi * 0.7 * TIME)
    rounded = track(np.round(QUANTUM * np.round(yaw / QUANTUM), 6))
    assert (rounded.rate_hz, rounded.quantum) == (pytest.approx(500), pytest.approx(QUANTUM, rel=1e-3))
    assert track(yaw).quantum is None
    held = track(yaw[np.arange(TIME.size) // 5 * 5])
    assert held.rate_hz == pytest.approx(100, rel=0.02)
    # With the repetitions it would lag by 4 ms on average: 5 mrad.
    assert_allclose(held.angles(TIME[500:-500])[:, 0], yaw[500:-500], atol=1e-3)


@pytest.mark.parametrize("period", [0.001, 0.002, 0.01])
def test_angles_between_samples_are_exact_to_a_third_of_a_step(period):
    time = np.arange(0, 10, period)
    at = np.random.default_rng(0).uniform(1, 9, 500)
    nodes = track(QUANTUM * np.round(0.35 * np.sin(2 * np.pi * 0.7 * time) / QUANTUM), time)
    error = nodes.angles(at)[:, 0] - 0.35 * np.sin(2 * np.pi * 0.7 * at)
    assert (error.std() < 0.35 * QUANTUM, abs(error.mean()) < 0.05 * QUANTUM) == (True, True)


def test_angles_outside_a_log_and_in_its_gaps_are_not_covered(refused):
    kept = ((TIME < 4.0) | (TIME > 4.3)) & (TIME < 10)
    moments = np.array([-0.1, 0.1, 3.9, 4.01, 4.2, 4.29, 4.4, 9.9, 11.0])
    expected = [False, True, True, False, False, False, True, True, False]
    assert track(np.sin(TIME[kept]), TIME[kept]).covers(moments).tolist() == expected
    assert track(np.sin(TIME[::50]), TIME[::50]).covers(np.arange(1.0, 9.0, 0.03)).all()  # a slow log
    refused(r"gimbal\.csv: the yaw has 1 values in", track, np.full(TIME.size, 0.1))


STAMPS = np.sort(np.random.default_rng(0).uniform(0.5, 19.0, 1200))


def chirp(time):
    return 0.3 * np.sin(2 * np.pi * (0.2 * time + 0.05 * time**2))


def bearing(offset):
    azimuth = 0.1 - chirp(STAMPS + offset) + 0.002 * np.random.default_rng(1).standard_normal(STAMPS.size)
    azimuth[::40] += 0.5  # something else than the plate
    return azimuth


def test_bearings_that_can_not_be_aligned_are_refused(refused):
    tone = 0.3 * np.sin(2 * np.pi * 2 * TIME)
    refused("check signs", rough_offset, track(chirp(TIME)), STAMPS, -bearing(0.0))
    refused(r"mirrors the yaw .* 0\.5.* times", rough_offset, track(2 * chirp(TIME)), STAMPS, bearing(0.0))
    refused("repeats itself", rough_offset, track(tone), STAMPS, 0.1 - np.interp(STAMPS, TIME, tone))
    assert rough_offset(track(tone), STAMPS, 0.1 - np.interp(STAMPS + 0.02, TIME, tone), 0.2) == pytest.approx(0.02)
    refused("covers fewer than 20 detections", rough_offset, track(chirp(TIME)), STAMPS + 18, bearing(0.0), 1.0)


def test_rate_and_missed_frames_of_an_even_camera_are_exact():
    period, missed = frame_timing(1.7e9 + np.delete(GRID, [5, 6, 100, 900]))
    assert (period.value, missed.value) == (pytest.approx(1 / 80, rel=1e-6), 4 / 1600)
    assert frame_timing(GRID[(GRID < 5) | (GRID > 9)])[1].value == 0  # out of view
    kept = np.random.default_rng(0).random(GRID.size) > 0.6
    assert frame_timing(GRID[kept])[0].value == pytest.approx(1 / 80, rel=1e-6)


@pytest.mark.parametrize("jitter", [2e-4, 1.5e-3])
def test_the_interval_of_the_period_has_it_under_jitter_and_misses(jitter):
    covered, shares = 0, []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        stamps = np.sort(GRID + jitter * rng.standard_normal(GRID.size))
        period, missed = frame_timing(stamps[rng.random(GRID.size) > 0.1])
        covered += period.low <= 1 / 80 <= period.high
        shares.append(missed.value)
    assert 271 <= covered <= 297  # of 300 intervals that have 95 %, in all but 1 in 1000 sets
    assert np.mean(shares) == pytest.approx(0.1, abs=0.003)


@pytest.mark.parametrize("correlation", [0.0, 0.7])
def test_the_intervals_of_a_latency_have_it_though_messages_depend_on_one_another(correlation):
    noise = np.random.default_rng(0).standard_normal((300, 900))
    series = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], noise)[:, 100:]
    means, deviations = map(mean_estimate, series), map(scatter_estimate, series)
    least = 262 if correlation else 271  # 271: 1 in 1000 sets; correlated ones may fall a little short
    assert sum(each.low <= 0 <= each.high for each in means) >= least
    assert correlation or sum(each.low <= 1 <= each.high for each in deviations) >= least


def steps_log(delays, **robot):
    count = round(0.6 / TICK)
    command = np.concatenate([np.zeros(count), *(np.full(count, 0.14 * (1 - k % 2)) for k in range(len(delays)))])
    return logged(command, np.repeat([0.0, *delays], count), np.random.default_rng(0), **robot)[1]


@pytest.mark.parametrize("limit", [67.0, 1e9])
@pytest.mark.parametrize("quantum", [0.0, QUANTUM])
def test_each_step_has_its_delay_saturated_or_not(limit, quantum):
    delays = 1e-3 * np.array([5, 9, 13, 7, 15, 11])
    found, _ = command_delays([steps_log(delays, rate=1000.0, limit=limit, quantum=quantum)])
    assert_allclose(found, delays + FEEDBACK_S, atol=2e-3 if quantum else 5e-4)


MOMENTS = 2.0 + 1.1 * np.arange(20) + np.random.default_rng(5).uniform(0, 0.1, 20)


def stepping(size=0.3):
    rng = np.random.default_rng(0)
    exposed = np.arange(0.0, 26.0, 1 / 80) + rng.uniform(0, 1 / 80)
    position = np.tile([3.0, 0.0, 0.0], (exposed.size, 1)) + 0.005 * rng.standard_normal((exposed.size, 3))
    position[:, 1] += size * (np.searchsorted(MOMENTS, exposed) % 2)
    return DetectionLog(exposed + 0.4, position, exposed + 0.035, "target.csv")


def test_without_jitter_the_frames_around_the_steps_bound_the_latency():
    detections = stepping()
    since, new = detections.receive[None] - MOMENTS[:, None], (detections.time - 0.4)[None] > MOMENTS[:, None]
    lowest, highest = since[~new].max(initial=-9, where=since[~new] < 0.5), since[new].min()
    found, used = step_latency(detections, MOMENTS, 1 / 80)
    assert used == 20
    assert found.value == pytest.approx(0.5 * (lowest + highest), abs=3e-4)
    assert lowest - 1e-3 < found.low < 0.035 < found.high < highest + 1e-3


def test_target_steps_that_do_not_show_the_latency_are_refused(refused):
    refused("take receive_s", step_latency, stepping()._replace(receive=None), MOMENTS, 1 / 80)
    refused("0 of 20 target steps can be used", step_latency, stepping(size=0.01), MOMENTS, 1 / 80)
    refused("4 of 4 target steps can be used, expected at least 5", step_latency, stepping(), MOMENTS[:4], 1 / 80)


def test_a_clock_that_was_set_frames_that_were_dropped_and_a_latency_in_blocks_are_told_and_taken_apart(shared):
    expected = {  # stamp to exposure before any change, ends of the latency, its jitter [ms], what is said
        "camera_clock_step": (7.0, 31.6, 31.6, r"exposure it is 7\.\d ms, from 12\.0 s on −1[78]\.\d ms"),
        "renumbered_frames": (
            7.0,
            31.6,
            31.6,
            r"by 0\.0 ms, from 4\.\d s on 66\.7 ms, .* on 333\.3 ms: frames were dro",
        ),
        "latency_under_load": (7.0, 31.6, 71.6, r"latency is 31\.[5-8] ms, from 12\.0 s on 71\.[4-7] ms"),
    }
    for name, (offset, least, most, text) in expected.items():
        folder = shared(f"data/cases_2/{name}")
        result = identify_sensing(folder / "sweep.csv", folder / "plate.csv")
        camera, (low, high) = result.record.camera, result.record.intervals["camera.latency"]
        assert camera.time_offset == pytest.approx(1e-3 * offset, abs=2e-4)  # 0.1 ms of it is the interval's
        assert_allclose([1e3 * low, 1e3 * high], [least, most], atol=0.9)
        assert (camera.latency_jitter < 1.4e-3, camera.rate_hz) == (True, pytest.approx(60, abs=1e-2))
        assert (result.report.usable, len(result.report.doubts)) == (True, 1)
        assert re.search(text, result.report.doubts[0]), result.report.doubts


def test_stamps_and_latencies_of_other_sizes_give_what_the_recording_gives_without_their_fault(sweep):
    plate, late = sweep.plate, sweep.plate.time > 5.0 + sweep.clock
    written = np.sort(np.concatenate([plate.time, plate.time + 0.004]))
    coarse = plate._replace(time=np.floor(plate.time / 0.01) * 0.01)
    frames = np.round((plate.time - plate.time[0]) * 80)
    even = frames / 80 + np.median(plate.time - frames / 80)
    counted = even - 3 / 80 * late  # as a camera stamps that dropped three frames
    kept = counted > np.maximum.accumulate(np.append(-np.inf, counted[:-1]))
    again = DetectionLog(written, np.repeat(plate.position, 2, axis=0), np.repeat(plate.receive, 2), "plate.csv")
    faults = {
        "clock .* 5.0 s on": plate._replace(time=plate.time - 0.006 * late),
        "clock .* from 5.0 s on .* ms": plate._replace(time=plate.time + 0.4 * late),
        r"from 5\.\d s on 37\.5 ms: frames": DetectionLog(counted[kept], plate.position[kept], plate.receive[kept]),
        r"latency .* from 5\.0 s on": plate._replace(receive=plate.receive + 0.015 * late),
        "multiples of 10 ms": coarse,
        "": again,
    }
    found = identify_sensing(sweep.sweep, plate).record.camera
    for text, recording in faults.items():
        result = identify_sensing(sweep.sweep, recording)
        camera, shift = result.record.camera, 0.005 * (recording is coarse)  # its stamps are early by half a step
        assert camera.time_offset == pytest.approx(found.time_offset + shift, abs=4e-4)
        assert camera.rate_hz == pytest.approx(80, rel=1e-3)
        low, high = result.record.intervals["camera.latency_jitter"]
        assert low - 2e-4 < 0.002 < high + 2e-4
        assert re.search(text, " ".join(result.report.doubts)), result.report.doubts
    assert result.report.findings[0].samples == plate.time.size


def test_a_slewed_clock_is_followed_by_the_receipts_and_its_interval_spans_what_it_was(sweep):
    plate, found = sweep.plate, identify_sensing(sweep.sweep, sweep.plate).record.camera
    early = 2e-3 * np.clip(plate.time - sweep.clock - 3.0, 0, 3)  # 2000 ppm for 3 s
    result = identify_sensing(sweep.sweep, plate._replace(time=plate.time + early))
    assert result.record.camera.latency == pytest.approx(found.latency, abs=3e-4)
    low, high = result.record.intervals["camera.time_offset"]
    assert low < found.time_offset - 0.006 < found.time_offset < high < low + 0.011
    assert ("or was slewed" in result.report.doubts[0], len(result.report.doubts)) == (True, 1)
    drifting = identify_sensing(sweep.sweep, plate._replace(time=plate.time + 3e-4 * (plate.time - plate.time[0])))
    for name, true in (("time_offset", found.time_offset - 1e-3), ("latency", found.latency)):
        low, high = drifting.record.intervals[f"camera.{name}"]
        assert low < true < high


def test_single_frames_that_were_dropped_are_found_and_a_clock_set_back_is_none_of_them(sweep):
    plate, rng = sweep.plate, np.random.default_rng(2)
    frames = np.round((plate.time - plate.time[0]) * 80)
    even = frames / 80 + np.median(plate.time - frames / 80)
    gone = np.sort(rng.choice(np.arange(20, frames.size - 20), 24, replace=False))
    kept = np.delete(np.arange(frames.size), gone)
    counted = (even - np.cumsum(np.isin(np.arange(frames.size), gone)) / 80)[kept]  # on from the frame before
    receive = plate.time - sweep.clock + 0.03 + 0.001 * rng.standard_normal(frames.size)
    dropped = identify_sensing(sweep.sweep, DetectionLog(counted, plate.position[kept], receive[kept]))
    back = identify_sensing(sweep.sweep, plate._replace(time=even - 3 / 80 * (even > 5.0 + sweep.clock)))
    found = identify_sensing(sweep.sweep, plate).record.camera
    for result, text in ((dropped, r"in 2[234] steps, .*: frames were dropped"), (back, "clock .* was set")):
        assert re.search(text, result.report.doubts[0])
        assert result.record.camera.time_offset == pytest.approx(found.time_offset, abs=4e-4)
    with pytest.raises(InputError, match="log receive_s, which shows"):
        identify_sensing(sweep.sweep, DetectionLog(counted, plate.position[kept]))


@pytest.mark.parametrize(("rate", "written"), [(30, 100), (30, 50), (60, 200), (20, 100)])
def test_frames_that_were_written_again_keep_their_rate(rate, written):
    rows = np.arange(0, 20, 1 / written) + 2e-4 * np.random.default_rng(0).standard_normal(20 * written)
    frames = np.floor(rows * rate)
    once, repeated, step = written_once(DetectionLog(rows, np.column_stack([frames + 1, frames, frames])))
    assert (repeated, step) == (rows.size - 20 * rate, pytest.approx(1 / written, rel=1e-2))
    _, period = coarse_stamps(once.time, step) or (0, None)
    assert frame_timing(once.time, period=period)[0].value == pytest.approx(1 / rate, rel=1e-3)


def test_good_recordings_raise_no_alarm_of_stamps():
    alarms = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        rate = rng.choice([30, 60, 100])
        stamps = np.cumsum(1 + (rng.random(1200) < 0.05)) / rate
        jitter = lfilter([0.866], [1, -0.5], rng.standard_normal(stamps.size))  # correlated from frame to frame
        delay = 0.03 + rng.uniform(5e-4, 6e-3) * jitter + 1e-4 * stamps  # and a clock that drifts
        noisy = stamps + 2e-4 * rng.standard_normal(stamps.size)
        slow, _ = slow_changes(delay, False)
        jumps = delay_changes(stamps, stamps + delay, 1 / rate).rows
        alarms += jumps.size > 0 or slow.any() or coarse_stamps(noisy.round(4)) is not None
    assert alarms <= 1  # 0.5 % of 300
