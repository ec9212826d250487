"""Files of shots with one fault each: how it is made, and what the command must say."""

import numpy as np

from .faults import Fault
from .recorded_axis import write

FAULTS: list[Fault] = []

LANDING = ("pitch_deg", "distance_m", "speed_m_s")


def fault(outcome, code):
    def register(make):
        FAULTS.append(Fault(make, outcome, code))
        return make

    return register


def shots(pitches=(0.0, 3.0, 6.0), each=8, seed=0):
    """Return pitch [°], landing distance [m] and speed [m/s] of shots from 0.4 m with little drag."""
    rng = np.random.default_rng(seed)
    pitch = np.repeat(pitches, each)
    speed = 18 + 0.2 * rng.standard_normal(pitch.size)
    angle = np.radians(pitch + 0.3 * rng.standard_normal(pitch.size))
    rise, run = speed * np.sin(angle), speed * np.cos(angle)
    flight = run * (rise + np.sqrt(rise**2 + 2 * 9.81 * 0.4)) / 9.81
    # Drag: k v² shortens the way by about half of k times its square.
    return pitch, flight - 0.5 * 0.019 * flight**2, speed


def csv(folder, *columns, names=LANDING):
    rows = "\n".join(",".join(f"{value:.4f}" for value in row) for row in zip(*columns, strict=True))
    return [write(folder, ",".join(names) + "\n" + rows + "\n", "shots.csv"), "--height-m", "0.4"]


@fault("refused", "no-such-file")
def a_missing_file(folder):
    return [folder / "shots.csv"]


@fault("refused", "empty")
def an_empty_file(folder):
    return [write(folder, "", "shots.csv")]


@fault("refused", "no-data")
def names_and_nothing_else(folder):
    return [write(folder, ",".join(LANDING) + "\n", "shots.csv")]


@fault("refused", "not-a-number")
def a_word_among_numbers(folder):
    pitch, distance, speed = shots()
    (path, *_) = csv(folder, pitch, distance, speed)
    path.write_text(path.read_text().replace("18.", "fast", 1))
    return [path]


@fault("refused", "missing-values")
def an_empty_field(folder):
    (path, *_) = csv(folder, *shots())
    path.write_text(path.read_text().rsplit(",", 1)[0] + ",\n")
    return [path]


@fault("refused", "infinite")
def an_infinite_distance(folder):
    pitch, distance, speed = shots()
    distance[3] = np.inf
    return csv(folder, pitch, distance, speed)


@fault("refused", "too-few-shots")
def four_shots(folder):
    return csv(folder, *(each[:4] for each in shots()))


@fault("refused", "not-separable")
def one_setting_without_speeds(folder):
    pitch, distance, _ = shots((2.0,), 20)
    return csv(folder, pitch, distance, names=LANDING[:2])


@fault("refused", "millimetres")
def millimetres(folder):
    pitch, distance, speed = shots()
    return csv(folder, pitch, 1000 * distance, speed)


@fault("refused", "beyond-reach")
def a_landing_point_beyond_reach(folder):
    pitch, distance, speed = shots()
    distance[5] = 500.0
    return csv(folder, pitch, distance, speed)


@fault("refused", "not-positive")
def a_negative_distance(folder):
    pitch, distance, speed = shots()
    distance[5] = -1.0
    return csv(folder, pitch, distance, speed)


@fault("refused", "angle-out-of-range")
def a_pitch_of_100_degrees(folder):
    pitch, distance, speed = shots()
    pitch[5] = 100.0
    return csv(folder, pitch, distance, speed)


@fault("refused", "implausible-speed")
def speeds_in_mm_per_s(folder):
    pitch, distance, speed = shots()
    return csv(folder, pitch, distance, 1000 * speed)


@fault("refused", "nominal-speed")
def speeds_from_the_data_sheet(folder):
    pitch, distance, speed = shots()
    return csv(folder, pitch, distance, 0 * speed + 18.0)


@fault("refused", "duplicate-shots")
def a_block_pasted_twice(folder):
    columns = shots()
    return csv(folder, *(np.concatenate([each, each[4:12]]) for each in columns))


@fault("refused", "no-scatter")
def means_instead_of_shots(folder):
    pitch, distance, _ = shots()
    return csv(folder, pitch, np.repeat(distance[::8], 8), names=LANDING[:2])


@fault("refused", "censored-misses")
def pellets_that_missed(folder):
    pitch, distance, speed = shots()
    missed = np.zeros(pitch.size)
    missed[[3, 9]] = 1
    return csv(folder, pitch, distance, speed, missed, names=(*LANDING, "missed"))


@fault("refused", "censored-misses")
def pellets_that_missed_in_a_table_of_blanks(folder):
    pitch, distance, _ = shots()
    missed = np.arange(pitch.size) == 3
    (path, *rest) = csv(folder, pitch, distance, missed, names=("pitch_deg", "distance_m", "missed"))
    path.write_text(path.read_text().replace(",", " "))
    return [path, *rest]


@fault("refused", "open-quote")
def an_open_quotation_mark(folder):
    (path, *_) = csv(folder, *shots())
    lines = path.read_text().splitlines()
    lines[4] = lines[4].replace(",", ',"', 1)
    path.write_text("\n".join(lines) + "\n")
    return [path]


@fault("refused", "mixed-columns")
def landing_points_and_a_plane(folder):
    pitch, distance, speed = shots()
    names = (*LANDING, "plane_distance_m", "hit_height_m")
    return csv(folder, pitch, distance, speed, distance, 0 * distance, names=names)


@fault("refused", "unknown-unit")
def a_column_of_millimetres(folder):
    pitch, distance, speed = shots()
    return csv(folder, pitch, 1000 * distance, speed, names=("pitch_deg", "distance_mm", "speed_m_s"))


@fault("refused", "out-of-range")
def a_height_of_centimetres(folder):
    return [*csv(folder, *shots())[:-1], "42"]


@fault("warning", "outliers")
def a_ricochet(folder):
    pitch, distance, speed = shots((0.0, 3.0, 6.0), 20)
    distance[7] *= 1.6
    return csv(folder, pitch, distance, speed)


@fault("warning", "repeated-shots")
def a_shot_written_twice(folder):
    columns = shots()
    return csv(folder, *(np.append(each, each[5]) for each in columns))


@fault("warning", "no-lateral")
def no_lateral_distances(folder):
    return csv(folder, *shots())


@fault("warning", "dependent-shots")
def a_speed_that_drifts(folder):
    pitch, distance, speed = shots((2.0,), 60)
    return csv(folder, pitch, np.sort(distance), speed)
