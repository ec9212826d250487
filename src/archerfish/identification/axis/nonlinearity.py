"""Which nonlinearity explains what a linear plant leaves of its recordings: five that gimbals and servos have.

Each is a static or hysteretic operator on the command in front of the same linear plant (a Hammerstein model), with one
level. The plant is fitted once more behind it, and the operator is named where that explains the recordings far better.
Behind the right operator the linear part is found without the bias that the nonlinearity gives to a linear fit, so that
the change of its steady gain says how much that bias is.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.delay_walk import colour, rounding
from archerfish.identification.axis.log_ground import Ground, ground_of
from archerfish.identification.axis.modal_form import section_offsets, section_poles, sections_from_poles
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_poles
from archerfish.identification.axis.recursive_filter import recursion
from archerfish.identification.axis.simulation_fit import linear_parameters, transfer_columns
from archerfish.identification.axis.structure_choice import Structure
from archerfish.records.recording import Recording, slice_recording

Array = NDArray[np.float64]

_MOST_SAMPLES = 8000
_LINES = 400
_EFFORT, _ROUGH = Effort(0.3, 10), Effort(1.0, 4)
_FASTER = (1.0, 2.5)
"""Factors on the speed of the linear plant's poles to start from."""
_SHARES = (0.01, 0.03, 0.08, 0.2, 0.45)
_LIMITS = (0.3, 0.45, 0.6, 0.75, 0.9)
_SLEWS = (0.25, 0.5, 0.8, 1.2, 2.5, 5.0)
_NEAR = ((0.7, 1.35), (0.87, 1.15))
"""Factors on the best level of the grid that are tried next, and then on the best of those."""
_DELAYS = (-6, -4, -3, -2, -1, 1, 2)
_SETTLED = 4.0
"""Time constants of the slowest pole after which a step has settled."""
_TEST_SINES = 14
_SLOWEST_TEST = 20_000
"""Samples that a test signal has at most."""


class NonlinearFit(NamedTuple):
    """The plant behind one operator."""

    name: str
    """Of the operator: "saturation", "dead zone", "rate limit" or "hysteresis" (backlash or friction)."""
    level: float
    """Its limit, half width or, of a rate limit, its slope per second, in units of the input."""
    residual_share: float
    """Power of its residual over that of the linear plant's."""
    gained: float
    """Twice the log likelihood that it gains."""
    gain_ratio: float
    """Steady output per input at the largest command, over that of the linear plant."""
    agreement_percent: float
    """Fit of the linear plant to the plant behind the operator, on steps and sines of the largest command [%]."""
    delay: int
    """Delay of the plant behind it [samples]."""


def nonlinear_fits(ground: Ground, linear: Structure) -> list[NonlinearFit]:
    """Fit the plant behind each operator; the one that leaves least comes first.

    Args:
      ground: all lines of recordings with one input and one output.
      linear: the plant without any.
    """
    search = _Search(_shortened(ground), linear)
    fits = [fit for name, levels in search.families() if (fit := search.best(name, levels)) is not None]
    return sorted(fits, key=lambda each: each.residual_share)


