"""Time stamps → equal intervals, and recordings in memory."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter

from archerfish.logs.log import read_log
from archerfish.logs.recording import Recording

PERIOD, COUNT = 0.01, 600


def axis():
    """Time, command and angle of an axis that follows steps with two poles at 0.85 ± 0.15i, a delay and 1 % noise."""
    rng, denominator = np.random.default_rng(0), np.real(np.poly([0.85 + 0.15j, 0.85 - 0.15j]))
    u = np.repeat(rng.uniform(-0.3, 0.3, COUNT), rng.integers(5, 30, COUNT))[:COUNT]
    y = lfilter([0, denominator.sum()], denominator, u)
    return PERIOD * np.arange(COUNT), u, y + 0.01 * y.std() * rng.standard_normal(COUNT)


def read(folder, *columns, **more):
    np.savetxt(path := folder / "log.csv", np.column_stack(columns), "%.17g", ",", header="time_s,u,y", comments="")
    return read_log(path, **more)


def codes(log):
    return {each.code: each.severity for each in log.findings}


@pytest.mark.parametrize("origin", [0.0, 1e5, 1.7e9])
@pytest.mark.parametrize("spread", [0.0, 0.04, -0.09])
def test_even_stamps_of_any_clock_leave_samples_as_they_are(tmp_path, origin, spread):
    time, u, y = axis()
    wander = spread * PERIOD * (np.random.default_rng(1).uniform(-1, 1, COUNT) if spread > 0 else np.sin(time))
    log = read(tmp_path, origin + time + wander, u, y)
    assert_array_equal(log.recordings[0].outputs[:, 0], y)
    assert (log.findings, len(log.recordings)) == ((), 1)
    assert log.recordings[0].period_s == pytest.approx(PERIOD, rel=1e-3)


def test_rounded_stamps_are_even_ones(tmp_path):
    log = read(tmp_path, np.round(0.0075 * np.arange(COUNT), 3), *axis()[1:])
    assert (log.findings, log.recordings[0].period_s) == ((), pytest.approx(0.0075, rel=1e-5))


@pytest.mark.parametrize("busy", [False, True])
def test_samples_that_a_host_stamps_late_are_taken_as_even_ones(tmp_path, busy):
    (time, u, y), rng = axis(), np.random.default_rng(6)
    late = 0.6 * PERIOD * (rng.standard_exponential(COUNT) if busy else rng.random(COUNT))
    log = read(tmp_path, np.maximum.accumulate(time + late) + 1e-6 * np.arange(COUNT), u, y)
    assert codes(log) == {"jitter": "repaired"}
    assert_allclose(log.recordings[0].outputs[:, 0], y, atol=1e-12)
    assert_allclose(log.recordings[0].inputs[:, 0], u, atol=1e-12)


def test_lost_samples_are_interpolated_and_the_input_held(tmp_path):
    (time, u, y), lost = axis(), [100, 101, 250, 400]
    rows = np.delete(np.arange(COUNT), lost)
    log = read(tmp_path, time[rows], u[rows], y[rows])
    assert (codes(log), len(log.recordings[0])) == ({"jitter": "repaired"}, COUNT)
    assert_allclose(log.recordings[0].outputs[rows, 0], y[rows], atol=1e-12)
    assert_allclose(log.recordings[0].outputs[lost, 0], y[lost], atol=0.1 * y.std())
    assert_allclose(log.recordings[0].inputs[lost, 0], u[[99, 99, 249, 399]], atol=1e-12)


def test_samples_that_were_taken_unevenly_are_resampled_with_a_warning_where_that_costs_much(tmp_path):
    rng, fine = np.random.default_rng(3), 0.001 * np.arange(10 * COUNT)
    at = PERIOD * (np.arange(COUNT) + rng.uniform(-0.3, 0.3, COUNT))
    rough = lfilter([1], [1, -0.9], rng.standard_normal(fine.size))
    assert codes(read(tmp_path, at, np.interp(at, fine, rough), np.interp(at, fine, rough))) == {"jitter": "warning"}
    log = read(tmp_path, at, np.sin(5 * at), np.sin(5 * at))
    (recording,) = log.recordings
    assert (codes(log), recording.period_s) == ({"jitter": "repaired"}, pytest.approx(PERIOD, rel=2e-3))
    assert_allclose(recording.outputs[:, 0], np.sin(5 * (recording.time + at[0])), atol=1e-3)
    assert_allclose(recording.inputs[:, 0], np.sin(5 * (recording.time + at[0])), atol=0.06)  # held up to a period


def test_a_rate_that_drifts_is_not_even(tmp_path):
    at = np.cumsum(np.linspace(0.92e-3, 1.08e-3, 4000))
    log = read(tmp_path, at, np.sin(5 * at), np.sin(5 * at))
    (recording,) = log.recordings
    assert codes(log) == {"jitter": "repaired"}
    assert_allclose(recording.outputs[:, 0], np.sin(5 * (recording.time + at[0])), atol=1e-6)


def test_a_log_is_cut_at_gaps_and_short_parts_are_left_out(tmp_path):
    time, u, y = axis()
    for first in (200, 500, 590):
        time[first:] += 1
    log = read(tmp_path, time, u, y)
    assert [len(each) for each in log.recordings] == [200, 300, 90]
    assert [each.start_s for each in log.recordings] == pytest.approx([0, 3, 7])
    assert {each.code: each.samples for each in log.findings} == {"gap": 0, "short-piece": 10}
    assert log.recordings[1].source == "log.csv[3.000 s…]"


def test_rows_without_outputs_are_no_samples(tmp_path):
    time, u, y = axis()
    y[[100, 300, 301, 302]] = np.nan
    log = read(tmp_path, time, u, y)
    assert [len(each) for each in log.recordings] == [300, 297]
    assert {each.code: each.samples for each in log.findings} == {"missing-values": 4, "gap": 0, "jitter": 0}
    stamped = read(tmp_path, time, u, y, sample_period_s=0.02)
    assert ([len(each) for each in stamped.recordings], stamped.recordings[0].period_s) == ([300, 297], 0.02)


def test_an_input_with_stamps_of_its_own_is_averaged_between_the_outputs(tmp_path):
    (time, _, y), at = axis(), np.sort(np.random.default_rng(2).uniform(0, PERIOD * COUNT, 4000))
    lacking = np.full(4000, np.nan)
    rows = np.hstack([[time, lacking[:COUNT], y], [at, np.sin(at), lacking]])
    log = read(tmp_path, *rows[:, np.argsort(rows[0], kind="stable")])
    (recording,) = log.recordings
    assert codes(log).keys() == {"late-input"}  # an input of its own clock is held, as it always is
    expected = np.sin(time[COUNT - len(recording) :] + PERIOD / 2)
    assert_allclose(recording.inputs[:-1, 0], expected[:-1], atol=0.01)


def test_stamps_in_another_unit_that_no_name_states_are_suspected(tmp_path):
    time, u, y = axis()
    for unit, scale in {"time_ms": 1e3, "time_us": 1e6, "time_ns": 1e9}.items():
        log = read(tmp_path, scale * time, u, y)
        (finding,) = log.findings
        assert (finding.code, finding.severity, unit in finding.remedy) == ("time-unit", "warning", True)
        assert log.recordings[0].period_s == pytest.approx(PERIOD)
    assert codes(read(tmp_path, u, u, y, sample_period_s=5)) == {"time-unit": "warning"}


DRONE = "identification/quarter_drone/14_drone_seq_20260529_195254.csv"
RECORDED = [
    (DRONE, "u_pct", "angulo_deg", "tempo_ms", {"time-unit", "gap", "jitter"}),
    ("identification/silverbox/SNLS80mV.csv", "V1", "V2", 1 / 610.35, {}),
    ("identification/drgp_vss/actuator.mat", "X[0]", "y", 0.05, {}),
]


@pytest.mark.parametrize(("name", "u", "y", "clock", "expected"), RECORDED)
def test_recorded_logs_are_read(name, u, y, clock, expected, shared):
    stamps = {"time": clock} if isinstance(clock, str) else {"sample_period_s": clock}
    log = read_log(shared(f"data/{name}"), inputs=[u], outputs=[y], **stamps)
    assert codes(log).keys() == set(expected)
    lengths = [1598, 3424, 1012] if name == DRONE else [log.samples]
    assert [len(each) for each in log.recordings] == pytest.approx(lengths, rel=0.005)


def test_a_recording_is_read_back_as_it_was_written(tmp_path):
    rng = np.random.default_rng(1)
    made = Recording.from_arrays(rng.standard_normal((50, 2)), rng.standard_normal(50), 0.004, input_names=("a", "b,"))
    made.write_csv(tmp_path / "log.csv")
    (found,) = read_log(tmp_path / "log.csv", inputs=made.input_names).recordings
    for name in ("inputs", "outputs", "time", "period_s", "input_names"):
        assert_array_equal(getattr(found, name), getattr(made, name))


def test_signals_that_are_no_recording_are_refused(refused):
    ramp, make = np.arange(3.0), Recording.from_arrays
    refused("^recording: u has 4,000 samples and y 3,999, ", make, np.ones(4000), np.ones(3999), 0.1)
    refused(r'u has shape \(1, 3\), expected \(N, 1\) of "u".*; samples come first', make, ramp[None], ramp[None], 0.1)
    refused(r"y has shape \(3, 2\), expected \(N, 1\).*several signals are named", make, ramp, np.ones((3, 2)), 0.1)
    refused("not empty", make, [], [], 0.1)
    refused("not finite; cut the recording", make, ramp, [0, np.nan, 1], 0.1)
    refused("period_s is 0.0, expected above 0 s", make, ramp, ramp, 0.0)
    for period_s, time in ((None, None), (0.1, ramp), (ramp, None)):
        refused("period_s.*; ", lambda p, t: make(ramp, ramp, p, time=t), period_s, time)


def test_arrays_with_even_stamps_are_a_recording_and_others_are_read_as_a_file_is(tmp_path, refused):
    time, u, y = axis()
    found = Recording.from_arrays(u, y, time=time, input_names=("cmd",), source="mine")
    assert repr(found) == "Recording(cmd → y: 600 samples every 0.01 s, 6 s, mine)"
    rows = np.delete(np.arange(COUNT), [100, 250])
    refused(r"stamps are uneven, .* s off .*; read_log\({", Recording.from_arrays, u[rows], y[rows], time=time[rows])
    (even,) = read_log({"time_s": time[rows], "u": u[rows], "y": y[rows]}).recordings
    (expected,) = read(tmp_path, time[rows], u[rows], y[rows]).recordings
    assert_array_equal(np.hstack([even.inputs, even.outputs]), np.hstack([expected.inputs, expected.outputs]))
    refused("time does not increase", Recording.from_arrays, u, y, time=-time)
