"""Training ends early where a hit rate is certain: the mean action is tried on engagements of a stream of its own."""

from collections.abc import Callable

from archerfish.cli.setting import Setting
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.evaluation.trial import fight
from archerfish.learning.training import Standing, trained_policy
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.targets.own_motion import find_motion

EVERY = 20
"""Iterations between two trials; of a whole number of compiled calls."""
ENGAGEMENTS = 25
"""Per range of the tables, and per kind of target that the training has."""


def never(_: Standing) -> bool:
    """Go on to the last iteration."""
    return False


def hit_rate_stop(
    aim: float | None,
    setting: Setting,
    environment: ShootingEnvironment,
    static_share: float,
    seed: int,
    motion: str = "",
) -> Callable[[Standing], bool]:
    """Return what tells whether a training has come far enough.

    It has when the lower end of the 95 % interval of the hit rate is at least the one aimed at. The engagements are the
    same in every trial, and those of no evaluation. Trying again and again gives chance more openings than one: where
    5 % matters, aim a little higher.

    Args:
      aim: hit rate, 0…1, or none.
      setting: the robot.
      environment: that of the training.
      static_share: share of its targets that stand still.
      seed: of the training.
      motion: of moving targets, as `find_motion` takes it; as eq (7) says if empty.
    """
    if aim is None:
        return never
    conditions, world = setting.conditions, environment.world
    kinds = {1.0: ("static",), 0.0: ("dynamic",)}.get(static_share, ("static", "dynamic"))
    own = find_motion(motion) if motion else None
    suites = tuple(each for each in table_suites(conditions, world.plants, motion=own) if each.target in kinds)
    trials = draw_trials(suites, ENGAGEMENTS, conditions.decisions, seed, "stopping", world.normals)

    def tried(standing: Standing) -> HitRate:
        policy = trained_policy(environment.observer, standing.learner)
        return hit_rate(fight(world, policy, trials).hits(conditions.hit_radius))

    def enough(standing: Standing) -> bool:
        due = standing.iterations > 0 and standing.iterations % EVERY == 0
        return due and tried(standing).low >= aim

    return enough
