"""Logs with one fault each: how it is made, and what the command must say."""

import gzip
import io
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io

from . import recorded_bags
from .recorded_axis import PERIOD, SAMPLES, command, noise, response, sound, sweep, table, write

Maker = Callable[[Path], list[object]]


class Fault(NamedTuple):
    """A bad log."""

    make: Maker
    """Writes it into a folder and returns the command's arguments."""
    outcome: str
    """"refused", "repaired", "warning", or "accepted" for what is only unusual."""
    code: str


FAULTS: list[Fault] = []


def fault(outcome: str, code: str = "") -> Callable[[Maker], Maker]:
    def register(make: Maker) -> Maker:
        FAULTS.append(Fault(make, outcome, code))
        return make

    return register


def csv(folder, time, u, y, **options):
    return [write(folder, table(time, u, y, **options))]


def lines(**options):
    return table(*sound(**options)).splitlines()


def joined(rows):
    return "\n".join(rows) + "\n"


# What is unusual and read all the same


@fault("accepted")
def byte_order_mark(folder):
    return [write(folder, b"\xef\xbb\xbf" + table(*sound()).encode())]


@fault("accepted")
def carriage_returns(folder):
    return csv(folder, *sound(), end="\r\n")


@fault("accepted")
def semicolons(folder):
    return csv(folder, *sound(), separator=";")


@fault("accepted")
def tabs(folder):
    return csv(folder, *sound(), separator="\t")


@fault("accepted")
def blanks_and_no_names(folder):
    text = table(*sound(), separator="  ").split("\n", 1)[1]
    return [write(folder, text, "log.dat"), "--time", "1", "--input", "2", "--output", "3"]


@fault("accepted")
def utf_16_with_mark(folder):
    return [write(folder, table(*sound()).encode("utf-16"))]


@fault("accepted")
def quoted_names(folder):
    return csv(folder, *sound(), names=('"time_s"', '"u"', '"y"'))


@fault("accepted")
def blank_lines(folder):
    return [write(folder, table(*sound()).replace("\n", "\n\n"))]


@fault("accepted")
def no_line_break_at_the_end(folder):
    return [write(folder, table(*sound()).rstrip())]


@fault("accepted")
def zero_bytes_after_a_power_cut(folder):
    return [write(folder, table(*sound()).encode() + bytes(4096))]


@fault("accepted")
def a_symbolic_link(folder):
    (folder / "link.csv").symlink_to(write(folder, table(*sound())))
    return [folder / "link.csv"]


@fault("accepted")
def arrays(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, signals=np.column_stack([u, y]))
    return [folder / "log.npz", "--input", "signals[0]", "--output", "signals[1]"]


@fault("accepted")
def matlab(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u[:, None], "Y": np.column_stack([u, y])})
    return [folder / "log.mat", "--output", "Y[1]"]


@fault("accepted")
def a_bag(folder):
    return recorded_bags.joint_states(folder / "bag", *sound())


# What can't be read


@fault("refused", "no-such-file")
def a_missing_file(folder):
    return [folder / "log.csv"]


@fault("refused", "no-such-file")
def a_link_to_nothing(folder):
    (folder / "link.csv").symlink_to(folder / "gone.csv")
    return [folder / "link.csv"]


@fault("refused", "unreadable")
def a_link_to_itself(folder):
    (folder / "link.csv").symlink_to(folder / "link.csv")
    return [folder / "link.csv"]


@fault("refused", "unreadable")
def a_pipe(folder):
    os.mkfifo(folder / "log.csv")
    return [folder / "log.csv"]


@fault("refused", "too-large")
def a_sparse_file_of_2_gb(folder):
    with (folder / "log.csv").open("wb") as stream:
        stream.truncate(2 * 2**30)
    return [folder / "log.csv"]


@fault("refused", "empty")
def an_empty_file(folder):
    return [write(folder, "")]


@fault("refused", "empty")
def only_blank_lines(folder):
    return [write(folder, "\n \n\n")]


@fault("refused", "no-data")
def names_and_nothing_else(folder):
    return [write(folder, "time_s,u,y\n")]


@fault("refused", "encoding")
def chinese_names_in_gbk(folder):
    return [write(folder, table(*sound()).replace("time_s", "时间").encode("gbk"))]


@fault("refused", "zero-bytes")
def utf_16_without_mark(folder):
    return [write(folder, table(*sound()).encode("utf-16-le"))]


@fault("refused", "encoding")
def a_pickle(folder):
    return [write(folder, pickle.dumps(sound()), "log.csv")]


@fault("refused", "unknown-format")
def compressed(folder):
    return [write(folder, gzip.compress(table(*sound()).encode()), "log.csv.gz")]


@fault("refused", "unknown-format")
def a_folder(folder):
    return [folder]


@fault("refused", "unknown-format")
def a_single_array(folder):
    np.save(folder / "log.npy", sound()[0])
    return [folder / "log.npy"]


