"""Wrapped angles and counters, repeated feedback, faults of sensors; and whether the plant is right in the end."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import cont2discrete, lfilter

from archerfish2.identification.axis.fit import fit_axis
from archerfish2.logs.log import read_log

COUNT, PERIOD = 1600, 0.005
CASES = next(
    (each / "shared/data/cases" for each in Path(__file__).parents if (each / "shared/data/cases").is_dir()), None
)
RNG = np.random.default_rng(0)
U = np.concatenate([np.full(k, v) for k, v in zip(RNG.integers(20, 120, 90), RNG.uniform(-10, 10, 90), strict=True)])[
    :COUNT
]
TIME, STEPS = PERIOD * np.arange(COUNT), U[::-1].copy()


def response(u, natural_hz=6.0, delay=2):
    """Follow a command by a second-order axis of damping 0.7, a steady gain of 1 and a delay of some samples."""
    w = 2 * np.pi * natural_hz
    b, a, _ = cont2discrete(([w * w], [1, 1.4 * w, w * w]), PERIOD)
    return np.concatenate([np.zeros(delay), lfilter(b[0], a, u)[: len(u) - delay]])


Y = response(U) + 0.002 * RNG.standard_normal(COUNT)


def read(folder, u, y, time=TIME, **more):
    np.savetxt(
        path := folder / "log.csv", np.column_stack([time, u, y]), "%.15g", ",", header="time_s,u,y", comments=""
    )
    return read_log(path, **more)


def plant(log):
    """Return natural frequency [Hz], damping, steady gain and delay [s] of a second-order fit."""
    fit, period = fit_axis(log.recordings, 2), log.recordings[0].period_s
    pole = np.log(fit.poles[0].astype(complex)) / period
    return abs(pole) / (2 * np.pi), -pole.real / abs(pole), fit.gain.item(), fit.delay * period


def codes(log):
    return {each.code: each.severity for each in log.findings}


CASE = {  # expected natural frequency, gain, least and largest delay [ms]; findings
    "held_feedback.csv": ({}, (4.0, 1.0, 0, 20), {"held-output": "repaired"}),
    "encoder_wrap.csv": ({"inputs": "command_deg", "outputs": "ecd"}, (6.0, 68.27, 5, 5), {"angle-wrap": "repaired"}),
    "sep_line.csv": ({}, (6.0, 1.0, 0, 0), {}),
    "sparse_command.csv": ({}, (6.0, 1.0, 0, 0), {"held-input": "repaired"}),
    "two_publishers.mcap": (
        {"inputs": "/gimbal_command/yaw/position", "outputs": "/joint_states/yaw/position"},
        (4.0, 1.0, 0, 0),
        {"other-joints": "repaired", "held-input": "repaired"},
    ),
    "recorder_died.mcap": (
        {"inputs": "/command/data", "outputs": "/angle/data"},
        (6.0, 1.0, 0, 0),
        {"truncated": "repaired", "receive-time": "warning", "held-input": "repaired"},
    ),
    "time_us.csv": ({"time": "TimeUS"}, (6.0, 1.0, 0, 0), {"time-unit": "repaired"}),
}


@pytest.mark.skipif(CASES is None, reason="no folder shared/data/cases beside the clone")
@pytest.mark.parametrize(("name", "names", "expected", "findings"), [(k, *v) for k, v in CASE.items()], ids=CASE)
def test_the_cases_give_the_plant_that_made_them(name, names, expected, findings):
    if name.endswith(".mcap"):
        pytest.importorskip("rosbags")
    log = read_log(CASES / name, **names)
    natural, damping, gain, delay = plant(log)
    assert_allclose((natural, damping, gain), (expected[0], 0.7, expected[1]), rtol=5e-3)
    assert expected[2] <= round(1e3 * delay) <= expected[3]
    assert codes(log) == findings
    if name == "recorder_died.mcap":
        assert (log.samples, len(log.recordings[0])) == (400, 400)


@pytest.mark.parametrize("origin", [0, 1e5, 1.7e9])
@pytest.mark.parametrize("every", [2, 3, 5])
def test_repeated_feedback_is_fitted_where_it_is_fresh(tmp_path, every, origin):
    log = read(tmp_path, U, Y[np.arange(COUNT) // every * every], origin + TIME)
    assert codes(log) == {"held-output": "repaired"}
    assert f"one row of {every} only" in log.findings[0].message
    assert (log.samples, log.findings[0].samples) == (COUNT, COUNT - len(log.recordings[0]))
    natural, damping, gain, delay = plant(log)
    assert_allclose((natural, damping, gain), (6, 0.7, 1), rtol=0.05)
    assert abs(delay - 0.01) <= 1.5 * every * PERIOD


def test_feedback_that_is_fresh_at_irregular_times_is_found(tmp_path):
    fresh = np.cumsum(np.random.default_rng(1).integers(3, 7, COUNT))
    fresh = np.concatenate([[0], fresh[fresh < COUNT]])
    log = read(tmp_path, U, Y[fresh[np.searchsorted(fresh, np.arange(COUNT), side="right") - 1]])
    assert codes(log).keys() == {"held-output", "jitter"}
    assert_allclose(plant(log)[:3], (6, 0.7, 1), rtol=0.05)


def test_outputs_that_are_slow_coarse_or_steps_are_not_held_ones(tmp_path):
    for u, y in (
        (U, np.round(Y, 0)),
        (U / 50, np.round(Y / 50, 2)),
        (U, response(U, 0.3)),
        (Y, U),
        (U, np.round(STEPS)),
    ):
        assert "held-output" not in codes(read(tmp_path, u, y))


COUNTER = {8192: 68.27, 4096: 200.0, 65_536: 5e3, 1.0: 0.05, 2 * np.pi: 0.35, 360.0: 30.0, 3600.0: 300.0, 400.0: 30.0}


@pytest.mark.parametrize("low", [0.0, 0.5])
@pytest.mark.parametrize(("turn", "gain"), COUNTER.items())
def test_angles_and_counters_are_unwrapped_at_usual_turns(tmp_path, turn, gain, low):
    counts = np.round(gain * Y) if turn > 400 else gain * Y
    log = read(tmp_path, U, (counts + low * turn) % turn - low * turn)
    assert codes(log) == ({"angle-wrap": "repaired"} if np.any(np.abs(counts) > turn / 2) or not low else {})
    change = log.recordings[0].outputs[:, 0] - counts
    assert_allclose(change, change[0], atol=1e-9 * turn)


def test_steps_and_random_levels_are_not_unwrapped(tmp_path):
    levels = np.where(RNG.random(COUNT // 5) < 0.5, -128, 128).repeat(5)
    for y in (levels / 256, levels, response(levels, 70), levels * np.pi / 128 + 0.01 * Y, 3 * (TIME * 200 % 7)):
        assert "angle-wrap" not in codes(read(tmp_path, U, y))


SWEEP = 0.3 * np.sin(2 * np.pi * (0.5 * TIME + 7.25 * TIME**2 / 8))
SWEPT = response(SWEEP)


def changed(rows, values):
    y = SWEPT.copy()
    y[rows] = values
    return y


FAULTS = {
    "saturation": (np.clip(SWEPT, *np.quantile(SWEPT, [0.15, 0.85])), "is at its extreme in"),
    "quantisation": (np.radians(np.round(np.degrees(SWEPT / 3))), "moves in steps of 0.01745, which is a noise of"),
    "spike": (changed([120, 340], 3.0), "within a sample 2 times, first at 0.6 s"),
    "frozen": (changed(slice(300, 600), SWEPT[300]), "rests from 1.5 s for 30[01] samples while the input moves"),
    "two-sources": (np.where(np.arange(COUNT) % 2, SWEPT, 5 + SWEPT), "alternates between two values"),
}


@pytest.mark.parametrize(("code", "y", "message"), [(code, *each) for code, each in FAULTS.items()], ids=FAULTS)
def test_what_may_spoil_an_estimate_is_warned_of(tmp_path, code, y, message):
    (finding,) = read(tmp_path, SWEEP, y).findings
    assert (finding.code, finding.severity) == (code, "warning")
    assert pytest.approx(0) == finding.samples
    assert __import__("re").search(f'"y" {message}', finding.message)


def test_a_signal_that_never_moves_is_refused_and_a_part_at_rest_left_out(tmp_path, refused):
    refused('"u" is 2 throughout.*; record a log in which', read, tmp_path, 0 * U + 2, Y)
    refused('"y" is 0 throughout', read, tmp_path, U, 0 * Y)
    log = read(tmp_path, np.where(TIME < 4, U, 0), Y, TIME + (TIME >= 4))
    assert codes(log) == {"gap": "repaired", "constant-input": "repaired"}
    assert (len(log.recordings), log.findings[-1].samples) == (1, 800)
