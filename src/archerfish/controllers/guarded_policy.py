"""A policy that knows when it doesn't know: beside it two classical trackers, and who of them foretold the target best.

A policy is as sure of itself with targets that move as none did in its training as with those that did. So all three
say at every decision where the target will be when the pellet arrives: the policy by the command that it wants, the
Kalman filters of its observation by the intercept at constant velocity. A sight of that moment shows how far off each
was. Where a filter would have hit more often of late, by a margin, the gimbal is sent to its intercept: the policy
falls back on it, until its own forecasts are as good again. All changes over are gradual, so that no rounding decides.
"""

from typing import Any, NamedTuple, cast

import numpy as np

from archerfish.controllers.network import forward, normalise
from archerfish.controllers.policy import PolicyController, policy_from_record
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import Array, namespace, single_precision
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.sensing.multimodel_observation import LEAD_S, MultimodelObserver

KEPT = 24
"""Decisions whose forecasts are remembered: more than pass until a pellet has arrived and its sight is there."""
REACH_M, FORGETTING, MARGIN, SPAN = 0.07, 0.06, 0.2, 0.3
"""Of a `GuardedPolicy`, chosen on the tuning stream and on motions that no suite has."""
_ARRIVED = 0.03
"""A command that is this far from what is wanted [rad], or farther, makes no forecast of it."""
_LITTLE = 1e-3


class Forecasts(NamedTuple):
    """What was foretold, and how well."""

    arrival: Array
    """When the pellets of the latest decisions arrive, from now on [s], the newest last, shape B + (k,)."""
    angle: Array
    """Where they should have been sent, pitch and yaw, by policy, fast and slow filter [rad], shape B + (k, 3, 2)."""
    counts: Array
    """One, down to zero while the gimbal slewed: what is wanted then is no forecast; shape B + (k,)."""
    scores: Array
    """Of the three, mean of exp(−e² / (2 r²)) over their latest forecasts, off by e, shape B + (3,)."""


class GuardedMemory(NamedTuple):
    """What is remembered between decisions."""

    policy: Any
    """By the policy."""
    forecasts: Forecasts
    """Beside it."""


class GuardedPolicy(NamedTuple):
    """A policy of the multimodel observation that falls back on a Kalman filter where that foretells better."""

    policy: PolicyController
    """Who decides, with the multimodel observation."""
    period: Array
    """Decision period [s], shape ()."""
    reach: Array
    """r of the scores [m], shape ()."""
    forgetting: Array
    """Share of the latest forecast in a score, shape ()."""
    margin: Array
    """By how much a filter's score is above the policy's when they have equal parts in the aim, shape ()."""
    span: Array
    """Of that difference, from the policy's aim alone to the filter's alone, shape ()."""

    @property
    def observer(self) -> MultimodelObserver:
        """How the policy sees and acts."""
        return cast(MultimodelObserver, self.policy.observer)

    def reset(self, seen: Seen, truth: Truth | None = None) -> GuardedMemory:  # noqa: ARG002
        """Return the memory at the beginning of an engagement."""
        xp = namespace(seen.angle, seen.plate)
        zero = 0.0 * seen.elapsed
        none, three = xp.stack([zero] * KEPT, axis=-1), xp.stack([zero] * 3, axis=-1)
        angles = xp.stack([xp.stack([three, three], axis=-1)] * KEPT, axis=-3)
        return GuardedMemory(self.observer.begin(seen), Forecasts(none, angles, none, three))

    def step(self, state: GuardedMemory, seen: Seen) -> tuple[GuardedMemory, Command]:
        """Decide from the memory."""
        observer = self.observer
        xp = namespace(seen.angle, seen.plate)
        memory = observer.remember(state.policy, seen)
        forecasts = self._judged(state.forecasts, seen)
        action = forward(self.policy.actor, normalise(self.policy.normaliser, observer.observe(memory)))
        fast, slow = observer.intercepts(memory)
        foretold = xp.stack([observer.wanted(memory, action), fast.angle, slow.angle], axis=-2)
        own, by_fast, by_slow = (forecasts.scores[..., index] for index in range(3))
        share = self._share(xp.maximum(by_fast, by_slow) - own - self.margin)
        classical = slow.angle + self._share(by_fast - by_slow)[..., None] * (fast.angle - slow.angle)
        aim = foretold[..., 0, :] + share[..., None] * (classical - foretold[..., 0, :])
        angle = observer.towards(memory, aim)
        counts = xp.maximum(1.0 - xp.max(xp.abs(angle - aim), axis=-1) / _ARRIVED, 0.0)
        after = Forecasts(
            xp.concat([forecasts.arrival[..., 1:], (LEAD_S + fast.flight_time)[..., None]], axis=-1),
            xp.concat([forecasts.angle[..., 1:, :, :], foretold[..., None, :, :]], axis=-3),
            xp.concat([forecasts.counts[..., 1:], counts[..., None]], axis=-1),
            forecasts.scores,
        )
        return GuardedMemory(memory, after), fire_always(angle)._replace(fallback=share > 0.5)

    def _share(self, ahead: Array) -> Array:
        """Return the part in an aim of who is ahead by some score, 0…1."""
        return namespace(ahead).clip(0.5 + ahead / self.span, 0.0, 1.0)

    def _judged(self, forecasts: Forecasts, seen: Seen) -> Forecasts:
        """Compare a new sight with the forecasts of its time, and bring the scores up to date."""
        xp = namespace(seen.angle, seen.plate)
        arrival = forecasts.arrival - seen.elapsed[..., None]
        plate, fresh = seen.plate[..., 0, :], seen.fresh[..., 0] & (seen.elapsed > 0.0)
        shown = aim_at(plate, self.observer.muzzle).angle
        distance = xp.sqrt(plate[..., 0] ** 2 + plate[..., 1] ** 2)[..., None, None]
        # Linear between the forecasts for just before and just after the sight.
        weight = forecasts.counts * xp.maximum(1.0 - xp.abs(arrival + seen.plate_age[..., :1]) / self.period, 0.0)
        total = xp.sum(weight, axis=-1)[..., None]
        mean = xp.sum(weight[..., None, None] * forecasts.angle, axis=-3) / xp.maximum(total, _LITTLE)[..., None]
        error = distance * (mean - shown[..., None, :])
        found = xp.exp(-0.5 * xp.sum(error**2, axis=-1) / self.reach**2)
        share = xp.where(fresh[..., None], self.forgetting * xp.minimum(total, 1.0), 0.0 * total)
        return forecasts._replace(arrival=arrival, scores=forecasts.scores + share * (found - forecasts.scores))


def guarded(policy: PolicyController, period_s: float) -> GuardedPolicy:
    """Give a policy with the multimodel observation the filters to fall back on.

    Args:
      policy: in NumPy.
      period_s: decision period [s].
    """
    settings = (np.asarray(each) for each in (period_s, REACH_M, FORGETTING, MARGIN, SPAN))
    return GuardedPolicy(policy, *single_precision(tuple(settings)))


def controller_from_record(record: PolicyRecord) -> PolicyController | GuardedPolicy:
    """Build the controller of a policy record as it is to be played, in NumPy.

    Raises:
      InputError: if the kind of observation is unknown or has not the size that the network takes.
    """
    policy = policy_from_record(record)
    return guarded(policy, record.period_s) if isinstance(policy.observer, MultimodelObserver) else policy
