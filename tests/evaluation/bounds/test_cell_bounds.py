from dataclasses import replace

import numpy as np
import pytest

from archerfish.evaluation.bounds import cell_bounds as module
from archerfish.evaluation.bounds.cell_bounds import cell_bounds, reach_rates
from archerfish.evaluation.bounds.published import (
    PublishedBounds,
    PublishedCell,
    camera_means,
    read_published,
    write_published,
)

RADIUS = 0.06


@pytest.fixture
def published(shooting, tmp_path, monkeypatch):
    """Publish bounds of two engagements a cell on a robot, seed 0, and return what then stands beside hit rates."""
    world, trials = shooting("gate", 2, robot=True)
    cells = tuple(
        PublishedCell(suite.target, suite.range_m, rate, rate - 0.01, 0.001, rate - 0.02 * (index != 2), 0.002)
        for index, (suite, rate) in enumerate(
            zip(trials.suites, map(float, reach_rates(world, trials, RADIUS)), strict=True)
        )
    )
    found = PublishedBounds("identified-me", "gate", 0, 2, camera_means(world), cells)
    path = tmp_path / "published.json"
    write_published([found], path)
    monkeypatch.setattr(module, "read_published", lambda: read_published(path))
    return found


def test_a_robot_has_no_bound(shooting) -> None:
    class Robot:
        """Not linear."""

    assert cell_bounds(Robot(), shooting().trials, RADIUS, "infantry", "gate", 0) is None


def test_without_a_published_one_the_reach_bound_holds_of_all(shooting) -> None:
    world, trials = shooting("gate", 2, robot=True)
    found = cell_bounds(world, trials, RADIUS, "identified-nobody", "gate", 0)
    assert [each.causal for each in found] == [each.hindsight for each in found]
    assert {(each.causal.kind, each.causal.error) for each in found} == {("reach", 0.0)}
    np.testing.assert_allclose([each.causal.value for each in found], reach_rates(world, trials, RADIUS))


def test_published_bounds_stand_where_they_are_of_these_very_engagements(shooting, published) -> None:
    world, trials = shooting("gate", 2, robot=True)
    found = cell_bounds(world, trials, RADIUS, "identified-me", "gate", 0)
    assert [each.hindsight.kind for each in found] == ["hindsight"] * 8
    # Of a mean over a cell both hold, so the smaller one does.
    assert [each.causal.kind for each in found] == [*["combined"] * 2, "hindsight", *["combined"] * 5]
    assert found[0].hindsight[:2] == (published.cells[0].hindsight, 0.001)
    assert found[0].causal[:2] == (published.cells[0].combined, 0.002)


def test_published_bounds_of_anything_else_are_left_alone(shooting, published) -> None:
    world, trials = shooting("gate", 2, robot=True)
    slower = world._replace(muzzles=world.muzzles._replace(speed=0.995 * world.muzzles.speed))
    blind = world._replace(sensing=world.sensing._replace(across=1.01 * world.sensing.across))
    others = [
        (world, trials, "identified-me", "gate", 1),
        (world, trials, "identified-you", "gate", 0),
        (world, trials, "identified-me", "box", 0),
        (world, shooting("gate", 3, robot=True).trials, "identified-me", "gate", 0),
        (world, shooting("gate", 2, robot=True, seed=1).trials, "identified-me", "gate", 0),
        (slower, trials, "identified-me", "gate", 0),
        (blind, trials, "identified-me", "gate", 0),
        (world, replace(trials, suites=trials.suites[::-1]), "identified-me", "gate", 0),
    ]
    for where, which, *names in others:
        kinds = {each.causal.kind for each in cell_bounds(where, which, RADIUS, *names)}
        assert kinds == {"reach"}


def test_what_is_published_anew_takes_the_place_of_the_old(tmp_path, published) -> None:
    path = tmp_path / "published.json"
    write_published([replace(published, cells=published.cells[:1]), replace(published, seed=1)], path)
    assert [(each.seed, len(each.cells)) for each in read_published(path)] == [(0, 1), (1, 8)]


def test_the_bounds_that_come_with_the_library_can_be_read() -> None:
    for each in read_published():
        assert len(each.cells) == 8
        assert all(0.5 < cell.hindsight <= cell.reach <= 1.0 + 1e-9 for cell in each.cells)
