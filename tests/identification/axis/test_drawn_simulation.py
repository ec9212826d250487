from dataclasses import replace

import numpy as np
import pytest

from archerfish.identification.axis.drawn_simulation import simulate_draws
from archerfish.identification.axis.state_space import simulate


@pytest.mark.parametrize("count", [8, 31, 32, 2048, 5000])
def test_draws_move_as_plants_of_their_own_over_any_length(resonant_plant, count):
    plant = resonant_plant(delay=2, feedthrough=0.3, inputs=2)
    rng = np.random.default_rng(3)
    draws = {
        name: getattr(plant, name) + 0.01 * rng.standard_normal((4, *getattr(plant, name).shape)) for name in "ABCD"
    }
    uncertain = replace(plant, draws=draws, draw_delays=np.array([2, 0, 7, 2]))
    inputs = rng.standard_normal((count, 2))
    alone = [
        replace(plant, delay_samples=int(uncertain.draw_delays[k]), **{name: draws[name][k] for name in draws})
        for k in range(3)
    ]
    expected = [simulate(each, inputs) for each in alone]
    np.testing.assert_allclose(simulate_draws(uncertain, inputs, 3), expected, rtol=1e-9, atol=1e-9)
