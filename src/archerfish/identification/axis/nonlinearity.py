"""Which nonlinearity explains what a linear plant leaves of its logs: a Hammerstein model.

A static or hysteretic operator with one level acts on the command before a linear plant, which is fitted again behind
it. Behind the right operator the plant lacks the bias that the nonlinearity gives to a linear fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.fit import AxisFit
from archerfish.identification.axis.output_error import LinearFit, noise_colour, plant_of, refine, refine_best
from archerfish.identification.axis.sections import poles_of, sections_from_poles
from archerfish.identification.axis.spectrum import Experiment, Lines, lines_of, rounding_floor, thinned
from archerfish.identification.simulation import TINY, Array, first_motion, simulate
from archerfish.logs.recording import Recording

_MOST_SAMPLES, _LINES = 8000, 400  # of all logs
_FINE, _ROUGH = (10, 1e-4), (4, 1e-2)  # steps and tolerance of a fit
_FASTER = 2.5  # factor on the speed of poles: what lags by itself has made the linear plant slower
_LIMITS, _SHARES = np.array([0.3, 0.45, 0.6, 0.75, 0.9]), np.array([0.01, 0.03, 0.08, 0.2, 0.45])  # of the command
_SLEWS = np.array([0.25, 0.5, 0.8, 1.2, 2.5, 5.0])  # over the speed that the output reaches
_NEAR = (0.7, 1.35), (0.87, 1.15)  # factors on the best level that are tried next, and then on the best of those
_DELAYS = (-6, -4, -3, -2, -1, 1, 2)  # that are tried, over the linear plant's [samples]
_CLEAR, _SHARE = 15.0, 0.97  # likelihood gained from which an operator is named, and share of the residual up to which
_LEVELS, _SETTLED, _LONGEST = 60, 4.0, 2000  # of test steps; time constants until rest, samples of that at most


class Nonlinearity(NamedTuple):
    """An operator on the command that explains the logs clearly better, and the plant behind it."""

    name: str  # "saturation", "dead zone", "hysteresis" (backlash or friction) or "rate limit"
    level: float  # limit, or half width, in units of the input; of a rate limit per second
    residual_share: float  # power of its residual over the linear plant's
    gained: float  # twice the log likelihood
    gain_ratio: float  # steady output at the largest command over that of the linear plant
    agreement_percent: float  # fit of the linear plant to it, on steps as large as the largest command


def nonlinearity(found: AxisFit, recordings: Sequence[Recording]) -> Nonlinearity | None:
    """Return the operator that explains the logs best, if it is clearly better than none.

    Args:
      found: plant of one input and one output.
      recordings: from which it was identified.
    """
    if found.plant.D.shape != (1, 1):
        return None
    most, period_s = _MOST_SAMPLES // len(recordings), recordings[0].period_s
    commands, cut = list[Array](), list[Experiment]()
    for log, spectrum in zip(recordings, found.experiments, strict=True):
        # A log may rest for longer than that before it moves.
        at = max(0, first_motion(log.inputs) - most // 2)
        commands.append(np.asarray(log.inputs[at : at + most, 0]))
        pad, rest, skip = min(spectrum.pad, most), max(spectrum.rest - at, 1), max(spectrum.skip - at, 0)
        cut.append(replace(spectrum, y=spectrum.y[at : at + most], pad=pad, rest=rest, skip=skip))
    largest = max(float(np.abs(u).max()) for u in commands)
    span = max(float(np.ptp(u)) for u in commands)
    width = max(1, most // 1000)
    moves = [np.abs(log.outputs[width:, 0] - log.outputs[:-width, 0]) for log in recordings]
    fastest = max(float(np.quantile(move, 0.995)) for move in moves) / (width * period_s)
    speed = fastest / np.abs(found.plant.dc_gain.item())
    levels = largest * _LIMITS, largest * _SHARES, span / 2 * _SHARES, speed * _SLEWS
    search = _Search(found._replace(experiments=cut), commands, period_s)
    names = [name for name in _OPERATORS if name != "none"]
    fits = [search.best(name, tried.tolist()) for name, tried in zip(names, levels, strict=True)]
    best = min(filter(None, fits), key=lambda fit: fit.residual_share, default=None)
    return best if best and best.gained > _CLEAR and best.residual_share < _SHARE else None


class _Search:
    """Fits of few lines behind operators."""

    def __init__(self, found: AxisFit, commands: list[Array], period_s: float) -> None:
        self.found, self.commands, self.period_s = found, commands, period_s
        self.linear = self.logs("none", 0.0)
        self.picks = thinned(self.linear, _LINES)
        self.base = refine(found.fit.sections, self.lines(self.linear, found.structure.delay), *_FINE)
        poles = poles_of(self.base.sections)
        self.starts = [self.base.sections, sections_from_poles(poles * np.abs(poles) ** (_FASTER - 1))]

    def logs(self, name: str, level: float) -> list[Experiment]:
        inputs = [_OPERATORS[name](u, level, self.period_s)[:, None] for u in self.commands]
        return [replace(e, u=u) for e, u in zip(self.found.experiments, inputs, strict=True)]

    def lines(self, logs: list[Experiment], delay: int) -> list[Lines]:
        return lines_of(logs, self.picks, delay, self.found.structure.feedthrough)

    def best(self, name: str, levels: list[float]) -> Nonlinearity | None:
        """Fit the plant behind an operator at its best level; None if it explains no more than a linear one."""
        costs, at = dict[float, float](), self.found.structure.delay
        for factors in (*_NEAR, ()):
            for tried in levels:
                costs[tried] = refine_best(self.starts, self.lines(self.logs(name, tried), at), *_ROUGH).cost
            level = min(costs, key=costs.__getitem__)
            levels = [level * factor for factor in factors]
        logs = self.logs(name, level)
        fits = {at: refine_best(self.starts, self.lines(logs, at), *_FINE)}
        if fits[at].cost >= self.base.cost:
            return None
        for delay in (at + step for step in _DELAYS if at + step >= 0):
            fits[delay] = refine(fits[at].sections, self.lines(logs, delay), *_FINE)
        delay = min(fits, key=lambda tried: fits[tried].cost)
        # The poles or the delay may be what is better, and not the operator.
        other = [refine(fits[delay].sections, self.lines(self.linear, tried), *_FINE) for tried in (at, delay)]
        least = rounding_floor(logs)
        share = max(fits[delay].cost, least) / max(least, min(fit.cost for fit in (self.base, *other)))
        output = np.concatenate([lines.outputs[0] for lines in self.lines(logs, delay)])
        residual = fits[delay].residual[0].view(complex)
        colour = noise_colour(residual, output - residual)
        measured = sum(e.measured for e in logs) / sum(e.length for e in logs)  # a rest put before adds nothing
        gained = -2 * len(residual) * measured / colour * float(np.log(share))
        return Nonlinearity(name, level, share, gained, *self.compared(name, level, fits[delay], delay))

    def compared(self, name: str, level: float, fit: LinearFit, delay: int) -> tuple[float, float]:
        """Return the gain behind an operator over the linear plant's, and the fit of that one to it [%]."""
        structure, scale, period_s = self.found.structure, self.found.scale, self.period_s
        linear = plant_of(self.base, structure, scale, period_s)
        behind = plant_of(fit, structure._replace(delay=delay), scale, period_s)
        decay = -np.log(np.clip(np.abs(poles_of(self.base.sections)).max(), 1e-6, 1 - 1e-4))
        settle = min(int(_SETTLED / decay) + 10, _LONGEST) + max(structure.delay, delay)
        largest = max(float(np.abs(u).max()) for u in self.commands)
        levels = np.random.default_rng(0).uniform(-largest, largest, _LEVELS)
        given = np.concatenate([[0.0], np.full(settle, largest), levels.repeat(settle // 4)])
        ours = simulate(linear, given[:, None])
        theirs = simulate(behind, _OPERATORS[name](given, level, period_s)[:, None])
        agreement = 1 - np.linalg.norm(theirs - ours) / max(float(np.linalg.norm(theirs - theirs.mean())), TINY)
        return theirs[settle].item() / ours[settle].item(), 100 * float(agreement)


def _followed(command: Array, move: Callable[[float, float], float]) -> Array:
    """Return where each sample's move from the last place leads, from the first sample on."""
    return np.array(list(accumulate(command.tolist(), move)))


_OPERATORS: dict[str, Callable[[Array, float, float], Array]] = {
    "none": lambda u, *_: u,
    "saturation": lambda u, level, _: np.clip(u, -level, level),
    "dead zone": lambda u, level, _: u - np.clip(u, -level, level),
    "hysteresis": lambda u, level, _: _followed(u, lambda y, x: min(max(y, x - level), x + level)),
    "rate limit": lambda u, level, t: _followed(u, lambda y, x: y + min(max(x - y, -level * t), level * t)),
}
