"""What the step from a simulator to a robot costs, in the same engagements with the same dispersion draws."""

import math
from collections.abc import Iterable

from archerfish.evaluation.evaluate import Ground, Outcome, suite_difference, suite_label
from archerfish.evaluation.results import Drop


def drops(ground: Ground, outcomes: Iterable[Outcome], simulated: Iterable[Outcome]) -> list[Drop]:
    """Compare every entrant with itself in the simulator, over whole engagements and over their settled shots.

    Args:
      ground: where the outcomes were shot.
      outcomes: with a robot.
      simulated: of the same entrants in the same engagements.
    """
    before = {(each.name, each.policy_seed): each for each in simulated}
    first = round(ground.conditions.settled_after_s / ground.world.period_s) - 1
    found = []
    for outcome in outcomes:
        other = before.get((outcome.name, outcome.policy_seed))
        if other is None:
            continue
        for index, suite in enumerate(ground.trials.suites):
            for settled, shots in ((False, slice(None)), (True, slice(first, None))):
                difference = suite_difference(suite, other, outcome, index, shots)
                label = vars(suite_label(ground, suite, outcome))
                # Where fired shots count and either fired none, there is nothing to compare.
                if math.isfinite(difference.difference):
                    found.append(Drop(**label, settled=settled, **difference._asdict()))
    return found
