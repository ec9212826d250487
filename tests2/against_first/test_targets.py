"""Targets and draws of engagements, number for number as in the first edition."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

pytestmark = pytest.mark.against_first
pytest.importorskip("archerfish.targets.drawn")

from archerfish.paper.conditions import assumed_conditions  # noqa: E402
from archerfish.targets import drawn, parabola, path, variation  # noqa: E402
from archerfish.targets.motion import StillOrMoving as FirstStillOrMoving  # noqa: E402
from archerfish2.targets import distributions, kinds, mixture, motion  # noqa: E402
from archerfish2.task import StillOrMoving  # noqa: E402

SHAPES = [(), (3,), (2, 3), (64,)]


def float32(*values: float) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(each, np.float32) for each in values)


@pytest.mark.parametrize("name", [*kinds.KINDS, "kinds"])
@pytest.mark.parametrize("shape", SHAPES)
def test_drawn_paths_are_those_of_the_first_edition(name, shape) -> None:
    conditions, rng = assumed_conditions(), np.random.default_rng(7)
    eq_7 = float32(
        conditions.max_lateral_speed,
        np.sqrt(conditions.parabola_rise / conditions.parabola_curvature),
        conditions.parabola_rise,
    )
    first = drawn.drawn_motion({"kinds": "any"}.get(name, name))
    assert mixture.path_uniforms(name) == first.chances
    place = rng.uniform([1.0, -0.7, 0.1], [5.0, 0.7, 0.3], (*shape, 3)).astype(np.float32)
    uniforms = rng.random((*shape, first.chances), dtype=np.float32)
    duration = rng.choice(np.array([1.0, 3.0], np.float32), shape)
    expected = first.path(place, uniforms, duration)
    found = mixture.drawn_path(name, place, uniforms, duration, eq_7)
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.dtype == theirs.dtype == np.float32
        assert_array_equal(ours, theirs)
    for time in (rng.uniform(-0.5, 4.0, shape), rng.uniform(-0.5, 4.0, (5, *shape))):
        time = time.astype(np.float32)
        assert_array_equal(found.position(time), expected.position(time))


def test_the_table_is_that_of_the_first_edition() -> None:
    from archerfish.targets.distributions import TABLE, VARIATION

    uniform = np.linspace(0.0, 1.0, 101, dtype=np.float32)[:-1]
    for ours, theirs in ((distributions.TABLE, TABLE), ({"": distributions.VARIATION}, {"": VARIATION})):
        assert {name: [*each] for name, each in ours.items()} == {name: [*each] for name, each in theirs.items()}
        for name in ours:
            for mine, first in zip(ours[name].values(), theirs[name].values(), strict=True):
                assert mine.unit == first.unit
                assert_array_equal(mine.draw(uniform), first.draw(uniform))
    assert [*drawn.MIXTURE.values()] == [*mixture.MIXTURES["kinds"].values()]
    assert mixture.path_uniforms("kinds") == variation.CHANCES + kinds.KIND_DRAWS + 1
    assert_array_equal(motion.TIMES, path.TIMES)


@pytest.mark.parametrize("shape", SHAPES)
def test_eq_7_is_that_of_the_first_edition(shape) -> None:
    rng = np.random.default_rng(8)
    fields = [rng.uniform(0.1, 4.0, (*shape, *more)).astype(np.float32) for more in ((3,), (), (), (), ())]
    moving = rng.random(shape) < 0.5
    ours = StillOrMoving(fields[0], moving, motion.disc(motion.Parabola(*fields), fields[0]))
    theirs = FirstStillOrMoving(fields[0], moving, parabola.Parabola(*fields))
    time = rng.uniform(-0.3, 3.0, shape).astype(np.float32)
    times = np.stack([time, time + np.float32(0.5)])
    assert_array_equal(ours.at(time).position[..., 0, :], theirs.position(time))
    plates = ours.at(times)
    assert_array_equal(plates.position[..., 0, :], np.stack([theirs.position(each) for each in times]))
    assert_array_equal(plates.normal_yaw, np.full((2, *shape, 1), np.pi, np.float32))
