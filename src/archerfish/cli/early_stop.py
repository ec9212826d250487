"""Training ends early where a hit rate is certain: the mean action is tried on engagements of a stream of its own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.setting import Setting
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.evaluation.results import MOTION_TABLES
from archerfish.evaluation.suites import Suite, Trials, draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.learning.training import Standing, trained_policy
from archerfish.paper.conditions import Conditions
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.setting import make_scenario
from archerfish.targets.drawn import drawn_motion
from archerfish.targets.own_motion import find_motion

EVERY = 20
"""Iterations between two trials; of a whole number of compiled calls."""
ENGAGEMENTS = 25
"""Per range of the tables, and per kind of target that the training has, or per length where motions are drawn."""


def never(_: Standing) -> bool:
    """Go on to the last iteration."""
    return False


def stopping_suites(
    setting: Setting, environment: ShootingEnvironment, static_share: float, motion: str = "", target: str = ""
) -> tuple[tuple[Suite, ...], ...]:
    """Return the engagements that a training is tried on, like its own: a group for each length.

    Args:
      setting: the robot.
      environment: that of the training.
      static_share: share of its targets that stand still.
      motion: of moving targets, as `find_motion` takes it; as eq (7) says if empty.
      target: one of `targets.drawn`, in the place of the paper's targets.
    """
    conditions, plants = setting.conditions, environment.world.plants
    if target:
        return tuple(_drawn_suites(conditions, seconds, plants, target) for seconds in MOTION_TABLES)
    kinds = {1.0: ("static",), 0.0: ("dynamic",)}.get(static_share, ("static", "dynamic"))
    own = find_motion(motion) if motion else None
    return (tuple(each for each in table_suites(conditions, plants, motion=own) if each.target in kinds),)


def _drawn_suites(conditions: Conditions, seconds: float, plants: int, target: str) -> tuple[Suite, ...]:
    """Return engagements of one length as the training has them: of `any`, all motions mixed, eq (7) among them."""
    lasting, motion = replace(conditions, engagement_s=seconds), drawn_motion(target)
    return tuple(
        Suite(MOTION_TABLES[seconds], "dynamic", range_m, make_scenario(lasting, range_m, 0.0, plants, motion), target)
        for range_m in conditions.range_bins
    )


def hit_rate_stop(
    aim: float | None,
    setting: Setting,
    environment: ShootingEnvironment,
    suites: tuple[tuple[Suite, ...], ...],
    seed: int,
) -> Callable[[Standing], bool]:
    """Return what tells whether a training has come far enough.

    It has when the lower end of the 95 % interval of the hit rate is at least the one aimed at. The engagements are the
    same in every trial, and those of no evaluation. Trying again and again gives chance more openings than one: where
    5 % matters, aim a little higher.

    Args:
      aim: hit rate, 0…1, or none.
      setting: the robot.
      environment: that of the training.
      suites: from `stopping_suites`.
      seed: of the training.
    """
    if aim is None:
        return never
    conditions, world = setting.conditions, environment.world
    trials = [_draw(each, setting, seed, world.normals) for each in suites]

    def tried(standing: Standing) -> HitRate:
        policy = trained_policy(environment.observer, standing.learner)
        return _together([fight(world, policy, each).hits(conditions.hit_radius) for each in trials])

    def enough(standing: Standing) -> bool:
        due = standing.iterations > 0 and standing.iterations % EVERY == 0
        return due and tried(standing).low >= aim

    return enough


def _draw(suites: tuple[Suite, ...], setting: Setting, seed: int, normals: int) -> Trials:
    seconds = float(suites[0].scenario.lengths[..., 1])
    decisions = round(seconds / setting.conditions.control_period_s)
    return draw_trials(suites, ENGAGEMENTS, decisions, seed, "stopping", normals)


def _together(hits: list[NDArray[np.bool_]]) -> HitRate:
    """Count hits of engagements of several lengths, shape (N, T) each: of shorter ones no later decision counts."""
    longest = max(each.shape[-1] for each in hits)
    tables = [(each, np.ones(each.shape, bool)) for each in hits]
    hit, counted = (
        np.concatenate([np.pad(table, ((0, 0), (0, longest - table.shape[-1]))) for table in part])
        for part in zip(*tables, strict=True)
    )
    return hit_rate(hit, counted)
