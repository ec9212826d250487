"""What is wrong with a set of shots before anything is estimated: wrong units, invented speeds, shots given twice."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.muzzle.landing import landing_distance
from archerfish.identification.muzzle.model import RANGES
from archerfish.records.errors import InputError
from archerfish.records.shots import Shots, departure_azimuth, settings, vertical_measurement

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEWEST_SHOTS = 5

_FASTEST = RANGES["speed"][1]
_ASTRAY = RANGES["pitch_offset"][1]
_HIGHEST = RANGES["height"][1]
_BLOCK = 3
"""Fewest successive shots that count as a run."""
_BY_CHANCE = 1e-3
"""Share of sets without repetition in which a run may stand twice."""


class Remark(NamedTuple):
    """Something about a set of shots that the user should know."""

    code: str
    """Short, stable name; docs/shots.md lists them."""
    text: str
    """What it is and what to do, in sentences."""


def check_shots(shots: Shots) -> list[Remark]:
    """Refuse shots that can't be what they are said to be.

    Returns:
      Remarks on shots that are strange, but may be right.

    Raises:
      InputError: with a code: too few shots, millimetres or a place beyond reach, a speed that no pellet has, speeds
        that were not measured, the same shots twice, no scatter at all.
    """
    if len(shots) < FEWEST_SHOTS:
        raise _refusal(
            shots, f"{len(shots)} shots are too few", f"shoot at least {FEWEST_SHOTS}, better 100", "too-few-shots"
        )
    _check_speeds(shots)
    _check_reach(shots)
    _check_repeated_blocks(shots)
    _check_scatter(shots)
    return _repeated_rows(shots)


def _refusal(shots: Shots, problem: str, remedy: str, code: str) -> InputError:
    return InputError(f"{shots.source or 'shots'}: {problem}; {remedy}", code)


def _check_speeds(shots: Shots) -> None:
    if shots.speed is None:
        return
    middle = float(np.median(shots.speed))
    if not RANGES["speed"][0] <= middle <= _FASTEST:
        problem = f"the median of the speeds is {middle:g} m/s, expected {RANGES['speed'][0]:g} to {_FASTEST:g}"
        raise _refusal(shots, problem, "give the muzzle speed in m/s", "implausible-speed")
    if np.ptp(shots.speed) == 0:
        problem = f"every shot has the speed {middle:g} m/s, to the digit: a nominal speed, not a measured one"
        remedy = "leave the column out (shoot at several settings then), or measure the speed of each shot"
        raise _refusal(shots, problem, remedy, "nominal-speed")


def _check_reach(shots: Shots) -> None:
    """Compare with the reach of the fastest pellet, 20° above the barrel's pitch, from a muzzle 3 m high."""
    reach = landing_distance(np.array(_FASTEST), np.minimum(shots.pitch + _ASTRAY, np.pi / 4), _HIGHEST, 0.0)
    what = "the target plane" if shots.on_plane else "the landing point"
    _check_lengths(shots, shots.distance, shots.distance > reach, what)
    # Ricochets may be anywhere: these two are wrong only if most of them are.
    height = shots.hit_height
    if height is not None:
        rise = shots.distance * np.tan(np.minimum(np.abs(shots.pitch) + _ASTRAY, 1.5))
        # A slow pellet drops further than it could rise, but not below the ground.
        beyond = (height > rise) | (height < -np.maximum(_HIGHEST, rise))
        _check_lengths(shots, height, beyond, "the hit", share=0.5)
    azimuth = departure_azimuth(shots)
    if shots.lateral is not None and azimuth is not None:
        _check_lengths(shots, shots.lateral, np.abs(azimuth) > _ASTRAY, "the hit", share=0.5)


def _check_lengths(shots: Shots, length: Array, bad: Flags, what: str, share: float = 0.0) -> None:
    """Refuse lengths beyond reach if more than a share of them are, and say whether millimetres would explain it."""
    if np.count_nonzero(bad) <= share * bad.size:
        return
    first = int(np.argmax(bad))
    problem = f"{shots.place(first)}: {what} at {length[first]:g} m is beyond the reach of a pellet of {_FASTEST:g} m/s"
    if np.count_nonzero(bad) > 0.5 * bad.size and np.median(np.abs(length[bad])) >= 10.0:
        remedy = "these look like millimetres: give metres"
        raise _refusal(shots, f"{problem}, as are {np.count_nonzero(bad)} of {bad.size}", remedy, "millimetres")
    raise _refusal(shots, problem, "mend the value or remove the line; lengths are in metres", "beyond-reach")


def _rows(shots: Shots) -> Array:
    """All that is known of each shot, shape (N, columns)."""
    columns = [shots.pitch, shots.yaw, shots.distance, shots.hit_height, shots.speed, shots.lateral]
    return np.stack([column for column in columns if column is not None], axis=1)


def _check_repeated_blocks(shots: Shots) -> None:
    """Refuse a run of shots that stands in the set twice, as after pasting it or giving a file twice."""
    rows = _rows(shots)
    length = _telling_length(rows)
    seen: dict[bytes, int] = {}
    for start in range(len(rows) - length + 1):
        block = rows[start : start + length]
        if np.all(block == block[0]):
            continue
        first = seen.setdefault(block.tobytes(), start)
        if first <= start - length:
            problem = f"{shots.place(start)} and the lines after it repeat {shots.place(first)} and those after it"
            raise _refusal(shots, problem, "give every shot once", "duplicate-shots")


def _telling_length(rows: Array) -> int:
    """How many successive shots are not alike twice by chance: coarse measurements of one setting often agree."""
    near = [np.all(rows[lag:] == rows[:-lag], axis=1) for lag in (1, 2)]
    alike = (sum(int(np.count_nonzero(pairs)) for pairs in near) + 1) / (sum(pairs.size for pairs in near) + 2)
    pairs = len(rows) ** 2 / 2
    return max(_BLOCK, int(np.ceil(np.log(_BY_CHANCE / pairs) / np.log(alike))))


def _repeated_rows(shots: Shots) -> list[Remark]:
    """Remark on single shots that stand there twice, if they agree in more than one measurement."""
    measured = sum(each is not None for each in (shots.speed, shots.lateral)) + 1
    _, first, number = np.unique(_rows(shots), axis=0, return_index=True, return_inverse=True)
    again = [index for index, group in enumerate(number.ravel()) if first[group] != index]
    if measured < 2 or not again:
        return []
    listed = ", ".join(
        f"{shots.place(index)} (= {shots.place(int(first[number.ravel()[index]]))})" for index in again[:5]
    )
    more = ", …" if len(again) > 5 else ""
    return [
        Remark(
            "repeated-shots",
            f"Shots that agree to the last digit with an earlier one: {listed}{more}. "
            "If they were written down twice, remove them: they make the intervals too short.",
        )
    ]


def _check_scatter(shots: Shots) -> None:
    """Refuse repeated shots without any scatter: no muzzle shoots so."""
    number, measured = settings(shots), vertical_measurement(shots)
    sizes = np.bincount(number)
    middle = np.bincount(number, measured) / sizes
    if sizes.max() > 1 and np.all(np.abs(measured - middle[number]) < 1e-9) and shots.speed is None:
        problem = "all shots of a setting agree to the last digit"
        raise _refusal(shots, problem, "give each shot as it was measured, not their mean", "no-scatter")
