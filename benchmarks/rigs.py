"""Simulated axes of known truth: linear dynamics, dead time, what is not linear, and commands that move them.

A rig responds at any sampling period, so that a plant that was identified at another period than that of its log can be
compared with the truth as well. Without anything that is not linear the response is exact for an input that is held
between its samples, also where the dead time is no whole number of samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm
from scipy.signal import lfilter

from archerfish.paper.gimbal import printed_plants

Array: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]
Rng: TypeAlias = np.random.Generator

FAMILIES = ("motor speed", "second order", "servo", "flexible", "printed pitch", "overdamped")
RATES_HZ = {50.0: 0.1, 100.0: 0.2, 200.0: 0.25, 500.0: 0.2, 1000.0: 0.25}  # sampling rate [Hz] → share of the logs
_RESONANCE_HZ, _PRINTED_HZ = (20.0, 60.0), 1000.0  # the printed axis is known at one sampling rate alone
_LONGEST_DELAY = (15, 0.04)  # of a usual rig, in samples and in seconds; the shorter one counts
_SUBSTEPS = 10  # of a sample, where something is not linear
_HIGHEST = 0.4  # highest frequency of an excitation, as a share of the sampling rate


@dataclass(frozen=True)
class Rig:
    """An axis: delayed command → limits of the command → linear dynamics → play and friction → output."""

    family: str
    A: Array  # in continuous time [1/s], (n, n)
    B: Array  # (n,)
    C: Array  # (n,)
    bandwidth_hz: float  # up to which the output follows, about
    settle_s: float  # until a step has settled to about 2 %, without the dead time
    loop: tuple[float, float] | None = None  # natural frequency [rad/s] and damping, where it is of second order
    lag_s: float = 0.0  # time constant of an actuator ahead of that loop
    gain: float = 1.0  # steady, or the velocity gain [1/s] of an integrating axis
    delay_s: float = 0.0  # dead time
    integrating: bool = False
    responsive: bool = True  # whether the output depends on the input at all
    slew: float = np.inf  # fastest change of the command inside the rig [1/s]
    limit: float = np.inf  # largest command inside the rig
    dead_zone: float = 0.0  # half width of the commands around zero that move nothing
    backlash: float = 0.0  # half width of the play at the output, in its units
    friction: float = 0.0  # Coulomb friction at the load, as the command that overcomes it
    stiction: float = 0.0  # friction at rest, likewise

    @property
    def linear(self) -> bool:
        """Whether it has no limit, no play and no friction."""
        still = self.dead_zone or self.backlash or self.friction or self.stiction
        return not still and self.slew == self.limit == np.inf


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of two others."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def usual_rig(rng: Rng, rate_hz: float, among: tuple[str, ...] = FAMILIES) -> Rig:
    """Draw a linear rig with a usual steady gain and dead time, of a family that can be logged at a rate [Hz]."""
    without = {"printed pitch"} if rate_hz != _PRINTED_HZ else set()
    without |= {"flexible"} if 0.4 * rate_hz <= _RESONANCE_HZ[0] else set()
    families = tuple(each for each in FAMILIES if each not in without and each in among)
    rig = draw_rig(rng, rate_hz, str(rng.choice(families)))
    gain = 1.0 if rng.random() < 0.6 else log_uniform(rng, 0.2, 5.0)
    gain *= -1.0 if rng.random() < 0.1 else 1.0
    delay = float(rng.integers(0, min(_LONGEST_DELAY[0], int(_LONGEST_DELAY[1] * rate_hz + 1e-9)) + 1))
    if rng.random() < 0.2:
        delay = round(max(delay - rng.random(), 0.1), 1)
    return replace(rig, gain=gain, delay_s=delay / rate_hz)


def draw_rig(rng: Rng, rate_hz: float, family: str) -> Rig:
    """Draw a linear rig of steady gain 1 and no dead time whose bandwidth suits a sampling rate [Hz]."""
    if family == "motor speed":
        low, high = max(1 / (2 * np.pi * 0.3), rate_hz / 500), min(1 / (2 * np.pi * 0.02), rate_hz / 10)
        lag_s, one = 1 / (2 * np.pi * log_uniform(rng, low, high)), np.array([1.0])
        return Rig(family, np.array([[-1 / lag_s]]), one / lag_s, one, 1 / (2 * np.pi * lag_s), 4 * lag_s)
    if family == "printed pitch":
        return _printed()
    if family == "flexible":
        return _flexible(rng, rate_hz)
    low, high = max(3.0, rate_hz / 500), min(15.0, rate_hz / 10)
    damping = (1.3, 3.0) if family == "overdamped" else (0.25, 1.2)
    second = _second(family, log_uniform(rng, low, high), rng.uniform(*damping))
    if family != "servo":
        return second
    assert second.loop is not None
    lag_s = 1 / (2 * np.pi * second.bandwidth_hz * log_uniform(rng, 1.5, 5.0))
    A = np.zeros((3, 3))
    A[:2, :2], A[:2, 2], A[2, 2] = second.A, second.B, -1 / lag_s
    B, C = np.array([0.0, 0.0, 1 / lag_s]), np.append(second.C, 0.0)
    return Rig(family, A, B, C, second.bandwidth_hz, second.settle_s + 4 * lag_s, second.loop, lag_s)


def _second(family: str, bandwidth_hz: float, damping: float) -> Rig:
    """Return a loop of second order; beyond critical damping its bandwidth is that of the two lags in a row."""
    frequency = 2 * np.pi * bandwidth_hz * (1.0 if damping <= 1.2 else 2 * damping)
    A = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    slowest = -np.linalg.eigvals(A).real.max()
    B, C = np.array([0.0, frequency**2]), np.array([1.0, 0.0])
    return Rig(family, A, B, C, bandwidth_hz, 4 / slowest, (frequency, damping))


def _flexible(rng: Rng, rate_hz: float) -> Rig:
    main = _second("flexible", log_uniform(rng, 4.0, min(10.0, rate_hz / 10)), rng.uniform(0.4, 0.9))
    low, high = max(_RESONANCE_HZ[0], 2.5 * main.bandwidth_hz), min(_RESONANCE_HZ[1], 0.4 * rate_hz)
    light = _second("flexible", log_uniform(rng, min(low, high), high), rng.uniform(0.01, 0.05))
    share = rng.uniform(0.02, 0.1) * rng.choice([-1.0, 1.0])
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = main.A, light.A
    C = np.concatenate([(1 - share) * main.C, share * light.C])
    return Rig("flexible", A, np.concatenate([main.B, light.B]), C, main.bandwidth_hz, main.settle_s)


def _printed() -> Rig:
    """Return the printed pitch axis as the continuous-time system whose held response at 1 kHz is the printed one."""
    plant = printed_plants()["pitch"]
    A = np.asarray(logm(plant.A)).real / plant.sample_period_s
    B = A @ np.linalg.solve(plant.A - np.eye(len(A)), plant.B[:, 0])
    rates = np.linalg.eigvals(A)
    slowest = rates[np.argmax(rates.real)]
    C = plant.C[0] / (-plant.C[0] @ np.linalg.solve(A, B))
    return Rig("printed pitch", A, B, C, abs(slowest) / (2 * np.pi), -4 / slowest.real)


def respond(rig: Rig, command: Array, period_s: float) -> Array:
    """Simulate a rig from rest.

    Args:
      rig: the rig.
      command: held between its samples, zero before the first, shape (N,).
      period_s: sampling period [s].

    Returns:
      Outputs at the samples, shape (N,).
    """
    if not rig.responsive:
        return np.zeros(len(command))
    inner = np.clip(command, -rig.limit, rig.limit)
    inner = np.asarray(np.sign(inner) * np.maximum(np.abs(inner) - rig.dead_zone, 0.0))
    substeps = _SUBSTEPS if np.isfinite(rig.slew) or rig.friction > 0 else 1
    inner, step_s = np.repeat(inner, substeps), period_s / substeps
    if np.isfinite(rig.slew):
        inner = _slewed(inner, rig.slew * step_s)
    outputs = _with_friction(rig, inner, step_s) if rig.friction else linear_response(rig, inner, step_s)
    return _play(outputs[::substeps], rig.backlash)


def linear_response(rig: Rig, command: Array, period_s: float) -> Array:
    """Return the exact response of the linear dynamics from rest to a held command, both of shape (N,)."""
    rates, weights = modes(rig)
    late, before, after = held_steps(rates, weights, rig.delay_s, period_s)
    delayed = np.concatenate([np.zeros(late), command])[: len(command)]
    outputs = np.zeros(len(command))
    for rate, old, new in zip(rates, before, after, strict=True):
        outputs += lfilter([0.0, new, old], [1.0, -np.exp(rate * period_s)], delayed).real
    return outputs


def modes(rig: Rig) -> tuple[Complex, Complex]:
    """Return the poles [1/s] of the linear dynamics and each one's share of the impulse response, shape (n,) each."""
    A, B, C = rig.A, rig.B, rig.C
    if rig.integrating:
        A = np.block([[A, np.zeros((len(A), 1))], [C[None], np.zeros((1, 1))]])
        B, C = np.append(B, 0.0), np.append(np.zeros(len(C)), 1.0)
    rates, vectors = np.linalg.eig(A)
    return rates.astype(complex), rig.gain * (C @ vectors) * np.linalg.solve(vectors, B.astype(complex))


