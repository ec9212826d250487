"""The axes of the simulated logs of strangers: linear dynamics in continuous time, dead time, and what is not linear.

A rig answers at any sampling period, so that a plant that was identified at another period than that of the log can be
compared with the truth as well. Without anything that is not linear the response is exact for an input that is held
between its samples, also where the dead time is no whole number of samples.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm
from scipy.signal import lfilter

from archerfish.paper.gimbal import printed_plants

Array = NDArray[np.float64]

FAMILIES = ("motor speed", "second order", "servo", "flexible", "printed pitch", "overdamped")
SUBSTEPS = 10
"""Steps of the simulation per sample where something is not linear."""
_RESONANCE_HZ = (20.0, 60.0)
_RATES_OF_PRINT = 1000.0
"""Only sampling rate at which the printed loop is known [Hz]."""


@dataclass(frozen=True)
class Rig:
    """An axis: delayed command → limits of the command → linear dynamics → what happens at the load → output."""

    family: str
    """Which kind of dynamics."""
    A: Array
    """Continuous-time state matrix [1/s], shape (n, n)."""
    B: Array
    """Continuous-time input vector, shape (n,)."""
    C: Array
    """Output vector, shape (n,)."""
    bandwidth_hz: float
    """Frequency up to which the output follows, about [Hz]."""
    settle_s: float
    """Time after which a step has settled to about 2 % [s], dead time not included."""
    loop: tuple[float, float] | None = None
    """Natural frequency [rad/s] and damping of the loop that moves the load, where it is of second order."""
    lag_s: float = 0.0
    """Time constant of an actuator ahead of that loop [s]."""
    gain: float = 1.0
    """Steady gain, or the velocity gain [1/s] of an integrating axis."""
    delay_s: float = 0.0
    """Dead time [s]."""
    integrating: bool = False
    """Whether the output is the integral of what the dynamics give."""
    responsive: bool = True
    """Whether the output answers to the input at all."""
    slew: float = np.inf
    """Fastest change of the command inside the rig [1/s]."""
    limit: float = np.inf
    """Largest command inside the rig."""
    dead_zone: float = 0.0
    """Half width of the commands around zero that move nothing."""
    backlash: float = 0.0
    """Half width of the play at the output, in units of the output."""
    friction: float = 0.0
    """Coulomb friction at the load, as the command that it takes to overcome it."""
    stiction: float = 0.0
    """Friction at rest, likewise; at least the Coulomb friction."""

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def linear(self) -> bool:
        """Whether it has no limit, no play and no friction."""
        still = self.dead_zone or self.backlash or self.friction or self.stiction
        return not still and self.slew == self.limit == np.inf


def draw_rig(generator: np.random.Generator, rate_hz: float, family: str) -> Rig:
    """Draw a linear rig of steady gain 1 and no dead time whose bandwidth suits a sampling rate.

    Args:
      generator: source of the draws.
      rate_hz: of the log [Hz].
      family: one of `FAMILIES`.
    """
    if family == "motor speed":
        low, high = max(1 / (2 * np.pi * 0.3), rate_hz / 500), min(1 / (2 * np.pi * 0.02), rate_hz / 10)
        return _lag(1 / (2 * np.pi * log_uniform(generator, low, high)))
    if family == "printed pitch":
        return _printed()
    low, high = max(3.0, rate_hz / 500), min(15.0, rate_hz / 10)
    if family == "overdamped":
        return _second(family, log_uniform(generator, low, high), generator.uniform(1.3, 3.0))
    if family == "flexible":
        return _flexible(generator, rate_hz)
    second = _second(family, log_uniform(generator, low, high), generator.uniform(0.25, 1.2))
    if family == "second order":
        return second
    return _behind_lag(second, 1 / (2 * np.pi * second.bandwidth_hz * log_uniform(generator, 1.5, 5.0)))


def families_at(rate_hz: float) -> tuple[str, ...]:
    """Return the families that can be logged sensibly at a rate [Hz]."""
    without = {"printed pitch"} if rate_hz != _RATES_OF_PRINT else set()
    if 0.4 * rate_hz <= _RESONANCE_HZ[0]:
        without.add("flexible")
    return tuple(each for each in FAMILIES if each not in without)


def log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of two others."""
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))


def respond(rig: Rig, command: Array, period_s: float) -> Array:
    """Simulate a rig from rest, under a command that is held between its samples.

    Args:
      rig: the rig.
      command: at each sample, zero before the first, shape (N,).
      period_s: sampling period [s].

    Returns:
      Outputs at the samples, shape (N,).
    """
    if not rig.responsive:
        return np.zeros(len(command))
    inner = _within(np.clip(command, -rig.limit, rig.limit), rig.dead_zone)
    fine = np.isfinite(rig.slew) or rig.friction > 0
    substeps = SUBSTEPS if fine else 1
    inner, step_s = np.repeat(inner, substeps), period_s / substeps
    if np.isfinite(rig.slew):
        inner = _slewed(inner, rig.slew * step_s)
    outputs = _with_friction(rig, inner, step_s) if rig.friction else linear_response(rig, inner, step_s)
    return _play(outputs[::substeps], rig.backlash)


def linear_response(rig: Rig, command: Array, period_s: float) -> Array:
    """Return the exact response of the linear dynamics from rest to a command that is held between its samples.

    Args:
      rig: the rig; only its dynamics, steady gain and dead time count.
      command: zero before the first sample, shape (N,).
      period_s: sampling period [s].
    """
    rates, weights = modes(rig)
    whole, before, after = held_steps(rates, weights, rig.delay_s, period_s)
    late = np.concatenate([np.zeros(whole), command])[: len(command)]
    outputs = np.zeros(len(command))
    for rate, old, new in zip(rates, before, after, strict=True):
        outputs += lfilter([0.0, new, old], [1.0, -np.exp(rate * period_s)], late).real
    return outputs


