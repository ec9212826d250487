import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.paper.conditions import assumed_conditions
from archerfish.simulation.scenario import UNIFORMS, draw_engagement
from archerfish.simulation.setting import make_scenario
from archerfish.targets.own_motion import find_motion

CONDITIONS = assumed_conditions()


def drawn(count: int = 2000, **options):
    uniforms = np.random.default_rng(111).random((count, UNIFORMS)).astype(np.float32)
    return draw_engagement(make_scenario(CONDITIONS, **options), uniforms)


def test_targets_fill_the_range_and_the_width() -> None:
    vertex = drawn(range_m=(2.0, 3.0)).motion.vertex
    assert 2.0 <= vertex[:, 0].min() < 2.01
    assert 2.99 < vertex[:, 0].max() <= 3.0
    assert -0.7 <= vertex[:, 1].min() < -0.69
    assert 0.69 < vertex[:, 1].max() <= 0.7
    assert_allclose(vertex[:, 2], CONDITIONS.armor_height)


def test_without_a_range_all_the_tables_are_covered() -> None:
    distance = drawn().motion.vertex[:, 0]
    assert distance.min() < 1.1
    assert distance.max() > 4.9


def test_moving_targets_have_any_speed_and_phase() -> None:
    motion = drawn().motion
    assert 0.0 <= motion.speed.min() < 0.01
    assert 0.34 < motion.speed.max() <= 0.35
    assert motion.phase.max() - motion.phase.min() > 0.99
    assert_allclose(motion.half_width, CONDITIONS.reversal_half_width, rtol=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_the_targets_stands_still_at_the_vertex(share) -> None:
    motion = drawn(static_share=share).motion
    still = motion.speed == 0.0
    # Four standard errors: a false alarm once in 16,000 seeds.
    assert np.mean(still) == pytest.approx(share, abs=4.0 * math.sqrt(share * (1.0 - share) / 2000) + 1e-9)
    path = motion.position(np.full(2000, 0.7, np.float32))
    assert_allclose(path[still], motion.vertex[still], atol=1e-6)


def test_every_plant_is_drawn() -> None:
    counts = np.bincount(drawn(plants=5).plant)
    assert len(counts) == 5
    assert counts.min() > 300


def test_a_single_plant_is_the_first() -> None:
    assert not drawn().plant.any()


def test_the_gimbal_begins_where_the_conditions_say() -> None:
    assert_allclose(drawn(count=3).start, [[CONDITIONS.start_pitch, CONDITIONS.start_yaw]] * 3)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    uniforms = np.random.default_rng(112).random((*shape, UNIFORMS))
    scenario = make_scenario(CONDITIONS, static_share=0.5, plants=4)
    engagement = agree_in_jax(draw_engagement, scenario, uniforms)
    assert engagement.motion.vertex.shape == (*shape, 3)
    assert engagement.plant.shape == shape


def test_a_motion_of_one_s_own_moves_where_the_paper_s_would_and_still_targets_stand_there(agree_in_jax) -> None:
    motion = find_motion(f"{Path(__file__).parents[2] / 'examples' / 'departure.py'}:Departure")
    scenario = make_scenario(CONDITIONS, static_share=0.5, plants=4, motion=motion.drawer)
    uniforms = np.random.default_rng(113).random((200, scenario.uniforms)).astype(np.float32)
    ours = agree_in_jax(draw_engagement, scenario, uniforms)
    theirs = draw_engagement(make_scenario(CONDITIONS, static_share=0.5, plants=4), uniforms[:, :UNIFORMS])
    assert_allclose(ours.plant, theirs.plant)
    begin, end = (agree_in_jax(lambda each, t: each.position(t), ours.motion, np.full(200, t)) for t in (0.0, 1.0))
    assert_allclose(begin, theirs.motion.vertex, atol=1e-6)
    still = theirs.motion.speed == 0.0
    assert_allclose(end[still], begin[still])
    # It leaves within half a second, at the speed of the paper's target, to either side.
    way = np.abs(end - begin)[~still, 1] / theirs.motion.speed[~still]
    assert 0.5 <= way.min() < way.max() <= 1.0 + 1e-3
    assert set(np.sign((end - begin)[~still, 1])) == {-1.0, 1.0}
