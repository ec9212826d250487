"""Which poles of an identified axis the recordings determine, and why they don't determine the others."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.modal_form import Poles, Sections
from archerfish.identification.axis.uncertainty import Posterior, heard_sections, pole_deviations, pole_slopes
from archerfish.identification.validation.frequency import natural_frequency_hz

Array = NDArray[np.float64]

_BEYOND = 1.5
"""Factor by which a pole may lie outside the excited band: what it does reaches into the band."""
_LOOSE = 1 / 3
"""Standard deviation over the natural frequency, from which the frequency is within three of them from nothing."""


class PoleTrust(NamedTuple):
    """Poles in the z plane, slowest first, and what is known of them."""

    poles: Poles
    """Shape (n,)."""
    real_sd: Array
    """Standard deviation of their real parts, shape (n,)."""
    imaginary_sd: Array
    """Standard deviation of their imaginary parts, shape (n,)."""
    reasons: tuple[str, ...]
    """Why the recordings don't determine each pole; empty where they do."""
    held: Array
    """Directions of the free numbers, in their order, along which a pole that is not determined moves; shape (k, n)."""

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Whether the recordings determine each pole, shape (n,)."""
        return np.array([not reason for reason in self.reasons])


def trusted_poles(
    known: Posterior, sections: Sections, band_hz: tuple[float, float], sample_period_s: float
) -> PoleTrust:
    """Judge every pole.

    Args:
      known: parameters with their covariance.
      sections: the poles, in the order of the parameters.
      band_hz: lowest and highest frequency that the inputs excite [Hz].
      sample_period_s: sampling period [s].
    """
    poles, real_sd, imaginary_sd = pole_deviations(known)
    heard = [flag for flag, section in zip(heard_sections(known, sections), sections, strict=True) for _ in section]
    reasons = []
    for pole, sd, adds in zip(poles, np.hypot(real_sd, imaginary_sd), heard, strict=True):
        frequency = natural_frequency_hz(pole, sample_period_s)
        spread = float(sd / max(abs(pole), np.finfo(float).tiny) / (2 * np.pi * sample_period_s))
        reasons.append(_reason(frequency, spread, adds, band_hz))
    held = pole_slopes(known)[[bool(reason) for reason in reasons]].reshape(-1, poles.size)
    order = np.lexsort((-poles.imag, -np.abs(poles).round(12)))
    return PoleTrust(poles[order], real_sd[order], imaginary_sd[order], tuple(reasons[i] for i in order), held)


def _reason(frequency: float, spread: float, adds: bool, band_hz: tuple[float, float]) -> str:
    low, high = band_hz
    if frequency > _BEYOND * high:
        return f"lies above the excited {low:.3g}–{high:.3g} Hz"
    if frequency < low / _BEYOND:
        return f"lies below the excited {low:.3g}–{high:.3g} Hz"
    if not adds:
        return "adds less to the output than three standard deviations of that"
    if spread > _LOOSE * frequency:
        return f"has a frequency that is uncertain by {spread:.3g} Hz (one standard deviation)"
    return ""


def pole_remarks(trust: PoleTrust, sample_period_s: float) -> list[str]:
    """Say of every pole that is not determined why not, a sentence for each pair."""
    remarks = []
    for pole, reason in zip(trust.poles, trust.reasons, strict=True):
        if reason and pole.imag >= 0:
            place = f"{pole.real:.3f} ± {pole.imag:.3f}i" if pole.imag else f"{pole.real:.3f}"
            frequency = natural_frequency_hz(pole, sample_period_s)
            remarks.append(
                f"The pole at z = {place} ({frequency:.3g} Hz) {reason}: these recordings say little about it."
            )
    return remarks
