"""The words of an identified muzzle: what is known of it, how sure that is, and what to record next."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from archerfish.cli.interval_words import ends, with_margin
from archerfish.identification.muzzle.dispersion import dispersion_at
from archerfish.identification.muzzle.likelihood import MuzzleIdentification
from archerfish.records.shots import Shots, settings

LABELS = {
    "speed": ("muzzle speed", "m/s", 1.0),
    "speed_sd": ("its scatter (standard deviation)", "m/s", 1.0),
    "pitch_offset": ("pitch offset", "°", 180 / np.pi),
    "pitch_sd": ("its scatter (standard deviation)", "°", 180 / np.pi),
    "yaw_offset": ("yaw offset", "°", 180 / np.pi),
    "yaw_sd": ("its scatter (standard deviation)", "°", 180 / np.pi),
    "height": ("muzzle height", "m", 1.0),
    "drag": ("drag", "1/m", 1.0),
    "length": ("from pivot to muzzle", "m", 1.0),
}
"""Each parameter in words, with the unit that it is told in and what turns it into that unit."""

TELLING_RANGE_M = 3.0
"""Distance at which the scatter is told [m]: the middle of what the paper shoots at."""
_DOUBTFUL = ("too-many-outliers", "radians-as-degrees", "repeated-shots")
"""Codes of findings that put the whole estimate in question."""
_LEVEL = np.radians(1.0)
"""Range of pitch settings over which the muzzle counts as resting at one height [rad]."""
_FEW_SETTINGS = 3
_FEW_SHOTS = 10
_LOOSE = 0.3
"""Half width of a scatter's interval, as a share of it, beyond which more shots pay."""


class MuzzleVerdict(NamedTuple):
    """What a person should know of an identified muzzle."""

    headline: str
    """All in one line."""
    fits: bool
    """Whether nothing speaks against the flight model and the shots."""
    known: tuple[str, ...]
    """What is known, each a sentence."""
    doubts: tuple[str, ...]
    """What puts the estimate in question, each in sentences."""
    next_steps: tuple[str, ...]
    """What to do, the most useful first, each a sentence."""


def muzzle_verdict(shots: Shots, result: MuzzleIdentification) -> MuzzleVerdict:
    """Judge an identified muzzle.

    Args:
      shots: what it was identified from.
      result: the identification.
    """
    doubts = tuple(_doubts(result))
    return MuzzleVerdict(
        _headline(shots, result), not doubts, tuple(_known(shots, result)), doubts, tuple(_next_steps(shots, result))
    )


def told(result: MuzzleIdentification, name: str) -> str:
    """Write a parameter with its interval and its unit."""
    _, unit, scale = LABELS[name]
    value, interval = getattr(result.muzzle, name), result.muzzle.intervals.get(name)
    return f"{with_margin(value, interval, scale)}{'' if unit == '°' else ' '}{unit}"


def _headline(shots: Shots, result: MuzzleIdentification) -> str:
    fit = result.lack_of_fit
    flight = (
        f"the flight model does not fit ({fit.rms_percent:.2g} % off, rms over the settings)"
        if fit.matters
        else f"the flight model fits to {fit.rms_percent:.2g} % (rms over the settings)"
        if fit.shown
        else "too little to test the flight model with"
        if fit.p_value is None
        else "the flight model fits"
    )
    count = int(result.kept.sum())
    used = f"all {count} shots used" if result.kept.all() else f"{count} of {len(shots)} shots used"
    return f"muzzle: {told(result, 'speed')}, scatter {_spread_words(result)}; {used}; {flight}"


def _spread_words(result: MuzzleIdentification) -> str:
    (spread,) = dispersion_at(result.muzzle, [TELLING_RANGE_M])
    height = f"{100 * spread.vertical_sd:.2g} cm in height"
    side = f" and {100 * spread.lateral_sd:.2g} cm to the side" if "yaw_sd" in result.muzzle.intervals else ""
    return f"{height}{side} at {TELLING_RANGE_M:g} m"


