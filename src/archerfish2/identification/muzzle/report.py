"""The report of an identified muzzle: what is known of it, how certain that is, and what to record next."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from archerfish2.identification.muzzle.flight import linearised
from archerfish2.identification.statistics import Array
from archerfish2.logs.shots import Shots
from archerfish2.records.json_files import plain
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import MUTED, PALETTE, new_figure, plot_style
from archerfish2.reports.table import Estimate, Table, entry_texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.identification.muzzle.identify import MuzzleResult

_DOUBTFUL = ("too-many-outliers", "radians-as-degrees")
"""Findings that put the whole estimate in question."""
_DISTANCES = np.arange(1.0, 7.0)


def muzzle_report(result: "MuzzleResult") -> Report:
    """Judge an identified muzzle: usable is one that neither a lack of fit nor the shots put in question."""
    fit, muzzle, shots = result.lack_of_fit, result.muzzle, result.shots
    shown = {name: _in_degrees(each) for name, each in result.estimates.items()}
    text = {name: "{} ({})".format(*entry_texts(each)) for name, each in shown.items()}
    spread, side = 100 * dispersion(muzzle, _DISTANCES), shots.lateral is not None
    doubts = [each.message for each in result.findings if each.code in _DOUBTFUL] + [str(fit)] * fit.matters
    scatter = f"{spread[2, 0]:.1f} cm in height" + f" and {spread[2, 1]:.1f} cm to the side" * side
    used, verdict = f"{np.count_nonzero(result.kept)} of {len(shots)} shots used", str(fit).partition(":")[0].lower()
    known = [f"Pellets leave at {text['speed']}, scattering by {text['speed_sd']}."]
    for axis in ("pitch", "yaw")[: 1 + side]:
        known += [f"Their {axis} is off the barrel's by {text[f'{axis}_offset']}, scattering by {text[f'{axis}_sd']}."]
    known += ["The scatter to the side is recorded as none, which overestimates every hit rate."] * (not side)
    given = [f"{name} {getattr(muzzle, name):g}" for name in ("height", "drag", "length") if name not in shown]
    rows = [(f"{far:g} m", *each) for far, each in zip(_DISTANCES, spread.tolist(), strict=True)]
    parameters = [(name.replace("_sd", " scatter").replace("_", " "), each) for name, each in shown.items()]
    return Report(
        title=f"Muzzle from {shots.source}",
        headline=f"Muzzle: {text['speed']}, scatter {scatter} at 3 m; {used}; {verdict}.",
        usable=not doubts,
        reasons=tuple(doubts),
        known=(*known, str(fit), f"Given, not estimated: {', '.join(given)} (SI units)."),
        next_steps=_next_steps(result),
        tables=(
            Table("Parameters", ("parameter", "estimate, 95 %"), tuple(parameters)),
            Table("Dispersion, standard deviations [cm]", ("distance", "height", "side"), tuple(rows)),
        ),
        figures=(("Measured less modelled", result.plot),),
        findings=result.findings,
        provenance=plain(muzzle.provenance),
    )


def dispersion(muzzle: MuzzleRecord, distances: Array) -> Array:
    """Return the scatter of level shots in height and to the side at planes, by the delta method.

    Args:
      muzzle: its speed, offset and scatter.
      distances: of the planes [m], shape (N,).

    Returns:
      Standard deviations [m], shape (N, 2).
    """
    level = Shots(0 * distances, 0 * distances, distances, 0 * distances)
    values = {name: getattr(muzzle, name) for name in ("speed", "pitch_offset", "height", "drag", "length")}
    variance = linearised(level, values).scales @ np.square([muzzle.speed_sd, muzzle.pitch_sd])
    return np.stack([np.sqrt(variance), distances * muzzle.yaw_sd], axis=1)


def shots_by_setting(
    setting: NDArray[np.intp], residual: Array, sd: Array, kept: NDArray[np.bool_], *, names: list[str], title: str = ""
) -> "Figure":
    """Draw measured less expected distances or heights, a setting after the other, each in the order of fire.

    Args:
      setting: number of each shot's setting, shape (N,).
      residual: measured less expected [m], shape (N,).
      sd: of each by the model [m], shape (N,); the band holds 95 % of the shots.
      kept: which shots were used, shape (N,); the others are crosses.
      names: of the settings.
      title: above all.
    """
    order, place = np.argsort(setting, kind="stable"), np.arange(setting.size)
    with plot_style():
        figure, [[axes]] = new_figure()
        band = 196 * sd[order]
        axes.fill_between(place, -band, band, step="mid", color=MUTED, alpha=0.25, lw=0, label="95 % by the model")
        for used, label, marker, color in ((kept, "measured", ".", PALETTE[0]), (~kept, "left out", "x", PALETTE[1])):
            axes.plot(place[used[order]], 100 * residual[order][used[order]], marker, color=color, label=label)
        axes.set_xticks([place[setting[order] == each].mean() for each in range(len(names))], names)
        axes.set(xlabel="setting", ylabel="measured less model [cm]", title=title)
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _in_degrees(each: Estimate) -> Estimate:
    value, low, high = np.degrees(each[:3]).tolist()
    return Estimate(value, low, high, "°") if each.unit == "rad" else each


def _next_steps(result: "MuzzleResult") -> tuple[str, ...]:
    """Return what to do, the most useful first."""
    shots, sizes = result.shots, np.bincount(result.shots.settings()[0][result.kept])
    again = f"archerfish2 identify muzzle {' '.join(map(str, shots.files))}"
    moves = shots.hit_height is None and not result.muzzle.length and np.ptp(shots.pitch) > np.radians(1)
    loose = any(e.high - e.low > 0.6 * e.value for name, e in result.estimates.items() if name[:-3] in ("pitch", "yaw"))
    steps = (
        (moves, f"Measure how far the muzzle is from the pivot, for it rises with the pitch: {again} --length-m …"),
        (result.lack_of_fit.matters, f"Measure angles, distances and height again; then: {again} --drag estimate"),
        (shots.speed is None, "Measure the speed of each shot (column speed_m_s): its scatter is hardly known."),
        (shots.lateral is None, "Measure how far left each pellet went (column lateral_m)."),
        (sizes.size < 3, f"Shoot at three to five settings: {sizes.size} hardly test the flight model."),
        (sizes.min() < 10 or loose, f"Shoot some twenty times more at each setting, then: {again} MORE.csv"),
    )
    return tuple(text for is_due, text in steps if is_due)
