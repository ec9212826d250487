"""Does an axis integrate? A rate for a command and an angle for an output have a pole at z = 1.

The fit keeps every pole inside the unit circle, so that such an axis comes out with a very slow one, and with a steady
gain that means nothing.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.modal_form import Sections, section_offsets, section_poles, sections_from_numbers
from archerfish.identification.axis.trust import PoleTrust
from archerfish.identification.axis.uncertainty import Posterior, transfer

Array = NDArray[np.float64]

_NOT_TOLD = 4.0
"""Deviations within which a pole is not told from one at 1."""
_UNSEEN = 0.1
"""Share of its time constant that the longest recording lasts, up to which a pole is as good as at 1."""
_LOOSE = 0.25
"""Half width of the steady gain's interval over the gain, from which there may as well be none."""
_SHARE = 0.5
"""Of the response at the lowest excited frequency, from which the axis is said to integrate."""


def integration_remarks(
    known: Posterior,
    trust: PoleTrust,
    gains: tuple[Array, Array],
    lowest: float,
    samples: int,
    input_names: Sequence[str],
) -> list[str]:
    """Say from which inputs the axis integrates, as far as the recordings tell.

    Args:
      known: the parameters.
      trust: its poles with their deviations.
      gains: ends of the steady gain's 95 % interval, shape (p, m) each; one that is known is that of no integrator.
      lowest: lowest excited frequency [radians a sample].
      samples: length of the longest recording.
      input_names: of the m inputs.
    """
    real = trust.poles.imag == 0
    slowness = np.where(real, 1 - trust.poles.real, np.inf)
    slowest = int(np.argmin(slowness))
    unseen = slowness[slowest] <= _UNSEEN / samples
    if not unseen and slowness[slowest] > _NOT_TOLD * float(trust.real_sd[slowest]):
        return []
    share = _share(known, float(trust.poles[slowest].real), lowest)
    return [
        f"From {name} the axis integrates, as far as these recordings tell: a steady {name} lets the output run on "
        f"(pole at z = {trust.poles[slowest].real:.6f}). The steady gain means nothing; name the rate of the output as "
        "the output, or a command that the output comes to rest at as the input."
        for name, part, low, high in zip(input_names, share, gains[0][0], gains[1][0], strict=True)
        if part > _SHARE and (unseen or high - low > _LOOSE * abs(high + low))
    ]


def _share(known: Posterior, pole: float, frequency: float) -> Array:
    """Return the share of a real pole in the response of the first output to each input, shape (m,)."""
    lag = np.exp(-1j * np.array([frequency]))
    whole = np.abs(transfer(known, lag)[0, 0])
    residue = _residue(sections_from_numbers(known.free), known, pole)
    return np.asarray(np.abs(residue / (1 / lag - pole)) / np.maximum(whole, np.finfo(float).tiny))


def _residue(sections: Sections, known: Posterior, pole: float) -> Array:
    """Return the residue of the first output's response to each input at a pole, shape (m,)."""
    numerators = known.linear[: known.order * known.inputs, 0].reshape(known.order, known.inputs)
    nearest = min(sections, key=lambda section: float(np.abs(section_poles((section,)) - pole).min()))
    start = next(begin for begin, section in section_offsets(sections) if section is nearest)
    if nearest.size == 1:
        return np.asarray(numerators[start])
    first, second = section_poles((nearest,)).real
    other = second if abs(first - pole) < abs(second - pole) else first
    # A double pole integrates twice.
    apart = np.copysign(max(abs(pole - other), np.finfo(float).eps), pole - other)
    return np.asarray((numerators[start] * pole + numerators[start + 1]) / apart)
