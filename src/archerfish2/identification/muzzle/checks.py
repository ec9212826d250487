"""What speaks against shots: impossible values before the fit, outliers, lack of fit and dependence after it."""

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from archerfish2.errors import InputError
from archerfish2.identification.muzzle.estimate import TYPICAL, MuzzleFit, fit_means, fit_muzzle, rounding_step
from archerfish2.identification.muzzle.flight import (
    RANGES,
    MuzzleProblem,
    azimuth,
    landing_distance,
    response,
    vertical,
)
from archerfish2.identification.statistics import Array
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots

FEWEST = 5
"""Shots that are needed at least; below twice as many none is left out."""

_FALSE_ALARM = 0.01
"""Share of clean sets that lose a shot, and of independent ones that are called dependent."""
_MOST_OUTLIERS = 0.2
_SUSPECT = 3.5
"""Robust standard deviations from which a shot is suspect."""
_REMEDIES = {
    "speed": "measure the muzzle speed of each shot (column speed_m_s)",
    "height": "measure the muzzle's height above the ground (--height-m)",
    "drag": "give the drag coefficient (--drag)",
}


def check_shots(shots: Shots) -> list[Finding]:
    """Refuse shots that can't be what they are said to be, and return findings on those that may be right.

    Raises:
      InputError: with a code: too few shots, lengths in millimetres or beyond reach, speeds of no pellet or not
        measured, the same shots twice, no scatter at all.
    """
    if len(shots) < FEWEST:
        raise _refusal(
            shots, f"{len(shots)} shots are too few", f"shoot at least {FEWEST}, better 100", "too-few-shots"
        )
    low, high = RANGES["speed"]
    if shots.speed is not None and not low <= (middle := float(np.median(shots.speed))) <= high:
        problem = f"the median of the speeds is {middle:g} m/s, expected {low:g} to {high:g}"
        raise _refusal(shots, problem, "give them in m/s", "implausible-speed")
    if shots.speed is not None and np.ptp(shots.speed) == 0:
        problem = f"every shot has the speed {middle:g} m/s, a nominal one"
        raise _refusal(shots, problem, "measure that of each shot, or leave the column out", "nominal-speed")
    _check_reach(shots)
    number = shots.settings()[0]
    middle = np.bincount(number, vertical(shots)) / np.bincount(number)
    if number.size > middle.size and shots.speed is None and np.ptp(vertical(shots) - middle[number]) < 1e-9:
        problem = "all shots of a setting agree to the last digit"
        raise _refusal(shots, problem, "give each shot as it was measured, not their mean", "no-scatter")
    return _repetitions(shots)


def _refusal(shots: Shots, problem: str, remedy: str, code: str) -> InputError:
    return InputError(f"{shots.source}: {problem}; {remedy}", code)


def _check_reach(shots: Shots) -> None:
    """Compare lengths with the reach of the fastest pellet, 20° above the barrel's pitch, from a muzzle 3 m high."""
    fastest, astray, highest = RANGES["speed"][1], RANGES["pitch_offset"][1], RANGES["height"][1]
    up = np.minimum(shots.pitch + astray, np.pi / 4)
    far = shots.distance > landing_distance(np.array(fastest), up, np.array(highest), np.array(0.0))
    # Ricochets may be anywhere: heights and lateral distances are wrong only if most of them are.
    lengths = [(shots.distance, far, 0.0)]
    if (height := shots.hit_height) is not None:
        rise = shots.distance * np.tan(np.minimum(np.abs(shots.pitch) + astray, 1.5))
        lengths.append((height, (height > rise) | (height < -np.maximum(highest, rise)), 0.5))
    if (aside := azimuth(shots)) is not None and shots.lateral is not None:
        lengths.append((shots.lateral, np.abs(aside) > astray, 0.5))
    for length, bad, share in lengths:
        if bad.mean() > share:
            first = int(np.argmax(bad))
            problem = f"{shots.place(first)}: {length[first]:g} m is beyond the reach of a pellet of {fastest:g} m/s"
            if bad.mean() > 0.5 and np.median(np.abs(length[bad])) >= 10:
                raise _refusal(shots, problem, "these look like millimetres: give metres", "millimetres")
            raise _refusal(shots, problem, "correct the value or remove the line", "beyond-reach")


