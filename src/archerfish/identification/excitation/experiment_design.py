"""What logs that are yet to be recorded will tell of an axis: the Fisher information of the simulation error.

With white measurement noise of standard deviation σ, and the slopes J of the simulated output in the parameters, the
covariance of an efficient estimate is σ² (JᵀJ)⁻¹. Initial state and offset of each log are unknown too and are
projected out, and the delay counts as known, as in the identification itself, which chooses it among whole samples.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.excitation.parallel_sections import (
    ParallelPlant,
    delay_slope,
    frequency_response,
    modes,
    parallel_plant,
    response,
    response_slopes,
)
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]

_TWO_SIDED = 1.959964
"""Standard deviations on either side that hold 95 %."""

_KNOWN_MODE = 0.5
"""Largest half-width of a mode's frequency, as a share of it, at which the mode counts as identifiable."""

_BEYOND = 1.5
"""Factor above the highest frequency that the logs show, beyond which a mode is no more than a fit's tail."""

_RANK = 1e-12


class Expected(NamedTuple):
    """A figure of the plant and how well it will be known."""

    name: str
    """What it is."""
    value: float
    """Its value in the assumed plant."""
    half_width: float
    """Half the width of its 95 % interval."""
    unit: str
    """Its unit."""


class ExpectedMode(NamedTuple):
    """A mode and how well it will be known."""

    frequency: Expected
    """Natural frequency [Hz]."""
    damping: Expected
    """Damping ratio."""
    identifiable: bool
    """Whether its frequency will be known to a half, from frequencies near it."""


class ExpectedBode(NamedTuple):
    """Frequency response of the assumed plant, how well it will be known, and where the logs show it."""

    frequency_hz: Array
    """Frequencies [Hz], shape (F,)."""
    gain: Array
    """Output per input, shape (F,)."""
    gain_half_width: Array
    """Half of the gain's 95 % interval, shape (F,)."""
    phase: Array
    """[rad], unwrapped, shape (F,)."""
    phase_half_width: Array
    """Half of the phase's 95 % interval [rad], shape (F,)."""
    coherence: Array
    """Expected squared coherence of command and angle, 0…1, shape (F,)."""


class ExperimentPrediction(NamedTuple):
    """What the logs will tell."""

    dc_gain: Expected
    """Steady output per steady input."""
    modes: tuple[ExpectedMode, ...]
    """Slowest first."""
    gains: tuple[Expected, ...]
    """Gain at five frequencies of the band."""
    delay: Expected
    """Input delay [s], were it no whole number of samples."""
    bode: ExpectedBode
    """Frequency response and its band."""
    known_band_hz: tuple[float, float]
    """From the lowest frequency that a log excites to the highest with a coherence of a half or more [Hz]."""


def predict_experiment(
    commands: Sequence[Array], plant: PlantRecord, noise_sd: float, band_hz: tuple[float, float]
) -> ExperimentPrediction:
    """Predict how well logs will determine a plant of that order.

    Args:
      commands: one per log, sampled at the plant's rate, shape (N,) each [rad].
      plant: what the axis is taken to be.
      noise_sd: standard deviation of the white measurement noise [rad].
      band_hz: frequencies of interest [Hz].

    Raises:
      InputError: if the noise is not positive, there is no command, or the plant can't be used.
    """
    if not 0 < noise_sd < np.inf:
        raise InputError(f"the noise must be > 0 rad, got {noise_sd:g}")
    if not commands:
        raise InputError("a prediction needs a command that is fitted; plan at least one beside the validation step")
    sections = parallel_plant(plant)
    spread = _Spread(np.vstack([_own_slopes(sections, command) for command in commands]), noise_sd)
    grid = np.geomspace(0.1 * band_hz[0], min(4 * band_hz[1], 0.49 / plant.sample_period_s), 300)
    coherence, highest = _coherence(sections, commands, noise_sd, grid)
    gain, gain_slopes = frequency_response(sections, np.zeros(1))
    dc_gain = Expected("DC gain", float(gain[0].real), spread.half_width(gain_slopes[0].real), "")
    return ExperimentPrediction(
        dc_gain,
        tuple(_expected_modes(sections, spread, highest)),
        tuple(_gains(sections, spread, np.geomspace(*band_hz, 5))),
        _delay(sections, commands, noise_sd),
        _bode(sections, spread, grid, coherence),
        (min(_lowest_excited_hz(command, plant.sample_period_s) for command in commands), highest),
    )


class _Spread:
    """Half-widths of figures from their slopes in the parameters."""

    def __init__(self, slopes: Array, noise_sd: float) -> None:
        self._scale = np.linalg.norm(slopes, axis=0)
        self._scale[self._scale == 0] = 1.0
        triangle = np.linalg.qr(slopes / self._scale, mode="r")
        _, size, self._directions = np.linalg.svd(triangle)
        # What the logs don't tell at all is left with a huge spread, not an infinite one times zero.
        self._size = np.maximum(size, _RANK * size[0])
        self._noise_sd = noise_sd

    def half_width(self, slope: Array) -> float:
        parts = self._directions @ (slope / self._scale) / self._size
        return float(_TWO_SIDED * self._noise_sd * np.linalg.norm(parts))


