"""A prior for frequencies that the input never excited: no gain beyond the band, smooth continuation below it.

What a log does not show, a simulation fit is free to invent: a resonance at half the sampling rate, a drift of the
steady gain. The prior asks for two things of the transfer function of each input, in squares added to the error:

- at frequencies from the excited band on upwards, G = 0 within the gain in the band, the less firmly the more the input
  has there (its energy against the noise decides);
- from the lowest excited frequency f₁ down to zero, Re G(f) = Re G(f₁) and Im G(f) = f/f₁ Im G(f₁), the first terms of
  any smooth transfer function.

It weighs about as much as a few hundred samples of noise would, and where the data disagree it yields (see
`prior_strength`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from archerfish.identification.axis.informative_lines import mean_squared_gain
from archerfish.identification.axis.pole_refinement import Problem, Refinement
from archerfish.identification.axis.simulation_fit import Penalty
from archerfish.identification.axis.spectra import Spectrum

Array = NDArray[np.float64]

_WEIGHT = 1000.0
"""Squared gain relative to the band's, averaged over the bins, is weighed by this many noise variances."""
_PULL = 3.0
_BINS = 48
_POINTS_BELOW = 8
_HEARD = 30.0
"""Response over noise, in power, from which the low end of the band counts as known."""
_SILENT = 0.1
"""Response over the loudest, in power, up to which a line is not part of the band."""
_NEIGHBOURS = 5
"""Lines over which the energy of the input is averaged: that of random signals scatters by as much as it is."""
_BLUR = 0.5
"""Way off the unit circle at which the gain is looked at, in bins."""
_RESOLVED = 2.5
"""Below this many lines there is no band to continue into."""


def out_of_band_prior(problem: Problem, refinement: Refinement) -> Penalty:
    """Build the prior for an axis.

    Args:
      problem: all lines of its experiments.
      refinement: a fit without penalty to all or some of them, for the gain in the band and the noise.
    """
    experiments = problem.experiments
    outputs = experiments[0].outputs.shape[1]
    noise = 2 * refinement.fit.misfit / refinement.fit.residuals.size
    loudness = mean_squared_gain(problem, refinement) / max(noise, np.finfo(float).tiny)
    density = _density(experiments, _bin_edges())
    lowest = _lowest(experiments, loudness)
    bins = (np.arange(_BINS) + 0.5) / _BINS * np.pi
    below = np.append(np.linspace(0.0, lowest, _POINTS_BELOW, endpoint=False), lowest)
    lag = np.exp(-1j * np.append(bins, below))
    # A little inside the circle no resonance is narrow enough to slip through between two bins.
    lag[:_BINS] *= np.exp(-_BLUR * np.pi / _BINS)
    wishes = []
    for channel, gain in enumerate(loudness):
        if gain == 0.0:  # an input that is a copy of another one, which carries both
            wishes.append(np.zeros((0, 2 * lag.size)))
            continue
        # A gain as large as that in the band is _WEIGHT noise variances worth, averaged over the bins.
        unit = 0.5 * _WEIGHT / gain
        heard = density[:, channel] * gain
        firmness = 1 / (1 + heard)
        firmness[: np.flatnonzero(heard >= min(1.0, heard.max()))[0] + 1] = 0.0
        wishes.append(_rows(np.sqrt(unit / _BINS * firmness), np.sqrt(unit / _POINTS_BELOW), below))
    zeros = tuple(np.zeros((len(each), outputs)) for each in wishes)
    return Penalty(lag, tuple(wishes), zeros, 0.5 * _PULL * noise)


def after_delay(penalty: Penalty, samples: int) -> Penalty:
    """Return the prior for a plant whose transfer function is seen without a delay that it has.

    Off the unit circle the delay changes the gain: without this, the same plant would cost the more the more of its
    delay is explicit.
    """
    weights = np.tile(np.abs(penalty.lag) ** samples, 2)
    return penalty._replace(rows=tuple(each * weights for each in penalty.rows))


def scaled_penalty(penalty: Penalty, scale: float) -> Penalty:
    """Return the penalty with its squares weighed by `scale`²."""
    return Penalty(
        penalty.lag,
        tuple(scale * each for each in penalty.rows),
        tuple(scale * each for each in penalty.targets),
        scale**2 * penalty.pull,
    )


def _bin_edges() -> Array:
    return np.linspace(0.0, np.pi, _BINS + 1)


def _density(experiments: Sequence[Spectrum], edges: Array) -> Array:
    """Mean energy of a line of each input per bin, over all experiments, shape (bins, m)."""
    frequency = np.concatenate([np.abs(np.angle(each.lag)) for each in experiments])
    power = np.concatenate([np.abs(each.inputs) ** 2 for each in experiments])
    count = np.maximum(np.histogram(frequency, edges)[0], 1)
    return np.stack([np.histogram(frequency, edges, weights=each)[0] / count for each in power.T], axis=1)


def _lowest(experiments: Sequence[Spectrum], loudness: Array) -> float:
    """Return the frequency [radians a sample] above which every input is heard, zero if there is no gap below it."""
    lowest = []
    for channel, gain in enumerate(loudness):
        loud = [
            gain * uniform_filter1d(np.abs(each.inputs[:, channel]) ** 2, _NEIGHBOURS, mode="nearest")
            for each in experiments
        ]
        # A log that is noisy throughout has no silent end, however little it tells anywhere.
        threshold = min(_HEARD, _SILENT * max(float(each.max()) for each in loud))
        heard = [np.abs(np.angle(each.lag))[power >= threshold] for each, power in zip(experiments, loud, strict=True)]
        lowest.append(min(float(each.min()) for each in heard if each.size))
    finest = min(float(-np.angle(each.lag[0])) for each in experiments)
    return max(lowest) if max(lowest) > _RESOLVED * finest else 0.0


def _rows(above: Array, smooth: float, below: Array) -> Array:
    """Weights of real over imaginary parts at the bins and the points below, shape (R, 2 (bins + points))."""
    points = above.size + below.size
    wanted = np.flatnonzero(above > 0)
    gains = np.zeros((2 * wanted.size, 2 * points))
    for part in range(2):
        gains[part * wanted.size + np.arange(wanted.size), part * points + wanted] = above[wanted]
    if below[-1] == 0.0:
        return gains
    count = below.size - 1
    bends = np.zeros((2 * count, 2 * points))
    place = np.arange(count)
    for part, edge in ((0, np.ones(count)), (1, below[:-1] / below[-1])):
        bends[part * count + place, part * points + above.size + place] = smooth
        bends[part * count + place, (part + 1) * points - 1] = -smooth * edge
    return np.concatenate([gains, bends])