def _repetitions(shots: Shots) -> list[Finding]:
    """Refuse a run of shots that is there twice, as after pasting it, and find single ones."""
    columns = (shots.pitch, shots.yaw, shots.distance, shots.hit_height, shots.speed, shots.lateral)
    rows = np.stack([each for each in columns if each is not None], axis=1)
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    # Coarse measurements of a setting often agree: a run counts from a length that one set in a thousand has twice.
    alike = (sum(np.count_nonzero(number[lag:] == number[:-lag]) for lag in (1, 2)) + 1) / (2 * number.size - 1)
    length = max(3, int(np.ceil(np.log(2e-3 / number.size**2) / np.log(alike))))
    seen: dict[bytes, int] = {}
    for start, block in enumerate(sliding_window_view(number, min(length, number.size))):
        if np.ptp(block) and seen.setdefault(block.tobytes(), start) <= start - length:
            problem = (
                f"{shots.place(start)} and those after it repeat {shots.place(seen[block.tobytes()])} and those after"
            )
            raise _refusal(shots, problem, "give every shot once", "duplicate-shots")
    again = np.flatnonzero(first[number] != np.arange(number.size))
    if not again.size or (shots.speed is None and shots.lateral is None):
        return []
    places = ", ".join(shots.place(index) for index in again[:5].tolist())
    message = f"{again.size} shots agree to the last digit with an earlier one, among them {places}"
    return [
        _warning(shots, "repeated-shots", message, "remove them if they were written twice: intervals are too short")
    ]


def check_separable(problem: MuzzleProblem, fit: MuzzleFit | None = None) -> None:
    """Refuse shots at too few settings for the free parameters, or at settings too near each other.

    Hits on a plane need a distance of its own for each parameter: a change of pitch moves all of them alike.

    Raises:
      InputError: naming the parameters that can't be separated, and the measurement that is missing.
    """
    shots, free, on_plane = problem.shots, problem.free, problem.shots.hit_height is not None
    kind, values = ("target distances", shots.distance) if on_plane else ("pitch settings", np.degrees(shots.pitch))
    count, needed, blurred = np.unique(np.round(values, 2)).size, len(free) + len(problem.spreads) + 2, ()
    more = f"shoot at {len(free)} {kind}" if count < len(free) else f"shoot at {kind} that lie further apart"
    if count < len(free):
        blurred = free
    elif len(shots) < needed:
        problem_text = f"{len(shots)} shots are too few for {len(free)} means and the standard deviations"
        raise _refusal(
            shots, problem_text, f"shoot at least {needed}, better 20 at each of the {kind}", "too-few-shots"
        )
    elif fit is not None:
        spreads = fit.response.scales / fit.sd[:, None] ** 2
        for names, columns in ((free, fit.design / fit.sd[:, None]), (problem.spreads, spreads)):
            _, values, directions = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
            if names and values[-1] < 1e-3:  # the derivatives are the same to a part in a thousand
                blurred = tuple(itertools.compress(names, np.abs(directions[-1]) > 0.1))
    if blurred:
        remedies = dict.fromkeys(_REMEDIES[each] for name in blurred if (each := name.removesuffix("_sd")) in _REMEDIES)
        said = " from ".join(name.replace("_sd", " scatter").replace("_", " ") for name in blurred)
        problem_text = f"{count} {kind} can't separate {said}"
        raise _refusal(shots, problem_text, ", or ".join([*remedies, more]), "not-separable")


class RobustFit(NamedTuple):
    """A fit that a minority of bad shots can't spoil."""

    point: Array  # free parameters, (q,)
    deviation: Array  # residuals in robust standard deviations, (N,)
    scale: float  # robust standard deviation over that of typical spreads


