import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.records.shots import ShotColumns, merge_shots, read_shots_csv


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_degrees_become_radians_and_optional_columns_may_be_missing(tmp_path):
    shots = read_shots_csv(write(tmp_path / "shots.csv", "pitch_deg,yaw_deg,distance_m\n5,-5,6.5\n0,0,2.8\n"))
    np.testing.assert_allclose(np.degrees(shots.pitch), [5, 0])
    np.testing.assert_allclose(np.degrees(shots.yaw), [-5, 0])
    assert shots.speed is None
    assert shots.lateral is None
    assert len(shots) == 2


def test_shots_without_a_yaw_column_are_straight_ahead(tmp_path):
    shots = read_shots_csv(write(tmp_path / "shots.csv", "pitch_deg,distance_m\n5,6.5\n"))
    np.testing.assert_array_equal(shots.yaw, [0.0])


def test_speeds_and_lateral_distances_are_read_where_there_are_any(tmp_path):
    text = "pitch_deg,distance_m,speed_m_s,lateral_m\n5,6.5,18,-0.1\n0,3,17.5,0.2\n"
    shots = read_shots_csv(write(tmp_path / "shots.csv", text))
    np.testing.assert_array_equal(shots.speed, [18, 17.5])
    np.testing.assert_array_equal(shots.lateral, [-0.1, 0.2])


def test_columns_can_have_other_names(tmp_path):
    path = write(tmp_path / "shots.csv", "alpha,beta,d,v\n5,1,6.5,18\n")
    columns = ShotColumns(pitch_deg="alpha", yaw_deg="beta", distance_m="d", speed_m_s="v")
    assert read_shots_csv(path, columns).speed == [18]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pitch_deg,distance_m\n95,3\n", 'line 2: column "pitch_deg" is 95, expected an angle inside ±90°'),
        ("pitch_deg,distance_m\n5,3\n5,0\n", 'line 3: column "distance_m" is 0, expected a value above 0'),
        ("pitch_deg,distance_m,speed_m_s\n5,3,-1\n", 'line 2: column "speed_m_s" is -1'),
        ("angle,distance_m\n5,3\n", 'no column "pitch_deg"'),
    ],
)
def test_impossible_shots_are_refused_with_their_line(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        read_shots_csv(write(tmp_path / "shots.csv", text))
    assert message in str(caught.value)


def test_a_renamed_optional_column_must_be_there(tmp_path):
    path = write(tmp_path / "shots.csv", "pitch_deg,distance_m\n5,3\n")
    with pytest.raises(InputError, match='no column "chrono"'):
        read_shots_csv(path, ShotColumns(speed_m_s="chrono"))


def test_files_of_one_muzzle_are_joined(tmp_path):
    first = read_shots_csv(write(tmp_path / "a.csv", "pitch_deg,distance_m\n5,6\n"))
    second = read_shots_csv(write(tmp_path / "b.csv", "pitch_deg,distance_m\n0,3\n1,4\n"))
    both = merge_shots([first, second])
    np.testing.assert_array_equal(both.distance, [6, 3, 4])
    assert both.source == "a.csv, b.csv"


def test_files_with_and_without_speeds_are_not_mixed(tmp_path):
    first = read_shots_csv(write(tmp_path / "a.csv", "pitch_deg,distance_m\n5,6\n"))
    second = read_shots_csv(write(tmp_path / "b.csv", "pitch_deg,distance_m,speed_m_s\n0,3,18\n"))
    with pytest.raises(InputError, match=r"b\.csv: has measured speeds and other files have none"):
        merge_shots([first, second])