def held_steps(rates: Complex, weights: Complex, delay_s: float, period_s: float) -> tuple[int, Complex, Complex]:
    """Return by how many whole samples inputs are late, and what the older and the newer one then add to each mode.

    With a dead time of d + f samples the input of d + 1 samples ago acts for the first share f of an interval, and that
    of d samples ago for the rest.

    Args:
      rates: poles [1/s], shape (n,).
      weights: of the modes in the output, shape (n,).
      delay_s: dead time [s].
      period_s: sampling period [s].
    """
    late = delay_s / period_s
    samples = int(np.floor(late + 1e-9))
    share = max(late - samples, 0.0)
    newer = _grown(rates, (1 - share) * period_s)
    older = np.exp(rates * (1 - share) * period_s) * _grown(rates, share * period_s)
    return samples, weights * older, weights * newer


def _grown(rates: Complex, span_s: float) -> Complex:
    """Integrate exp(rate t) from 0 to the span, for rates that may be 0."""
    still = np.abs(rates) < 1e-12
    safe = np.where(still, 1.0, rates)
    return np.where(still, span_s, np.expm1(safe * span_s) / safe)


def _slewed(command: Array, most: float) -> Array:
    """Let the command change by at most so much per step."""
    followed, at = np.empty(len(command)), 0.0
    for index, wanted in enumerate(command.tolist()):
        change = min(max(wanted - at, -most), most)
        # A ramp is held at its middle; a jump of less than a step's ramp is done at once.
        followed[index] = at + (0.5 * change if abs(change) == most else change)
        at += change
    return followed