def _own_slopes(plant: ParallelPlant, command: Array) -> Array:
    """Slopes of one log in the parameters, less what its own initial state and offset explain."""
    return _without(response_slopes(plant, command), _own_columns(plant.denominators, len(command)))


def _own_columns(sections: Sections, count: int) -> Array:
    impulse = np.zeros(count)
    impulse[0] = 1.0
    columns = [lfilter(np.eye(each.size)[lag], [1.0, *each], impulse) for each in sections for lag in range(each.size)]
    return np.column_stack([*columns, np.ones(count)])


def _without(signals: Array, columns: Array) -> Array:
    basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    return np.asarray(signals - basis @ (basis.T @ signals))


def _expected_modes(plant: ParallelPlant, spread: _Spread, highest_hz: float) -> list[ExpectedMode]:
    found = []
    for mode in modes(plant):
        half_width = spread.half_width(mode.frequency_slope)
        damping = Expected("damping", mode.damping, spread.half_width(mode.damping_slope), "")
        frequency = Expected("frequency", mode.frequency_hz, half_width, "Hz")
        near = mode.frequency_hz < _BEYOND * highest_hz
        found.append(ExpectedMode(frequency, damping, near and half_width < _KNOWN_MODE * mode.frequency_hz))
    return found


def _gains(plant: ParallelPlant, spread: _Spread, frequency_hz: Array) -> list[Expected]:
    gain, slopes = frequency_response(plant, frequency_hz)
    along = np.real(np.conj(gain / np.abs(gain))[:, None] * slopes)
    return [
        Expected(f"gain at {frequency:.3g} Hz", float(value), spread.half_width(slope), "")
        for frequency, value, slope in zip(frequency_hz, np.abs(gain), along, strict=True)
    ]


def _delay(plant: ParallelPlant, commands: Sequence[Array], noise_sd: float) -> Expected:
    """Predict the delay beside all other parameters, which it then must be told from."""
    columns = [np.column_stack([response_slopes(plant, each), delay_slope(plant, each)]) for each in commands]
    own = [
        _without(slopes, _own_columns(plant.denominators, len(each)))
        for slopes, each in zip(columns, commands, strict=True)
    ]
    spread = _Spread(np.vstack(own), noise_sd)
    unit = np.zeros(own[0].shape[1])
    unit[-1] = 1.0
    return Expected("delay", plant.delay_samples * plant.sample_period_s, spread.half_width(unit), "s")


def _bode(plant: ParallelPlant, spread: _Spread, frequency_hz: Array, coherence: Array) -> ExpectedBode:
    gain, slopes = frequency_response(plant, frequency_hz)
    relative = slopes / gain[:, None]
    gain_half, phase_half = (
        np.array([spread.half_width(slope) for slope in part]) for part in (relative.real, relative.imag)
    )
    size = np.abs(gain)
    return ExpectedBode(frequency_hz, size, size * gain_half, np.unwrap(np.angle(gain)), phase_half, coherence)


def _coherence(
    plant: ParallelPlant, commands: Sequence[Array], noise_sd: float, frequency_hz: Array
) -> tuple[Array, float]:
    """Predict the coherence, the share of the plant's output in the measured power over a sixth of an octave.

    Also returns the highest frequency at which it is a half or more [Hz], zero if it is nowhere.
    """
    signal = np.zeros(len(frequency_hz))
    noise = 0.0
    for command in commands:
        output = response(plant, command)
        output = output - output.mean()
        power = np.concatenate([[0.0], np.cumsum(np.abs(np.fft.rfft(output)) ** 2)])
        lines = np.fft.rfftfreq(len(output), plant.sample_period_s)
        # A line more on either side: at low frequencies a sixth of an octave may hold none.
        first = np.maximum(np.searchsorted(lines, frequency_hz * 2 ** (-1 / 12)) - 1, 0)
        last = np.minimum(np.searchsorted(lines, frequency_hz * 2 ** (1 / 12)) + 1, len(lines))
        signal += (power[last] - power[first]) / (last - first)
        noise += len(output) * noise_sd**2
    coherence = signal / (signal + noise)
    shown = frequency_hz[coherence >= 0.5]
    return coherence, float(shown[-1]) if shown.size else 0.0


def _lowest_excited_hz(command: Array, sample_period_s: float) -> float:
    """Lowest line with a hundredth of the command's largest energy density [Hz]."""
    density = np.abs(np.fft.rfft(command - command.mean())) ** 2
    return float(np.fft.rfftfreq(len(command), sample_period_s)[np.argmax(density >= 1e-2 * density.max())])
