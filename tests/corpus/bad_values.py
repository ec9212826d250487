"""Logs whose values are wrong."""

import numpy as np

from .faults import csv, fault, joined, lines
from .recorded_axis import PERIOD, SAMPLES, command, noise, sound, sweep, table, write


@fault("repaired", "truncated")
def cut_off_in_the_last_line(folder):
    return [write(folder, table(*sound())[:-1].rsplit(",", 1)[0])]


@fault("repaired", "truncated")
def cut_off_in_the_last_number(folder):
    return [write(folder, table(*sound())[:-1].rsplit(",", 1)[0] + ",-")]


@fault("repaired", "truncated")
def cut_off_inside_the_last_number(folder):
    return [write(folder, table(*sound())[:-8])]


@fault("repaired", "truncated")
def zero_bytes_after_half_a_line(folder):
    return [write(folder, table(*sound())[:-8].encode() + bytes(4096))]


@fault("repaired", "zero-bytes")
def zero_bytes_after_a_power_cut(folder):
    return [write(folder, table(*sound()).encode() + bytes(4096))]


@fault("repaired", "decimal-comma")
def decimal_commas(folder):
    return [write(folder, table(*sound(), separator=";").replace(".", ","))]


@fault("repaired", "missing-values")
def blank_fields(folder):
    rows = lines()
    rows[300] = rows[300].rsplit(",", 1)[0] + ","
    return [write(folder, joined(rows))]


@fault("repaired", "missing-values")
def lines_of_separators_alone(folder):
    # Without stamps, nothing but the line says that a sample is missing.
    rows = lines()
    rows[300:303] = [",,"] * 3
    return [write(folder, joined(rows)), "--sample-period-s", PERIOD]


@fault("repaired", "missing-values")
def not_a_numbers(folder):
    time, u, y = sound()
    y[300:305] = np.nan
    return csv(folder, time, u, y)


@fault("repaired", "angle-wrap")
def an_angle_within_a_turn_in_radians(folder):
    time, u, y = sound(u=20 * sweep(high=3.0))
    return csv(folder, time, u, (y + np.pi) % (2 * np.pi) - np.pi)


@fault("repaired", "angle-wrap")
def an_angle_within_a_turn_in_degrees(folder):
    time, u, y = sound(u=500 * sweep(high=3.0))
    return csv(folder, time, u, y % 360)


@fault("repaired", "repeated-log")
def one_log_twice(folder):
    (path,) = csv(folder, *sound())
    return [path, write(folder, path.read_bytes(), "copy.csv")]


@fault("repaired", "constant-input")
def an_axis_at_rest_after_the_gap(folder):
    time, u, y = sound(count=900)
    u[500:] = 0.0
    time[500:] += 1.0
    return csv(folder, time, u, y)


@fault("refused", "constant-input")
def a_constant_input(folder):
    time, u, y = sound()
    return csv(folder, time, 0 * u + 2.0, y)


@fault("refused", "dependent-inputs")
def two_inputs_that_are_one(folder):
    time, u, y = sound()
    rows = "\n".join(f"{t:.10g},{a:.10g},{2 * a:.10g},{b:.10g}" for t, a, b in zip(time, u, y, strict=True))
    return [write(folder, f"time_s,u,v,y\n{rows}\n"), "--input", "u", "v"]


@fault("refused", "constant-output")
def an_axis_that_never_moves(folder):
    time, u, y = sound()
    return csv(folder, time, u, 0 * y)


@fault("refused", "single-sine")
def a_single_sine(folder):
    u = 0.3 * np.sin(2 * np.pi * 3.3 * PERIOD * np.arange(SAMPLES))
    return [*csv(folder, *sound(u=u)), "--order", "4"]


@fault("refused", "no-response")
def an_output_of_noise(folder):
    time, u, _ = sound()
    return csv(folder, time, u, noise(SAMPLES, 4))


@fault("warning", "long-delay")
def an_output_delayed_by_200_ms(folder):
    rng = np.random.default_rng(8)
    return csv(folder, *sound(u=np.repeat(rng.standard_normal(200), 5), delay=21))


@fault("warning", "saturation")
def a_third_of_the_output_cut_off(folder):
    time, u, y = sound(u=sweep())
    return csv(folder, time, u, np.clip(y, *np.quantile(y, [0.15, 0.85])))


@fault("warning", "quantisation")
def an_angle_in_whole_degrees(folder):
    time, u, y = sound()
    return csv(folder, time, u, np.radians(np.round(np.degrees(y / 3))))


@fault("warning", "spike")
def single_samples_that_leap(folder):
    time, u, y = sound()
    y[[120, 340]] += 3.0
    return csv(folder, time, u, y)


@fault("warning", "frozen")
def a_sensor_that_stops(folder):
    time, u, y = sound()
    y[350:450] = y[350]
    return csv(folder, time, u, y)


@fault("warning", "drift")
def a_drifting_output(folder):
    time, u, y = sound(u=sweep())
    return csv(folder, time, u, y + 0.2 * time)


@fault("warning", "degrees-radians")
def degrees_out_radians_in(folder):
    time, u, y = sound()
    return csv(folder, time, u, np.degrees(y))


@fault("warning", "degrees-radians")
def radians_out_degrees_in(folder):
    time, u, y = sound()
    return csv(folder, time, np.degrees(u), y)


@fault("warning", "sign-flip")
def an_axis_that_runs_the_other_way(folder):
    time, u, y = sound()
    return csv(folder, time, u, -y)


@fault("warning", "swapped")
def input_and_output_exchanged(folder):
    time, u, y = sound()
    return csv(folder, time, y, u)


@fault("warning", "swapped")
def input_and_output_of_a_sweep_exchanged(folder):
    time, u, y = sound(count=2400, u=sweep(2400))
    return csv(folder, time, y, u)


@fault("warning", "feedback")
def a_closed_loop(folder):
    rng = np.random.default_rng(11)
    reference, disturbance = command(1200, 2), 0.2 * np.cumsum(rng.standard_normal(1200))
    y, u = np.zeros(1200), np.zeros(1200)
    for k in range(2, 1200):
        y[k] = 1.6 * y[k - 1] - 0.65 * y[k - 2] + 0.05 * u[k - 1] + 0.1 * (disturbance[k] - disturbance[k - 1])
        u[k] = 2.0 * (reference[k] - y[k])
    return csv(folder, PERIOD * np.arange(1200), u, y)


@fault("warning", "sweep-above-nyquist")
def a_sweep_to_50_hz_at_80_hz(folder):
    period, count = 1 / 80, 1600
    u = sweep(count, 2.0, 50.0, period)
    _, _, y = sound(u=u)
    return csv(folder, period * np.arange(count), u, y)


@fault("warning", "excited-band")
def a_sweep_and_no_step(folder):
    return csv(folder, *sound(u=sweep(1000, 3.0, 20.0)))


@fault("warning", "not-held-back")
def a_fitted_log_to_validate_with(folder):
    (path,) = csv(folder, *sound())
    return [path, "--validate", path]