def _play(outputs: Array, half_width: float) -> Array:
    """Let the output follow with a play: it moves only where the drive pushes it."""
    if half_width == 0:
        return outputs
    followed, at = np.empty(len(outputs)), 0.0
    for index, drive in enumerate(outputs.tolist()):
        at = min(max(at, drive - half_width), drive + half_width)
        followed[index] = at
    return followed


def _with_friction(rig: Rig, command: Array, step_s: float) -> Array:
    """Simulate a loop of second order whose load is held by dry friction; exact between changes of its direction."""
    assert rig.loop is not None
    frequency, damping = rig.loop
    late = np.concatenate([np.zeros(round(rig.delay_s / step_s)), command])[: len(command)]
    if rig.lag_s:
        kept = np.exp(-step_s / rig.lag_s)
        # Mean of the beginning and the end of each step, in which the loop takes it to be held.
        late = lfilter([0.5 * (1 - kept), 0.5 * (1 - kept)], [1.0, -kept], late)
    block = np.zeros((3, 3))
    block[:2] = [[0.0, 1.0, 0.0], [-(frequency**2), -2 * damping * frequency, frequency**2]]
    (a, b, c), (d, e, f) = expm(block * step_s)[:2].tolist()
    outputs, place, speed = np.empty(len(late)), 0.0, 0.0
    for index, wanted in enumerate(late.tolist()):
        outputs[index] = place
        if speed == 0.0 and abs(wanted - place) <= rig.stiction:
            continue
        direction = 1.0 if (speed or wanted - place) > 0 else -1.0
        push = wanted - direction * rig.friction
        place, speed = a * place + b * speed + c * push, d * place + e * speed + f * push
        if speed * direction < 0 and abs(wanted - place) <= rig.stiction:
            speed = 0.0  # the load has come to rest within the step, and nothing moves it on
    return outputs * rig.gain


class Drawn(NamedTuple):
    """What a command is drawn for, and with."""

    samples: int
    period_s: float
    rig: Rig  # its bandwidth and settling set the scale
    rng: Rng


def _sweep(log: Drawn) -> Array:
    """Sweep from far below the bandwidth to above it, linearly or logarithmically in time."""
    time, duration = log.period_s * np.arange(log.samples), log.period_s * log.samples
    low = log.rig.bandwidth_hz * log_uniform(log.rng, 0.02, 0.5)
    high = max(min(log.rig.bandwidth_hz * log_uniform(log.rng, 2.0, 6.0), _HIGHEST / log.period_s), 1.5 * low)
    if log.rng.random() < 0.5:
        return np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * duration)))
    growth = np.log(high / low) / duration
    return np.asarray(np.sin(2 * np.pi * low * np.expm1(growth * time) / growth))


