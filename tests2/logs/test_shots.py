"""Shots from text tables: what is read, joined, repaired and refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.errors import InputError
from archerfish2.logs.shots import ShotColumns, read_shots

LANDING, HITS = "pitch_deg,distance_m", "pitch_deg,plane_distance_m,hit_height_m"


@pytest.fixture
def file(tmp_path):
    def write(text, name="shots.csv", encoding="utf-8"):
        (tmp_path / name).write_text(text, encoding=encoding)
        return tmp_path / name

    return write


def test_degrees_become_radians_and_a_shot_has_its_line(file):
    shots = read_shots(file(f"{LANDING},yaw_deg,speed_m_s,note\n5,6.5,-5,18,1\n\n,,,,\n0,2.8,0,17.5,2\n"))
    assert_allclose(np.degrees([shots.pitch, shots.yaw]), [[5, 0], [-5, 0]])
    assert_array_equal(shots.speed, [18, 17.5])
    assert (shots.lateral, shots.hit_height, len(shots), shots.source) == (None, None, 2, "shots.csv")
    assert [shots.place(index) for index in range(2)] == ["shots.csv line 2", "shots.csv line 5"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_hits_on_a_plane_are_found_by_their_columns_in_every_table(file, encoding):
    text = "\n".join(["pitch_deg;plane_distance_m;hit_height_m;lateral_m", "0;4;-0,23;0,02", "1;2;-0,16;-0,01", ""])
    shots = read_shots(file(text, encoding=encoding))
    found = [shots.hit_height, shots.distance, shots.lateral, shots.yaw]
    assert_array_equal(found, [[-0.23, -0.16], [4, 2], [0.02, -0.01], [0, 0]])
    assert [each.code for each in shots.findings] == ["decimal-comma"]


def test_settings_are_numbered_by_pitch_and_plane_and_named(file):
    number, names = read_shots(file(f"{HITS}\n3,4,0\n3,2,0.1\n3,4,0.2\n")).settings()
    assert (number.tolist(), names) == ([1, 0, 1], ["3.0°, 2.00 m", "3.0°, 4.00 m"])
    assert read_shots(file(f"{LANDING}\n3,4\n3,4.2\n-1,3\n")).settings()[1] == ["-1.0°", "3.0°"]


def test_files_are_joined_and_shots_selected_even_without_a_last_line_break(file, refused):
    one, two = file(f"{LANDING}\n5,6.5\n1,3\n", "one.csv"), file(f"{LANDING}\n0,2.8", "two.csv")
    some = read_shots(one, two).select(np.array([False, True, True]))
    assert some.places == ("one.csv line 3", "two.csv line 2")
    assert_array_equal(some.distance, [3, 2.8])
    other = file(f"{LANDING},speed_m_s\n0,2.8,18\n", "other.csv")
    refused("other.csv: speed_m_s is not in all files", read_shots, one, other)


def test_columns_may_have_other_names_and_are_then_required(file, refused):
    path, columns = file("alpha,d\n5,6.5\n"), ShotColumns(pitch_deg="alpha", distance_m="d")
    assert read_shots(path, columns=columns).distance == [6.5]
    refused('no column "chrono"', read_shots, path, columns=ShotColumns("alpha", distance_m="d", speed_m_s="chrono"))


FAULTS = {
    f"{LANDING}\n95,3\n": ('shots.csv line 2: "pitch_deg" is 95, expected a number within ±90', "angle-out-of-range"),
    f"{LANDING}\n5,3\n5,0\n": ('shots.csv line 3: "distance_m" is 0, expected a number above 0', "not-positive"),
    f"{HITS}\n5,-3,0\n": ('"plane_distance_m" is -3', "not-positive"),
    f"{LANDING},speed_m_s\n5,3,\n": ('line 2: "speed_m_s" is nan', "missing-values"),
    f"{LANDING}\n5,inf\n": ('"distance_m" is inf', "infinite"),
    f"{LANDING}\n5,far\n": ('"far"', "not-a-number"),
    "pitch_deg,distance_mm\n5,3000\n": ('"distance_mm" has another unit than distance_m', "unknown-unit"),
    "pitch_deg,distance_m,hit_height_m\n5,3,0.1\n": ("both landing points and hits", "mixed-columns"),
    "pitch_deg,distance_m,missed\n5,3,0\n5,,1\n": ("1 of 2 shots missed", "censored-misses"),
    "pitch_deg distance_m missed\n5 3 0\n5 4 1\n": ("1 of 2 shots missed", "censored-misses"),
    "angle,distance_m\n5,3\n": ('no column "pitch_deg"', "no-column"),
}


@pytest.mark.parametrize("text", FAULTS)
def test_what_can_not_be_right_is_refused_with_its_place_and_code(file, text):
    with pytest.raises(InputError) as caught:
        read_shots(file(text))
    assert FAULTS[text][0] in str(caught.value)
    assert caught.value.code == FAULTS[text][1]
