import math
from typing import NamedTuple

import numpy as np
import pytest

from archerfish.controllers.roster import Tuning
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.evaluation.tuning import BUDGET, GRIDS, LEAST_GAIN, Grid, starting_point, tune
from archerfish.paper.conditions import assumed_conditions

CONDITIONS = assumed_conditions()


class Hill(NamedTuple):
    """A hit rate that falls off on either side of the best settings, in octaves of a ratio and in seconds."""

    acceleration_sd: float = 4.0
    extra_lead_s: float = 0.0
    velocity_decay: float = 1.0

    def __call__(self, tuning: Tuning) -> float:
        away = math.log2(tuning.acceleration_sd / self.acceleration_sd)
        late = (tuning.extra_lead_s - self.extra_lead_s) / 0.02
        fast = math.log2(tuning.velocity_decay / self.velocity_decay)
        # One setting makes up for another, as lead and decay do.
        return 0.9 - 0.01 * (away**2 + late**2 + (3.0 * fast) ** 2 + 0.5 * late * away)


@pytest.mark.parametrize("lead", [-0.14, -0.02, 0.0, 0.1])
@pytest.mark.parametrize("acceleration", [0.25, 4.0, 128.0])
def test_the_best_settings_are_found_wherever_they_lie(lead, acceleration) -> None:
    hill = Hill(acceleration, lead, 0.64)
    tuned = tune("kalman", hill)
    assert tuned.hit_rate == pytest.approx(0.9, abs=0.003)
    assert tuned.tuning.extra_lead_s == pytest.approx(lead, abs=0.021)
    assert abs(math.log2(tuned.tuning.acceleration_sd / acceleration)) <= 1.0
    assert len(tuned.tried) <= BUDGET
    assert tuned.hit_rate >= max(rate for _, rate in tuned.tried) - LEAST_GAIN


@pytest.mark.parametrize("name", GRIDS)
def test_a_chosen_value_lies_between_two_that_were_tried_or_at_a_natural_bound(name) -> None:
    # Hit rates as rough as those of few engagements, with a slope that leads far from the start.
    rng = np.random.default_rng(7)

    def rate(tuning: Tuning) -> float:
        slope = math.log2(tuning.initial_speed) + 10.0 * tuning.extra_lead_s - math.log2(tuning.smoothing)
        return 0.8 + 0.01 * math.tanh(0.1 * slope) + 0.002 * rng.standard_normal()

    tuned = tune(name, rate)
    assert len(tuned.tried) <= BUDGET
    assert set(tuned.neighbours) == set(GRIDS[name])
    rates = dict(tuned.tried)
    for setting, beside in tuned.neighbours.items():
        assert beside.value == getattr(tuned.tuning, setting)
        for side, sign in ((beside.below, -1), (beside.above, 1)):
            if side is None:
                assert setting == "velocity_decay"
                assert (sign, beside.value) == (1, 1.0)
            else:
                value, found = side
                assert sign * (value - beside.value) > 0.0
                assert rates[tuned.tuning._replace(**{setting: value})] == found


def test_a_velocity_never_grows() -> None:
    tuned = tune("kalman", lambda tuning: 0.5 + 0.1 * tuning.velocity_decay)
    assert tuned.tuning.velocity_decay == 1.0
    assert max(tuning.velocity_decay for tuning, _ in tuned.tried) == 1.0
    assert tuned.neighbours["velocity_decay"].above is None


def test_no_setting_is_tried_twice() -> None:
    asked = []

    def rate(tuning: Tuning) -> float:
        asked.append(tuning)
        return Hill(16.0, -0.06, 0.8)(tuning)

    tuned = tune("kalman-lq", rate)
    assert len(asked) == len(set(asked)) == len(tuned.tried)


def test_steps_grow_on_the_way_to_a_far_optimum() -> None:
    grids = {"acceleration_sd": Grid(1.0, 2.0)}
    tuned = tune("far", lambda tuning: -0.01 * abs(math.log2(tuning.acceleration_sd) - 20.0), grids)
    assert tuned.tuning.acceleration_sd == 2.0**20
    assert len(tuned.tried) < 15


def test_every_controller_that_tracks_has_all_its_settings_tuned() -> None:
    lead = {"extra_lead_s"}
    tracker = lead | {"acceleration_sd", "initial_speed", "velocity_decay"}
    assert set(GRIDS["kalman"]) == set(GRIDS["kalman-tuned"]) == tracker
    assert set(GRIDS["kalman-lq"]) == tracker | {"smoothing"}
    assert set(GRIDS["imm-lq"]) == tracker - {"velocity_decay"} | {"smoothing", "turn_rate"}
    # The filter of the rule needs no belief about the target.
    assert set(GRIDS["parabola-lq"]) == lead | {"smoothing"}


def test_a_search_begins_at_its_starting_point() -> None:
    for name in GRIDS:
        tuned = tune(name, lambda _: 0.5)
        assert tuned.tried[0][0] == tuned.tuning == starting_point(name)
    assert starting_point("oracle") is None


def test_tuning_has_draws_that_no_evaluation_has() -> None:
    suites = table_suites(CONDITIONS)[:4]
    trials = draw_trials(suites, engagements=20, decisions=30, seed=0, purpose="tuning")
    judged = draw_trials(suites, engagements=20, decisions=30, seed=0)
    assert not np.intersect1d(trials.draws, judged.draws).size > trials.draws.size // 1000
    assert not np.any(trials.engagements.motion.vertex[:, 1] == judged.engagements.motion.vertex[:, 1])