class _Search(NamedTuple):
    ground: Ground
    linear: Structure

    def families(self) -> Iterator[tuple[str, list[float]]]:
        """Return each operator with the levels to try."""
        largest = max(float(np.abs(each.inputs).max()) for each in self.ground.recordings)
        span = max(float(np.ptp(each.inputs)) for each in self.ground.recordings)
        yield "saturation", [share * largest for share in _LIMITS]
        yield "dead zone", [share * largest for share in _SHARES]
        yield "hysteresis", [0.5 * share * span for share in _SHARES]
        speed = self._speed()
        if speed:
            yield "rate limit", [share * speed for share in _SLEWS]

    def _speed(self) -> float:
        """Return how fast a command must change for the outputs to move as fast as they do, per second."""
        gain = abs(_steady_gain(self.linear.refinement, self.linear.problem)) * float(self.ground.scale[0])
        fastest = 0.0
        for each in self.ground.recordings:
            width = max(1, len(each) // 1000)
            moved = np.abs(each.outputs[width:, 0] - each.outputs[:-width, 0]) / (width * each.sample_period_s)
            fastest = max(fastest, float(np.quantile(moved, 0.995)))
        return fastest / gain if gain > 0 else 0.0

    def best(self, name: str, levels: Sequence[float]) -> NonlinearFit | None:
        """Fit the plant behind an operator at its best level; None if it changes nothing."""
        base = self._fit(self.ground, self.linear.delay)
        costs = {level: self._cost(name, level) for level in levels}
        for factors in _NEAR:
            top = min(costs, key=lambda level: costs[level])
            costs |= {top * factor: self._cost(name, top * factor) for factor in factors}
        top = min(costs, key=lambda level: costs[level])
        changed = self._changed(name, top)
        powers = (1.0,) if name in _STATIC else _FASTER
        problem, fit = min(
            (self._fit(changed, self.linear.delay, each) for each in powers), key=lambda each: each[1].cost
        )
        delay = self.linear.delay
        sections = fit.sections
        if fit.cost >= base[1].cost:
            return None
        for step in _DELAYS:
            other = self.linear.delay + step
            if other >= 0 and (tried := refine_poles(sections, self._problem(changed, other), _EFFORT)).cost < fit.cost:
                problem, fit, delay = self._problem(changed, other), tried, other
        # The poles may be what is better, and not the operator.
        without = [
            refine_poles(sections, self._problem(self.ground, each), _EFFORT) for each in (self.linear.delay, delay)
        ]
        cost = min(base[1].cost, *(each.cost for each in without))
        if fit.cost >= cost:
            return None
        least = rounding(problem.experiments)
        share = max(fit.cost, least) / max(cost, least)
        rows = fit.fit.residuals.size / max(1.0, colour(problem, fit))
        behind = _Plant(problem, fit, delay)
        ratio, agreement = self._compared(_Plant(*base, self.linear.delay), behind, _OPERATORS[name], top)
        return NonlinearFit(name, top, share, -rows * float(np.log(share)), ratio, agreement, delay)

    def _compared(
        self, linear: "_Plant", behind: "_Plant", operator: Callable[[Array, float, float], Array], level: float
    ) -> tuple[float, float]:
        """Return the gain behind an operator over the linear plant's, and the fit of one to the other [%]."""
        amplitude = max(float(np.abs(each.inputs).max()) for each in self.ground.recordings)
        settle = self._settling(linear.fit)
        given = self._test_signal(settle, amplitude)
        first = min(linear.delay, behind.delay)
        ours = _response(linear, given, linear.delay - first)
        theirs = _response(behind, operator(given, level, self.period_s), behind.delay - first)
        spread = max(float(np.linalg.norm(theirs - theirs.mean())), float(np.finfo(float).tiny))
        agreement = 100 * (1 - float(np.linalg.norm(theirs - ours)) / spread)
        # Where the first level has been held: below the excited band both plants extrapolate, each to its own end.
        held = slice(settle + int(0.9 * settle), 2 * settle)
        return float(np.mean(theirs[held]) / np.mean(ours[held])), agreement

    @property
    def period_s(self) -> float:
        """Sampling period [s]."""
        return self.ground.recordings[0].sample_period_s

    def _settling(self, linear: Refinement) -> int:
        """Return how long a step takes to settle [samples]."""
        decay = -np.log(np.clip(np.abs(section_poles(linear.sections)), 1e-6, 1 - 1e-4))
        return min(int(_SETTLED / decay.min()) + 10, _SLOWEST_TEST // 10)

    def _test_signal(self, settle: int, amplitude: float) -> Array:
        """Return levels that are held until the axis rests, then sines through its band, shape (N,)."""
        band = np.clip(_SETTLED / settle / (2 * np.pi), 1e-4, 0.1)
        frequencies = band * np.geomspace(0.1, 2.5, _TEST_SINES)
        time = np.arange(min(int(10 / band), _SLOWEST_TEST // 2))
        phases = np.pi * np.arange(_TEST_SINES) ** 2 / _TEST_SINES
        sines = np.sum(np.sin(2 * np.pi * frequencies[:, None] * time + phases[:, None]), axis=0)
        levels = np.repeat([0.0, 1.0, -1.0, 0.5, 0.0], settle)
        return amplitude * np.concatenate([levels, sines / np.abs(sines).max()])

    def _cost(self, name: str, level: float) -> float:
        ground = self._changed(name, level)
        if name in _STATIC:
            problem = self._problem(ground, self.linear.delay)
            return solve(self.linear.refinement.sections, lay_out(*problem)).fit.cost
        # What lags by itself has made the linear plant slower than the one behind it.
        return min(self._fit(ground, self.linear.delay, power, _ROUGH)[1].cost for power in _FASTER)

    def _fit(
        self, ground: Ground, delay: int, power: float = 1.0, effort: Effort = _EFFORT
    ) -> tuple[Problem, Refinement]:
        problem = self._problem(ground, delay)
        sections = self.linear.refinement.sections
        if power != 1.0:
            poles = np.asarray(section_poles(sections), np.complex128)
            sections = sections_from_poles(np.abs(poles) ** power * np.exp(1j * np.angle(poles)))
        return problem, refine_poles(sections, problem, effort)

    def _problem(self, ground: Ground, delay: int) -> Problem:
        return Problem(ground.spectra(delay), self.linear.problem.feedthrough)

    def _changed(self, name: str, level: float) -> Ground:
        operator = _OPERATORS[name]
        changed = [
            replace(each, inputs=operator(each.inputs[:, 0], level, each.sample_period_s)[:, None])
            for each in self.ground.recordings
        ]
        whole = ground_of(changed, self.ground.scale, self.ground.skips, self.ground.from_rest)
        whole = whole._replace(lines=self.ground.lines)
        return whole.drifting() if self.ground.undelayed[0].drift is not None else whole


def _shortened(ground: Ground) -> Ground:
    most = _MOST_SAMPLES // len(ground.recordings)
    cut: list[Recording] = [each if len(each) <= most else slice_recording(each, 0, most) for each in ground.recordings]
    short = ground_of(cut, ground.scale, ground.skips, ground.from_rest).thinned(_LINES)
    return short.drifting() if ground.undelayed[0].drift is not None else short


def _steady_gain(refinement: Refinement, problem: Problem) -> float:
    (columns,) = transfer_columns(refinement.sections, np.ones(1, np.complex128), 1, problem.feedthrough)
    return float((columns @ linear_parameters(refinement.fit, problem.feedthrough))[0, 0].real)


class _Plant(NamedTuple):
    problem: Problem
    fit: Refinement
    delay: int


def _response(plant: _Plant, given: Array, delay: int) -> Array:
    """Return the response to an input from rest, so many samples late, shape (N,)."""
    linear = plant.fit.fit
    total = linear.feedthrough[0, 0] * given if plant.problem.feedthrough else np.zeros_like(given)
    for start, section in section_offsets(plant.fit.sections):
        state = np.concatenate([np.zeros(section.size), recursion(section, given)])
        for lag, weight in enumerate(linear.numerators[start : start + section.size, 0, 0], 1):
            total = total + weight * state[section.size - lag : section.size - lag + given.size]
    return np.concatenate([np.zeros(delay), total])[: given.size]


def _limited(command: Array, level: float, _: float) -> Array:
    return np.clip(command, -level, level)


def _beyond(command: Array, level: float, _: float) -> Array:
    return np.asarray(np.sign(command) * np.maximum(np.abs(command) - level, 0.0))


def _with_play(command: Array, level: float, _: float) -> Array:
    followed, place = np.empty_like(command), float(command[0])
    for index, wanted in enumerate(command.tolist()):
        place = min(max(place, wanted - level), wanted + level)
        followed[index] = place
    return followed


def _slewed(command: Array, level: float, period_s: float) -> Array:
    followed, place, most = np.empty_like(command), float(command[0]), level * period_s
    for index, wanted in enumerate(command.tolist()):
        place += min(max(wanted - place, -most), most)
        followed[index] = place
    return followed


_STATIC = ("saturation", "dead zone")
_OPERATORS: dict[str, Callable[[Array, float, float], Array]] = {
    "saturation": _limited,
    "dead zone": _beyond,
    "hysteresis": _with_play,
    "rate limit": _slewed,
}
