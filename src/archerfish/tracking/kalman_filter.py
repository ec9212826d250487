"""A Kalman filter for a target of nearly constant velocity on level ground: the tracker of classical auto-aim.

State per target: x, y and their speeds; the height hardly changes on level ground and is a filter of its own, which
lets it drift a little. White acceleration of standard deviation q drives x and y. The camera measures along the line of
sight less well than across it, so the measurement noise is rotated into the line of sight; with noise fixed to the
axes, range errors leak into the bearing.
"""

from typing import NamedTuple

from archerfish.arrays import Array, lift, namespace
from archerfish.protocols import Base
from archerfish.records.sensing import SensingRecord

INITIAL_SPEED = 1.0
"""Default standard deviation of the speed at the first detection [m/s]."""
_LEAST_M = 1e-3
"""Of a measurement by an identified camera, however near the target is [m]."""


class TrackerNoise(NamedTuple):
    """What the filter assumes of target and camera; shape () each."""

    acceleration: Array  # standard deviation q of the target's acceleration [m/s²]
    along: Array  # standard deviation of the measurement along the line of sight [m]
    across: Array  # standard deviation across it [m]
    along_share: Array = 0.0  # what is added to `along` in proportion to the distance (their squares add)
    across_angle: Array = 0.0  # what is added to `across` as an azimuth [rad] (the squares add)
    initial_speed: Array = INITIAL_SPEED  # standard deviation of the speed at first, in x and y each [m/s]
    height_angle: Array = 0.0  # what is added to `across` of the height as an elevation [rad] (the squares add)


def noise_from_record(record: SensingRecord | None, acceleration: float, exact_sd: float) -> TrackerNoise:
    """Return what a filter assumes of a camera.

    Args:
      record: camera and link; None of a camera without noise.
      acceleration: standard deviation of the target's acceleration [m/s²].
      exact_sd: of a measurement by a camera without noise [m].
    """
    if record is None:
        return TrackerNoise(acceleration, exact_sd, exact_sd)
    camera = record.camera
    return TrackerNoise(
        acceleration=acceleration,
        along=_LEAST_M,
        across=_LEAST_M,
        along_share=camera.range_sd / camera.noise_range,
        across_angle=camera.bearing_sd,
        height_angle=camera.elevation_sd,
    )


class Track(NamedTuple):
    """Estimate of a target."""

    mean: Array  # x, y [m], ẋ, ẏ [m/s], B + (4,)
    covariance: Array  # shape B + (4, 4)
    height: Array  # z [m], B
    height_variance: Array  # its variance [m²], B


UNSEEN_SD = 3.0
"""Standard deviation of a place that no frame has shown yet [m]; the distance to the first detection is no speed."""
HEIGHT_DRIFT = 0.02
"""Standard deviation of the change of the height in a second [m]."""


def begin_track(noise: TrackerNoise, plate: Array, shown: Array | None = None) -> Track:
    """Begin a track, with a mean velocity of zero.

    Args:
      noise: what the filter assumes.
      plate: first measurement [m], shape B + (3,).
      shown: whether a frame shows it, shape B; a place that none has shown yet is a guess. All are shown if not given.
    """
    xp = namespace(plate)
    position, height = measurement_covariance(noise, plate), height_noise(noise, plate)
    if shown is not None:
        guess = UNSEEN_SD**2 * lift(xp.eye(2, dtype=plate.dtype), position) + 0.0 * position
        position = xp.where(shown[..., None, None], position, guess)
        height = xp.where(shown, height, UNSEEN_SD**2 + 0.0 * height)
    speed = noise.initial_speed**2 * lift(xp.eye(2, dtype=plate.dtype), position) + 0.0 * position
    covariance = covariance_blocks(position, 0.0 * position, speed)
    mean = xp.concat([plate[..., :2], 0.0 * plate[..., :2]], axis=-1)
    return Track(mean, covariance, plate[..., 2], height)


