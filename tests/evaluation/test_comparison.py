import dataclasses

import pytest

from archerfish.evaluation.comparison import (
    cells_of,
    clearly_above,
    comparisons_of,
    policy_seeds,
    pooled_rate,
    rmse_to_paper,
    shares,
)
from archerfish.evaluation.results import Cell, Comparison, Results


def cell(hits: int, *, range_m: tuple[float, float] = (1.0, 2.0), paper: float | None = None, **label: object) -> Cell:
    where = {"table": "II", "setting": "paper", "target": "static", "command_limit": "box", "controller": "kalman"}
    return Cell(
        **{**where, **label},
        range_m=range_m,
        hits=hits,
        shots=100,
        engagements=2,
        low=0.0,
        high=1.0,
        misses_slewing=100 - hits,
        misses_settled=0,
        paper=paper,
    )


def comparison(difference: float, low: float) -> Comparison:
    return Comparison(
        table="II",
        setting="paper",
        target="static",
        range_m=(1.0, 2.0),
        command_limit="box",
        controller="history",
        policy_seed=0,
        against="kalman",
        difference=difference,
        low=low,
        high=1.0,
    )


def test_rmse_is_the_root_mean_square_in_points() -> None:
    assert rmse_to_paper([cell(83, paper=80.0), cell(76, paper=80.0)]) == pytest.approx((25 / 2) ** 0.5)


def test_rmse_passes_over_cells_that_the_paper_does_not_print() -> None:
    assert rmse_to_paper([cell(83, paper=80.0), cell(10)]) == pytest.approx(3.0)
    assert rmse_to_paper([cell(10)]) is None


def test_share_of_the_oracle_is_taken_cell_by_cell() -> None:
    near, far = ("II", (1.0, 2.0)), ("II", (2.0, 3.0))
    ours = {near: cell(45), far: cell(80, range_m=(2.0, 3.0))}
    assert shares(ours, {near: cell(90)}) == {near: 0.5}
    assert shares(ours, {near: cell(0)}) == {}


def test_pooled_rate_weighs_cells_by_their_shots() -> None:
    assert pooled_rate([cell(80), cell(60)]) == pytest.approx(0.7)
    assert pooled_rate([]) is None


def test_clearly_above_wants_the_whole_interval_above_zero() -> None:
    assert clearly_above([comparison(0.1, 0.05), comparison(0.1, 0.0), comparison(0.1, -0.05)]) == 1


def test_cells_are_picked_by_setting_limit_and_controller(synthetic_results: Results) -> None:
    found = cells_of(synthetic_results.cells, command_limit="gate", controller="oracle")
    assert len(found) == 8
    assert {(each.command_limit, each.controller) for each in found.values()} == {("gate", "oracle")}
    assert cells_of(synthetic_results.cells, command_limit="gate", controller="oracle", setting="sentry") == {}


def test_of_several_policies_the_lowest_seed_stands_unless_another_is_named() -> None:
    cells = [cell(50 + seed, controller="history", policy_seed=seed) for seed in (5, 2, 9)]
    where = {"command_limit": "box", "controller": "history"}
    assert policy_seeds(cells, command_limit="box", controller="history") == (2, 5, 9)
    assert [each.hits for each in cells_of(cells, **where).values()] == [52]
    assert [each.hits for each in cells_of(cells, **where, policy_seed=9).values()] == [59]


def test_comparisons_are_picked_by_whom_they_are_against(synthetic_results: Results) -> None:
    found = comparisons_of(
        synthetic_results.comparisons, against="kalman-lq", command_limit="box", controller="history"
    )
    assert len(found) == 8
    assert {each.against for each in found.values()} == {"kalman-lq"}
    swapped = [dataclasses.replace(each, policy_seed=3) for each in found.values()]
    assert len(comparisons_of(swapped, against="kalman-lq", command_limit="box", controller="history")) == 8
