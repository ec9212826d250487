"""Logs that no causal linear plant with one delay gives, each beside the plant that would be right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from archerfish.errors import InputError
from archerfish.identification.axis.checks import follows_output
from archerfish.identification.axis.departures import changed_delay, early_outputs, half_angle
from archerfish.identification.axis.encoder import without_angle_error, without_leaps
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.axis.idle import without_idle
from archerfish.identification.axis.result import LogFit
from archerfish.identification.residuals import lead
from archerfish.identification.simulation import free_run, simulate
from archerfish.logs.log import read_log
from archerfish.logs.recording import Recording
from archerfish.records.plant import PlantRecord

FOLDER = "data/cases_2"


def command(period_s, seconds=10.0, size=8.0, seed=0):
    """Return a sweep from 0.5 to 9 Hz, then levels, shape (N,)."""
    time = period_s * np.arange(round(0.6 * seconds / period_s))
    sweep = size * np.exp(-time / time[-1]) * signal.chirp(time, 0.5, time[-1], 9)
    levels = size * np.random.default_rng(seed).uniform(-1, 1, 8)
    return np.concatenate([np.zeros(round(0.3 / period_s)), sweep, levels.repeat(round(0.05 * seconds / period_s))])


def recorded(u, hz=4.0, delay_s=0.01, period_s=0.005, change=np.asarray, noise=0.003, seed=0):
    """Simulate a log whose outputs are changed before it is saved."""
    plant = PlantRecord.second_order(hz, 0.7, delay_s, period_s)
    y = simulate(plant, u[:, None])[:, 0]
    y = y + noise * y.std() * np.random.default_rng(seed).standard_normal(len(y))
    return Recording.from_arrays(u, change(y), period_s)


def fitted(log, order=4, delay=0):
    plant = fit_axis([log], order, delay).plant
    return LogFit(log, False, free_run(plant, log.inputs, log.outputs))


def codes(findings):
    return [finding.code for finding in findings]


def reasons(result):
    return " ".join(result.report.reasons)


def centred(half):
    return lambda y: np.convolve(np.pad(y, half, "edge"), np.full(2 * half + 1, 1 / (2 * half + 1)), "valid")


def test_an_angle_that_was_smoothed_both_ways_is_no_plant_however_well_it_is_fitted(shared):
    result = identify_axis(shared(f"{FOLDER}/smoothed_both_ways.csv"), order=4)
    assert (result.report.usable, result.report.doubts) == (False, ())
    assert "or more before its input, as if it were smoothed forwards and backwards" in reasons(result)


SMOOTHED = {
    "Savitzky-Golay": (0.005, 4, lambda y: signal.savgol_filter(y, 41, 3)),
    "Butterworth": (0.005, 4, lambda y: signal.filtfilt(*signal.butter(2, 0.05), y)),
    "50 ms at 1 kHz": (0.001, 4, centred(50)),
    "80 ms at 100 Hz": (0.01, 3, centred(8)),
    "stamped early": (0.005, 6, lambda y: np.append(y[8:], y[-1].repeat(8))),
}


@pytest.mark.parametrize("name", SMOOTHED)
def test_filters_that_know_the_future_are_found_and_a_causal_one_is_not(name):
    period_s, hz, change = SMOOTHED[name]
    u = command(period_s)
    assert codes(early_outputs([fitted(recorded(u, hz, 0.01, period_s, change))])) == ["early-output"]
    assert early_outputs([fitted(recorded(u, hz, 0.0, period_s))]) == []


def test_an_input_that_is_held_after_an_early_step_shows_no_lead():
    wander = signal.lfilter([1], [1, -0.99], np.random.default_rng(0).standard_normal(1200))
    assert lead(wander, np.repeat([0.0, 3.3], [10, 1190])) == (1, 0.0)


def test_a_component_of_a_quaternion_is_no_angle(shared):
    names = {"inputs": "/gimbal/yaw_command/point.x", "outputs": "/gimbal/imu/orientation/yaw"}
    (log,) = read_log(shared(f"{FOLDER}/imu_orientation"), **names).recordings
    result = identify_axis(replace(log, outputs=np.sin(log.outputs / 2)), order=2)
    assert not result.report.usable
    assert "is 0.498, and it stays within 1, as the component of a quaternion does" in reasons(result)


DEGREE = np.pi / 180
HALVES = {
    "sine": (35, 1, lambda angle: np.sin(angle / 2), True),
    "sine about a heading, of a command in degrees": (8, 180 / np.pi, lambda angle: np.sin((angle + 0.7) / 2), True),
    "cosine about a heading": (35, 1, lambda angle: np.cos((angle + 60 * DEGREE) / 2), True),
    "gear": (60, 1, lambda angle: -angle / 2, False),
    "small angle, which may be either": (8, 1, lambda angle: angle / 2, True),
    "three radians": (180, 1, lambda angle: angle / 2, False),
}


@pytest.mark.parametrize("name", HALVES)
def test_components_of_quaternions_are_told_from_gears_of_two_to_one(name):
    size, unit, change, is_half = HALVES[name]
    log = recorded(command(0.01, size=size * DEGREE), period_s=0.01, change=change)
    fit = fitted(replace(log, inputs=log.inputs * unit), 2)
    plant = fit_axis([fit.recording], 2).plant
    assert codes(half_angle(fit, plant, False)) == ["half-angle"] * is_half
    assert codes(half_angle(fit, plant, True)) == ["half-angle"] * (is_half and "small" not in name)


def test_a_rate_is_told_from_an_angle_whose_gain_is_not_known(shared):
    result = identify_axis(shared(f"{FOLDER}/gyro_rate.csv"), order=3)
    assert not result.report.usable
    assert '"y" rests wherever "u" does, as the rate of an angle would: log the angle' in reasons(result)


def test_another_zero_from_one_row_on_is_subtracted(shared):
    result = identify_axis(shared(f"{FOLDER}/index_pulse.csv"), order=2)
    assert ('"y" leaps by 7.3 at 7.035 s without its input: subtracted') in [each.message for each in result.findings]
    assert result.report.usable
    (gain,), (pole,) = result.dc_gain, result.poles
    assert (gain.value, pole.frequency_hz.value) == pytest.approx((1.0, 4.0), rel=0.005)


LEAPS = {"small": [(1501, 1.0)], "two": [(1000, 3.0), (1900, -5.0)], "at rest": [(30, 3.0)], "none": []}


@pytest.mark.parametrize("name", LEAPS)
def test_leaps_of_the_zero_are_found_with_their_times(name):
    u = command(0.005, 12)
    log = recorded(u, change=lambda y: y + sum(size * (np.arange(len(y)) >= at) for at, size in LEAPS[name]))
    (corrected,), _, found = without_leaps(fit_axis([log], 2), [log], [])
    assert sorted(round(float(each.message.split()[5]) / 0.005) for each in found) == [at for at, _ in LEAPS[name]]
    assert fit_axis([corrected], 2, 2).plant.dc_gain.item() == pytest.approx(1, rel=0.002)


def test_an_error_once_per_turn_is_subtracted_and_takes_no_poles(shared):
    result = identify_axis(shared(f"{FOLDER}/eccentric_encoder.csv"), order=2)
    assert result.report.usable
    assert '"y" errs by 1.9 once per turn of 360' in str(result.findings)
    (gain,), (pole,) = result.dc_gain, result.poles
    assert (gain.value, pole.frequency_hz.value) == pytest.approx((1.0, 4.0), rel=0.01)


ERRORS = {
    "twice": (360, 2, 1 / 360),
    "radians": (2 * np.pi, 1, 1 / 360),
    "counts": (8192, 1, 1 / 400),
    "none": (360, 1, 0),
}


@pytest.mark.parametrize("name", ERRORS)
def test_errors_of_an_encoder_are_told_from_a_good_one_in_other_units(name):
    turn, harmonic, size = ERRORS[name]
    u = command(0.01, 12, turn / 5)
    log = recorded(u, 3.0, 0.02, 0.01, lambda y: y + turn * size * np.sin(2 * np.pi * harmonic / turn * y + 2))
    (corrected,), _, found = without_angle_error(fit_axis([log], 3), [log], [])
    assert codes(found) == ["angle-error"] * (size > 0)
    assert fit_axis([corrected], 2, 2).plant.dc_gain.item() == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize(("degrees", "severity"), [(170, "repaired"), (60, "warning")])
def test_errors_once_and_twice_per_turn_are_separated_by_wide_motions_alone(degrees, severity):
    def change(y):
        return y + 2 * np.sin(np.radians(y) + 0.3) + np.sin(2 * np.radians(y) + 1)

    log = recorded(command(0.01, 12, degrees), 3.0, 0.02, 0.01, change)
    (corrected,), _, (finding,) = without_angle_error(fit_axis([log], 3), [log], [])
    assert (finding.code, finding.severity) == ("angle-error", severity)
    if severity == "repaired":
        assert "errs by 2 once and 0.98 twice per turn of 360" in finding.message
        assert fit_axis([corrected], 2, 2).plant.dc_gain.item() == pytest.approx(1, rel=0.002)
    else:
        assert "another gain explains the log as well" in finding.message


def test_an_output_that_was_computed_from_its_input_is_refused():
    u = command(0.01)
    with pytest.raises(InputError, match=r'"y" is "u" times -1\.4 in every row') as caught:
        identify_axis(Recording.from_arrays(u, -1.4 * u + 2, 0.01))
    assert caught.value.code == "same-signal"


def test_a_delay_that_changes_is_told_and_is_no_rate_limit(shared):
    result = identify_axis(shared(f"{FOLDER}/latency_steps.csv"), order=2)
    assert not result.report.usable
    assert "the delay is 10 ms until 7.5 s, and 40 ms from then on: log at a steady load" in reasons(result)
    assert "rate limit" not in reasons(result)


DELAYS = {
    "twice": (0.005, (0.01, 0.02), (6,)),
    "less": (0.01, (0.03, 0.01), (4,)),
    "fast": (0.002, (0.004, 0.024), (7,)),
    "back again": (0.005, (0.01, 0.04, 0.01), (3, 6)),
    "same": (0.01, (0.02,), ()),
}


def test_delays_that_alternate_are_counted():
    period_s, u = 0.01, command(0.01, 16)
    parts = np.arange(len(u)) // 250 % 2
    outputs = [recorded(u, 4.0, delay_s, period_s).outputs[:, 0] for delay_s in (0.01, 0.04)]
    log = Recording.from_arrays(u, np.choose(parts, outputs), period_s)
    (finding,) = changed_delay(fitted(log, 2, 3), 1.0)
    assert "times between 10 and 40 ms" in finding.message


@pytest.mark.parametrize("name", DELAYS)
def test_delays_of_all_parts_are_found(name):
    period_s, delays_s, changes_s = DELAYS[name]
    u = command(period_s, 12)
    parts = np.searchsorted(changes_s, period_s * np.arange(len(u)), side="right")
    outputs = [recorded(u, 4.0, delay_s, period_s).outputs[:, 0] for delay_s in delays_s]
    log = Recording.from_arrays(u, np.choose(parts, outputs), period_s)
    found = changed_delay(fitted(log, 2, 3), 1.0)
    until = [f"{1e3 * delay_s:.3g} ms until {at_s} s" for delay_s, at_s in zip(delays_s, changes_s, strict=False)]
    expected = f"the delay is {', '.join(until)}, and {1e3 * delays_s[-1]:.3g} ms from then on"
    assert [each.message for each in found] == [expected] * (len(delays_s) > 1)


def test_a_loop_that_makes_the_command_is_named_before_what_is_not_linear(shared):
    result = identify_axis(shared(f"{FOLDER}/outer_loop.csv"), order=2)
    (reason,) = result.report.reasons
    assert reason.endswith(
        "the input follows the output: switch the outer loop off, or log its set point as the input."
    )


def looped(gain, size, period_s=0.005, hz=4.0):
    """Return a log whose command is a set point less the output times a gain, with a disturbance of a size."""
    target, plant = command(period_s, 15), PlantRecord.second_order(hz, 0.7, 0, period_s)
    noise = signal.lfilter([1], [1, -0.97], np.random.default_rng(0).standard_normal(len(target)))
    state, u, y = np.zeros(len(plant.A)), np.zeros(len(target)), size * noise / noise.std()
    for at in range(len(target)):
        y[at] += (plant.C @ state).item()
        u[at] = target[at] - gain * y[at]
        state = plant.A @ state + plant.B[:, 0] * u[at]
    return Recording.from_arrays(u, y, period_s)


@pytest.mark.parametrize(("gain", "size"), [(0.5, 1.0), (1.0, 2.0), (-0.4, 3.0), (0.0, 3.0)])
def test_an_input_that_follows_the_output_is_told_from_noise(gain, size):
    fit = fitted(looped(gain, size), 2)
    assert follows_output(fit.recording, fit.residual) == (gain != 0)


def test_a_stretch_with_the_motors_off_is_left_out(shared):
    result = identify_axis(shared(f"{FOLDER}/motors_off.csv"), order=2)
    assert result.report.usable
    assert '"y" does not follow its input from 5 to 8.1 s, left out' in [each.message for each in result.findings]
    (gain,), (pole,) = result.dc_gain, result.poles
    assert (gain.value, pole.frequency_hz.value) == pytest.approx((1.0, 4.0), rel=0.01)


STRETCHES = {"sweep": (0.01, 3.0, 2.0, 3.5), "steps": (0.002, 5.0, 8.6, 10.6), "none": (0.005, 4.0, 2.0, 2.0)}


@pytest.mark.parametrize("name", STRETCHES)
def test_stretches_without_motors_are_found_in_sweeps_and_in_steps(name):
    period_s, hz, begin_s, end_s = STRETCHES[name]
    begin, end = round(begin_s / period_s), round(end_s / period_s)
    u = command(period_s, 12)
    log = recorded(u, hz, 0.02, period_s, lambda y: np.concatenate([y[:begin], y[begin].repeat(end - begin), y[end:]]))
    kept, _, found = without_idle(fit_axis([log], 2), [log], [])
    assert codes(found) == ["idle"] * (end > begin)
    if found:
        times = [float(word) for word in found[0].message.replace(",", "").split() if word[0].isdigit()]
        assert times == pytest.approx((begin_s, end_s), abs=0.25)
    assert fit_axis(kept, 2, round(0.02 / period_s)).plant.dc_gain.item() == pytest.approx(1, rel=0.003)


def rests(y):
    return np.concatenate([y[:600], y[600].repeat(400), y[1000:1700], y[1700].repeat(500), y[2200:]])


HELD_BACK = {
    "idle": (rests, ["idle", "idle"]),
    "offset-jump": (lambda y: y + 5 * (np.arange(len(y)) > 1900), ["offset-jump"]),
}


@pytest.mark.parametrize("name", HELD_BACK)
def test_a_log_that_is_held_back_is_corrected_too(name):
    change, expected = HELD_BACK[name]
    held_back = recorded(command(0.005, 20, seed=1), change=change)
    result = identify_axis(recorded(command(0.005, 20)), order=2, validate=held_back)
    assert codes(result.findings) == expected
    assert result.report.usable
    assert result.judged.held_back
    assert result.judged.fit_percent > 99


def test_a_mode_that_hardly_moves_the_output_is_in_doubt():
    log = recorded(command(0.01, 12), 3.0, 0.02, 0.01)
    hum = 0.01 * np.sin(2 * np.pi * 1.7 * log.time)
    result = identify_axis(replace(log, outputs=log.outputs + 4 * hum[:, None]), order=4)
    assert not any(pole.determined for pole in result.poles if pole.damping.value < 0.1)
    assert any("moves the output by less than 1 %" in doubt for doubt in result.report.doubts)


def test_a_dead_zone_is_no_stretch_without_motors():
    u = command(0.005, 12)
    dead = np.sign(u) * np.maximum(np.abs(u) - 2, 0)
    log = replace(recorded(dead), inputs=u[:, None])
    assert codes(without_idle(fit_axis([log], 2), [log], [])[2]) == []
