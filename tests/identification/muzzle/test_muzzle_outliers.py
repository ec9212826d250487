from dataclasses import replace

import numpy as np
import pytest

from archerfish.identification.muzzle.model import MuzzleProblem
from archerfish.identification.muzzle.outliers import robust_fit, sort_out

KNOWN = {"drag": 0.019, "height": 0.4}


def problem(shots):
    return MuzzleProblem(shots, KNOWN | ({} if shots.speed is None else {"speed": float(np.median(shots.speed))}))


def test_clean_sets_keep_their_shots(fire):
    # One in a hundred sets loses a shot.
    lost = [
        np.count_nonzero(~sort_out(problem(fire([-3, 0, 3], 10, lateral=True, seed=seed))).kept) for seed in range(30)
    ]
    assert sum(lost) <= 2


@pytest.mark.parametrize("planes", [(), (3, 5)])
@pytest.mark.parametrize("where", ["vertical", "lateral", "speed"])
def test_a_fault_in_any_measurement_is_found(fire, where, planes):
    shots = fire([0] if planes else [-3, 3], 20, planes=planes, lateral=True, seed=1)
    name = {"vertical": "hit_height" if planes else "distance"}.get(where, where)
    values = getattr(shots, name).copy()
    values[4] += {"vertical": -1.0, "lateral": 0.5, "speed": 9.0}[where]
    np.testing.assert_array_equal(np.flatnonzero(~sort_out(problem(replace(shots, **{name: values}))).kept), [4])


def test_a_third_of_bad_shots_does_not_move_the_robust_fit(fire):
    shots = fire([-6, -3, 0, 3, 6], 20, speeds=False, seed=2)
    bad = np.arange(100) % 3 == 0
    found = robust_fit(problem(replace(shots, distance=np.where(bad, 0.5 * shots.distance, shots.distance))))
    assert found.values["speed"] == pytest.approx(18.0, rel=0.05)


def test_too_many_bad_shots_are_counted_and_used(fire):
    shots = fire([-6, -3, 0, 3, 6], 20, speeds=False, seed=2)
    bad = np.arange(100) % 3 == 0
    found = sort_out(problem(replace(shots, distance=np.where(bad, 0.2 * shots.distance, shots.distance))))
    assert found.kept.all()
    assert found.too_many > 20


def test_no_shot_of_a_small_set_is_left_out(fire):
    shots = fire([-3, 3], 4, seed=3)
    distance = shots.distance.copy()
    distance[0] *= 0.3
    assert sort_out(problem(replace(shots, distance=distance))).kept.all()
