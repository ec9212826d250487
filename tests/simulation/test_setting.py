import numpy as np
import pytest

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.errors import InputError
from archerfish.simulation.setting import make_world, paper_muzzle

CONDITIONS = assumed_conditions()


def test_a_world_is_float32_throughout(build_world) -> None:
    found = []
    map_arrays(found.append, build_world(draws=2))
    assert {each.dtype for each in found} == {np.dtype(np.float32)}


@pytest.mark.parametrize(("draws", "count"), [(0, 1), (3, 3)])
def test_a_world_has_as_many_plants_as_its_records_have_draws(build_world, draws, count) -> None:
    assert build_world(draws=draws).plants == count


def test_an_unknown_command_limit_is_refused() -> None:
    plants = printed_plants()
    with pytest.raises(InputError, match="command limit"):
        make_world(plants["pitch"], plants["yaw"], paper_muzzle(CONDITIONS), gate_limits(), "fence", CONDITIONS)