def predict(noise: TrackerNoise, track: Track, elapsed: Array) -> Track:
    """Predict a track `elapsed` later [s], shape B."""
    xp = namespace(track.mean, elapsed)
    elapsed = xp.asarray(elapsed)[..., None]
    mean = xp.concat([track.mean[..., :2] + elapsed * track.mean[..., 2:], track.mean[..., 2:]], axis=-1)
    step = elapsed[..., None]
    p = track.covariance
    corner = p[..., :2, 2:] + step * p[..., 2:, 2:]
    upper = p[..., :2, :2] + step * (corner + xp.matrix_transpose(p[..., :2, 2:]))
    q = noise.acceleration**2 * lift(xp.eye(2, dtype=p.dtype), upper)
    corner = corner + q * step**3 / 2.0
    covariance = covariance_blocks(upper + q * step**4 / 4.0, corner, p[..., 2:, 2:] + q * step**2)
    return Track(mean, covariance, track.height, track.height_variance + HEIGHT_DRIFT**2 * elapsed[..., 0])


def update(noise: TrackerNoise, track: Track, plate: Array, fresh: Array) -> Track:
    """Update a track with a measurement.

    Args:
      noise: what the filter assumes.
      track: predicted to the time of the measurement.
      plate: position [m], shape B + (3,).
      fresh: whether it is new, shape B; if not, the track stays.
    """
    xp = namespace(track.mean, plate)
    p = track.covariance
    measured = measurement_covariance(noise, plate)
    spread = p[..., :2, :2] + measured
    gain = matrix_product(p[..., :, :2], inverse_and_determinant(spread)[0])
    innovation = plate[..., :2] - track.mean[..., :2]
    mean = track.mean + xp.sum(gain * innovation[..., None, :], axis=-1)
    # P − K (P + R) Kᵀ is K R in the columns of the place: no difference of large numbers there, which in float32 would
    # leave nothing of a small variance after a long silence.
    known = matrix_product(gain, measured)
    speed = p[..., 2:, 2:] - matrix_product(gain[..., 2:, :], p[..., :2, 2:])
    place, corner = symmetric(known[..., :2, :]), xp.matrix_transpose(known[..., 2:, :])
    covariance = covariance_blocks(place, corner, symmetric(speed))
    measured_height = height_noise(noise, plate)
    sum_of_both = track.height_variance + measured_height
    share = xp.where(fresh, track.height_variance / sum_of_both, 0.0 * sum_of_both)
    seen = fresh[..., None]
    return Track(
        xp.where(seen, mean, track.mean),
        xp.where(seen[..., None], covariance, p),
        track.height + share * (plate[..., 2] - track.height),
        # (1 − share) of the variance, again without the difference.
        xp.where(fresh, track.height_variance * measured_height / sum_of_both, track.height_variance),
    )


def log_likelihood(noise: TrackerNoise, track: Track, plate: Array) -> Array:
    """Return the log density of a measurement under a track that was predicted to its time, less a constant.

    Args:
      noise: what the filter assumes.
      track: predicted to the time of the measurement.
      plate: position [m], shape B + (3,); x and y count.

    Returns:
      Shape B.
    """
    xp = namespace(track.mean, plate)
    spread = track.covariance[..., :2, :2] + measurement_covariance(noise, plate)
    inverse, determinant = inverse_and_determinant(spread)
    innovation = plate[..., :2] - track.mean[..., :2]
    square = xp.sum(innovation * xp.sum(inverse * innovation[..., None, :], axis=-1), axis=-1)
    return -0.5 * (square + xp.log(determinant))


def log_likelihood_across(noise: TrackerNoise, track: Track, plate: Array) -> Array:
    """Return the log density of a measurement's place across the line of sight alone, less a constant, shape B."""
    innovation, variance = innovation_by_axis(noise, track, plate)
    return -0.5 * (innovation[..., 0] ** 2 / variance[..., 0] + namespace(variance).log(variance[..., 0]))


def innovation_by_axis(noise: TrackerNoise, track: Track, plate: Array) -> tuple[Array, Array]:
    """Return the innovation of a measurement across and along the line of sight [m], and its variance [m²].

    Args:
      noise: what the filter assumes.
      track: predicted to the time of the measurement.
      plate: position [m], shape B + (3,); x and y count.

    Returns:
      Shape B + (2,) each.
    """
    xp = namespace(track.mean, plate)
    spread = track.covariance[..., :2, :2] + measurement_covariance(noise, plate)
    outward = _outward(plate)[0]
    left = xp.stack([-outward[..., 1], outward[..., 0]], axis=-1)
    axes = xp.stack([left, outward], axis=-2)
    innovation = xp.sum(axes * (plate[..., :2] - track.mean[..., :2])[..., None, :], axis=-1)
    return innovation, xp.sum(axes * matrix_product(axes, spread), axis=-1)