def robust_fit(problem: MuzzleProblem) -> RobustFit:
    """Fit the means by the soft-L1 loss, from the best of some speeds and offsets, which trade against each other."""
    grid = {
        "speed": (8.0, 12.0, 16.0, 20.0, 25.0),
        "pitch_offset": (-0.1, -0.03, 0.0, 0.03),
        "height": (0.4,),
        "drag": (0.02,),
    }
    guesses = [np.array(each) for each in itertools.product(*(grid[name] for name in problem.free))]

    def ratio(point: Array) -> tuple[Array, Array]:
        there = response(problem, problem.values(point))
        shape = np.sqrt(there.scales @ TYPICAL[-len(problem.spreads) :])
        return (vertical(problem.shots) - there.mean) / shape, shape

    point = min(guesses, key=lambda each: float(np.median(np.abs(ratio(each)[0]))))
    for _ in range(4):
        deviation, shape = ratio(point)
        scale = max(
            1.4826 * float(np.median(np.abs(deviation))),
            rounding_step(vertical(problem.shots)) / np.median(shape) / 3.5,
        )
        last, point = point, fit_means(problem, point, shape * scale, 0.0, "soft_l1")
    deviation, shape = ratio(point)
    return RobustFit(point, deviation / scale, scale)


def without_outliers(problem: MuzzleProblem) -> tuple[Array, MuzzleFit, int]:
    """Estimate the muzzle without ricochets and flyers.

    A shot is left out beyond the quantile of Student's t that the furthest of as many good shots exceeds in 1 % of all
    sets (Bonferroni), first by a robust fit, then by the fit without those. None is where they are more than a fifth.

    Returns:
      Which shots were kept, shape (N,), their fit, and the number of outliers that were too many, else 0.
    """
    robust, shots = robust_fit(problem), problem.shots
    number, kept, deviation = shots.settings()[0], np.ones(len(shots), bool), robust.deviation
    samples = [each for each in (shots.speed, azimuth(shots)) if each is not None]
    level = 1 - _FALSE_ALARM / (2 * len(shots) * (1 + len(samples)))
    fit = None
    for limit in (_SUSPECT, student.ppf(level, len(shots) - 1)) if len(shots) >= 2 * FEWEST else ():
        deviations = [_apart(number, deviation)]
        for sample in samples:
            own, step = sample[kept], rounding_step(sample)
            middle, spread = np.median(own), 1.4826 * np.median(np.abs(own - np.median(own)))
            if fit is not None:
                middle, spread = own.mean(), own.std(ddof=1)
            away = np.maximum(np.abs(sample - middle) - step / 2, 0.0)
            deviations.append(away / max(spread, step / np.sqrt(12), 1e-12))
        kept = np.max(deviations, axis=0) <= limit
        if kept.mean() < 1 - _MOST_OUTLIERS:
            everything = np.ones(kept.size, bool)
            return everything, fit_muzzle(problem, robust.point), int(np.count_nonzero(~kept))
        fit = fit_muzzle(replace(problem, shots=shots.select(kept)), robust.point)
        there = response(problem, fit.values)
        shift, sd = 0.5 * there.curvatures @ fit.variances, np.sqrt(there.scales @ fit.variances)
        deviation = (vertical(shots) - there.mean - shift) / np.hypot(sd, rounding_step(vertical(shots)) / np.sqrt(12))
    return kept, fit or fit_muzzle(problem, robust.point), 0


def _apart(number: NDArray[np.intp], deviation: Array) -> Array:
    """How far each shot is from the model or from its setting's median, whichever is less, shape (N,).

    A setting that is off as a whole is a lack of fit, and none of its shots a ricochet.
    """
    apart = np.abs(deviation)
    for group in np.flatnonzero(np.bincount(number) >= 5):
        own = number == group
        apart[own] = np.minimum(apart[own], np.abs(deviation[own] - np.median(deviation[own])))
    return apart


