import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.records.shots import (
    Shots,
    departure_azimuth,
    merge_shots,
    select_shots,
    setting_names,
    settings,
    vertical_measurement,
)


def landing(count=2, **more):
    return Shots(np.radians([5.0, 0.0])[:count], np.zeros(count), np.array([6.0, 3.0])[:count], **more)


def plane(**more):
    return Shots(np.zeros(2), np.zeros(2), np.array([2.0, 4.0]), hit_height=np.array([-0.1, -0.3]), **more)


def test_shots_of_several_files_are_joined_with_their_places():
    both = merge_shots([landing(source="a.csv", places=("a.csv line 2", "a.csv line 3")), landing(1, source="b.csv")])
    np.testing.assert_array_equal(both.distance, [6, 3, 6])
    assert both.source == "a.csv, b.csv"
    assert [both.place(index) for index in range(3)] == ["a.csv line 2", "a.csv line 3", "shot 1"]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (landing(speed=np.ones(2), source="b.csv"), r"b\.csv: has measured speeds and other files have none"),
        (landing(lateral=np.ones(2), source="b.csv"), r"b\.csv: has lateral distances"),
        (plane(source="b.csv"), r"b\.csv: has hits on a target plane"),
    ],
)
def test_files_of_different_columns_are_not_mixed(other, message):
    with pytest.raises(InputError, match=message) as caught:
        merge_shots([landing(source="a.csv"), other])
    assert caught.value.code == "mixed-columns"


def test_shots_of_one_pitch_and_plane_repeat_each_other():
    shots = Shots(np.radians([0, 3, 0, 3.0]), np.zeros(4), np.array([5.0, 7.0, 5.1, 6.9]))
    np.testing.assert_array_equal(settings(shots), [0, 1, 0, 1])
    assert setting_names(shots) == ["0° pitch", "3° pitch"]
    np.testing.assert_array_equal(settings(plane()), [0, 1])
    assert setting_names(plane()) == ["2 m", "4 m"]


def test_some_shots_can_be_taken():
    some = select_shots(landing(speed=np.array([17.0, 18.0]), places=("x", "y")), np.array([False, True]))
    assert (len(some), some.speed, some.places, some.lateral) == (1, [18.0], ("y",), None)


def test_the_azimuth_of_departure_is_against_the_barrel():
    shots = Shots(np.zeros(1), np.array([0.1]), np.array([4.0]), lateral=4 * np.tan([0.13]), hit_height=np.zeros(1))
    np.testing.assert_allclose(departure_azimuth(shots), [0.03])
    np.testing.assert_allclose(departure_azimuth(landing(1, lateral=np.array([0.06]))), np.arcsin(0.01))
    assert departure_azimuth(landing()) is None


def test_the_vertical_measurement_is_distance_or_height():
    np.testing.assert_array_equal(vertical_measurement(landing()), [6, 3])
    np.testing.assert_array_equal(vertical_measurement(plane()), [-0.1, -0.3])
