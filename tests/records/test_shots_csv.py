import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.records.shots_csv import ShotColumns, read_shots_csv


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_degrees_become_radians_and_optional_columns_may_be_missing(tmp_path):
    shots = read_shots_csv(write(tmp_path / "shots.csv", "pitch_deg,yaw_deg,distance_m\n5,-5,6.5\n0,0,2.8\n"))
    np.testing.assert_allclose(np.degrees(shots.pitch), [5, 0])
    np.testing.assert_allclose(np.degrees(shots.yaw), [-5, 0])
    assert (shots.speed, shots.lateral, shots.on_plane, len(shots)) == (None, None, False, 2)
    assert shots.places == ("shots.csv line 2", "shots.csv line 3")


def test_hits_on_a_plane_are_told_by_their_columns(tmp_path):
    text = "pitch_deg;plane_distance_m;hit_height_m;lateral_m\n0;4;-0.23;0.02\n\n1;4;-0.16;-0.01\n"
    shots = read_shots_csv(write(tmp_path / "shots.csv", text))
    assert shots.on_plane
    np.testing.assert_array_equal(shots.yaw, [0, 0])
    np.testing.assert_array_equal(shots.hit_height, [-0.23, -0.16])
    np.testing.assert_array_equal(shots.distance, [4, 4])
    assert shots.places[1] == "shots.csv line 4"


def test_speeds_and_lateral_distances_are_read_where_there_are_any(tmp_path):
    text = "pitch_deg,distance_m,speed_m_s,lateral_m,missed\n5,6.5,18,-0.1,0\n0,3,17.5,0.2,0\n"
    shots = read_shots_csv(write(tmp_path / "shots.csv", text))
    np.testing.assert_array_equal(shots.speed, [18, 17.5])
    np.testing.assert_array_equal(shots.lateral, [-0.1, 0.2])


def test_columns_can_have_other_names(tmp_path):
    path = write(tmp_path / "shots.csv", "alpha,beta,d,v\n5,1,6.5,18\n")
    columns = ShotColumns(pitch_deg="alpha", yaw_deg="beta", distance_m="d", speed_m_s="v")
    assert read_shots_csv(path, columns).speed == [18]


@pytest.mark.parametrize(
    ("text", "message", "code"),
    [
        ("pitch_deg,distance_m\n95,3\n", 'line 2: column "pitch_deg" is 95, expected an angle', "angle-out-of-range"),
        ("pitch_deg,distance_m\n5,3\n5,0\n", 'line 3: column "distance_m" is 0, expected a value', "not-positive"),
        ("pitch_deg,plane_distance_m,hit_height_m\n5,-3,0\n", 'column "plane_distance_m" is -3', "not-positive"),
        ("pitch_deg,distance_m,speed_m_s\n5,3,-1\n", 'line 2: column "speed_m_s" is -1', "not-positive"),
        (
            "pitch_deg,distance_mm\n5,3000\n",
            'column "distance_mm" has the unit "mm", expected distance_m',
            "unknown-unit",
        ),
        ("pitch_rad,distance_m\n0.1,3\n", 'column "pitch_rad" has the unit "rad", expected pitch_deg', "unknown-unit"),
        ("\n\npitch_rad,distance_m\n0.1,3\n", 'line 3: column "pitch_rad"', "unknown-unit"),
        ("\npitch_deg,distance_m,hit_height_m\n5,3,0.1\n", "line 2: columns of landing points", "mixed-columns"),
        ("pitch_deg,distance_m,hit_height_m\n5,3,0.1\n", "landing points and of hits on a plane", "mixed-columns"),
        ("pitch_deg,distance_m,missed\n5,3,0\n5,,1\n", "line 3: 1 of 2 shots missed", "censored-misses"),
    ],
)
def test_impossible_shots_are_refused_with_their_line_and_code(tmp_path, text, message, code):
    with pytest.raises(InputError) as caught:
        read_shots_csv(write(tmp_path / "shots.csv", text))
    assert message in str(caught.value)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("text", "message"),
    [("angle,distance_m\n5,3\n", 'no column "pitch_deg"'), ("pitch_deg\n5\n", 'no column "distance_m"'), ("", "empty")],
)
def test_missing_columns_are_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_shots_csv(write(tmp_path / "shots.csv", text))


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("pitch_deg distance_m missed\n5 3 0\n5 4 1\n", "utf-8"),
        ("\n\npitch_deg,distance_m,missed\n5,3,0\n5,4,1\n", "utf-8"),
        ("pitch_deg,distance_m,missed\n5,3,0\n5,4,1\n", "utf-16"),
    ],
)
def test_misses_are_found_in_every_kind_of_table(tmp_path, text, encoding):
    path = tmp_path / "shots.csv"
    path.write_text(text, encoding=encoding)
    with pytest.raises(InputError, match="1 of 2 shots missed"):
        read_shots_csv(path)


def test_hits_on_a_plane_are_known_in_every_encoding(tmp_path):
    path = tmp_path / "shots.csv"
    path.write_text("pitch_deg;plane_distance_m;hit_height_m\n0;4;-0.23\n", encoding="utf-16")
    assert read_shots_csv(path).on_plane


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_shots_csv(tmp_path / "none.csv")


def test_a_renamed_optional_column_must_be_there(tmp_path):
    path = write(tmp_path / "shots.csv", "pitch_deg,distance_m\n5,3\n")
    with pytest.raises(InputError, match='no column "chrono"'):
        read_shots_csv(path, ShotColumns(speed_m_s="chrono"))
