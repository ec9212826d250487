"""Wrapped angles and counters, repeated feedback, faults of sensors; and whether the plant is right in the end."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import cont2discrete, lfilter

from archerfish.identification.axis.fit import fit_axis
from archerfish.logs.log import read_log

COUNT, PERIOD = 1600, 0.005
RNG = np.random.default_rng(0)
U = np.repeat(RNG.uniform(-10, 10, 90), RNG.integers(20, 120, 90))[:COUNT]
TIME = PERIOD * np.arange(COUNT)


def response(u, natural_hz=6.0, delay=2):
    """Follow a command by a second-order axis of damping 0.7, a steady gain of 1 and a delay of some samples."""
    w = 2 * np.pi * natural_hz
    b, a, _ = cont2discrete(([w * w], [1, 1.4 * w, w * w]), PERIOD)
    return np.concatenate([np.zeros(delay), lfilter(b[0], a, u)[: len(u) - delay]])


Y, SWEEP = response(U) + 0.002 * RNG.standard_normal(COUNT), 0.3 * np.sin(2 * np.pi * (0.5 * TIME + 0.9 * TIME**2))
SWEPT = response(SWEEP)


def read(folder, u, y, time=TIME):
    rows = np.column_stack([time, u, y])
    np.savetxt(path := folder / "log.csv", rows, "%.15g", ",", header="time_s,u,y", comments="")
    return read_log(path)


def plant(log):
    """Return natural frequency [Hz], damping, steady gain and delay [ms] of a second-order fit."""
    fit, period = fit_axis(log.recordings, 2), log.recordings[0].period_s
    pole = np.log(fit.poles[0].astype(complex)) / period
    return abs(pole) / (2 * np.pi), -pole.real / abs(pole), fit.plant.dc_gain.item(), 1e3 * fit.structure.delay * period


def codes(log):
    return {each.code for each in log.findings}


JOINTS = ("/gimbal_command/yaw/position", "/joint_states/yaw/position")
CASE = [  # names of signals; natural frequency [Hz], steady gain, delay and its width [ms]; findings
    ("held_feedback.csv", ("u", "y"), (4, 1, 10, 10), {"held-output"}),
    ("encoder_wrap.csv", ("command_deg", "ecd"), (6, 68.27, 5, 0), {"angle-wrap"}),
    ("sep_line.csv", ("u", "y"), (6, 1, 0, 0), set()),
    ("sparse_command.csv", ("u", "y"), (6, 1, 0, 0), {"held-input"}),
    ("two_publishers.mcap", JOINTS, (4, 1, 0, 0), {"other-joints"}),
    ("recorder_died.mcap", ("/command/data", "/angle/data"), (6, 1, 0, 0), {"truncated", "receive-time"}),
    ("time_us.csv", ("u", "y"), (6, 1, 0, 0), {"time-unit"}),
]


@pytest.mark.parametrize(("name", "signals", "expected", "findings"), CASE)
def test_the_cases_give_the_plant_that_made_them(name, signals, expected, findings, shared):
    pytest.importorskip("rosbags" if name.endswith(".mcap") else "numpy")
    path, time = shared("data/cases") / name, "TimeUS" if name[:4] == "time" else "time_s"
    log = read_log(path, inputs=signals[0], outputs=signals[1], time=time)
    *found, delay = plant(log)
    assert_allclose(found, (expected[0], 0.7, expected[1]), rtol=5e-3)
    assert abs(delay - expected[2]) <= expected[3] + 1e-9
    assert codes(log) == findings
    assert log.samples == {"recorder_died.mcap": 400, "two_publishers.mcap": 190}.get(name, log.samples)


@pytest.mark.parametrize(("every", "origin"), [(2, 1.7e9), (5, 0), (5, 1e5), (5, 1.7e9)])
def test_repeated_feedback_is_fitted_where_it_is_fresh(tmp_path, every, origin):
    log = read(tmp_path, U, Y[np.arange(COUNT) // every * every], origin + TIME)
    assert f"one row of {every} only ({200 / every:g} Hz)" in log.findings[0].message
    assert (codes(log), log.findings[0].samples) == ({"held-output"}, COUNT - len(log.recordings[0]))
    *found, delay = plant(log)
    assert_allclose(found, (6, 0.7, 1), rtol=0.05)
    assert abs(delay - 10) <= 1500 * every * PERIOD


def test_feedback_that_is_fresh_at_irregular_times_is_found(tmp_path):
    fresh = np.append(0, np.cumsum(np.random.default_rng(1).integers(3, 7, 340)))
    log = read(tmp_path, U, Y[fresh[np.searchsorted(fresh, np.arange(COUNT), side="right") - 1]])
    assert codes(log) == {"held-output", "jitter"}
    assert_allclose(plant(log)[:3], (6, 0.7, 1), rtol=0.08)


def test_outputs_that_are_slow_coarse_or_steps_are_not_held_ones(tmp_path):
    for u, y in (
        (U, np.round(Y)),
        (U / 50, np.round(Y / 50, 2)),
        (U, np.round(response(U, 0.3), 1)),
        (Y, U),
        (U, U[::-1]),
    ):
        assert "held-output" not in codes(read(tmp_path, u, y))


TURNS = {8192: 68.27, 65_536: 5e3, 1.0: 0.05, 2 * np.pi: 0.35, 360.0: 30.0, 3600.0: 300.0}


@pytest.mark.parametrize("low", [0.0, 0.5])
@pytest.mark.parametrize(("turn", "gain"), TURNS.items())
def test_angles_and_counters_are_unwrapped_at_usual_turns(tmp_path, turn, gain, low):
    counts = np.round(gain * Y) if turn > 400 else gain * Y
    log = read(tmp_path, U, (counts + low * turn) % turn - low * turn)
    assert codes(log) == ({"angle-wrap"} if not low or np.abs(counts).max() > turn / 2 else set())
    change = log.recordings[0].outputs[:, 0] - counts
    assert_allclose(change, change[0], atol=1e-9 * turn)


@pytest.mark.parametrize("apart", [False, True])
def test_a_wrapped_input_is_averaged_as_its_unwrapped_twin(tmp_path, apart):
    """Its angle is refreshed in every second row, or is on a clock of its own."""
    yaw, time = 3 * np.sin(2 * TIME) + 4 * TIME, TIME / 5  # goes round within 8 s; 1 kHz
    angle, refreshed, logs = response(yaw)[np.arange(COUNT) // 2 * 2], np.arange(COUNT) % 2 == 0, []
    for signal in (yaw, (yaw + np.pi) % (2 * np.pi) - np.pi):
        u, y = np.where(apart & refreshed, np.nan, signal), np.where(apart & ~refreshed, np.nan, angle)
        logs.append(read(tmp_path, u, y, time))
    assert codes(logs[1]) - codes(logs[0]) == {"angle-wrap"}
    assert_allclose(logs[1].recordings[0].inputs, logs[0].recordings[0].inputs, atol=1e-9)


ROWS = np.arange(COUNT)
WRAPPED = {"gap": (ROWS, TIME + (TIME > 2) + 3 * (TIME > 5)), "time-duplicate": (ROWS.repeat(2), TIME)}


@pytest.mark.parametrize("code", WRAPPED)
def test_a_wrapped_angle_is_unwrapped_although_the_log_has_gaps_or_every_row_twice(tmp_path, code):
    (rows, time), yaw = WRAPPED[code], 5 * np.sin(2 * TIME)
    log = read(tmp_path, U[rows], ((response(yaw) + np.pi) % (2 * np.pi) - np.pi)[rows], time[rows])
    assert codes(log) == {code, "angle-wrap"}
    assert_allclose(np.concatenate([part.outputs[:, 0] for part in log.recordings]), response(yaw), atol=1e-9)


def test_steps_and_random_levels_are_not_unwrapped(tmp_path):
    levels = np.where(RNG.random(COUNT // 5) < 0.5, -128, 128).repeat(5)
    for y in (levels / 256, levels, response(levels, 70), np.arange(COUNT) % 7 + 0.5):
        assert "angle-wrap" not in codes(read(tmp_path, U, y))


def changed(rows, values):
    y = SWEPT.copy()
    y[rows] = values
    return y


FAULTS = {
    "saturation": (np.clip(SWEPT, *np.quantile(SWEPT, [0.15, 0.85])), "is at its extreme in 1.% of the samples"),
    "quantisation": (np.radians(np.round(np.degrees(SWEPT / 3))), "moves in steps of 0.01745, which is a noise of"),
    "spike": (changed([120, 340], 3.0), "leaves and returns within a sample 2 times, first at 0.6 s"),
    "frozen": (changed(slice(300, 600), SWEPT[300]), "rests from 1.5 s for 300 samples while the input moves"),
}


@pytest.mark.parametrize(("code", "y", "message"), [(code, *each) for code, each in FAULTS.items()], ids=FAULTS)
def test_what_may_spoil_an_estimate_is_warned_of(tmp_path, code, y, message):
    (finding,) = read(tmp_path, SWEEP, y).findings
    assert finding[:2] == (code, "warning")
    assert re.match(f'"y" {message}', finding.message)


def test_one_of_two_inputs_may_rest(tmp_path, refused):
    columns = np.column_stack([TIME, U, 0 * U, Y])
    np.savetxt(path := tmp_path / "log.csv", columns, "%.15g", ",", header="time_s,u,v,y", comments="")
    log = read_log(path, inputs=("u", "v"))
    assert (log.findings, log.recordings[0].inputs[:, 1].tolist()) == ((), [0] * COUNT)
    refused('"v" is 0 throughout', read_log, path, inputs="v")
    refused('"v" is 0 throughout', read_log, path, inputs=("u",), outputs=("y", "v"))


def test_a_signal_that_never_moves_is_refused_and_a_part_at_rest_left_out(tmp_path, refused):
    refused('"u" is 2 throughout.*; record a log in which', read, tmp_path, 0 * U + 2, Y)
    refused('"y" is 0 throughout', read, tmp_path, U, 0 * Y)
    log = read(tmp_path, np.where(TIME < 4, U, 0), Y, TIME + (TIME >= 4))
    assert (codes(log), len(log.recordings), log.findings[-1].samples) == ({"gap", "constant-input"}, 1, 800)
