import numpy as np
import pytest
from scipy.stats import ncx2

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.evaluation.bounds.hit_chance import hit_chance, shot_geometry
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.shooting import miss_at_armor
from archerfish.targets.parabola import Parabola

RADIUS = 0.06
FIRED = np.array([0.02, 0.3, 1.0])
MUZZLE = Muzzle(*(np.array(each) for each in (18.0, 0.2, [1e-3, -1e-3], [3.5e-3, 3.3e-3], 0.019, 0.16)))


@pytest.mark.parametrize("sd", [0.003, 0.012, 0.06])
def test_with_equal_spread_the_chance_is_that_of_the_noncentral_chi_square(sd) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 9)
    for distance in (0.0, 0.03, 0.055, 0.07, 0.15):
        offset = distance * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        expected = ncx2.cdf((RADIUS / sd) ** 2, 2, (distance / sd) ** 2)
        np.testing.assert_allclose(hit_chance(offset, np.full(2, sd), RADIUS), expected, atol=3e-4)


def test_without_spread_a_shot_hits_or_misses() -> None:
    offset = np.array([[0.0, 0.059], [0.042, 0.042], [0.043, 0.043], [0.061, 0.0]])
    np.testing.assert_allclose(hit_chance(offset, np.zeros(2), RADIUS), [1.0, 1.0, 0.0, 0.0], atol=1e-6)


def test_the_chance_is_the_share_of_simulated_pellets_that_hit() -> None:
    # 80 engagements × 3 shots × 2,000 pellets: the mean differs by more than 4 standard errors once in 16,000 seeds.
    rng = np.random.default_rng(5)
    vertex = np.stack([rng.uniform(1, 5, 80), rng.uniform(-0.7, 0.7, 80), np.zeros(80)], axis=-1)
    motion = Parabola(vertex, rng.uniform(0, 0.35, 80), rng.uniform(0, 1, 80), np.full(80, 0.115), np.full(80, 3.0))
    geometry = shot_geometry(Engagement(motion, np.zeros((80, 2)), np.zeros(80, np.int32)), MUZZLE, FIRED)
    off = rng.uniform(-0.06, 0.06, (80, 3, 2)) / geometry.x[..., None]
    rate = rng.uniform(-4.0, 4.0, (80, 3, 2))
    angle = geometry.aim + off - geometry.rate_share[..., None] * rate
    angle, rate = (np.repeat(each[..., None, :], 2000, axis=-2) for each in (angle, rate))
    position, velocity = pellet_at_muzzle(MUZZLE, angle, rate, rng.standard_normal((80, 3, 2000, 3)))
    moving = map_arrays(lambda each: each[:, None, None], motion)
    miss, _ = miss_at_armor(MUZZLE, moving, FIRED[:, None] + np.zeros((80, 3, 2000)), position, velocity)
    hit = np.linalg.norm(miss, axis=-1) <= RADIUS
    offset = np.stack([geometry.height_per_pitch * off[..., 0], geometry.lateral(off[..., 1])], axis=-1)
    chance = hit_chance(offset, geometry.sd, RADIUS)
    assert 0.2 < chance.mean() < 0.8
    error = np.sqrt(np.sum(chance * (1 - chance)) / 2000) / chance.size
    assert abs(hit.mean() - chance.mean()) < 4 * error
    assert np.max(np.abs(hit.mean(axis=-1) - chance)) < 0.08