def _step(log: Drawn) -> Array:
    """Step after a rest of 0.1 to 2 s, at most half of the log; in every other log, also step back."""
    return _stepped(log.samples, int(min(log_uniform(log.rng, 0.1, 2.0) / log.period_s, log.samples / 2)), log.rng)


def _early_step(log: Drawn) -> Array:
    """Step within the first samples of the log."""
    return _stepped(log.samples, int(log.rng.integers(0, 6)), log.rng)


def _stepped(samples: int, rest: int, rng: Rng) -> Array:
    signal = np.where(np.arange(samples) < rest, 0.0, rng.choice([-1.0, 1.0]))
    if rng.random() < 0.5:
        signal[rest + int((samples - rest) * rng.uniform(0.4, 0.7)) :] = 0.0
    return signal


def _staircase(log: Drawn) -> Array:
    """Step up and down again, one level after another."""
    stairs = int(log.rng.integers(2, 6))
    levels = np.concatenate([np.arange(stairs), np.arange(stairs, 0, -1)]) / stairs
    return np.asarray(levels[np.arange(log.samples) * len(levels) // log.samples])


def _held_levels(log: Drawn) -> Array:
    """Hold random levels for random times, some too short to settle."""
    shortest = max(0.3 * log.rig.settle_s / log.period_s, 1.0)
    spans = np.ceil(shortest * 10 ** log.rng.uniform(0, 1, int(log.samples / shortest) + 1)).astype(int)
    return np.repeat(log.rng.uniform(-1, 1, len(spans)), spans)[: log.samples]


def _multisine(log: Drawn) -> Array:
    """Sum sines of random phases in and around the band."""
    low = max(0.05 * log.rig.bandwidth_hz, 1 / (log.samples * log.period_s))
    high = max(min(4 * log.rig.bandwidth_hz, _HIGHEST / log.period_s), 2 * low)
    return sum_of_sines(log.samples, log.period_s, np.geomspace(low, high, int(log.rng.integers(8, 30))), log.rng)


def sum_of_sines(samples: int, period_s: float, frequency_hz: Array, rng: Rng) -> Array:
    """Sum sines of given frequencies [Hz], shape (L,), and random phases to a peak of 1, shape (N,)."""
    time, signal = period_s * np.arange(samples), np.zeros(samples)
    for frequency, phase in zip(frequency_hz, rng.uniform(0, 2 * np.pi, len(frequency_hz)), strict=True):
        signal += np.sin(2 * np.pi * frequency * time + phase)
    return np.asarray(signal / np.abs(signal).max())


def _binary(log: Drawn) -> Array:
    """Draw one of two levels at every tick of a clock about as fast as the axis."""
    clock = max(round(log_uniform(log.rng, 0.1, 0.8) / log.rig.bandwidth_hz / log.period_s), 1)
    return np.repeat(log.rng.choice([-1.0, 1.0], -(-log.samples // clock)), clock)[: log.samples]


def _sine(log: Drawn) -> Array:
    """Move in a single sine."""
    frequency = log.rig.bandwidth_hz * log_uniform(log.rng, 0.1, 2.0)
    return np.asarray(np.sin(2 * np.pi * frequency * log.period_s * np.arange(log.samples)))


COMMANDS: dict[str, Callable[[Drawn], Array]] = {
    "sweep": _sweep,
    "step": _step,
    "early step": _early_step,
    "staircase": _staircase,
    "held levels": _held_levels,
    "multisine": _multisine,
    "binary": _binary,
    "sine": _sine,
}
"""Name → what draws a command of peak 1 or below, shape (N,)."""


def draw_noise(kind: str, samples: int, rng: Rng) -> Array:
    """Draw noise of standard deviation 1, "white", "AR(0.9)" or "wander", shape (N,)."""
    if kind == "wander":
        slow = lfilter([1.0], [1.0, -(1 - 5 / (samples + 5))], rng.standard_normal(2 * samples))[samples:]
        wander = slow / max(float(np.std(slow)), 1e-12)
        return np.asarray(0.8 * wander + 0.6 * rng.standard_normal(samples))
    memory = 0.9 if kind == "AR(0.9)" else 0.0
    drawn = rng.standard_normal(samples + 1000)  # the recursion begins at rest: its first thousand are left out
    return np.asarray(lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], drawn)[1000:])
