"""A policy with a fallback: two Kalman filters beside it, and which of the three predicted the target best of late.

A trained policy has no doubts about targets that move as none did in its training. So at every decision there are three
predictions of where the pellet should arrive: the command that the policy wants, and the intercepts at constant
velocity of the two filters of its observation. A sight of the moment of arrival shows how far off each was. Where a
filter would have hit more often, by a margin, the gimbal is sent to its intercept, until the policy's predictions are
as good again. Between the two aims the change is gradual, so that no rounding decides.
"""

import math
from typing import Any, NamedTuple, cast

import numpy as np

from archerfish.controllers.network import forward, normalise
from archerfish.controllers.policy import PolicyController, policy_from_record
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import Array, lift, namespace, single_precision
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always
from archerfish.sensing.multimodel_observation import MultimodelObserver

KEPT_S = 1.0
"""How long predictions are remembered [s]: longer than a pellet flies, and its sight takes to come."""
REACH_M, FORGETTING, MARGIN, SPAN = 0.07, 0.06, 0.2, 0.3
"""Of a `GuardedPolicy`, chosen on the tuning stream and on motions that no suite has."""
_ARRIVED = 0.03
"""A command that is this far from what is wanted [rad], or farther, makes no prediction of it."""
_LITTLE = 1e-3


class Predictions(NamedTuple):
    """What was predicted, and how well."""

    arrival: Array
    """When the pellets of the latest decisions arrive, from now on [s], the newest last, shape B + (k,)."""
    angle: Array
    """Where they should be sent, pitch and yaw, by policy, fast and slow filter [rad], shape B + (k, 3, 2)."""
    counts: Array
    """One, down to zero while the gimbal slewed: what is wanted then is no prediction; shape B + (k,)."""
    scores: Array
    """Of the three, mean of exp(−e² / (2 r²)) over their latest predictions, off by e, shape B + (3,)."""


class GuardedMemory(NamedTuple):
    """What is remembered between decisions."""

    policy: Any
    """By the policy."""
    predictions: Predictions
    """Beside it."""


