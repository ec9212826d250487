"""Lack of fit of an alignment: whether what it leaves still moves with the gimbal.

Noise of a detector knows nothing of the gimbal. A lens that distorts bends the bearing with the angle, a time offset
that drifts or an angle that lags moves it with the rate and its change.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from archerfish.identification.sensing.gimbal_track import GimbalTrack
from archerfish.identification.sensing.plate_alignment import PlateAlignment

Array = NDArray[np.float64]

_SIGNIFICANT = 0.01
_LEFT_SHARE = 0.02
"""Share of the residual's power below which a misfit does no harm, shown or not."""


class MotionMisfit(NamedTuple):
    """What the gimbal's motion explains of the bearing's residual."""

    share: float
    """Share of its power, less what chance would explain, 0…1."""
    p_value: float
    """Chance of as much if the alignment were right (F test)."""

    @property
    def shown(self) -> bool:
        """Whether the alignment misses something that matters."""
        return self.p_value < _SIGNIFICANT and self.share > _LEFT_SHARE


def motion_misfit(track: GimbalTrack, alignment: PlateAlignment) -> MotionMisfit:
    """Regress the residual of the bearing on angle (to the third power), rate, its size, and acceleration.

    Args:
      track: the gimbal.
      alignment: of the plate's detections.
    """
    moments, residual = alignment.moments[alignment.inlier], alignment.residual[alignment.inlier, 0]
    angle, rate, change = (track.angles(moments, order)[:, 0] for order in range(3))
    angle = angle - angle.mean()
    columns = np.column_stack([angle, angle**2, angle**3, rate, np.abs(rate), change])
    columns = columns - columns.mean(axis=0)
    # What the alignment fits with straight lines has been spent; the columns need only be independent of each other.
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    target = residual - residual.mean()
    explained, total = float(np.sum((basis.T @ target) ** 2)), max(float(target @ target), 1e-300)
    wanted, spare = basis.shape[1], target.size - basis.shape[1] - 1
    ratio = (explained / wanted) / max((total - explained) / spare, 1e-300)
    share = 1 - (1 - explained / total) * (target.size - 1) / spare
    return MotionMisfit(max(share, 0.0), float(fisher.sf(ratio, wanted, spare)))
