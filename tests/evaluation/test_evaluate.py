"""Evaluation with controllers that it has never heard of."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import pytest

from archerfish.dynamics.aiming import line_of_sight
from archerfish.evaluation.bounds.cell_bounds import Bound, CellBounds
from archerfish.evaluation.evaluate import (
    Entrant,
    Ground,
    Outcome,
    cells,
    comparisons,
    compete,
    ground_bounds,
    perfect_aim,
)
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.simulation.setting import make_world, paper_muzzle

CONDITIONS = assumed_conditions()
ENGAGEMENTS = 6


class Musketeer(NamedTuple):
    """Points straight at what it sees, and a little beside it."""

    beside: Any
    """Pitch and yaw [rad], shape (2,)."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        sight = line_of_sight(seen.plate[..., 0, :])
        return state, fire_always(sight + self.beside.reshape((1,) * (sight.ndim - 1) + (2,)))


@pytest.fixture(scope="module")
def ground() -> Ground:
    world = make_world(
        **printed_plants(),
        muzzle=paper_muzzle(CONDITIONS),
        limits=gate_limits(),
        command_limit="box",
        conditions=CONDITIONS,
    )
    trials = draw_trials(table_suites(CONDITIONS), ENGAGEMENTS, CONDITIONS.decisions, seed=0)
    return Ground(world, trials, "box", "paper", CONDITIONS)


@pytest.fixture(scope="module")
def outcomes(ground: Ground) -> list[Outcome]:
    straight, beside = (Musketeer(np.array(each, np.float32)) for each in ((0.0, 0.0), (0.0, 0.02)))
    entrants = [Entrant("athos", straight), Entrant("porthos", beside), Entrant("aramis", straight, policy_seed=4)]
    return [*compete(ground, entrants), perfect_aim(ground)]


def test_every_entrant_has_one_cell_per_suite_under_its_own_name(ground: Ground, outcomes: list[Outcome]) -> None:
    found = cells(ground, outcomes)
    assert [cell.controller for cell in found[::8]] == ["athos", "porthos", "aramis", "perfect"]
    assert {(cell.table, cell.range_m) for cell in found[:8]} == {
        (suite.table, suite.range_m) for suite in ground.trials.suites
    }
    for cell in found:
        assert (cell.shots, cell.engagements) == (ENGAGEMENTS * CONDITIONS.decisions, ENGAGEMENTS)
        assert (cell.withheld, cell.counts) == (0, "decisions")
        assert cell.hits_per_s == pytest.approx(cell.hits / (ENGAGEMENTS * CONDITIONS.engagement_s))
        assert cell.low <= cell.hits / cell.shots <= cell.high
        assert cell.hits + cell.misses_slewing + cell.misses_settled == cell.shots
        assert cell.paper is None
        assert (cell.setting, cell.command_limit) == ("paper", "box")
    assert {cell.policy_seed for cell in found[16:24]} == {4}


def test_every_controller_has_the_bound_that_holds_of_it(ground: Ground, outcomes: list[Outcome]) -> None:
    bounds = [
        CellBounds(Bound(0.9 + index / 100, 0.0, "hindsight"), Bound(0.8, 0.002, "combined")) for index in range(8)
    ]
    athos, _, _, perfect = outcomes
    seer = dataclasses.replace(athos, name="seer", needs_truth=True)
    found = cells(ground, [athos, seer, perfect], bounds)
    assert {(cell.bound, cell.bound_error, cell.bound_kind) for cell in found[:8]} == {(0.8, 0.002, "combined")}
    assert [cell.bound for cell in found[8:16]] == [each.hindsight.value for each in bounds]
    # Perfect aim is a way of scoring: no gimbal moved.
    assert {cell.bound for cell in found[16:]} == {None}
    # Who fires the easy shots alone may hit more of them.
    suites = tuple(dataclasses.replace(each, counts="shots") for each in ground.trials.suites)
    chosen = dataclasses.replace(ground, trials=dataclasses.replace(ground.trials, suites=suites))
    assert {cell.bound for cell in cells(chosen, [athos], bounds)} == {None}
    assert {cell.bound for cell in cells(ground, outcomes)} == {None}


def test_who_needs_the_truth_is_known_by_it(ground: Ground) -> None:
    class Seer(Musketeer):
        @property
        def needs_truth(self) -> bool:
            return True

    entrants = [Entrant("athos", Musketeer(np.zeros(2, np.float32))), Entrant("seer", Seer(np.zeros(2, np.float32)))]
    assert [each.needs_truth for each in compete(ground, entrants)] == [False, True]


def test_bounds_of_a_ground_lie_above_what_is_hit(ground: Ground, outcomes: list[Outcome]) -> None:
    bounds = ground_bounds(ground, seed=0)
    assert bounds is not None
    for cell in cells(ground, outcomes[:1], bounds):
        assert cell.bound is not None
        assert cell.rate < cell.bound <= 1.0


def test_counts_are_those_of_the_shots(ground: Ground, outcomes: list[Outcome]) -> None:
    found = cells(ground, outcomes[:1])
    settled = CONDITIONS.control_period_s * np.arange(1, CONDITIONS.decisions + 1) >= CONDITIONS.settled_after_s - 1e-9
    for index, cell in enumerate(found):
        hit = outcomes[0].hit[index]
        assert cell.hits == hit.sum()
        assert cell.misses_settled == (~hit)[:, settled].sum()


def test_the_same_aim_under_two_names_makes_the_same_shots(outcomes: list[Outcome]) -> None:
    athos, porthos, aramis, perfect = outcomes
    np.testing.assert_array_equal(athos.hit, aramis.hit)
    assert perfect.hit.mean() > athos.hit.mean() > porthos.hit.mean()


def test_trained_entrants_are_compared_in_pairs(ground: Ground, outcomes: list[Outcome]) -> None:
    found = comparisons(ground, outcomes, against="porthos")
    assert [(each.controller, each.against, each.policy_seed) for each in found] == [("aramis", "porthos", 4)] * 8
    for index, each in enumerate(found):
        expected = outcomes[2].hit[index].mean() - outcomes[1].hit[index].mean()
        assert each.difference == pytest.approx(expected)
        assert each.low <= expected <= each.high
    assert comparisons(ground, outcomes, against="nobody") == []


def test_progress_hears_of_every_entrant(ground: Ground) -> None:
    heard: list[str] = []
    entrants = [Entrant(name, Musketeer(np.zeros(2, np.float32))) for name in ("athos", "porthos")]
    compete(ground, entrants, heard.append)
    assert heard == ["athos", "porthos"]


def test_what_was_asked_of_the_yaw_axis_is_the_jump_to_the_target(ground: Ground, outcomes: list[Outcome]) -> None:
    # Under `box` the first command jumps from rest to the line of sight; the largest one is the largest bearing.
    vertex = ground.trials.engagements.motion.position(np.zeros(len(ground.trials.draws), np.float32))
    bearing = np.abs(np.arctan2(vertex[:, 1], vertex[:, 0])).max()
    asked = outcomes[0].yaw_acceleration
    assert asked == pytest.approx(bearing / CONDITIONS.control_period_s**2, rel=0.01)
