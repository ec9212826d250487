from typing import Any, NamedTuple

import numpy as np
import pytest

from archerfish.controllers.roster import Tuning
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import namespace
from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.evaluation.tuning import ACCELERATIONS, GRIDS, LEADS, tune
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.simulation.setting import make_world, paper_muzzle
from archerfish.simulation.shooting import ShootingWorld

CONDITIONS = assumed_conditions()


class Aside(NamedTuple):
    """Points to the left of the target by an angle."""

    angle: Any
    """[rad], shape ()."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        sight = line_of_sight(seen.plate[..., 0, :])
        drop, left = 0.01 + 0.0 * sight[..., 0], self.angle + 0.0 * sight[..., 0]
        return state, fire_always(sight + namespace(sight).stack([drop, left], axis=-1))


def aside(tuning: Tuning) -> Aside:
    """The nearer to 4 m/s² and 0.04 s, the nearer to straight ahead."""
    return Aside(np.float32(abs(np.log2(tuning.acceleration_sd / 4.0)) * 0.02 + abs(tuning.extra_lead_s - 0.04)))


@pytest.fixture(scope="module")
def world() -> ShootingWorld:
    plants = printed_plants()
    return make_world(**plants, muzzle=paper_muzzle(CONDITIONS), limits=gate_limits(), command_limit="box",
                      conditions=CONDITIONS)  # fmt: skip


@pytest.fixture(scope="module")
def trials() -> Trials:
    return draw_trials(table_suites(CONDITIONS)[:4], engagements=20, decisions=30, seed=0, purpose="tuning")


def test_a_lead_that_is_best_at_the_end_of_the_grid_is_sought_beyond_it(world, trials) -> None:
    def far(tuning: Tuning) -> Aside:
        return Aside(np.float32(2.0 * abs(tuning.extra_lead_s - 0.12)))

    grid = [Tuning(4.0, extra_lead_s=lead) for lead in LEADS]
    tuned = tune(world, trials, "aside", far, CONDITIONS.hit_radius, grid)
    assert tuned.tuning.extra_lead_s == pytest.approx(0.12)
    assert tuned.tried == len(LEADS) + 3  # 0.10 and 0.12 s are better, 0.14 s is not


def test_the_settings_that_hit_most_are_chosen_of_the_whole_grid(world, trials) -> None:
    grid = GRIDS["kalman"]
    tuned = tune(world, trials, "aside", aside, CONDITIONS.hit_radius, grid)
    rates = [fight(world, aside(each), trials).hits(CONDITIONS.hit_radius).mean() for each in grid]
    assert (tuned.controller, tuned.tried) == ("aside", len(ACCELERATIONS) * len(LEADS))
    assert tuned.hit_rate == pytest.approx(max(rates))
    assert rates[grid.index(tuned.tuning)] == max(rates)
    assert (tuned.tuning.acceleration_sd, tuned.tuning.extra_lead_s) == (4.0, 0.04)
    assert max(rates) > 1.5 * np.mean(rates)


def test_trackers_are_tuned_by_grids_of_one_size() -> None:
    assert len(GRIDS["kalman"]) == len(GRIDS["kalman-lq"]) == 30
    assert len({*GRIDS["kalman"], *GRIDS["kalman-lq"]}) > 50
    # The filter of the rule has nothing to be told of the target.
    assert {each.acceleration_sd for each in GRIDS["parabola-lq"]} == {0.0}


def test_tuning_has_draws_that_no_evaluation_has(trials) -> None:
    judged = draw_trials(table_suites(CONDITIONS)[:4], engagements=20, decisions=30, seed=0)
    assert not np.intersect1d(trials.draws, judged.draws).size > trials.draws.size // 1000
    assert not np.any(trials.engagements.motion.vertex[:, 1] == judged.engagements.motion.vertex[:, 1])
