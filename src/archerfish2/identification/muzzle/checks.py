"""What speaks against shots: impossible values before the fit, then outliers, lack of fit and dependence."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from archerfish2.errors import InputError
from archerfish2.identification.muzzle.estimate import (
    TYPICAL,
    MuzzleFit,
    fit_means,
    fit_muzzle,
    free_names,
    rounding_step,
    values_at,
)
from archerfish2.identification.muzzle.flight import RANGES, azimuth, landing_distance, response, vertical
from archerfish2.identification.statistics import Array
from archerfish2.logs.shots import Shots

Fault = tuple[bool, str, str, str]
"""Whether it is there, what it is, what to do, and its code."""

_FEWEST = 5
_FALSE_ALARM = 0.01
"""Share of clean sets that lose a shot, and of independent ones that are called dependent."""
_REMEDIES = {
    "speed": "measure the muzzle speed of each shot (column speed_m_s)",
    "height": "measure the muzzle's height above the ground (--height-m)",
    "drag": "give the drag coefficient (--drag)",
}
_GRID = {
    "speed": (8.0, 12.0, 16.0, 20.0, 25.0),
    "pitch_offset": (-0.1, -0.03, 0.0, 0.03),
    "height": (0.4,),
    "drag": (0.02,),
}


def check_shots(shots: Shots, known: Mapping[str, float]) -> None:
    """Refuse shots that can't be what they are said to be, or that can't separate the parameters that are not known.

    Raises:
      InputError: with a code and what to do.
    """
    for is_there, problem, remedy, code in itertools.chain(_faults(shots), _inseparable(shots, free_names(known))):
        if is_there:
            raise InputError(f"{shots.source}: {problem}; {remedy}", code)


def _faults(shots: Shots) -> Iterator[Fault]:
    yield (
        len(shots) < _FEWEST,
        f"{len(shots)} shots are too few",
        f"shoot at least {_FEWEST}, better 100",
        "too-few-shots",
    )
    (low, high), speed = RANGES["speed"], RANGES["speed"][:1] if shots.speed is None else shots.speed
    middle = float(np.median(speed))
    problem = f"the median of the speeds is {middle:g} m/s, expected {low:g} to {high:g}"
    yield not low <= middle <= high, problem, "give them in m/s", "implausible-speed"
    problem, remedy = f"every shot has the speed {middle:g} m/s, a nominal one", "measure each, or leave the column out"
    yield shots.speed is not None and not np.ptp(speed), problem, remedy, "nominal-speed"
    # The fastest pellet, 20° above the barrel's pitch, from a muzzle 3 m high.
    astray, highest = RANGES["pitch_offset"][1], RANGES["height"][1]
    reach = landing_distance(
        np.array(high), np.minimum(shots.pitch + astray, np.pi / 4), np.array(highest), np.array(0)
    )
    lengths = [(shots.distance, shots.distance > reach, 0.0)]
    # Ricochets may be anywhere: heights and lateral distances are wrong only if most of them are.
    if shots.hit_height is not None:
        rise = shots.distance * np.tan(np.minimum(np.abs(shots.pitch) + astray, 1.5))
        lengths += [
            (shots.hit_height, (shots.hit_height > rise) | (shots.hit_height < -np.maximum(highest, rise)), 0.5)
        ]
    if shots.lateral is not None and (aside := azimuth(shots)) is not None:
        lengths += [(shots.lateral, np.abs(aside) > astray, 0.5)]
    for length, bad, share in lengths:
        first, large = int(np.argmax(bad)), bad.mean() > 0.5 and np.median(np.abs(length[bad])) >= 10
        problem = f"{shots.place(first)}: {length[first]:g} m is beyond the reach of a pellet of {high:g} m/s"
        yield bad.mean() > share and large, problem, "these look like millimetres: give metres", "millimetres"
        yield bad.mean() > share, problem, "correct the value or remove the line", "beyond-reach"
    if block := _repeated_block(shots):
        problem = f"{shots.place(block[1])} and those after it repeat {shots.place(block[0])} and those after it"
        yield True, problem, "give every shot once", "duplicate-shots"
    number = shots.settings()[0]
    away = vertical(shots) - (np.bincount(number, vertical(shots)) / np.bincount(number))[number]
    same = bool(shots.speed is None and number.max() + 1 < number.size and np.ptp(away) < 1e-9)
    yield same, "all shots of a setting agree to the last digit", "give each shot, not their mean", "no-scatter"


def identical(shots: Shots) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return for each shot the first one with the same values, and its number among different ones, shape (N,) each."""
    columns = (shots.pitch, shots.yaw, shots.distance, shots.hit_height, shots.speed, shots.lateral)
    rows = np.stack([each for each in columns if each is not None], axis=1)
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first[number], number


