"""A plant with one input and one output as parallel sections, and how its response moves with their coefficients.

    G(z) = z^−delay [ D + Σ_sections (b₁ z⁻¹ + b₂ z⁻²) / (1 + a₁ z⁻¹ + a₂ z⁻²) ]

The coefficients are the parameters that an identification has: every figure that is read off a plant, a pole's
frequency as the gain at some frequency, has its slope in them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from archerfish.identification.axis.modal_form import Sections, section_offsets, section_poles, sections_from_poles
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LONGEST_RESPONSE = 20_000


class ParallelPlant(NamedTuple):
    """A plant as parallel sections; its parameters are the denominators, the numerators and the feedthrough."""

    denominators: Sections
    """(a₁, a₂) or (a₁,) of each section."""
    numerators: Sections
    """(b₁, b₂) or (b₁,) of each section."""
    feedthrough: float
    """D; where it is zero it counts as known, since an identification leaves it out."""
    delay_samples: int
    """Input delay [samples]."""
    sample_period_s: float
    """Sampling period [s]."""


class Mode(NamedTuple):
    """A pole, or a conjugate pair, and the slopes of its figures in the parameters."""

    frequency_hz: float
    """Natural frequency [Hz]."""
    damping: float
    """Damping ratio, 1 for a real pole."""
    frequency_slope: Array
    """∂ frequency / ∂ parameters, shape (P,)."""
    damping_slope: Array
    """∂ damping / ∂ parameters, shape (P,)."""


def second_order_plant(bandwidth_hz: float, damping: float, delay_s: float, sample_period_s: float) -> PlantRecord:
    """Return ω² / (s² + 2 ζ ω s + ω²), the least that an axis under position control is, behind a delay.

    Args:
      bandwidth_hz: natural frequency ω / 2π [Hz].
      damping: ζ.
      delay_s: rounded to whole samples [s].
      sample_period_s: sampling period [s].

    Raises:
      InputError: if a value is out of range.
    """
    if not 0 < bandwidth_hz < 0.5 / sample_period_s:
        raise InputError(
            f"the bandwidth must be above 0 and below {0.5 / sample_period_s:g} Hz (half the sampling rate), got "
            f"{bandwidth_hz:g}"
        )
    if not (0 < damping < np.inf and 0 <= delay_s < np.inf):
        raise InputError(f"damping must be > 0 and the delay ≥ 0 s, got {damping:g} and {delay_s:g}")
    omega = 2 * np.pi * bandwidth_hz
    continuous = ([[0.0, 1.0], [-(omega**2), -2 * damping * omega]], [[0.0], [omega**2]], [[1.0, 0.0]], [[0.0]])
    A, B, C, D, _ = cont2discrete(tuple(map(np.array, continuous)), sample_period_s, method="zoh")
    return PlantRecord(A, B, C, D, round(delay_s / sample_period_s), sample_period_s)


def parallel_plant(plant: PlantRecord) -> ParallelPlant:
    """Write a plant as parallel sections.

    Raises:
      InputError: if it has several inputs or outputs, or is not stable.
    """
    poles = np.linalg.eigvals(plant.A).astype(np.complex128)
    if plant.B.shape[1] != 1 or plant.C.shape[0] != 1:
        raise InputError(
            f"a prediction needs a plant with one input and one output, got {plant.B.shape[1]} and {plant.C.shape[0]}"
        )
    if np.abs(poles).max() >= 1:
        raise InputError("a prediction needs a stable plant; identify the axis under position control")
    sections = sections_from_poles(poles)
    # Read off the impulse response, which also serves poles that no eigenvectors tell apart.
    settling = 5 / (1 - np.abs(poles).max())
    impulse = np.zeros(int(np.clip(settling, 20 * len(poles), _LONGEST_RESPONSE)))
    impulse[0] = 1.0
    columns = np.column_stack(_numerator_responses(sections, impulse))
    solved = np.linalg.lstsq(columns, _impulse_response(plant, len(impulse)), rcond=None)[0]
    coefficients: Array = np.asarray(solved, dtype=np.float64)
    numerators: Sections = tuple(
        coefficients[start : start + section.size] for start, section in section_offsets(sections)
    )
    return ParallelPlant(sections, numerators, plant.D.item(), plant.delay_samples, plant.sample_period_s)


def _impulse_response(plant: PlantRecord, count: int) -> Array:
    """Return 0, C B, C A B, …: the response without delay and feedthrough, shape (count,)."""
    state, found = plant.B[:, 0], np.zeros(count)
    for index in range(1, count):
        found[index] = plant.C[0] @ state
        state = plant.A @ state
    return found


def _numerator_responses(sections: Sections, driving: Array) -> list[Array]:
    return [
        _later(lfilter([1.0], [1.0, *section], driving), lag)
        for section in sections
        for lag in range(1, section.size + 1)
    ]


def _later(signal: Array, lag: int) -> Array:
    return np.concatenate([np.zeros(min(lag, len(signal))), signal[: len(signal) - lag]])


def response(plant: ParallelPlant, command: Array) -> Array:
    """Return the output from rest for a command less its first value, shape (N,)."""
    driving = _driving(plant, command, 0)
    outputs = [
        lfilter([0.0, *b], [1.0, *a], driving) for a, b in zip(plant.denominators, plant.numerators, strict=True)
    ]
    return np.asarray(plant.feedthrough * driving + np.sum(outputs, axis=0))


def response_slopes(plant: ParallelPlant, command: Array) -> Array:
    """Differentiate the output by the parameters: denominators, numerators, feedthrough if any; shape (N, P)."""
    driving = _driving(plant, command, 0)
    columns = []
    for a, b in zip(plant.denominators, plant.numerators, strict=True):
        twice = -lfilter([1.0], [1.0, *a], lfilter([0.0, *b], [1.0, *a], driving))
        columns += [_later(twice, lag) for lag in range(1, a.size + 1)]
    columns += _numerator_responses(plant.denominators, driving)
    return np.column_stack([*columns, driving] if plant.feedthrough else columns)


def delay_slope(plant: ParallelPlant, command: Array) -> Array:
    """Differentiate the output by the delay [1/s], from a sample more and a sample less; shape (N,)."""
    later, earlier = (response(plant._replace(delay_samples=0), _driving(plant, command, shift)) for shift in (1, -1))
    return (later - earlier) / (2 * plant.sample_period_s)


def _driving(plant: ParallelPlant, command: Array, shift: int) -> Array:
    samples = plant.delay_samples + shift
    moved = command - command[0]
    return _later(moved, samples) if samples >= 0 else np.append(moved[1:], moved[-1])


def frequency_response(plant: ParallelPlant, frequency_hz: Array) -> tuple[ComplexArray, ComplexArray]:
    """Return G at z = exp(i 2π f Ts), shape (F,), and its slopes in the parameters, shape (F, P)."""
    back = np.exp(-2j * np.pi * frequency_hz * plant.sample_period_s)
    lag = back**plant.delay_samples
    total = np.full(len(back), plant.feedthrough, dtype=np.complex128)
    poles_columns, zeros_columns = [], []
    for a, b in zip(plant.denominators, plant.numerators, strict=True):
        powers = back[:, None] ** np.arange(1, a.size + 1)
        section = powers @ b / (1 + powers @ a)
        total += section
        poles_columns.append(-powers * (section / (1 + powers @ a))[:, None])
        zeros_columns.append(powers / (1 + powers @ a)[:, None])
    columns = [*poles_columns, *zeros_columns, np.ones((len(back), int(plant.feedthrough != 0)))]
    slopes = np.hstack(columns)
    return total * lag, slopes * lag[:, None]


def modes(plant: ParallelPlant) -> list[Mode]:
    """Return the modes, slowest first.

    A pole z has s = ln z / Ts, the natural frequency |s| / 2π and the damping −Re s / |s|; ∂z/∂aᵢ = −z^(k−i) / A′(z)
    for the denominator A(z) = z^k + a₁ z^(k−1) + ….
    """
    order = sum(section.size for section in plant.denominators)
    found = []
    for start, section in section_offsets(plant.denominators):
        for pole in section_poles((section,)):
            if pole.imag >= 0:
                found.append(_mode(pole, section, start, 2 * order + (plant.feedthrough != 0), plant.sample_period_s))
    return sorted(found, key=lambda mode: mode.frequency_hz)


def _mode(pole: complex, section: Array, start: int, parameters: int, sample_period_s: float) -> Mode:
    size = section.size
    steepness = complex(np.polyval(np.polyder([1.0, *section]), pole))
    # A double pole moves without bound; this is far enough to be called unknown.
    steepness = steepness if abs(steepness) > 1e-9 else 1e-9
    shift = -(pole ** np.arange(size - 1, -1, -1)) / steepness
    s, ds = np.log(complex(pole)) / sample_period_s, shift / (pole * sample_period_s)
    radius, d_radius = abs(s), np.real(np.conj(s) * ds) / abs(s)
    frequency_slope, damping_slope = np.zeros(parameters), np.zeros(parameters)
    frequency_slope[start : start + size] = d_radius / (2 * np.pi)
    damping_slope[start : start + size] = (-ds.real + s.real / radius * d_radius) / radius
    return Mode(float(radius / (2 * np.pi)), float(-s.real / radius), frequency_slope, damping_slope)
