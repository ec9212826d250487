"""What speaks against shots: impossible values before the fit, then outliers, lack of fit and dependence."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from archerfish2.errors import InputError
from archerfish2.identification.muzzle import estimate
from archerfish2.identification.muzzle.estimate import Known, MuzzleFit, rounding_step
from archerfish2.identification.muzzle.flight import azimuth, landing_distance, linearised, vertical
from archerfish2.identification.statistics import Array
from archerfish2.logs.shots import Shots

Flags = NDArray[np.bool_]

_FALSE_ALARM = 0.01
"""Share of clean sets that lose a shot, and of independent ones that are called dependent."""
_GRID = {"speed": (8, 12, 16, 20, 25), "pitch_offset": (-0.1, -0.03, 0.0, 0.03), "height": (0.4,), "drag": (0.02,)}
"""From where the free parameters are sought: speed and offset trade against each other."""


def check_shots(shots: Shots, known: Known) -> None:
    """Refuse shots that can't be what they are said to be, or that can't separate the parameters that are not known.

    Raises:
      InputError: with a code and what to do.
    """
    for is_there, problem, remedy, code in _faults(shots, estimate.free_names(known)):
        if is_there:
            raise InputError(f"{shots.source}: {problem}; {remedy}", code)


def _faults(shots: Shots, free: list[str]) -> Iterator[tuple[bool, str, str, str]]:
    """Yield whether a fault is there, what it is, what to do, and its code."""
    count, speed = len(shots), np.array([1.0, 35.0]) if shots.speed is None else shots.speed
    yield count < 5, f"{count} shots are too few", "shoot at least 5, better 100", "too-few-shots"
    middle = float(np.median(speed))
    yield (not 1 <= middle <= 35, f"the median speed is {middle:g} m/s, not 1 to 35", "give m/s", "implausible-speed")
    yield (
        not np.ptp(speed),
        f"each speed is {middle:g} m/s, a nominal one",
        "measure or leave it out",
        "nominal-speed",
    )
    # The fastest pellet, 20° off the barrel, from 3 m; ricochets may be anywhere: of hits, more than half are.
    reach = landing_distance(np.array(35.0), np.minimum(shots.pitch + 0.35, 0.78), np.array(3.0), np.array(0.0))
    rise, side = (shots.distance * np.tan(np.minimum(np.abs(each) + 0.35, 1.5)) for each in (shots.pitch, shots.yaw))
    lengths = ((shots.distance, reach, 0.0), (shots.hit_height, np.maximum(rise, 3.0), 0.5), (shots.lateral, side, 0.5))
    for length, limit, share in lengths:
        if length is not None and (bad := np.abs(length) > limit).mean() > share:
            large, first = bad.mean() > 0.5 and np.median(np.abs(length[bad])) >= 10, int(np.argmax(bad))
            problem = f"{shots.place(first)}: {length[first]:g} m is beyond the reach of a pellet of 35 m/s"
            yield large, problem, "these look like millimetres: give metres", "millimetres"
            yield True, problem, "correct the value or remove the line", "beyond-reach"
    for start, first in repeated(shots)[1][:1]:
        problem = f"{shots.place(start)} and those after it repeat {shots.place(first)} and those after it"
        yield True, problem, "give every shot once", "duplicate-shots"
    away = vertical(shots) - setting_means(shots, vertical(shots))
    same = shots.speed is None and len(shots.settings()[1]) < count and float(np.ptp(away)) < 1e-9
    yield same, "all shots of a setting agree to the last digit", "give each shot, not their mean", "no-scatter"
    # A change of pitch moves all hits alike, so that these need a distance for each parameter.
    kind, values = "pitch settings", np.degrees(shots.pitch)
    kind, values = (kind, values) if shots.hit_height is None else ("target distances", shots.distance)
    settings, needed = np.unique(np.round(values, 2)).size, len(free) + 4 - (shots.speed is not None)
    problem = f"{settings} {kind} can't separate {' from '.join(free)}"
    remedy = f"measure speed_m_s of each shot, give --height-m and --drag, or shoot at {len(free)} {kind} that differ"
    yield settings < len(free), problem, remedy, "not-separable"
    problem = f"{count} shots are too few for {len(free)} means and the scatter"
    yield count < needed, problem, f"shoot at least {needed}, better 20 at each of several {kind}", "too-few-shots"


def setting_means(shots: Shots, values: Array) -> Array:
    """Return for each shot the mean of a value over its setting, (N,) → (N,)."""
    number = shots.settings()[0]
    return np.asarray((np.bincount(number, values) / np.bincount(number))[number])


def repeated(shots: Shots) -> tuple[Flags, list[list[int]]]:
    """Return which shots are as one before, shape (N,), and begins and first begins of runs that are there twice.

    Coarse measurements of a setting often agree: a run counts from a length that one set in a thousand has twice.
    """
    columns = (shots.pitch, shots.yaw, shots.distance, shots.hit_height, shots.speed, shots.lateral)
    rows = np.stack([each for each in columns if each is not None], axis=1)
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    alike = (sum(np.count_nonzero(number[lag:] == number[:-lag]) for lag in (1, 2)) + 1) / (2 * number.size - 1)
    length = min(max(3, int(np.ceil(np.log(2e-3 / number.size**2) / np.log(alike)))), number.size)
    runs = sliding_window_view(number, length)
    _, begin, same = np.unique(runs, axis=0, return_index=True, return_inverse=True)
    begins = np.stack([np.arange(len(runs)), begin[same]], axis=1)
    twice = (begins[:, 0] - begins[:, 1] >= length) & (np.ptp(runs, axis=1) > 0)
    # Of one measurement alone, equal values are no repetition.
    is_copy = (first[number] != np.arange(number.size)) & (shots.speed is not None or shots.lateral is not None)
    return is_copy, begins[twice].tolist()


def robust_fit(shots: Shots, known: Known) -> tuple[Array, Array, float]:
    """Fit the means by a loss of linear growth (soft L1), then by Cauchy's.

    Returns:
      The free parameters, shape (q,), the residuals in robust standard deviations, shape (N,), and the latter over that
      of typical spreads.
    """

    def ratio(point: Array) -> tuple[Array, Array]:
        there = linearised(shots, estimate.values_at(known, point))
        shape = np.sqrt(there.scales @ estimate.TYPICAL[shots.speed is not None :])
        return (vertical(shots) - there.mean) / shape, shape

    guesses = map(np.array, itertools.product(*(_GRID[name] for name in estimate.free_names(known))))
    point = min(guesses, key=lambda each: float(np.median(np.abs(ratio(each)[0]))))
    for loss in ("soft_l1", "soft_l1", "cauchy", "cauchy"):
        deviation, shape = ratio(point)
        step = rounding_step(vertical(shots)) / float(np.median(shape))
        scale = max(1.4826 * float(np.median(np.abs(deviation))), step / 3.5)
        point = estimate.fit_means(shots, known, point, shape * scale, 0.0, loss)
    return point, ratio(point)[0] / scale, scale


def without_outliers(shots: Shots, known: Known) -> tuple[Flags, MuzzleFit, int]:
    """Estimate the muzzle without ricochets and flyers.

    Suspects of a robust fit are left out first; then those beyond the quantile of Student's t that the furthest of as
    many good shots exceeds in 1 % of all sets (Bonferroni), by the fit without the suspects.

    Returns:
      Which shots were kept, shape (N,), their fit, and the number of outliers where they were too many, else 0.
    """
    point, deviation, _ = robust_fit(shots, known)
    number, kept, fit = shots.settings()[0], np.ones(len(shots), bool), None
    samples = [each for each in (shots.speed, azimuth(shots)) if each is not None]
    level = 1 - _FALSE_ALARM / (2 * len(shots) * (1 + len(samples)))
    for limit in (3.5, student.ppf(level, len(shots) - 1)) if len(shots) >= 10 else ():
        apart = np.abs(deviation)
        for own in (number == each for each in np.flatnonzero(np.bincount(number) >= 5)):
            # A setting that is off as a whole is a lack of fit, and none of its shots a ricochet.
            apart[own] = np.minimum(apart[own], np.abs(deviation[own] - np.median(deviation[own])))
        within = apart <= limit
        for sample in samples:
            step, good = rounding_step(sample), sample[kept]
            middle, spread = good.mean(), good.std(ddof=1)
            if fit is None:
                middle, spread = np.median(good), 1.4826 * np.median(np.abs(good - np.median(good)))
            within &= np.abs(sample - middle) - step / 2 <= limit * max(spread, step / np.sqrt(12))
        if within.mean() < 0.8:
            return np.ones_like(kept), estimate.fit_muzzle(shots, known, point), int(np.count_nonzero(~within))
        kept, fit = within, estimate.fit_muzzle(shots.select(within), known, point)
        mean, sd = estimate.expected(shots, fit)
        deviation = (vertical(shots) - mean) / np.hypot(sd, rounding_step(vertical(shots)) / np.sqrt(12))
    return kept, fit or estimate.fit_muzzle(shots, known, point), 0


class LackOfFit(NamedTuple):
    """Classical lack-of-fit test over settings of repeated shots; percentages are of the distance."""

    rms_percent: float  # root mean square over the settings of mean measured less modelled value [%]
    worst_percent: float  # the largest of them, with its sign [%]
    worst_setting: str  # the setting of that one
    replicate_percent: float  # standard deviation of repeated shots [%]; NaN without a test
    p_value: float  # probability of such deviations if the model is right (F test); 1 without a test
    variance_ratio: float  # mean squares of the settings' means over those within, F; 1 without a test

    @property
    def matters(self) -> bool:
        """Whether it is shown at 5 %, and above a fifth of the scatter, which is what widens the hits by 2 %."""
        return self.p_value < 0.05 and self.rms_percent > 0.2 * self.replicate_percent

    def __str__(self) -> str:
        verdict = "does not fit" if self.matters else "fits" if self.variance_ratio != 1 else "is not tested"
        text = f"The flight model {verdict}: it leaves {self.rms_percent:.1f} % of the distance (rms over the settings)"
        text += f", at worst {self.worst_percent:+.1f} % at {self.worst_setting}"
        tested = f"; repeated shots scatter by {self.replicate_percent:.1f} % (p = {self.p_value:.2g})"
        return text + tested * (self.variance_ratio != 1) + "."


def lack_of_fit(shots: Shots, fit: MuzzleFit, *, is_test: bool = True) -> LackOfFit:
    """Compare the deviations of the settings' means with the scatter inside the settings, where that is a test."""
    (number, names), share, ratio = (
        shots.settings(),
        fit.residual / setting_means(shots, shots.distance),
        fit.residual / fit.sd,
    )
    mean, mean_ratio = setting_means(shots, share), setting_means(shots, ratio)
    single, worst, spare = np.unique(number, return_index=True)[1], np.argmax(np.abs(mean)), len(shots) - len(names)
    left = 100 * float(np.sqrt(np.mean(mean[single] ** 2))), 100 * float(mean[worst]), names[number[worst]]
    if not (is_test and spare):
        return LackOfFit(*left, np.nan, 1.0, 1.0)
    # As many parameters as settings leave no freedom, and a right model would pass through all means.
    freedom, scatter = max(len(names) - fit.design.shape[1], 1), np.sqrt(np.sum((share - mean) ** 2) / spare)
    found = float(np.sum(mean_ratio**2) / freedom / (np.sum((ratio - mean_ratio) ** 2) / spare))
    return LackOfFit(*left, 100 * float(scatter), float(fisher.sf(found, freedom, spare)), found)


def memory(series: Array) -> tuple[float, float]:
    """Return Durbin and Watson's statistic of a series of shape (N,), and the coefficient of its autoregression.

    The latter, of first order and less the bias −(1 + 3 ρ)/N, is 0 unless of independent series less than 1 % are as
    much alike (normal approximation).
    """
    deviation = (series - series.mean()) / (series.std() or 1.0)
    statistic, rho = (
        float(np.sum(np.diff(deviation) ** 2)) / series.size,
        float(deviation[1:] @ deviation[:-1]) / series.size,
    )
    dependent = statistic > 0 and norm.sf((1 - statistic / 2) * np.sqrt(series.size)) < _FALSE_ALARM
    return statistic, min(rho + (1 + 3 * rho) / series.size, 0.97) if dependent else 0.0