class LackOfFit(NamedTuple):
    """Classical lack-of-fit test over settings of repeated shots; percentages are of the distance."""

    rms_percent: float  # root mean square over the settings of mean measured less modelled value [%]
    worst_percent: float  # the largest of them, with its sign [%]
    worst_setting: str  # of that one
    replicate_percent: float | None  # standard deviation of repeated shots [%]; None without repetitions
    p_value: float | None  # probability of such deviations if the model is right (F test); None without repetitions
    variance_ratio: float  # mean squares of the settings' means over those within, F; 1 without repetitions

    @property
    def shown(self) -> bool:
        """Whether the model does not fit, at 5 %."""
        return self.p_value is not None and self.p_value < 0.05

    @property
    def matters(self) -> bool:
        """Whether it is off by more than a fifth of the scatter, which is what widens the hits by 2 %."""
        return self.shown and self.rms_percent > 0.2 * (self.replicate_percent or 0.0)

    def __str__(self) -> str:
        said = f"The flight model leaves {self.rms_percent:.1f} % of the distance (rms over the settings), at worst "
        said += f"{self.worst_percent:+.1f} % at {self.worst_setting}"
        if self.p_value is None or self.replicate_percent is None:
            return f"{said}; without repeated shots this can't be separated from scatter."
        said += f"; repeated shots scatter by {self.replicate_percent:.1f} %"
        verdict = "it does not fit" if self.matters else "a trifle beside the scatter" if self.shown else "it fits"
        return f"{said}: {verdict} (p = {self.p_value:.2g})."


def lack_of_fit(shots: Shots, residual: Array, sd: Array, parameters: int) -> LackOfFit:
    """Compare the deviations of the settings' means with the scatter inside the settings.

    Args:
      shots: N of them.
      residual: measured less modelled [m], shape (N,).
      sd: standard deviation of each measurement up to a common factor [m], shape (N,).
      parameters: number of parameters that were fitted to the means.
    """
    number, names = shots.settings()
    sizes = np.bincount(number)
    share = residual / (np.bincount(number, shots.distance) / sizes)[number]
    (mean, within), (mean_ratio, within_ratio) = (_parts(number, each) for each in (share, residual / sd))
    worst, spare = int(np.argmax(np.abs(mean))), number.size - sizes.size
    rms, most = 100 * float(np.sqrt(np.mean(mean**2))), 100 * float(mean[worst])
    if not spare or not within:
        return LackOfFit(rms, most, names[worst], None, None, 1.0)
    # As many parameters as settings leave no freedom, and a right model would pass through all means.
    freedom = max(sizes.size - parameters, 1)
    found = float((sizes @ mean_ratio**2 / freedom) / (within_ratio / spare))
    p_value = float(fisher.sf(found, freedom, spare))
    return LackOfFit(rms, most, names[worst], 100 * float(np.sqrt(within / spare)), p_value, found)


def _parts(number: NDArray[np.intp], values: Array) -> tuple[Array, float]:
    """Return the settings' means and the sum of squares within."""
    mean = np.bincount(number, values) / np.bincount(number)
    return mean, float(np.sum((values - mean[number]) ** 2))


def memory(series: Array) -> tuple[float, float]:
    """Return Durbin and Watson's statistic of a series of shape (N,), and its first-order autoregression.

    The latter, less the bias −(1 + 3 ρ)/N of a short series, is 0 unless independent series are as much alike in less
    than 1 % of cases (normal approximation).
    """
    deviation = series - series.mean()
    statistic = float(np.sum(np.diff(deviation) ** 2) / max(deviation @ deviation, 1e-300))
    if norm.sf((1 - statistic / 2) * np.sqrt(series.size)) >= _FALSE_ALARM:
        return statistic, 0.0
    rho = float(deviation[1:] @ deviation[:-1] / (deviation @ deviation))
    return statistic, min(rho + (1 + 3 * rho) / series.size, 0.97)


def _warning(shots: Shots, code: str, message: str, remedy: str, samples: int = 0) -> Finding:
    return Finding(code, "warning", shots.source, message, remedy, samples)
