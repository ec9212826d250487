"""From the paper's frame to ours.

The paper's frame is left-handed with z up (eqs 4 and 6): x forward, y to the right. Ours is right-handed: x forward, y
to the left. So y and yaw change sign. Pitch does not: in both, positive is muzzle up (eq 6's z row; in Table I a
positive α lands farther). A linear axis whose command and angle both change sign stays the same, so the printed plants
need no conversion.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def angles_from_paper(alpha_deg: ArrayLike, beta_deg: ArrayLike) -> NDArray[np.float64]:
    """Convert the paper's angles to pitch and yaw.

    Args:
      alpha_deg: pitch angle α as printed [degrees], shape B.
      beta_deg: yaw angle β as printed [degrees], shape B.

    Returns:
      Pitch (up positive) and yaw (left positive) [rad], shape B + (2,).
    """
    return np.stack([np.deg2rad(alpha_deg), -np.deg2rad(beta_deg)], axis=-1)


def position_from_paper(position: ArrayLike) -> NDArray[np.float64]:
    """Convert a position [m] in the paper's frame to ours, shape B + (3,)."""
    forward, right, up = np.moveaxis(np.asarray(position, dtype=np.float64), -1, 0)
    return np.stack([forward, -right, up], axis=-1)
