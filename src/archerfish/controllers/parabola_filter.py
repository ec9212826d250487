"""Where a target of eq (7) will be, from noisy sights: a Bayes filter over speeds and phases.

The rule is known (the width within which the target goes to and fro, its largest speed), speed, phase and middle are
not. Speeds and phases form a grid of hypotheses; the middle is Gaussian under each and marginalised in closed form. So
each hypothesis keeps three sums over the frames. The prediction is the place that most likely lies within the armor's
reach of the pellet, not the mean: a target that may or may not turn back is in one of two places, never between them.
"""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.target_motion import triangle_wave
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import TrackerNoise

SPEEDS, PHASES, PLACES = 12, 24, 17
"""Hypotheses, and candidates of the aim over the width."""


class Hypotheses(NamedTuple):
    """Evidence of one target; H hypotheses."""

    weight: Array
    """Sum of the precisions of the frames [1/m²], shape B."""
    residual: Array
    """Precision-weighted sum of lateral position less the hypothesis' swing [1/m], shape B + (H,)."""
    square: Array
    """The same of its square, shape B + (H,)."""
    depth: Array
    """Weighted mean of x [m], shape B."""
    depth_weight: Array
    """Sum of its precisions [1/m²], shape B."""
    height: Array
    """Mean of z [m], shape B."""
    clock: Array
    """Since the first sight's exposure [s], shape B."""
    age: Array
    """Of the latest sight [s], shape B."""


class ParabolaFilter(NamedTuple):
    """A predictor that knows the rule of eq (7), but not speed, phase and middle."""

    speed: Array
    """Of each hypothesis [m/s], shape (H,)."""
    phase: Array
    """Part of the cycle gone at the first sight, shape (H,)."""
    half_width: Array
    """Distance from the middle at which the target turns back [m]."""
    reach: Array
    """Hit radius [m]."""
    noise: TrackerNoise
    """Of the camera; its acceleration is unused."""

    def reset(self, seen: Seen) -> Hypotheses:
        """Begin at the first sight."""
        plate = seen.plate[..., 0, :]
        zero = 0.0 * plate[..., 0]
        flat = zero[..., None] + 0.0 * lift(self.speed, zero[..., None])
        empty = Hypotheses(zero, flat, flat, plate[..., 0], zero, plate[..., 2], zero, seen.plate_age[..., 0])
        begun = self._taken(empty, plate, zero == 0.0)
        # A place that no frame has shown is a guess: it weighs next to nothing against the first sight.
        xp, shown = namespace(plate), seen.fresh[..., 0]
        sums = {name: getattr(begun, name) for name in ("weight", "residual", "square", "depth_weight")}
        flags = {name: xp.reshape(shown, shown.shape + (1,) * (each.ndim - zero.ndim)) for name, each in sums.items()}
        return begun._replace(**{name: xp.where(flags[name], each, 1e-6 * each) for name, each in sums.items()})

    def step(self, state: Hypotheses, seen: Seen) -> Hypotheses:
        """Take in what is seen now."""
        age = seen.plate_age[..., 0]
        later = state._replace(clock=state.clock + state.age + seen.elapsed - age, age=age)
        return self._taken(later, seen.plate[..., 0, :], seen.fresh[..., 0] & (seen.elapsed > 0.0))

    def position_after(self, state: Hypotheses, time: Array) -> Array:
        """Return the place that a pellet most likely meets, shape B + (3,)."""
        xp = namespace(state.residual, time)
        middle = state.residual / state.weight[..., None]
        evidence = -0.5 * (state.square - state.residual * middle)
        chance = xp.exp(evidence - xp.max(evidence, axis=-1, keepdims=True))
        chance = chance / xp.sum(chance, axis=-1, keepdims=True)
        swing = self._swing(state.clock + state.age + time)
        lateral = middle + swing
        mean = xp.sum(chance * lateral, axis=-1)
        places = mean[..., None] + lift(self._places(), mean[..., None])
        spread = xp.sqrt(1.0 / state.weight)[..., None, None]
        width = lift(self.reach, spread)
        off = xp.abs(lateral[..., None, :] - places[..., :, None])
        # Smooth count of hypotheses within reach; the mean breaks ties.
        within = 1.0 / (1.0 + xp.exp(xp.clip((off - width) / (0.3 * width + spread), -30.0, 30.0)))
        score = xp.sum(chance[..., None, :] * within, axis=-1)
        sharp = xp.exp(60.0 * (score - xp.max(score, axis=-1, keepdims=True)))
        best = xp.sum(sharp * places, axis=-1) / xp.sum(sharp, axis=-1)
        return xp.stack([state.depth + 0.0 * best, best, state.height + 0.0 * best], axis=-1)

    def _places(self) -> Array:
        return namespace(self.half_width).linspace(-1.0, 1.0, PLACES, dtype=self.half_width.dtype) * self.half_width

    def _swing(self, time: Array) -> Array:
        """Lateral position against the middle under each hypothesis [m], shape B + (H,)."""
        time = namespace(time).asarray(time)[..., None]
        cycles = lift(self.phase, time) + lift(self.speed, time) * time / (4.0 * self.half_width)
        return self.half_width * triangle_wave(cycles)

    def _taken(self, state: Hypotheses, plate: Array, fresh: Array) -> Hypotheses:
        xp = namespace(plate)
        x, y, z = (plate[..., index] for index in range(3))
        distance = xp.sqrt(x**2 + y**2)
        across = self.noise.across**2 + self.noise.across_angle**2 * distance**2
        along = self.noise.along**2 + self.noise.along_share**2 * distance**2
        # A sight off to the side has some of the error of the distance in its y, and of the bearing in its x.
        side, front = (y / distance) ** 2, (x / distance) ** 2
        precision = xp.where(fresh, 1.0 / (across * front + along * side), 0.0 * x)
        depth_precision = xp.where(fresh, 1.0 / (along * front + across * side), 0.0 * x)
        residual = y[..., None] - self._swing(state.clock)
        weight = state.weight + precision
        depth_weight = state.depth_weight + depth_precision
        share = depth_precision / xp.maximum(depth_weight, 1e-9)
        height_share = precision / xp.maximum(weight, 1e-9)
        return state._replace(
            weight=weight,
            residual=state.residual + precision[..., None] * residual,
            square=state.square + precision[..., None] * residual**2,
            depth=state.depth + share * (x - state.depth),
            depth_weight=depth_weight,
            height=state.height + height_share * (z - state.height),
        )


def parabola_filter(half_width: float, max_speed: float, reach: float, noise: TrackerNoise) -> ParabolaFilter:
    """Build the filter.

    Args:
      half_width: distance from the middle at which the target turns back [m].
      max_speed: largest lateral speed [m/s]; speeds are as likely everywhere up to it.
      reach: hit radius [m].
      noise: of the camera.
    """
    speed, phase = np.meshgrid(max_speed * np.arange(SPEEDS) / (SPEEDS - 1), np.arange(PHASES) / PHASES, indexing="ij")
    return ParabolaFilter(speed.ravel(), phase.ravel(), np.asarray(half_width), np.asarray(reach), noise)
