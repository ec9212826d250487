"""Motions whose parameters are drawn: how far, how fast and from where they go."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.targets import mixture
from archerfish2.targets.distributions import LARGEST_SPEED, TABLE, VARIATION, draw_parameters
from archerfish2.targets.kinds import KINDS, UNIFORMS, driven, eq_7
from archerfish2.targets.motion import FLIGHT_S, STEP_S, TIMES, ZERO
from archerfish2.task import Task

SWING = tuple(np.asarray(each, np.float32) for each in (0.35, 0.115, 0.04))
PLACE = np.random.default_rng(6).uniform([1.0, -0.5, 0.2], [5.0, 0.5, 0.2], (400, 3))


def uniforms(*batch: int) -> np.ndarray:
    return np.random.default_rng(5).random((*batch, mixture.path_uniforms("any")))


def test_a_draw_is_the_inverse_of_the_distribution_function() -> None:
    even = np.linspace(0.0, 1.0, 101)[:-1]
    for each in [each for table in (*TABLE.values(), VARIATION) for each in table.values()]:
        scale = np.log if each.logarithmic else np.asarray
        assert_allclose(np.interp(scale(each.draw(even)), scale(each.value), each.share), even, atol=1e-12)


@pytest.mark.parametrize("duration", [1.0, 3.0])
@pytest.mark.parametrize("name", [*KINDS, "any"])
def test_a_target_stays_in_front_and_is_no_faster_than_a_robot(name, duration) -> None:
    path = mixture.drawn_path(name, PLACE, uniforms(400), np.full(400, duration), SWING)
    places = path.places[:, duration + FLIGHT_S + 1e-9 >= TIMES]
    speed = np.max(np.linalg.norm(np.diff(places, axis=1), axis=-1)) / STEP_S
    assert (speed > 0.1) == (name != "still")
    assert speed <= LARGEST_SPEED * (1.0 + 1e-9)
    most = PLACE[:, None, :1] * [mixture.LARGEST_FORWARD, mixture.LARGEST_LATERAL, 1e-12]
    assert np.all(np.abs(places - PLACE[:, None]) <= most * (1.0 + 1e-9))
    assert name not in ("still", "strafe", "stop-and-go", "singer") or np.allclose(places[:, ZERO], PLACE, atol=1e-12)


def test_kinds_have_their_shape() -> None:
    drawn, duration = uniforms(400)[:, 1:], np.full(400, 3.0)
    half_width, _, rise = (each[:, None] for each in draw_parameters(TABLE["parabola"], drawn))
    x, y = np.moveaxis(KINDS["parabola"](drawn, duration), -1, 0)
    assert_allclose(x, rise * (y / half_width) ** 2, atol=1e-12)
    passing = mixture.drawn_path("pass", PLACE, uniforms(400), duration, SWING)
    assert_allclose(passing.position(duration * drawn[:, 3]), PLACE, atol=1e-9)  # at its place once
    speed = np.diff(driven(np.asarray(1.0), np.array([-2.0]), np.array([0.5]), np.asarray(4.0))) / STEP_S
    assert_allclose(speed, np.interp(TIMES[:-1] + STEP_S / 2, [0.5, 1.0], [1.0, -1.0]), atol=1e-2)


def test_any_mixes_the_motions_by_their_weights() -> None:
    place, drawn, begin = np.tile([3.0, 0.0, 0.2], (2000, 1)), uniforms(2000), 0.0
    drawn[:, 1 + UNIFORMS] = 0.5  # neither slower nor swaying
    drawn[:, 0] = (np.arange(2000) + 0.5) / 2000
    mixed = mixture.drawn_path("any", place, drawn, np.asarray(1.0), SWING).places
    for name, weight in zip(KINDS, mixture.WEIGHTS, strict=False):
        mine = (drawn[:, 0] >= begin) & (drawn[:, 0] < (begin := begin + weight / 24.7))
        alone = mixture.drawn_path(name, place[mine], drawn[mine], np.asarray(1.0), SWING).places
        assert_allclose(mixed[mine], alone, atol=1e-12)
    assert_allclose(np.max(np.abs(mixed[drawn[:, 0] > begin, :, 1])), 0.115, rtol=1e-3)  # the rest is eq (7)


def test_numpy_and_jax_agree(batch, agree) -> None:
    def positions(scenario, place, drawn, duration, time):
        displacements = [each(drawn, duration) for each in KINDS.values()]
        displacements += [eq_7(drawn, *SWING), mixture.varied(displacements[2], drawn)]
        positions = [mixture.path_about(place, each, duration).position(time) for each in displacements]
        return *positions, scenario.draw(drawn[..., :6])

    rng = np.random.default_rng(7)
    place, time = rng.uniform([2.0, -0.5, 0.1], [4.0, 0.5, 0.3], (*batch, 3)), rng.uniform(-0.3, 1.7, batch)
    scenario = Task.load("paper").scenario(9)
    agree(positions, scenario, place, uniforms(*batch), np.ones(batch), time, atol=1e-4)