def inverse_and_determinant(spread: Array) -> tuple[Array, Array]:
    """Return inverse and determinant of 2×2 matrices, shape B + (2, 2) and B."""
    xp = namespace(spread)
    a, b, c = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    determinant = a * c - b * b
    inverse = xp.stack([xp.stack([c, -b], axis=-1), xp.stack([-b, a], axis=-1)], axis=-2)
    return inverse / determinant[..., None, None], determinant


def height_noise(noise: TrackerNoise, plate: Array) -> Array:
    """Return the variance of a measured height [m²], shape B."""
    level = namespace(plate).sum(plate[..., :2] ** 2, axis=-1)
    return noise.across**2 + noise.height_angle**2 * level


def measurement_covariance(noise: TrackerNoise, plate: Array) -> Array:
    """Return the covariance of x and y with the noise along and across the line of sight [m²], shape B + (2, 2)."""
    xp = namespace(plate)
    outward, distance = _outward(plate)
    along = outward[..., :, None] * outward[..., None, :]
    across = lift(xp.eye(2, dtype=plate.dtype), along) - along
    square = distance[..., None] ** 2
    along_variance = noise.along**2 + noise.along_share**2 * square
    return along_variance * along + (noise.across**2 + noise.across_angle**2 * square) * across


def _outward(plate: Array) -> tuple[Array, Array]:
    """Return the level unit vector towards a measurement and its distance [m], shape B + (2,) and B + (1,)."""
    xp, level = namespace(plate), plate[..., :2]
    distance = xp.sqrt(xp.sum(level**2, axis=-1, keepdims=True))
    above = distance < 1e-6  # straight above the pivot every direction is as good
    distance = xp.maximum(distance, 1e-6)
    return xp.where(above, lift(xp.asarray([1.0, 0.0], dtype=plate.dtype), level), level / distance), distance


def position_after(track: Track, time: Array, velocity_decay: Array = 1.0) -> Array:
    """Predict the position after a time, at a share of the estimated velocity.

    Args:
      track: estimate now.
      time: from now [s], shape B.
      velocity_decay: share of the velocity that the target is taken to keep on average, 0…1, shape (): less than 1
        where it may stop or turn back.

    Returns:
      Position [m], shape B + (3,).
    """
    xp = namespace(track.mean, time)
    level = track.mean[..., :2] + xp.asarray(time)[..., None] * (velocity_decay * track.mean[..., 2:])
    return xp.concat([level, track.height[..., None] + 0.0 * level[..., :1]], axis=-1)


def matrix_product(left: Array, right: Array) -> Array:
    """Return a matrix product as a sum, which fuses where a batched product of tiny matrices crawls.

    Args:
      left: shape B + (n, m).
      right: shape B + (m, k).
    """
    return namespace(left, right).sum(left[..., :, :, None] * right[..., None, :, :], axis=-2)


def symmetric(matrix: Array) -> Array:
    """Return a square matrix, shape B + (n, n), made symmetric to the last bit."""
    return 0.5 * (matrix + namespace(matrix).matrix_transpose(matrix))


def covariance_blocks(upper: Array, corner: Array, lower: Array) -> Array:
    """Return a symmetric matrix from its blocks, shape B + (2, 2) each → B + (4, 4)."""
    xp = namespace(upper)
    top = xp.concat([upper, corner], axis=-1)
    return xp.concat([top, xp.concat([xp.matrix_transpose(corner), lower], axis=-1)], axis=-2)


def moved(track: Track, by: Array) -> Track:
    """Return the same track against another origin.

    Args:
      track: estimate, shape B.
      by: what is added to places [m], shape B + (3,).
    """
    xp = namespace(track.mean, by)
    level = xp.concat([by[..., :2], 0.0 * by[..., :2]], axis=-1)
    return track._replace(mean=track.mean + level, height=track.height + by[..., 2])


def against_pivot(track: Track, base: Base, age: Array) -> Track:
    """Return a track against the own pivot, whose velocity the pellets have, too.

    Subtracted once and as a whole, since a compiler removes x − 0 but not 0 · x.

    Args:
      track: in O, as of a time ago, shape B.
      base: now.
      age: that time [s], shape B.
    """
    xp = namespace(track.mean)
    own = base.position - age[..., None] * base.velocity
    level = xp.concat([own[..., :2], base.velocity[..., :2]], axis=-1)
    return track._replace(mean=track.mean - level, height=track.height - own[..., 2])
