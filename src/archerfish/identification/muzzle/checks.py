"""Checks of shots: impossible values before the fit, then outliers and lack of fit."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, stats

from archerfish.errors import InputError
from archerfish.identification.muzzle import estimate
from archerfish.identification.muzzle.estimate import MuzzleFit, Parameters, azimuth, measured_vertical
from archerfish.identification.statistics import Array
from archerfish.logs.shots import Shots

Flags = NDArray[np.bool_]

_REACH = 130.0
"""Above what a pellet of 35 m/s reaches without drag, from 3 m above the ground [m]."""
_MEASURED = {
    "speed": "measure speed_m_s of each shot",
    "height": "measure the muzzle's height above the ground (height_m in [muzzle] of logs.toml, or --height-m)",
    "drag": "give the drag (--drag)",
}
"""How a parameter is known without a setting of its own."""
_LARGE, _LARGE_M = 1 / 3, 5e-3
"""Misfit that makes a muzzle useless: more than this share of a shot's scatter, which widens the hits by 5 %, and more
metres, a tenth of a small plate's half height."""
_SIGNIFICANT, _LARGE_LEVEL = 0.05, 0.02
"""Levels of the tests that there is a misfit, and that it is larger than that share; of good sets the latter refuses
one in some hundreds."""


def check_shots(shots: Shots, free: list[str]) -> None:
    """Refuse shots that can't be what they are said to be, or that can't separate the free parameters.

    Raises:
      InputError: with a code and what to do.
    """
    for is_there, problem, remedy, code in _faults(shots, free):
        if is_there:
            raise InputError(f"{shots.source}: {problem}; {remedy}", code)


def _faults(shots: Shots, free: list[str]) -> Iterator[tuple[bool, str, str, str]]:
    """Yield whether a fault is there, what it is, what to do, and its code."""
    # A change of pitch moves all hits by the same, so that these need a distance for each parameter.
    landed = shots.hit_height is None
    kind, values = ("pitch settings", np.degrees(shots.pitch)) if landed else ("target distances", shots.distance)
    count, settings = len(shots), np.unique(np.round(values, 2)).size
    needed = max(5, len(free) + 4 - (shots.speed is not None))
    remedy = f"shoot at least {needed}, better 20 at each of several {kind}"
    yield count < needed, f"{count} shots are too few for {len(free)} means and the scatter", remedy, "too-few-shots"
    if shots.speed is not None:
        middle = float(np.median(shots.speed))
        problem = f"the median speed is {middle:g} m/s, expected 1 to 35"
        yield not 1 <= middle <= 35, problem, "give m/s", "implausible-speed"
        problem = f"each speed is {middle:g} m/s, a nominal one"
        yield not np.ptp(shots.speed), problem, "give measured speeds, or none", "nominal-speed"
    lengths = ((shots.distance, _REACH), (shots.hit_height, shots.distance), (shots.lateral, shots.distance))
    large = any(np.median(np.abs(length) / most) > 1 for length, most in lengths if length is not None)
    yield large, "most distances or heights are beyond the reach of a pellet", "give metres", "millimetres"
    furthest = int(np.argmax(shots.distance))
    problem = f"{shots.place(furthest)}: {shots.distance[furthest]:g} m is beyond the reach of a pellet"
    yield shots.distance[furthest] > _REACH, problem, "correct the value or remove the line", "beyond-reach"
    scatter = np.abs(within_settings(shots, measured_vertical(shots))).max()
    same = shots.speed is None and scatter < 1e-9 and len(shots.settings()[1]) < count
    yield same, "all shots of a setting agree to the last digit", "give each shot, not their mean", "no-scatter"
    problem = f"{settings} {kind} can't separate {' from '.join(free)}"
    measurements = [how for name, how in _MEASURED.items() if name in free and settings == len(free) - 1]
    remedy = ", or ".join([*measurements, f"shoot at {len(free)} {kind} that differ"])
    yield settings < len(free), problem, remedy, "not-separable"


def within_settings(shots: Shots, values: Array) -> Array:
    """Return a value of each shot less the mean over its setting, (N,) → (N,)."""
    number = shots.settings()[0]
    return np.asarray(values - ndimage.mean(values, number, number))