@fault("refused", "unknown-format")
def matlab_7_3(folder):
    return [write(folder, b"\x89HDF\r\n\x1a\n" + bytes(100), "log.mat")]


@fault("refused", "no-column")
def another_column(folder):
    return [*csv(folder, *sound()), "--output", "angle"]


@fault("refused", "no-column")
def a_number_beyond_the_columns(folder):
    text = table(*sound()).split("\n", 1)[1]
    return [write(folder, text, "log.dat"), "--time", "1", "--input", "2", "--output", "4"]


@fault("refused", "column-twice")
def two_columns_of_one_name(folder):
    return csv(folder, *sound(), names=("time_s", "u", "u"))


@fault("refused", "not-a-number")
def a_word_among_numbers(folder):
    rows = lines()
    rows[300] = rows[300].split(",")[0] + ",0.1,overflow"
    return [write(folder, joined(rows))]


@fault("refused", "not-a-number")
def commas_of_thousands(folder):
    rows = [f"{k};{1000 + k:,};{2000 + k:,}" for k in range(200)]
    return [write(folder, "time_s;u;y\n" + joined(rows))]


@fault("refused", "infinite")
def an_infinity(folder):
    time, u, y = sound()
    y[100] = np.inf
    return csv(folder, time, u, y)


@fault("refused", "row-length")
def decimal_commas_between_commas(folder):
    return [write(folder, "time_s,u,y\n" + joined(f"0,{k:03d},1,{k:03d},2,{k:03d}" for k in range(200)))]


@fault("refused", "header-repeated")
def two_logs_in_one_file(folder):
    text = table(*sound())
    return [write(folder, text + text)]


@fault("refused", "missing-values")
def signals_in_alternate_rows(folder):
    time, u, y = sound()
    u, y = u.copy(), y.copy()
    u[::2], y[1::2] = np.nan, np.nan
    return csv(folder, time, u, y)


@fault("refused", "not-a-number")
def arrays_of_objects(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u.astype(object), y=y)
    return [folder / "log.npz"]


@fault("refused", "too-large")
def a_zip_bomb(folder):
    _, u, y = sound()
    np.savez(folder / "log.npz", u=u, y=y)
    with zipfile.ZipFile(folder / "log.npz", "a") as archive:
        archive.writestr("time_s.npy", b"")
        # What a file of a few kilobytes unpacks to is told by its directory, written at the end.
        archive.getinfo("time_s.npy").file_size = 600 * 2**20
    return [folder / "log.npz"]


@fault("refused", "damaged")
def an_array_that_claims_more_than_it_holds(folder):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(folder / "log.npz", "w") as archive:
        for name in ("time_s", "u", "y"):
            archive.writestr(f"{name}.npy", member.getvalue())
    return [folder / "log.npz"]


