"""Short logs of simulated axes: a hundred to three hundred samples, without faults, the truth beside them.

Case number k of a seed is always the same, however many are made.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strangers_commands import command
from strangers_logs import EXCITATIONS, RATES_HZ, File, StrangersLog, draw_noise, usual_rig
from strangers_rigs import Rig, log_uniform, respond
from strangers_truth import held_back

Array = NDArray[np.float64]

SAMPLES = (100, 300)
"""Fewest and most samples of a log."""
NOISE = (0.005, 0.1)
"""Least and largest standard deviation of the noise, over that of the clean output."""
KINDS = {"white": 2 / 3, "AR(0.9)": 1 / 3}
"""Kind of noise → share of the logs."""
SETTLED = 2.0
"""Times that the axis can settle within a log, at least: a step may come in its middle. Dead time counts thrice."""


class ShortLog(NamedTuple):
    """A log, and one of the same axis that is held back."""

    log: StrangersLog
    """The log, of one file."""
    given: Array
    """Command that is held back, at rest at first, shape (M,)."""
    clean: Array
    """Output under it, without noise and zero, shape (M,)."""

    @property
    def delay(self) -> int:
        """Whole samples of the dead time."""
        return int(np.floor(self.log.rig.delay_s / self.log.period_s + 1e-9))


def make_short_log(seed: int, index: int) -> ShortLog:
    """Make one case.

    Args:
      seed: of all cases.
      index: its number.
    """
    # A third number, so that the draws are none of the longer logs'.
    generator = np.random.default_rng((seed, index, 2))
    count = round(log_uniform(generator, *SAMPLES))
    rig, rate_hz = _settling(generator, count)
    kind = str(generator.choice(EXCITATIONS))
    given = log_uniform(generator, 0.01, 30.0) * command(kind, count, 1 / rate_hz, rig, generator)
    clean = respond(rig, given, 1 / rate_hz)
    spread = float(np.std(clean))
    noise, noise_kind = log_uniform(generator, *NOISE), str(generator.choice(list(KINDS), p=list(KINDS.values())))
    zero = generator.uniform(-3, 3) * spread * (generator.random() < 0.5)
    answer = clean + zero + noise * spread * draw_noise(noise_kind, count, generator)
    file = File(np.arange(count) / rate_hz, given, answer, given, answer)
    peak = float(np.abs(given).max())
    log = StrangersLog(index, rig, "none", 0.0, kind, 1 / rate_hz, peak, noise, noise_kind, False, (file,))
    return ShortLog(log, *held_back(log, log.period_s))


def _settling(generator: np.random.Generator, count: int) -> tuple[Rig, float]:
    """Draw sampling rates [Hz] and rigs until a rig can settle within so many samples."""
    while True:
        rate_hz = float(generator.choice(list(RATES_HZ), p=list(RATES_HZ.values())))
        rig = usual_rig(generator, rate_hz)
        if SETTLED * (rig.settle_s + 3 * rig.delay_s) * rate_hz <= count:
            return rig, rate_hz
