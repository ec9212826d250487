"""What a controller sees of one target, for tests."""

import numpy as np

from archerfish.sensing.interfaces import Seen


def seen_at(plate, angle=(0.0, 0.0), command=(0.0, 0.0), elapsed=0.02, age=0.04, fresh=True) -> Seen:
    plate, angle, command = (np.asarray(each, float) for each in (plate, angle, command))
    zero = np.zeros(plate.shape[:-1])
    return Seen(
        elapsed=zero + elapsed,
        angle=angle,
        rate=0.0 * angle,
        gimbal_age=zero + 0.003,
        command=command,
        plate=plate[..., None, :],
        normal_yaw=zero[..., None],
        plate_age=zero[..., None] + age,
        fresh=np.broadcast_to(np.asarray(fresh), (*zero.shape, 1)),
        base=np.zeros((*zero.shape, 4)),
        muzzle_speed=zero + 18.0,
        heat_left=zero + 1e6,
    )