@fault("refused", "damaged")
def half_an_archive(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, y=y)
    content = (folder / "log.npz").read_bytes()
    return [write(folder, content[: len(content) // 2], "log.npz")]


@fault("refused", "damaged")
def a_flipped_bit_in_an_archive(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, y=y)
    content = bytearray((folder / "log.npz").read_bytes())
    content[1000] ^= 1
    return [write(folder, bytes(content), "log.npz")]


@fault("refused", "length")
def arrays_of_different_length(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u[:-1], y=y)
    return [folder / "log.npz"]


@fault("refused", "no-column")
def an_array_that_is_not_there(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, angle=y)
    return [folder / "log.npz"]


@fault("refused", "damaged")
def a_matlab_file_cut_off(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u, "y": y})
    return [write(folder, (folder / "log.mat").read_bytes()[:-200], "log.mat")]


@fault("refused", "not-a-number")
def a_matlab_cell(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u, "y": np.array([y, y[:3]], dtype=object)})
    return [folder / "log.mat"]


@fault("refused", "damaged")
def half_a_bag(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    storage = next((folder / "bag").glob("*.db3"))
    storage.write_bytes(storage.read_bytes()[:20000])
    return words


@fault("refused", "no-column")
def a_topic_that_is_not_there(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    return [*words[:-1], "/imu/orientation.x"]


@fault("refused", "no-column")
def a_joint_that_is_not_there(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    return [*words[:-1], "/joint_states/roll/position"]


@fault("refused", "no-data")
def a_topic_without_messages(folder):
    time, u, y = sound()
    return recorded_bags.joint_states(folder / "bag", time[:0], u[:0], y[:0])


# What time does wrong


@fault("refused", "too-short")
def one_row(folder):
    return [write(folder, joined(lines()[:2]))]


@fault("refused", "too-short")
def one_row_less_than_needed(folder):
    # Order 2 and one input have 2 + 3 parameters and 3 for the start: 80 samples.
    return [write(folder, joined(lines()[:80]))]


@fault("refused", "too-short")
def gaps_all_over(folder):
    time, u, y = sound()
    return csv(folder, time + np.arange(SAMPLES) // 10, u, y)


@fault("refused", "time-backward")
def time_that_starts_again(folder):
    rows = lines()
    return [write(folder, joined(rows + rows[1:]))]


@fault("refused", "time-backward")
def two_lines_exchanged(folder):
    rows = lines()
    rows[200], rows[201] = rows[201], rows[200]
    return [write(folder, joined(rows))]


@fault("refused", "time-duplicate")
def stamps_too_coarse(folder):
    time, u, y = sound()
    return csv(folder, np.floor(time / 0.05) * 0.05, u, y)


@fault("refused", "jitter")
def jitter_of_a_fast_signal(folder):
    rng = np.random.default_rng(5)
    time = PERIOD * (np.arange(SAMPLES) + rng.uniform(-0.45, 0.45, SAMPLES))
    u = rng.standard_normal(SAMPLES)
    return csv(folder, time, u, response(u) + 0.3 * np.random.default_rng(6).standard_normal(SAMPLES))


@fault("refused", "sample-period")
def a_sampling_period_of_zero(folder):
    return [*csv(folder, *sound()), "--sample-period-s", "0"]


@fault("refused", "other-period")
def two_sampling_periods(folder):
    time, u, y = sound()
    other = write(folder, table(time / 2, u, y), "fast.csv")
    return [*csv(folder, time, u, y), other]


@fault("repaired", "time-duplicate")
def repeated_lines(folder):
    rows = lines()
    return [write(folder, joined([*rows[:300], rows[299], *rows[300:]]))]


@fault("repaired", "gap")
def a_gap(folder):
    rows = lines(count=900)
    return [write(folder, joined(rows[:400] + rows[490:]))]


@fault("repaired", "short-piece")
def a_gap_near_the_end(folder):
    rows = lines()
    return [write(folder, joined(rows[:560] + rows[595:]))]


@fault("repaired", "jitter")
def jitter_of_a_slow_signal(folder):
    time, u, y = smooth()
    at = time + PERIOD * np.random.default_rng(3).uniform(-0.2, 0.2, len(time))
    return csv(folder, at, np.interp(at, time, u), np.interp(at, time, y))


@fault("repaired", "jitter")
def single_samples_lost(folder):
    kept = np.delete(np.arange(SAMPLES), [100, 101, 250, 400])
    time, u, y = (each[kept] for each in smooth())
    return csv(folder, time, u, y)


def smooth():
    """A log of a motion that hardly changes from one sample to the next."""
    fine = response(command(10 * SAMPLES), 10)[::10]
    u = np.convolve(fine, np.ones(9) / 9, "same")
    y = response(u)
    return PERIOD * np.arange(SAMPLES), u, y + noise(SAMPLES, 9, 1e-4)


@fault("repaired", "time-rounded")
def stamps_rounded_to_their_last_digit(folder):
    _, u, y = sound()
    return csv(folder, np.round(0.0075 * np.arange(SAMPLES), 3), u, y)


@fault("repaired", "time-unit")
def milliseconds_by_name(folder):
    time, u, y = sound()
    return [*csv(folder, 1e3 * time, u, y, names=("tempo_ms", "u", "y")), "--time", "tempo_ms"]


@fault("repaired", "time-unit")
def microseconds_by_name(folder):
    time, u, y = sound()
    return [*csv(folder, 1e6 * time, u, y, names=("t [us]", "u", "y")), "--time", "t [us]"]


@fault("warning", "time-unit")
def milliseconds_as_seconds(folder):
    time, u, y = sound()
    return csv(folder, 1e3 * time, u, y)


@fault("warning", "time-unit")
def microseconds_as_seconds(folder):
    time, u, y = sound()
    return csv(folder, 1e6 * time, u, y)


@fault("repaired", "held-input")
def command_and_angle_in_two_topics(folder):
    return recorded_bags.two_topics(folder / "bag", *sound())


@fault("warning", "receive-time")
def messages_without_stamps(folder):
    return recorded_bags.unstamped(folder / "bag", *sound())


@fault("refused", "clocks")
def a_stamped_topic_and_one_without(folder):
    return recorded_bags.mixed(folder / "bag", *sound())


# What is wrong with the values


@fault("repaired", "truncated")
def cut_off_in_the_last_line(folder):
    return [write(folder, table(*sound())[:-1].rsplit(",", 1)[0])]


@fault("repaired", "truncated")
def cut_off_in_the_last_number(folder):
    return [write(folder, table(*sound())[:-1].rsplit(",", 1)[0] + ",-")]


@fault("repaired", "decimal-comma")
def decimal_commas(folder):
    return [write(folder, table(*sound(), separator=";").replace(".", ","))]


@fault("repaired", "missing-values")
def blank_fields(folder):
    rows = lines()
    rows[300] = rows[300].rsplit(",", 1)[0] + ","
    return [write(folder, joined(rows))]


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
