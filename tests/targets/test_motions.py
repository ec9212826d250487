import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.targets.circle import Circle
from archerfish.targets.parabola import Parabola, triangle_wave
from archerfish.targets.passing import Line
from archerfish.targets.sinusoid import Sinusoid
from archerfish.targets.still import Static
from archerfish.targets.track import Track

HALF_WIDTH = math.sqrt(0.04 / 3.0)


def parabola(speed: float = 0.3, phase: float = 0.0) -> Parabola:
    values = (np.array([4.0, 0.5, 0.2]), speed, phase, HALF_WIDTH, 3.0)
    return Parabola(*(np.asarray(each) for each in values))


def test_triangle_wave_by_hand() -> None:
    assert_allclose(triangle_wave(np.array([-1.0, 0.0, 0.125, 0.25, 0.5, 0.75, 1.0])), [-1, -1, -0.5, 0, 1, 0, -1])


def test_a_parabola_keeps_eq_7() -> None:
    x, y, z = np.moveaxis(parabola().position(np.linspace(0.0, 5.0, 400)), -1, 0)
    assert_allclose(x, 3.0 * (y - 0.5) ** 2 + 4.0)
    assert np.all(x <= 4.04 + 1e-12)
    assert_allclose(z, 0.2)


def test_a_parabola_turns_back_at_its_ends() -> None:
    cycle = 4.0 * HALF_WIDTH / 0.3
    moments = cycle * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    lateral = parabola().position(moments)[:, 1] - 0.5
    assert_allclose(lateral, HALF_WIDTH * np.array([-1, 0, 1, 0, -1]), atol=1e-12)
    assert_allclose(parabola().position(moments[[0, 2]])[:, 0], 4.04)


def test_phase_zero_is_at_the_right_and_moves_left() -> None:
    early = parabola().position(np.array([0.0, 0.05]))
    assert early[1, 1] - early[0, 1] == pytest.approx(0.3 * 0.05)
    assert early[0, 1] == pytest.approx(0.5 - HALF_WIDTH)


def test_a_parabola_is_continuous_at_its_lateral_speed_and_periodic() -> None:
    cycle = 4.0 * HALF_WIDTH / 0.3
    times = np.linspace(0.0, 2.0 * cycle, 2001)
    path = parabola(phase=0.37).position(times)
    steps = np.abs(np.diff(path[:, 1]))
    full = 0.3 * (times[1] - times[0])
    assert np.all(steps <= full * (1.0 + 1e-9))
    assert np.mean(np.isclose(steps, full)) > 0.99  # all but those that hold a turn
    assert_allclose(path[:1001], path[1000:], atol=1e-12)


def test_phase_is_a_shift_in_time() -> None:
    cycle = 4.0 * HALF_WIDTH / 0.3
    assert_allclose(parabola(phase=0.3).position(np.asarray(0.2)), parabola().position(np.asarray(0.2 + 0.3 * cycle)))


def test_a_parabola_without_speed_stands_still() -> None:
    path = parabola(speed=0.0, phase=0.25).position(np.array([0.0, 1.0]))
    assert_allclose(path, [[4.0, 0.5, 0.2]] * 2)


def test_a_static_target_stands_still() -> None:
    assert_allclose(Static(np.array([3.0, 1.0, 0.1])).position(np.array([0.0, 7.0])), [[3.0, 1.0, 0.1]] * 2)


def test_a_line_goes_straight_on() -> None:
    line = Line(np.array([3.0, 1.0, 0.1]), np.array([-0.5, 2.0, 0.0]))
    assert_allclose(line.position(np.asarray(2.0)), [2.0, 5.0, 0.1])


def test_a_circle_is_level_and_turns_left() -> None:
    circle = Circle(np.array([3.0, 0.0, 0.2]), np.asarray(0.5), np.asarray(math.pi), np.asarray(0.0))
    quarter = circle.position(np.array([0.0, 0.5, 1.0]))
    assert_allclose(quarter, [[3.5, 0.0, 0.2], [3.0, 0.5, 0.2], [2.5, 0.0, 0.2]], atol=1e-12)


def test_a_sinusoid_swings_about_its_centre() -> None:
    motion = Sinusoid(
        np.array([3.0, 0.0, 0.2]), np.array([0.0, 0.4, 0.1]), np.asarray(2.0 * math.pi), np.asarray(math.pi / 2)
    )
    path = motion.position(np.array([0.0, 0.25, 0.5]))
    assert_allclose(path, [[3.0, 0.4, 0.3], [3.0, 0.0, 0.2], [3.0, -0.4, 0.1]], atol=1e-12)


def test_a_track_is_linear_between_its_points_and_rests_outside() -> None:
    places = np.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [2.0, -1.0, 0.4]])
    track = Track(np.array([1.0, 2.0, 4.0]), places)
    moments = np.array([0.0, 1.0, 1.5, 2.0, 3.5, 4.0, 9.0])
    expected = np.stack([np.interp(moments, track.times, places[:, axis]) for axis in range(3)], axis=-1)
    assert_allclose(track.position(moments), expected)


def batch_of_each_motion(shape: tuple[int, ...]) -> tuple:
    rng = np.random.default_rng(9)
    place, other = rng.uniform(1.0, 4.0, (2, *shape, 3))
    a, b, c, d = rng.uniform(0.1, 0.5, (4, *shape))
    times = np.broadcast_to(np.array([0.0, 1.0, 2.5, 3.0]), (*shape, 4))
    return (
        Static(place),
        Parabola(place, a, b, c, d),
        Line(place, other),
        Circle(place, a, b, c),
        Sinusoid(place, other, a, b),
        Track(times, rng.uniform(1.0, 4.0, (*shape, 4, 3))),
    )


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    def positions(motions, time):
        return tuple(motion.position(time) for motion in motions)

    time = np.random.default_rng(1).uniform(0.0, 3.5, shape)
    for path in agree_in_jax(positions, batch_of_each_motion(shape), time, atol=1e-5):
        assert path.shape == (*shape, 3)


def test_many_moments_of_a_batch_of_any_motion(agree_in_jax) -> None:
    # How a planner looks ahead: a leading axis of moments before the batch.
    def ahead(motions, times):
        return tuple(map_arrays(lambda each: each[None], motion).position(times) for motion in motions)

    motions, times = batch_of_each_motion((3,)), np.linspace(0.0, 3.5, 12).reshape(4, 3)
    for motion, path in zip(motions, agree_in_jax(ahead, motions, times, atol=1e-5), strict=True):
        assert_allclose(path[2], motion.position(times[2]), atol=1e-5)