def _known(shots: Shots, result: MuzzleIdentification) -> Iterator[str]:
    muzzle, intervals = result.muzzle, result.muzzle.intervals
    how = "as measured" if shots.speed is not None else "from where the pellets went"
    speed, scatter = told(result, "speed"), told(result, "speed_sd")
    yield f"Pellets leave at {speed} ({how}), scattering by {scatter} from shot to shot."
    side = "above" if muzzle.pitch_offset > 0 else "below"
    pitch, scatter = told(result, "pitch_offset"), told(result, "pitch_sd")
    yield f"They leave {side} the barrel's direction by the pitch offset, {pitch}, scattering by {scatter}."
    if "yaw_offset" in intervals:
        side = "left" if muzzle.yaw_offset > 0 else "right"
        yaw, scatter = told(result, "yaw_offset"), told(result, "yaw_sd")
        yield f"They leave to the {side} by the yaw offset, {yaw}, scattering by {scatter}."
    else:
        yield "Nothing is known of how they scatter to the side: it is recorded as none, which flatters every hit rate."
    given = [f"{LABELS[name][0]} {told(result, name)}" for name in ("height", "drag") if name not in intervals]
    if shots.on_plane:
        given = [each for each in given if "height" not in each]
    elif muzzle.length:
        given.append(f"{told(result, 'length')} from pivot to muzzle")
    if given:
        yield f"Taken as given, not estimated: {' and '.join(given)}."
    if intervals.keys() & {"height", "drag"}:
        found = [f"{LABELS[name][0]} {told(result, name)}" for name in ("height", "drag") if name in intervals]
        yield f"Estimated from the shots as well: {' and '.join(found)}."


def _doubts(result: MuzzleIdentification) -> Iterator[str]:
    if result.lack_of_fit.matters:
        yield (
            f"{result.lack_of_fit.statement} Settings are missed by more than chance, so the numbers below describe "
            "these settings at best."
        )
    for finding in result.findings:
        if finding.code in _DOUBTFUL:
            yield finding.text


def _next_steps(shots: Shots, result: MuzzleIdentification) -> Iterator[str]:
    codes = {finding.code for finding in result.findings}
    if not shots.on_plane and not result.muzzle.length and np.ptp(shots.pitch) > _LEVEL:
        yield (
            "Measure how far the muzzle is from the gimbal's pivot (--length-m): it rises with the pitch, which passes "
            "for a pitch offset, or another height, as long as it is taken to stay where it is."
        )
    if result.lack_of_fit.matters:
        height_given = not shots.on_plane and "height" not in result.muzzle.intervals
        options = [*(["leave --height-m out"] if height_given else []), "--estimate-drag"]
        yield (
            "Measure the angles, the distances and the muzzle's height once more; if they hold, let the shots tell "
            f"more ({', or '.join(options)}) with one more setting for each."
        )
    if shots.speed is None:
        yield (
            "Measure the speed of each shot (column speed_m_s; a chronograph will do): without, the speed's scatter is "
            f"only loosely known, {ends(result.muzzle.intervals['speed_sd'])} m/s here."
        )
    if shots.lateral is None:
        yield "Measure how far left or right each pellet went (column lateral_m): the scatter to the side is unknown."
    if "dependent-shots" in codes:
        yield "Pause between shots, or mix the settings: successive shots are alike, which undoes repetition."
    yield from _more_shots(shots, result)


def _more_shots(shots: Shots, result: MuzzleIdentification) -> Iterator[str]:
    sizes = np.bincount(settings(shots)[result.kept])
    if sizes.size < _FEW_SETTINGS:
        what = "planes at three to five distances" if shots.on_plane else "three to five pitch settings"
        yield f"Shoot at {what}: with {sizes.size} the flight model is hardly put to the test."
    if sizes.min() < _FEW_SHOTS:
        yield f"Shoot some twenty times at each setting; the least used one has {sizes.min()}."
        return
    for name in ("pitch_sd", "yaw_sd"):
        if name in result.muzzle.intervals:
            value, (low, high) = getattr(result.muzzle, name), result.muzzle.intervals[name]
            if high - low > 2 * _LOOSE * value:
                what = name.split("_")[0]
                loose = f"The scatter in {what} is loosely known, {told(result, name)}"
                yield f"{loose}: twice the shots narrow it by a third."
