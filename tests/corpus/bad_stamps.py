"""Logs whose time stamps are wrong."""

import numpy as np

from . import recorded_bags
from .faults import csv, fault, joined, lines
from .recorded_axis import PERIOD, SAMPLES, command, noise, response, sound, table, write


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


@fault("repaired", "time-stamped-late")
def samples_stamped_late_by_a_host(folder):
    time, u, y = sound()
    late = np.maximum.accumulate(time + 0.6 * PERIOD * np.random.default_rng(5).random(time.size))
    return csv(folder, late + 1e-6 * np.arange(time.size), u, y)


@fault("repaired", "time-stamped-late")
def samples_that_wait_for_a_busy_host(folder):
    time, u, y = sound()
    waiting = 0.6 * PERIOD * np.random.default_rng(6).standard_exponential(time.size)
    late = np.maximum.accumulate(time + waiting)
    return csv(folder, late + 1e-6 * np.arange(time.size), u, y)


@fault("refused", "sample-period")
def a_sampling_period_of_zero(folder):
    return [*csv(folder, *sound()), "--sample-period-s", "0"]


@fault("repaired", "other-period")
def two_sampling_periods(folder):
    time, u, y = sound()
    often = PERIOD / 2 * np.arange(2 * time.size - 1)
    other = write(folder, table(often, np.repeat(u, 2)[:-1], np.interp(often, time, y)), "fast.csv")
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


@fault("repaired", "late-input")
def commands_that_begin_later(folder):
    return recorded_bags.two_topics(folder / "bag", *sound(count=900), commands_from=200)


@fault("warning", "receive-time")
def messages_without_stamps(folder):
    return recorded_bags.unstamped(folder / "bag", *sound())


@fault("refused", "clocks")
def a_stamped_topic_and_one_without(folder):
    return recorded_bags.mixed(folder / "bag", *sound())
