import numpy as np
import pytest

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.identification.muzzle.dispersion import dispersion_at
from archerfish.records.muzzle import MuzzleRecord

MUZZLE = MuzzleRecord(
    speed=18.0, speed_sd=0.5, pitch_offset=0.01, pitch_sd=0.004, yaw_offset=0.0, yaw_sd=0.005, drag=0.019
)


def test_the_scatter_is_that_of_many_shots():
    rng = np.random.default_rng(0)
    angle = np.stack([0.01 + 0.004 * rng.standard_normal(20_000), 0.005 * rng.standard_normal(20_000)], axis=1)
    velocity = (18.0 + 0.5 * rng.standard_normal(20_000))[:, None] * direction(angle)
    for found in dispersion_at(MUZZLE, [2.0, 6.0]):
        hits = flat_fire_crossing(np.zeros_like(velocity), velocity, np.asarray(found.distance), np.asarray(0.019))
        # A standard deviation of 20,000 shots is known to 0.5 %.
        assert found.vertical_sd == pytest.approx(hits.height.std(), rel=0.02)
        assert found.lateral_sd == pytest.approx(hits.lateral.std(), rel=0.02)
