"""A section's recursion, 1 / (1 + a₁ z⁻¹ + …), as the forward substitution of a banded triangular system.

The same as `scipy.signal.lfilter`, whose package takes longer to import than an identification takes.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

Array = NDArray[np.float64]


def recursion(section: Array, signals: Array) -> Array:
    """Filter signals by 1 / (1 + a₁ z⁻¹ + …) from the zero state.

    Args:
      section: a₁, …, shape (n,).
      signals: shape (N,) or (N, k).

    Returns:
      Same shape as the signals.
    """
    if not len(signals):
        return signals
    bands = np.empty((1 + min(section.size, len(signals) - 1), len(signals)), order="F")
    bands[0] = 1.0
    bands[1:] = section[: len(bands) - 1, None]
    columns = signals.reshape(len(signals), -1)
    return np.asarray(dtbtrs(bands, columns, uplo="L", diag="U")[0]).reshape(signals.shape)