class GuardedPolicy(NamedTuple):
    """A policy with the multimodel observation that falls back on a Kalman filter where that predicts better."""

    policy: PolicyController
    """The policy, with the multimodel observation."""
    period: Array
    """Decision period [s], shape ()."""
    gain: Array
    """Steady gain of the gimbal, pitch and yaw, shape (2,)."""
    lead: Array
    """By how much commands must lead for this gimbal, as `dynamics.linear_axis.RampResponse` [s], shape ()."""
    kept: Array
    """Ones, as many as decisions are remembered, shape (k,)."""
    reach: Array
    """r of the scores [m], shape ()."""
    forgetting: Array
    """Share of the latest prediction in a score, shape ()."""
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
        count = self.kept.shape[0]
        none, three = xp.stack([zero] * count, axis=-1), xp.stack([zero] * 3, axis=-1)
        angles = xp.stack([xp.stack([three, three], axis=-1)] * count, axis=-3)
        return GuardedMemory(self.observer.begin(seen), Predictions(none, angles, none, three))

    def step(self, state: GuardedMemory, seen: Seen) -> tuple[GuardedMemory, Command]:
        """Decide from the memory."""
        observer = self.observer
        xp = namespace(seen.angle, seen.plate)
        memory = observer.remember(state.policy, seen)
        scored = self._scored(state.predictions, seen)
        action = forward(self.policy.actor, normalise(self.policy.normaliser, observer.observe(memory)))
        own, (fast, slow) = observer.wanted(memory, action), observer.intercepts(memory, self.lead)
        gain = lift(self.gain, own)
        by_policy, by_fast, by_slow = (scored.scores[..., index] for index in range(3))
        share = self._share(xp.maximum(by_fast, by_slow) - by_policy - self.margin)
        filtered = (slow.angle + self._share(by_fast - by_slow)[..., None] * (fast.angle - slow.angle)) / gain
        # An aim without a part in the command must not spoil it, whatever it is.
        aim = xp.where(share[..., None] > 0.0, own + share[..., None] * (filtered - own), own)
        angle = observer.towards(memory, aim)
        counts = xp.maximum(1.0 - xp.max(xp.abs(angle - aim), axis=-1) / _ARRIVED, 0.0)
        predicted = xp.stack([gain * own, fast.angle, slow.angle], axis=-2)
        usable = xp.max(xp.max(xp.abs(predicted), axis=-1), axis=-1) + fast.flight_time < math.inf
        after = Predictions(
            _pushed(scored.arrival, xp.where(usable, self.lead + fast.flight_time, 0.0 * counts), -1),
            _pushed(scored.angle, xp.where(usable[..., None, None], predicted, 0.0 * scored.angle[..., -1, :, :]), -3),
            _pushed(scored.counts, xp.where(usable, counts, 0.0 * scored.counts[..., -1]), -1),
            scored.scores,
        )
        return GuardedMemory(memory, after), fire_always(angle)._replace(fallback=share > 0.5)

    def _share(self, ahead: Array) -> Array:
        """Return the part in an aim of what is ahead by some score, 0…1."""
        return namespace(ahead).clip(0.5 + ahead / self.span, 0.0, 1.0)

    def _scored(self, predictions: Predictions, seen: Seen) -> Predictions:
        """Compare a new sight with the predictions for its time, and bring the scores up to date."""
        xp = namespace(seen.angle, seen.plate)
        arrival = predictions.arrival - seen.elapsed[..., None]
        plate, fresh = seen.plate[..., 0, :], seen.fresh[..., 0] & (seen.elapsed > 0.0)
        shown = aim_at(plate, self.observer.muzzle).angle
        distance = xp.sqrt(plate[..., 0] ** 2 + plate[..., 1] ** 2)[..., None, None]
        # Linear between the predictions for just before and just after the sight.
        weight = predictions.counts * xp.maximum(1.0 - xp.abs(arrival + seen.plate_age[..., :1]) / self.period, 0.0)
        total = xp.sum(weight, axis=-1)[..., None]
        mean = xp.sum(weight[..., None, None] * predictions.angle, axis=-3) / xp.maximum(total, _LITTLE)[..., None]
        error = distance * (mean - shown[..., None, :])
        found = xp.exp(-0.5 * xp.sum(error**2, axis=-1) / self.reach**2)
        change = self.forgetting * xp.minimum(total, 1.0) * (found - predictions.scores)
        # Of a sight from which nothing follows, as at the pivot, nothing is learned.
        usable = fresh[..., None] & (xp.abs(change) < math.inf)
        return predictions._replace(
            arrival=arrival, scores=xp.where(usable, predictions.scores + change, predictions.scores)
        )


def _pushed(series: Array, newest: Array, axis: int) -> Array:
    """Drop the oldest along an axis, −1 or −3, and append the newest."""
    xp = namespace(series, newest)
    if axis == -1:
        return xp.concat([series[..., 1:], newest[..., None]], axis=-1)
    return xp.concat([series[..., 1:, :, :], newest[..., None, :, :]], axis=-3)


def guarded(policy: PolicyController, period_s: float, ramp: dict[str, float]) -> GuardedPolicy:
    """Give a policy with the multimodel observation the filters to fall back on.

    Args:
      policy: in NumPy.
      period_s: decision period [s].
      ramp: of the robot that it was trained for, as `PolicyRecord.ramp`.
    """
    kept = np.ones(math.ceil(KEPT_S / period_s))
    gain = np.array([ramp["pitch_gain"], ramp["yaw_gain"]])
    settings = (period_s, gain, ramp["lead"], kept, REACH_M, FORGETTING, MARGIN, SPAN)
    return GuardedPolicy(policy, *single_precision(settings))


def controller_from_record(record: PolicyRecord) -> PolicyController | GuardedPolicy:
    """Build the controller of a policy record as it is to be played, in NumPy.

    Raises:
      InputError: if the kind of observation is unknown or has not the size that the network takes.
    """
    policy = policy_from_record(record)
    is_guarded = isinstance(policy.observer, MultimodelObserver) and record.ramp
    return guarded(policy, record.period_s, record.ramp) if is_guarded else policy