def _repeated_block(shots: Shots) -> tuple[int, int] | None:
    """Return where a run of shots begins and is repeated, as after pasting it; None without one.

    Coarse measurements of a setting often agree: a run counts from a length that one set in a thousand has twice.
    """
    number = identical(shots)[1]
    alike = (sum(np.count_nonzero(number[lag:] == number[:-lag]) for lag in (1, 2)) + 1) / (2 * number.size - 1)
    length = max(3, int(np.ceil(np.log(2e-3 / number.size**2) / np.log(alike))))
    seen: dict[bytes, int] = {}
    for start, block in enumerate(sliding_window_view(number, min(length, number.size))):
        if np.ptp(block) and (first := seen.setdefault(block.tobytes(), start)) <= start - length:
            return first, start
    return None


def _inseparable(shots: Shots, free: list[str]) -> Iterator[Fault]:
    """Count settings: hits on a plane need a distance for each parameter, for a pitch moves all of them alike."""
    kind, values = "pitch settings", np.degrees(shots.pitch)
    kind, values = (kind, values) if shots.hit_height is None else ("target distances", shots.distance)
    count, needed = np.unique(np.round(values, 2)).size, len(free) + 4 - (shots.speed is not None)
    remedies = [_REMEDIES[name] for name in free if name in _REMEDIES]
    problem = f"{count} {kind} can't separate {' from '.join(free).replace('_', ' ')}"
    remedy = ", or ".join([*remedies, f"shoot at {len(free)} {kind} that differ"])
    yield count < len(free), problem, remedy, "not-separable"
    problem = f"{len(shots)} shots are too few for {len(free)} means and the standard deviations"
    yield len(shots) < needed, problem, f"shoot at least {needed}, better 20 at each of several {kind}", "too-few-shots"


def robust_fit(shots: Shots, known: Mapping[str, float]) -> tuple[Array, Array, float]:
    """Fit the means by the soft-L1 loss, from the best of some speeds and offsets, which trade against each other.

    Returns:
      The free parameters, shape (q,), the residuals in robust standard deviations, shape (N,), and the latter over that
      of typical spreads.
    """

    def ratio(point: Array) -> tuple[Array, Array]:
        there = response(shots, values_at(known, point))
        shape = np.sqrt(there.scales @ TYPICAL[shots.speed is not None :])
        return (vertical(shots) - there.mean) / shape, shape

    guesses = map(np.array, itertools.product(*(_GRID[name] for name in free_names(known))))
    point = min(guesses, key=lambda each: float(np.median(np.abs(ratio(each)[0]))))
    for loss in ("soft_l1", "soft_l1", "cauchy", "cauchy"):
        deviation, shape = ratio(point)
        scale = max(
            1.4826 * float(np.median(np.abs(deviation))), rounding_step(vertical(shots)) / np.median(shape) / 3.5
        )
        point = fit_means(shots, known, point, shape * scale, 0.0, loss)
    return point, ratio(point)[0] / scale, scale


def without_outliers(shots: Shots, known: Mapping[str, float]) -> tuple[NDArray[np.bool_], MuzzleFit, int]:
    """Estimate the muzzle without ricochets and flyers.

    Suspects of a robust fit are left out first; then those beyond the quantile of Student's t that the furthest of as
    many good shots exceeds in 1 % of all sets (Bonferroni), by the fit without the suspects.

    Returns:
      Which shots were kept, shape (N,), their fit, and the number of outliers where they were too many, else 0.
    """
    point, deviation, _ = robust_fit(shots, known)
    fit, kept, number = None, np.ones(len(shots), bool), shots.settings()[0]
    samples = [each for each in (shots.speed, azimuth(shots)) if each is not None]
    level = 1 - _FALSE_ALARM / (2 * len(shots) * (1 + len(samples)))
    for limit in (3.5, student.ppf(level, len(shots) - 1)) if len(shots) >= 2 * _FEWEST else ():
        # A setting that is off as a whole is a lack of fit, and none of its shots a ricochet.
        groups = [number == each for each in np.flatnonzero(np.bincount(number) >= 5)]
        own = sum((group * (deviation - np.median(deviation[group])) for group in groups), 0 * deviation)
        own = np.where(np.any(groups, axis=0), own, np.inf) if groups else np.inf
        within = np.minimum(np.abs(deviation), np.abs(own)) <= limit
        for sample in samples:
            step, good = rounding_step(sample), sample[kept]
            middle, spread = np.median(good), 1.4826 * np.median(np.abs(good - np.median(good)))
            middle, spread = (middle, spread) if fit is None else (good.mean(), good.std(ddof=1))
            within &= np.abs(sample - middle) - step / 2 <= limit * max(spread, step / np.sqrt(12))
        if within.mean() < 0.8:
            return np.ones(len(shots), bool), fit_muzzle(shots, known, point), int(np.count_nonzero(~within))
        kept, fit = within, fit_muzzle(shots.select(within), known, point)
        there, step = response(shots, fit.values), rounding_step(vertical(shots))
        sd = np.sqrt(there.scales @ fit.variances + step**2 / 12)
        deviation = (vertical(shots) - there.mean - 0.5 * there.curvatures @ fit.variances) / sd
    return kept, fit or fit_muzzle(shots, known, point), 0


