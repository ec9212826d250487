import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.sensing.interfaces import World, fire_always
from archerfish.simulation.shooting import ShootingWorld


def test_a_plain_command_fires_without_feed_forward_or_estimate() -> None:
    command = fire_always(np.array([[0.1, -0.2], [0.0, 0.3]]))
    assert_allclose(command.angle, [[0.1, -0.2], [0.0, 0.3]])
    assert_allclose(command.rate, 0.0)
    assert command.fire.tolist() == [True, True]
    assert np.isnan(command.hit_probability).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_angle_that_is_no_number_fires_nothing(bad) -> None:
    with np.errstate(invalid="ignore"):
        assert not fire_always(np.array([bad, 0.0])).fire


def test_the_simulation_keeps_the_worlds_protocol() -> None:
    assert isinstance(ShootingWorld(*[np.asarray(0.02)] * len(ShootingWorld._fields)), World)
