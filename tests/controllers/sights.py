"""What a predictor sees of a target, made by hand."""

from typing import Any

import numpy as np

from archerfish.sensing.interfaces import Seen

DT, AGE = 0.02, 0.04
"""Decision period and usual age of a sight [s]."""


def sight(plate: np.ndarray, elapsed: float = DT, age: float = AGE, fresh: bool = True) -> Seen:
    """Return a sight of a plate, shape B + (3,), by a gimbal at rest."""
    zero, pair = 0.0 * plate[..., 0], 0.0 * plate[..., :2]
    return Seen(
        elapsed=zero + elapsed,
        angle=pair,
        rate=pair,
        gimbal_age=zero,
        command=pair,
        plate=plate[..., None, :],
        normal_yaw=zero[..., None],
        plate_age=zero[..., None] + age,
        fresh=(zero[..., None] == 0.0) & fresh,
        base=0.0 * plate[..., np.array([0, 1, 0, 1])],
        muzzle_speed=zero,
        heat_left=zero,
    )


def follow(predictor: Any, plates: np.ndarray, age: float = AGE) -> Any:
    """Return the state after sights, shape (T,) + B + (3,), of one age; the first is seen twice, as by a controller."""
    state = predictor.step(predictor.reset(sight(plates[0], age=age)), sight(plates[0], elapsed=0.0, age=age))
    for plate in plates[1:]:
        state = predictor.step(state, sight(plate, age=age))
    return state