def findings(
    shots: Shots, known: Mapping[str, float], kept: NDArray[np.bool_], too_many: int
) -> list[tuple[str, str, str]]:
    """Return code, message and remedy of what may spoil an estimate.

    Args:
      shots: N of them.
      known: parameters that are given.
      kept: which shots were used, shape (N,).
      too_many: outliers that were too many to be left out.
    """
    found, first = [], identical(shots)[0]
    if not kept.all():
        listed = ", ".join(shots.place(index) for index in np.flatnonzero(~kept).tolist())
        message = f"{np.count_nonzero(~kept)} of {kept.size} shots are ricochets or flyers, and were left out: {listed}"
        found += [("outliers", message, "see whether these lines are as they were measured")]
    if too_many:
        message = f"{too_many} of {kept.size} shots disagree with the rest, too many to leave out: all were used"
        found += [("too-many-outliers", message, "check the angles and distances of whole settings")]
    again = np.flatnonzero(first != np.arange(first.size)).tolist()
    if again and not (shots.speed is None and shots.lateral is None):
        message = f"{', '.join(map(shots.place, again[:5]))} agree to the last digit with shots before"
        found += [("repeated-shots", message, "remove what was written twice: it makes intervals too short")]
    degrees = np.degrees(shots.pitch)
    if np.ptp(degrees) and np.abs(degrees).max() < 0.7:
        scale = [robust_fit(replace(shots, pitch=each), known)[2] for each in (shots.pitch, degrees)]
        if scale[1] < 0.5 * scale[0]:
            message = "pitch angles explain the shots far better if they are radians"
            found += [("radians-as-degrees", message, "give degrees")]
    if shots.lateral is None:
        message = "without lateral distances the yaw offset and its scatter are unknown, and recorded as 0"
        found += [("no-lateral", message, "record how far left each pellet went")]
    return found


class LackOfFit(NamedTuple):
    """Classical lack-of-fit test over settings of repeated shots; percentages are of the distance."""

    rms_percent: float  # root mean square over the settings of mean measured less modelled value [%]
    worst_percent: float  # the largest of them, with its sign [%]
    worst_setting: str  # the setting of that one
    replicate_percent: float | None  # standard deviation of repeated shots [%]; None without repetitions
    p_value: float | None  # probability of such deviations if the model is right (F test); None without repetitions
    variance_ratio: float  # mean squares of the settings' means over those within, F; 1 without repetitions

    @property
    def shown(self) -> bool:
        """Whether the model does not fit, at 5 %."""
        return self.p_value is not None and self.p_value < 0.05

    @property
    def matters(self) -> bool:
        """Whether it is also off by more than a fifth of the scatter, which is what widens the hits by 2 %."""
        return self.shown and self.rms_percent > 0.2 * (self.replicate_percent or 0.0)

    def __str__(self) -> str:
        text = f"The flight model leaves {self.rms_percent:.1f} % of the distance (rms over the settings), at worst "
        text += f"{self.worst_percent:+.1f} % at {self.worst_setting}"
        if self.p_value is None:
            return f"{text}; this can't be separated from scatter or rounding."
        text += f"; repeated shots scatter by {self.replicate_percent:.1f} %"
        verdict = "it does not fit" if self.matters else "little beside the scatter" if self.shown else "it fits"
        return f"{text}: {verdict} (p = {self.p_value:.2g})."


def lack_of_fit(shots: Shots, fit: MuzzleFit, *, tested: bool = True) -> LackOfFit:
    """Compare the deviations of the settings' means with the scatter inside the settings, unless that is no test."""
    number, names = shots.settings()
    sizes = np.bincount(number)
    share = fit.residual / (np.bincount(number, shots.distance) / sizes)[number]
    values = np.stack([share, fit.residual / fit.sd])
    mean = np.stack([np.bincount(number, each) / sizes for each in values])
    within, spare = np.sum((values - mean[:, number]) ** 2, axis=1), number.size - sizes.size
    worst = int(np.argmax(np.abs(mean[0])))
    left = 100 * float(np.sqrt(np.mean(mean[0] ** 2))), 100 * float(mean[0, worst]), names[worst]
    if not (tested and spare and within.all()):
        return LackOfFit(*left, None, None, 1.0)
    # As many parameters as settings leave no freedom, and a right model would pass through all means.
    freedom = max(sizes.size - fit.design.shape[1], 1)
    found = float((sizes @ mean[1] ** 2 / freedom) / (within[1] / spare))
    return LackOfFit(*left, 100 * float(np.sqrt(within[0] / spare)), float(fisher.sf(found, freedom, spare)), found)


def memory(series: Array) -> tuple[float, float]:
    """Return Durbin and Watson's statistic of a series of shape (N,), and the coefficient of its autoregression.

    The latter, of first order and less the bias −(1 + 3 ρ)/N, is 0 unless of independent series less than 1 % are as
    much alike (normal approximation).
    """
    deviation = (series - series.mean()) / series.std()
    statistic = float(np.sum(np.diff(deviation) ** 2) / series.size)
    rho = float(deviation[1:] @ deviation[:-1] / series.size)
    dependent = norm.sf((1 - statistic / 2) * np.sqrt(series.size)) < _FALSE_ALARM
    return statistic, min(rho + (1 + 3 * rho) / series.size, 0.97) if dependent else 0.0
