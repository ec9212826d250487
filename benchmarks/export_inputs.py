"""What an exported policy is held against its source with: frames of lively engagements, and those at the edges."""

import numpy as np
from numpy.typing import NDArray

from archerfish.sensing.interfaces import Seen

PERIOD_S = 0.02
SHOWN = 0.7
"""Share of the decisions that have a new frame."""
NOISE_M = {"tracked": 0.005, "multimodel": 0.005, "history": 0.0, "paper": 0.0}
"""Kind of observation → noise of a sight; the last two are made for exact sight."""
EDGE_PLATES = (
    (-3.0, 0.0, 0.2),  # behind: yaw is π
    (-3.0, -0.0, 0.2),  # and −π
    (-2.0, 1e-7, 0.0),
    (-2.0, -1e-7, 0.0),
    (0.0, 3.0, 0.1),
    (0.0, -3.0, 0.1),
    (-0.0, 2.0, 0.0),
    (1.0, 1.0, 0.0),
    (-1.0, -1.0, 0.0),
    (0.0, 0.0, 0.0),  # at the pivot, where there is no direction
    (0.0, 0.0, 2.0),  # overhead
    (0.3, 0.0, 3.0),
    (8.0, 0.0, -1.0),
)
"""Where a target may be seen at the worst [m]."""
EDGE_ANGLES = (-np.pi, np.pi, -np.pi / 2, np.pi / 2, np.deg2rad(-25.0), np.deg2rad(10.0), np.deg2rad(75.0), 0.0)
"""Angles and commands at the ends of their ranges [rad]."""
EDGE_AGES = (0.0, 1e-6, 0.5, 60.0, 1e9)
"""Ages of the feedback [s]."""


def lively_frames(decisions: int, batch: int, seed: int, noise_m: float) -> Seen:
    """Draw sequences of frames as on a robot: moving targets, a gimbal that follows, sights that are late or missing.

    Args:
      decisions: of each sequence, T.
      batch: sequences, B.
      seed: of all that is random.
      noise_m: standard deviation of a sight [m].

    Returns:
      Arrays of shape (T, B) first, float32.
    """
    rng = np.random.default_rng(seed)
    shape = (decisions, batch)
    reach, bearing = rng.uniform(1.0, 5.0, batch), rng.uniform(-1.0, 1.0, batch)
    start = np.stack([reach * np.cos(bearing), reach * np.sin(bearing), rng.uniform(-0.2, 0.3, batch)], axis=-1)
    velocity = rng.normal(0.0, [0.4, 0.4, 0.0], (batch, 3))
    elapsed = rng.choice([0.8, 1.0, 1.2], shape) * PERIOD_S
    elapsed[0] = 0.0
    fresh = rng.random(shape) < SHOWN
    age = _ages(elapsed, fresh, rng)
    now = np.cumsum(elapsed, axis=0)
    plate = start + velocity * (now - age)[..., None] + rng.normal(0.0, noise_m, (*shape, 3))
    plate = _held(plate, fresh)
    aim = np.stack([np.arctan2(plate[..., 2], reach), np.arctan2(plate[..., 1], plate[..., 0])], axis=-1)
    lag = rng.normal(0.0, 0.1, (batch, 2)) * np.exp(-now / 0.1)[..., None]
    angle = aim + lag + rng.normal(0.0, 0.002, (*shape, 2))
    command = aim + 0.5 * lag + rng.normal(0.0, 0.002, (*shape, 2))
    return _seen(elapsed, angle, rng.uniform(0.0, 0.01, shape), command, plate, age, fresh)


def edge_frames(batch: int, seed: int, signed_zeros: bool) -> Seen:
    """Draw first frames in which every number is at an edge or anywhere, in all combinations.

    Args:
      batch: frames, B.
      seed: of all that is random.
      signed_zeros: whether a zero may have a minus. ONNX Runtime loses it on the way through the state of a tracker:
        straight behind, it turns left where the others turn right.

    Returns:
      Arrays of shape (B,) first, float32.
    """
    rng = np.random.default_rng(seed)
    anywhere = rng.uniform(-5.0, 5.0, (batch, 3))
    plate = np.where(rng.random((batch, 1)) < 0.5, rng.choice(np.array(EDGE_PLATES), batch), anywhere)
    plate = plate if signed_zeros else plate + 0.0
    angle, command = rng.choice(np.array(EDGE_ANGLES), (2, batch, 2))
    gimbal_age, age = rng.choice(np.array(EDGE_AGES), (2, batch))
    return _seen(np.zeros(batch), angle, gimbal_age, command, plate, age, rng.random(batch) < SHOWN)


def _ages(elapsed: NDArray[np.float64], fresh: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw ages of the sights: each grows until a new one comes, whose exposure is later."""
    ages = [rng.uniform(0.01, 0.08, elapsed.shape[1])]
    for passed, new in zip(elapsed[1:], fresh[1:], strict=True):
        grown = ages[-1] + passed
        ages.append(np.where(new, rng.uniform(0.0, 1.0, grown.shape) * np.minimum(grown, 0.08), grown))
    return np.stack(ages)


def _held(plate: NDArray[np.float64], fresh: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Leave each plate where it was seen until a new sight."""
    held = [plate[0]]
    for place, new in zip(plate[1:], fresh[1:], strict=True):
        held.append(np.where(new[:, None], place, held[-1]))
    return np.stack(held)


def _seen(
    elapsed: NDArray[np.float64],
    angle: NDArray[np.float64],
    gimbal_age: NDArray[np.float64],
    command: NDArray[np.float64],
    plate: NDArray[np.float64],
    age: NDArray[np.float64],
    fresh: NDArray[np.bool_],
) -> Seen:
    shape, single = elapsed.shape, np.float32
    return Seen(
        elapsed=elapsed.astype(single),
        angle=angle.astype(single),
        rate=np.zeros((*shape, 2), single),
        gimbal_age=gimbal_age.astype(single),
        command=command.astype(single),
        plate=plate.astype(single)[..., None, :],
        normal_yaw=np.zeros((*shape, 1), single),
        plate_age=age.astype(single)[..., None],
        fresh=fresh[..., None],
        base=np.zeros((*shape, 4), single),
        muzzle_speed=np.full(shape, 18.0, single),
        heat_left=np.full(shape, 1e6, single),
    )
