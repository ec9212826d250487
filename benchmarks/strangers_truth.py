"""Whether a plant is right: held against the rig that the log is from."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.validation.free_run import free_run
from archerfish.records.errors import InputError
from archerfish.records.plant import USABLE_FIT_PERCENT, PlantRecord, dc_gain
from archerfish.records.recording import make_recording
from strangers_commands import sum_of_sines
from strangers_logs import StrangersLog
from strangers_rigs import linear_response, respond

Array = NDArray[np.float64]

GAIN_SHARE, DELAY_SHARE = 0.05, 0.1
"""Shares by which a steady gain and a dead time may be off."""
_OTHER_UNIT = 30.0
"""Factor between the sampling periods of plant and log beyond which time was taken in another unit."""
_SINES, _STEPS = 14, 10
_MOST_LEVELS = 12
_WORST_FIT = -1000.0
"""Fit at which the count stops: a plant may be arbitrarily bad [%]."""


class Truth(NamedTuple):
    """A plant beside the truth."""

    fit_percent: float
    """Fit of a noise-free log that was held back [%]; 0 where the axis does not respond or time has another unit."""
    gain_right: bool
    """Whether the steady gain is right."""
    delay_right: bool
    """Whether the dead time is right."""
    rise_right: bool
    """Whether a step reaches half its height when it should, within the same bounds; no part of the definition."""

    @property
    def usable(self) -> bool:
        """Whether the plant is usable, by the definition of this benchmark."""
        return self.fit_percent >= USABLE_FIT_PERCENT and self.gain_right and self.delay_right


def held_back(log: StrangersLog, period_s: float) -> tuple[Array, Array]:
    """Return command and clean output of a log that is not fitted, from rest, shape (N,) each.

    Levels that are held until the axis rests, then sines through the band, at the amplitude of the fitted log. Where
    the fitted log only steps, by the same height each time, and the axis is not linear, the held-back log has such
    steps, too: what larger and smaller moves do is nowhere in the fitted one.

    Args:
      log: the log that was fitted.
      period_s: sampling period [s].
    """
    levels = _levels(log)
    given = _moves(log, period_s) if levels is None or log.rig.linear else _steps(log, levels, period_s)
    return given, respond(log.rig, given, period_s)


def _moves(log: StrangersLog, period_s: float) -> Array:
    settle_s = log.rig.settle_s + log.rig.delay_s
    spans = np.ceil(settle_s * np.array([0.25, 1.5, 1.5, 1.5, 1.5]) / period_s).astype(int)
    levels = np.repeat([0.0, 1.0, -1.0, 0.5, 0.0], spans)
    band = log.rig.bandwidth_hz * np.geomspace(0.1, 2.5, _SINES)
    count = int(np.ceil(10.0 / log.rig.bandwidth_hz / period_s))
    generator = np.random.default_rng(log.index)
    sines = sum_of_sines(count, period_s, band[band < 0.4 / period_s], generator)
    return np.asarray(log.amplitude * np.concatenate([levels, sines]))


def _levels(log: StrangersLog) -> Array | None:
    """Return the levels between which a log steps, rising, if it does nothing else than steps of one height."""
    levels = np.unique(np.concatenate([each.command for each in log.files]))
    if not 1 < levels.size <= _MOST_LEVELS:
        return None
    heights = np.concatenate([np.abs(np.diff(each.command)) for each in log.files])
    heights = heights[heights > 0]
    return levels if heights.size and np.ptp(heights) < 1e-6 * heights.max() else None


def _steps(log: StrangersLog, levels: Array, period_s: float) -> Array:
    """Step up and down between neighbouring levels, after times of which some are too short to settle."""
    generator = np.random.default_rng(log.index)
    settle = (log.rig.settle_s + log.rig.delay_s) / period_s
    spans = np.ceil(settle * generator.uniform(0.4, 1.6, _STEPS)).astype(int)
    at, places = int(np.argmin(np.abs(levels))), []
    for _ in range(_STEPS):
        places.append(at)
        ways = [each for each in (at - 1, at + 1) if 0 <= each < levels.size]
        at = int(generator.choice(ways))
    rest = np.zeros(int(np.ceil(0.25 * settle)))
    return np.concatenate([rest, np.repeat(levels[places], spans)])


def judge_plant(log: StrangersLog, plant: PlantRecord) -> Truth:
    """Hold a plant against the rig of its log."""
    rig = log.rig
    ratio = plant.sample_period_s / log.period_s
    if not rig.responsive or not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        return Truth(0.0, False, False, False)
    given, clean = held_back(log, plant.sample_period_s)
    fit = float(free_run(plant, make_recording(given, clean, plant.sample_period_s)).fit_percent[0])
    gain = dc_gain(plant).item()
    low, high = sorted(abs(each) for each in _steady_gains(log))
    same_sign = gain * rig.gain > 0
    gain_right = not rig.integrating and same_sign and (1 - GAIN_SHARE) * low <= abs(gain) <= (1 + GAIN_SHARE) * high
    return Truth(
        max(fit, _WORST_FIT) if np.isfinite(fit) else _WORST_FIT,
        gain_right,
        _delay_right(log, plant),
        _rise_right(log, plant),
    )


def _steady_gains(log: StrangersLog) -> tuple[float, float]:
    """Return the steady outputs per steady command at the amplitude of the log, coming from below and from above.

    A dead zone and a limit change both; with friction or play the axis comes to rest anywhere between them.
    """
    rig = log.rig
    inner = max(min(log.amplitude, rig.limit) - rig.dead_zone, 0.0)
    held = min(rig.stiction + rig.backlash / abs(rig.gain), inner)
    return rig.gain * (inner - held) / log.amplitude, rig.gain * (inner + held) / log.amplitude


def true_delay(log: StrangersLog) -> float:
    """Return the dead time in samples of the log."""
    return round(log.rig.delay_s / log.period_s, 9)


def _delay_right(log: StrangersLog, plant: PlantRecord) -> bool:
    """Tell whether the dead time is right; a plant with feedthrough answers a sample earlier than one without."""
    delays = [plant.delay_samples]
    if np.any(plant.D):
        delays.append(plant.delay_samples - 1)
    most = _tolerance_s(log, plant)
    return any(abs(each * plant.sample_period_s - log.rig.delay_s) <= most for each in delays)


def _tolerance_s(log: StrangersLog, plant: PlantRecord) -> float:
    # A hair more than a sample, for the rounding of the stamps.
    return max(1.001 * plant.sample_period_s, DELAY_SHARE * log.rig.delay_s)


def _rise_right(log: StrangersLog, plant: PlantRecord) -> bool:
    """Tell whether the linear step responses of plant and rig reach half the true gain at the same time."""
    rig, period_s = log.rig, plant.sample_period_s
    if rig.integrating:
        return False
    step = np.ones(int(np.ceil(2 * (rig.settle_s + rig.delay_s) / period_s)) + 2)
    # A plant takes its input to have been held before: the step follows a rest as long as its delay.
    rest = plant.delay_samples + 1
    own = simulate(plant, np.concatenate([np.zeros(rest), step])[:, None])[rest:, 0]
    rises = [_half_risen(each / rig.gain) * period_s for each in (own, linear_response(rig, step, period_s))]
    return bool(abs(rises[0] - rises[1]) <= _tolerance_s(log, plant))


def _half_risen(response: Array) -> float:
    """Return when a step response first reaches one half [samples], between samples too; infinite if it does not."""
    above = np.flatnonzero(response >= 0.5)
    if not above.size:
        return np.inf
    first = int(above[0])
    if first == 0:
        return 0.0
    return float(first - (response[first] - 0.5) / (response[first] - response[first - 1]))


def oracle_usable(log: StrangersLog, clean: bool = False) -> bool:
    """Tell whether a fit that knows columns, times and order gives a usable plant.

    Args:
      log: the log.
      clean: whether it is also free of noise; else the noise of the log is left in.
    """
    recordings = []
    for file in log.files:
        answer = respond(log.rig, file.command, log.period_s) if clean else file.answer
        recordings.append(make_recording(file.command, answer, log.period_s))
    order = log.rig.order + log.rig.integrating
    try:
        result = identify_axis(recordings, order, max_delay=int(true_delay(log)) + 20)
    except InputError:
        return False
    return judge_plant(log, replace(result.plant, draws={}, draw_delays=np.zeros(0, np.int64))).usable