def modes(rig: Rig) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the poles of the linear dynamics [1/s] and what an impulse makes of the output of each, shape (n,) each.

    The steady gain is in the weights, and an integrating rig has one more pole.
    """
    A, B, C = rig.A, rig.B, rig.C
    if rig.integrating:
        A = np.block([[A, np.zeros((len(A), 1))], [C[None], np.zeros((1, 1))]])
        B, C = np.append(B, 0.0), np.append(np.zeros(len(C)), 1.0)
    rates, vectors = np.linalg.eig(A)
    return rates.astype(complex), rig.gain * (C @ vectors) * np.linalg.solve(vectors, B.astype(complex))


def held_steps(
    rates: NDArray[np.complex128], weights: NDArray[np.complex128], delay_s: float, period_s: float
) -> tuple[int, NDArray[np.complex128], NDArray[np.complex128]]:
    """Return by how many whole samples inputs are late, and what the older and the newer one then add to each mode.

    During a sampling interval a dead time of d + f samples lets the input of d + 1 samples ago act for the first share
    f of the interval, and that of d samples ago for the rest.

    Args:
      rates: poles [1/s], shape (n,).
      weights: of the modes in the output, shape (n,).
      delay_s: dead time [s].
      period_s: sampling period [s].
    """
    late = delay_s / period_s
    whole = int(np.floor(late + 1e-9))
    share = max(late - whole, 0.0)
    newer = _grown(rates, (1 - share) * period_s)
    older = np.exp(rates * (1 - share) * period_s) * _grown(rates, share * period_s)
    return whole, weights * older, weights * newer


def _grown(rates: NDArray[np.complex128], span_s: float) -> NDArray[np.complex128]:
    """Integrate exp(rate t) from 0 to the span, for rates that may be 0."""
    still = np.abs(rates) < 1e-12
    safe = np.where(still, 1.0, rates)
    return np.where(still, span_s, np.expm1(safe * span_s) / safe)


def _lag(lag_s: float) -> Rig:
    A, one = np.array([[-1 / lag_s]]), np.array([1.0])
    return Rig("motor speed", A, one / lag_s, one, 1 / (2 * np.pi * lag_s), 4 * lag_s)


def _second(family: str, bandwidth_hz: float, damping: float) -> Rig:
    """Return a loop of second order; beyond critical damping its bandwidth is that of the two lags in a row."""
    frequency = 2 * np.pi * bandwidth_hz * (1.0 if damping <= 1.2 else 2 * damping)
    A = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    slowest = -np.linalg.eigvals(A).real.max()
    B, C = np.array([0.0, frequency**2]), np.array([1.0, 0.0])
    return Rig(family, A, B, C, bandwidth_hz, 4 / slowest, (frequency, damping))


def _behind_lag(loop: Rig, lag_s: float) -> Rig:
    A = np.zeros((3, 3))
    A[:2, :2], A[:2, 2], A[2, 2] = loop.A, loop.B, -1 / lag_s
    B, C = np.array([0.0, 0.0, 1 / lag_s]), np.append(loop.C, 0.0)
    return Rig("servo", A, B, C, loop.bandwidth_hz, loop.settle_s + 4 * lag_s, loop.loop, lag_s)


def _flexible(generator: np.random.Generator, rate_hz: float) -> Rig:
    main = _second("flexible", log_uniform(generator, 4.0, min(10.0, rate_hz / 10)), generator.uniform(0.4, 0.9))
    low, high = max(_RESONANCE_HZ[0], 2.5 * main.bandwidth_hz), min(_RESONANCE_HZ[1], 0.4 * rate_hz)
    light = _second("flexible", log_uniform(generator, min(low, high), high), generator.uniform(0.01, 0.05))
    share = generator.uniform(0.02, 0.1) * generator.choice([-1.0, 1.0])
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = main.A, light.A
    C = np.concatenate([(1 - share) * main.C, share * light.C])
    return Rig("flexible", A, np.concatenate([main.B, light.B]), C, main.bandwidth_hz, main.settle_s)


def _printed() -> Rig:
    """Return the printed pitch loop as the continuous-time system whose held response at 1 kHz is the printed one."""
    plant = printed_plants()["pitch"]
    A = np.asarray(logm(plant.A)).real / plant.sample_period_s
    B = A @ np.linalg.solve(plant.A - np.eye(len(A)), plant.B[:, 0])
    rates = np.linalg.eigvals(A)
    slowest = rates[np.argmax(rates.real)]
    C = plant.C[0] / (-plant.C[0] @ np.linalg.solve(A, B))
    return Rig("printed pitch", A, B, C, abs(slowest) / (2 * np.pi), -4 / slowest.real)


def _within(command: Array, half_width: float) -> Array:
    return np.asarray(np.sign(command) * np.maximum(np.abs(command) - half_width, 0.0))


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
        pull = wanted - place
        if speed == 0.0:
            if abs(pull) <= rig.stiction:
                continue
            direction = 1.0 if pull > 0 else -1.0
        else:
            direction = 1.0 if speed > 0 else -1.0
        push = wanted - direction * rig.friction
        place, speed = a * place + b * speed + c * push, d * place + e * speed + f * push
        if speed * direction < 0 and abs(wanted - place) <= rig.stiction:
            speed = 0.0  # the load has come to rest within the step, and nothing moves it on
    return outputs * rig.gain
