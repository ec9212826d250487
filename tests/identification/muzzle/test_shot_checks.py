from dataclasses import replace

import numpy as np
import pytest

from archerfish.identification.muzzle.shot_checks import check_shots
from archerfish.records.errors import InputError
from archerfish.records.shots import merge_shots


def code_of(shots):
    with pytest.raises(InputError) as caught:
        check_shots(shots)
    return caught.value.code


def changed(shots, name, index, value):
    values = getattr(shots, name).copy()
    values[index] = value
    return replace(shots, **{name: values})


def test_sound_shots_pass_without_a_remark(fire):
    for planes in ((), (2, 5)):
        for speeds in (True, False):
            assert check_shots(fire([-3, 0, 10], 20, planes=planes, speeds=speeds, lateral=True)) == []


def test_too_few_shots_are_refused(fire):
    assert code_of(fire([0], 4)) == "too-few-shots"
    assert check_shots(fire([0], 5)) == []


@pytest.mark.parametrize("planes", [(), (3,)])
def test_millimetres_are_recognised_in_every_length(fire, planes):
    shots = fire([0, 3], 10, planes=planes, lateral=True)
    names = ("distance", "hit_height", "lateral") if planes else ("distance",)
    for name in names:
        assert code_of(replace(shots, **{name: 1000 * getattr(shots, name)})) == "millimetres"
    if not planes:
        # Both lengths in millimetres are as wrong as one.
        assert code_of(replace(shots, distance=1000 * shots.distance, lateral=1000 * shots.lateral)) == "millimetres"


def test_a_single_length_beyond_reach_is_named(fire):
    shots = replace(fire([0], 10), places=tuple(f"a.csv line {index + 2}" for index in range(10)))
    with pytest.raises(InputError, match=r"a\.csv line 6: the landing point at 300 m") as caught:
        check_shots(changed(shots, "distance", 4, 300.0))
    assert caught.value.code == "beyond-reach"


def test_a_hit_far_off_is_left_to_the_outliers(fire):
    assert check_shots(changed(fire([0], 10, planes=(3,)), "hit_height", 4, 2.5)) == []


@pytest.mark.parametrize(("factor", "code"), [(1000.0, "implausible-speed"), (3.6, "implausible-speed")])
def test_speeds_in_another_unit_are_refused(fire, factor, code):
    shots = fire([0], 10)
    assert code_of(replace(shots, speed=factor * shots.speed)) == code


def test_a_nominal_speed_is_refused(fire):
    shots = fire([0], 10)
    assert code_of(replace(shots, speed=np.full(10, 18.0))) == "nominal-speed"


def test_shots_that_stand_there_twice_are_refused_in_runs_and_remarked_singly(fire):
    shots = fire([0, 3], 10, lateral=True)
    assert code_of(merge_shots([shots, shots])) == "duplicate-shots"
    single = shots
    for name in ("distance", "speed", "lateral"):
        single = changed(single, name, 7, getattr(shots, name)[2])
    (remark,) = check_shots(single)
    assert remark.code == "repeated-shots"
    assert "shot 8 (= shot 3)" in remark.text


def test_coarse_measurements_may_agree(fire):
    shots = fire([0], 60, speeds=False, seed=3)
    assert check_shots(replace(shots, distance=np.round(shots.distance, 1))) == []


def test_shots_without_scatter_are_refused(fire):
    shots = fire([0, 3], 5, speeds=False)
    assert code_of(replace(shots, distance=np.repeat([5.0, 7.0], 5))) == "no-scatter"