def without_outliers(shots: Shots, free: list[str], known: Parameters) -> tuple[Flags, MuzzleFit, int]:
    """Estimate the muzzle without ricochets and flyers: shots far from a robust fit, or from the median azimuth.

    The limit is the quantile of Student's t that the furthest of as many good shots exceeds in 1 % of all sets
    (Bonferroni). Deviations are scaled by their median, which is as precise as a standard deviation of 0.37 N shots.

    Returns:
      Which shots were used, shape (N,), their fit, and the number of outliers where they were too many, else 0.
    """
    values, vertical = estimate.robust_fit(shots, free, known)
    number, sideways, count = shots.settings()[0], azimuth(shots), len(shots)
    # A setting of five shots that is off as a whole is a lack of fit, and none of its shots a ricochet.
    common = ndimage.median(vertical, number, number) * (np.bincount(number)[number] >= 5)
    deviation = np.minimum(np.abs(vertical), np.abs(vertical - common))
    if sideways is not None:
        spread = max(stats.median_abs_deviation(sideways, scale="normal"), estimate.rounding_step(sideways) / 3.5, 1e-9)
        deviation = np.maximum(deviation, np.abs(sideways - np.median(sideways)) / spread)
    used = (deviation <= stats.t.ppf(1 - 0.01 / (4 * count), 0.37 * count)) | (count < 10)
    too_many = int(np.count_nonzero(~used)) * (used.mean() < 0.8)
    used |= too_many > 0
    return used, estimate.fit_muzzle(shots.select(used), free, values), too_many


class LackOfFit(NamedTuple):
    """Classical lack-of-fit test over settings of repeated shots; percentages are of the distance."""

    rms_percent: float  # root mean square over the settings of mean measured less modelled value [%]
    worst_percent: float  # the largest of them, with its sign [%]
    worst_setting: str  # the setting of that one
    rms_m: float  # that root mean square as a length [m]
    variance_ratio: float = 1.0  # F: mean squares of the settings' means over those within; 1 without a test
    p_value: float = 1.0  # probability of a larger F if the model is right; 1 without a test
    matters: bool = False  # whether the misfit is significantly larger than what a shot's scatter hides

    @property
    def significant(self) -> bool:
        """Whether a right model would hardly deviate so much, however little that is."""
        return self.p_value < _SIGNIFICANT

    def __str__(self) -> str:
        verdict = "fits" if self.variance_ratio != 1 else "is not tested"
        if self.significant:
            verdict = "does not fit" if self.matters else "nearly fits"
        off = f"mean hits are {1e3 * self.rms_m:.0f} mm, {self.rms_percent:.1f} % of the distance, off"
        worst = f"at worst {self.worst_percent:+.1f} % at {self.worst_setting} (F test: p = {self.p_value:.2g})"
        return f"The flight model {verdict}: {off} (rms over the settings), {worst}."


def lack_of_fit(shots: Shots, fit: MuzzleFit, *, is_test: bool = True) -> LackOfFit:
    """Compare the deviations of the settings' means with the scatter inside the settings, where that is a test.

    A small misfit becomes significant with many shots, and in one of twenty good sets: neither spoils a muzzle. What
    does is a misfit that is significantly above a share of the scatter (minimum-effect test, Murphy and Myors 1999: F
    is compared with the non-central distribution of that misfit).

    Args:
      shots: N of them.
      fit: the estimate.
      is_test: whether the scatter is known.
    """
    number, names = shots.settings()
    mean = ndimage.mean(fit.residual, number, range(len(names)))
    percent = 100 * mean / ndimage.mean(shots.distance, number, range(len(names)))
    spare = len(shots) - len(names)
    worst = int(np.argmax(np.abs(percent)))
    rms_m = float(np.sqrt(np.mean(mean**2)))
    misfit = float(np.sqrt(np.mean(percent**2))), float(percent[worst]), names[worst], rms_m
    if not (is_test and spare and len(names) > 1):
        return LackOfFit(*misfit)
    ratio = fit.residual / fit.sd
    own = within_settings(shots, ratio)
    # As many parameters as settings leave no freedom, and a right model would pass through all means.
    freedom = max(len(names) - len(fit.free), 1)
    f_ratio = float(np.sum((ratio - own) ** 2)) / freedom / (float(np.sum(own**2)) / spare)
    p_value = float(stats.f.sf(f_ratio, freedom, spare))
    p_large = float(stats.ncf.sf(f_ratio, freedom, spare, len(shots) * _LARGE**2))
    return LackOfFit(*misfit, f_ratio, p_value, p_large < _LARGE_LEVEL and rms_m > _LARGE_M)
