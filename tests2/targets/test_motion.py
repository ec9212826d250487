"""Eq (7), sampled paths, discs, and targets of which some stand still."""

import numpy as np
from numpy.testing import assert_allclose

from archerfish2.targets.motion import Parabola, Path, StillOrMoving, disc

HALF_WIDTH = (0.04 / 3.0) ** 0.5
CYCLE = 4.0 * HALF_WIDTH / 0.3


def parabola(phase: float = 0.0, speed: float = 0.3) -> Parabola:
    return Parabola(*map(np.asarray, ([4.0, 0.5, 0.2], speed, phase, HALF_WIDTH, 3.0)))


def random_path(*batch: int) -> Path:
    rng = np.random.default_rng(9)
    return Path(rng.normal(size=(*batch, 5, 3)), rng.uniform(-0.3, 0.3, batch), rng.uniform(0.1, 0.5, batch))


def test_a_parabola_keeps_eq_7_and_turns_back_at_its_ends() -> None:
    x, y, z = np.moveaxis(parabola().position(np.linspace(0.0, 2.0 * CYCLE, 401)), -1, 0)
    assert_allclose(x, 3.0 * (y - 0.5) ** 2 + 4.0)
    assert_allclose([np.min(x), np.max(x), np.min(z), np.max(z)], [4.0, 4.04, 0.2, 0.2])
    assert_allclose(y[:201:50] - 0.5, HALF_WIDTH * np.array([-1.0, 0.0, 1.0, 0.0, -1.0]), atol=1e-12)
    assert_allclose(np.abs(np.diff(y)), 0.3 * CYCLE / 200.0)
    assert_allclose(parabola(0.3).position(np.asarray(0.2)), parabola().position(np.asarray(0.2 + 0.3 * CYCLE)))


def test_a_path_is_linear_between_its_points_and_rests_outside() -> None:
    path = random_path(2)
    for time in (-1.0, -0.29, 0.1, 0.123, 1.9, 9.0):
        for member, found in enumerate(path.position(np.full(2, time))):
            moments = path.begin[member] + path.step[member] * np.arange(5)
            expected = [np.interp(time, moments, path.places[member, :, axis]) for axis in range(3)]
            assert_allclose(found, expected, atol=1e-12)


def test_discs_at_several_times_at_once_are_those_at_each(batch, agree) -> None:
    def at(swing, path, moving, times):
        still = StillOrMoving(swing.vertex, moving, disc(path, swing.vertex))
        return disc(swing, swing.vertex).at(times), still.at(times)

    rng = np.random.default_rng(1)
    swing = Parabola(rng.normal(size=(*batch, 3)), *rng.uniform(0.1, 0.5, (4, *batch)))
    times, moving = rng.uniform(-0.3, 3.0, (4, *batch)), rng.random(batch) < 0.5
    ahead = agree(at, swing, random_path(*batch), moving, times, atol=1e-5)
    for many, one in zip(ahead, at(swing, random_path(*batch), moving, times[2]), strict=True):
        assert_allclose(many.position[2], one.position, atol=1e-5)
        assert_allclose(many.normal_yaw, np.full((4, *batch, 1), np.pi), rtol=1e-6)
    assert_allclose((ahead[1].position[..., 0, :] - swing.vertex)[:, ~moving], 0.0, atol=1e-6)
