"""A tracker of interacting multiple models (Blom and Bar-Shalom 1988): a target that stands, drives on, or turns back.

Three Kalman filters run side by side. The first takes the target to stand still, the second to drive on at constant
velocity, the third to have turned back: its velocity is the reverse of what the second estimates. Between two
detections a target may change from one to another, at rates per second, so frame rate and age don't matter. Each model
begins a step with the mixture of all three that leads to it, and detections weight them by their likelihood.
"""

from collections.abc import Callable
from typing import NamedTuple

from archerfish.arrays import Array, lift, map_arrays, namespace
from archerfish.tracking import kalman_filter
from archerfish.tracking.kalman_filter import Track, TrackerNoise, covariance_blocks, predict

STILL, ONWARD, TURNED = range(3)
"""Models, by index."""
STILL_SHARE = 0.5
"""Probability that a target stands still at first, where nothing else is known."""
KEPT = ((1.0, 0.0, 0.0), (0.0, 1.0, -1.0), (0.0, -1.0, 1.0))
"""Share of the velocity that is left when a target changes from one model (rows) to another (columns)."""
STARTS = ((0.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""Where it gets a velocity that is unknown."""


class ModelRates(NamedTuple):
    """How often a target changes its mode, and how it begins; shape () each."""

    turn: Array  # turns back, of a target that moves [1/s]
    stop: Array = 0.1  # stops of a moving target and starts of one that stands [1/s]
    still: Array = STILL_SHARE  # probability that a target stands at first, 0…1


class ModelTracks(NamedTuple):
    """Estimates under the three models."""

    track: Track  # of each model, B + (3, ...)
    probability: Array  # of each model, B + (3,)


def begin_models(noise: TrackerNoise, rates: ModelRates, plate: Array, shown: Array | None = None) -> ModelTracks:
    """Begin at the first detection: the target stands or drives, and has not turned yet.

    Args:
      noise: what the filters assume.
      rates: how it begins.
      plate: first measurement [m], shape B + (3,).
      shown: whether a frame shows it, shape B; all if not given.
    """
    xp = namespace(plate)
    driving = kalman_filter.begin_track(noise, plate, shown)
    still_track = kalman_filter.begin_track(noise._replace(initial_speed=0.0 * noise.initial_speed), plate, shown)
    track = map_arrays(lambda *models: xp.stack(models, axis=plate.ndim - 1), still_track, driving, driving)
    still = rates.still + 0.0 * plate[..., 0]
    return ModelTracks(track, xp.stack([still, 1.0 - still, 0.0 * still], axis=-1))


def step_models(
    noise: TrackerNoise,
    rates: ModelRates,
    tracks: ModelTracks,
    elapsed: Array,
    plate: Array,
    fresh: Array,
    *,
    likelihood: Callable[[TrackerNoise, Track, Array], Array] = kalman_filter.log_likelihood,
) -> ModelTracks:
    """Predict the estimates to a detection and update them.

    Args:
      noise: what the filters assume; a standing target has no acceleration.
      rates: of changes between the models.
      tracks: before.
      elapsed: since then [s], shape B.
      plate: position seen [m], shape B + (3,).
      fresh: whether it is new, shape B; if not, the estimates are only carried on.
      likelihood: log density of a detection given a model's estimate; by default of x and y.
    """
    xp = namespace(tracks.probability, plate)
    mixed = mix_models(noise, rates, tracks, elapsed)
    moving = xp.asarray([0.0, 1.0, 1.0], dtype=plate.dtype)
    driven = noise._replace(acceleration=lift(noise.acceleration * moving, mixed.probability)[..., None, None])
    carried = predict(driven, mixed.track, elapsed[..., None])
    place = plate[..., None, :]
    # Logarithms, for after an outlier all likelihoods may be too small for float32.
    evidence = xp.log(xp.maximum(mixed.probability, 1e-30)) + likelihood(noise, carried, place)
    weight = xp.exp(evidence - xp.max(evidence, axis=-1, keepdims=True))
    probability = xp.where(fresh[..., None], weight / xp.sum(weight, axis=-1, keepdims=True), mixed.probability)
    return ModelTracks(kalman_filter.update(noise, carried, place, fresh[..., None]), probability)


def transition_probabilities(rates: ModelRates, elapsed: Array) -> Array:
    """Return the probability of each model (last axis) after a time under each before it, shape B → B + (3, 3).

    Turns are a Poisson process: an odd number of them reverses the velocity. Stops and starts are rare: at most one
    counts.
    """
    xp = namespace(elapsed)
    # Without a new detection it is zero but for rounding, and a probability is never negative.
    elapsed = xp.maximum(elapsed, 0.0)
    turned = 0.5 * (1.0 - xp.exp(-2.0 * rates.turn * elapsed))
    stopped = 1.0 - xp.exp(-rates.stop * elapsed)
    going = 1.0 - stopped
    rows = (
        (going, stopped, 0.0 * going),
        (stopped, going * (1.0 - turned), going * turned),
        (stopped, going * turned, going * (1.0 - turned)),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def mix_models(noise: TrackerNoise, rates: ModelRates, tracks: ModelTracks, elapsed: Array) -> ModelTracks:
    """Let each model begin a step with the mixture of all that lead to it, mean and covariance matched.

    A change happens half way through the step on average, so the velocity before it lasts for half of the step.

    Args:
      noise: its initial speed is that of a target that starts.
      rates: of changes between the models.
      tracks: before.
      elapsed: length of the step [s], shape B.
    """
    xp = namespace(tracks.probability, elapsed)
    joint = tracks.probability[..., :, None] * transition_probabilities(rates, elapsed)
    probability = xp.sum(joint, axis=-2)
    # Bayes' rule; a model that nothing leads to keeps its own estimate.
    reached = probability[..., None, :] > 1e-9
    share = joint / xp.where(reached, probability[..., None, :], 1.0)
    share = xp.where(reached, share, lift(xp.eye(3, dtype=joint.dtype), joint))
    mean, covariance = _changed(noise, tracks.track, elapsed)
    mixed = xp.sum(share[..., None] * mean, axis=-3)
    off = mean - mixed[..., None, :, :]
    spread = covariance + off[..., :, None] * off[..., None, :]
    covariance = xp.sum(share[..., None, None] * spread, axis=-4)
    return ModelTracks(tracks.track._replace(mean=mixed, covariance=covariance), probability)


def _changed(noise: TrackerNoise, track: Track, elapsed: Array) -> tuple[Array, Array]:
    """Return each model's estimate as the beginning of every other: mean B + (3, 3, 4), covariance B + (3, 3, 4, 4)."""
    xp = namespace(track.mean, elapsed)
    kept = xp.asarray(KEPT, dtype=track.mean.dtype)
    factor = lift(kept, track.mean)[..., None]
    before = 0.5 * elapsed[..., None, None, None] * (1.0 - factor)
    place, velocity = track.mean[..., :, None, :2], track.mean[..., :, None, 2:]
    mean = xp.concat([place + before * velocity, factor * velocity], axis=-1)
    p = track.covariance[..., :, None, :, :]
    factor, before = factor[..., None], before[..., None]
    corner = p[..., :2, 2:] + before * p[..., 2:, 2:]
    upper = p[..., :2, :2] + before * (corner + xp.matrix_transpose(p[..., :2, 2:]))
    start = lift(xp.asarray(STARTS, dtype=upper.dtype)[..., None, None], upper) * noise.initial_speed**2
    speed = factor**2 * p[..., 2:, 2:] + start * lift(xp.eye(2, dtype=upper.dtype), upper)
    return mean, covariance_blocks(upper, factor * corner, speed)


def moved_models(models: ModelTracks, by: Array) -> ModelTracks:
    """Return the same estimates against another origin; `by` is added to places [m], shape B + (3,)."""
    return models._replace(track=kalman_filter.moved(models.track, by[..., None, :]))
