"""The report of an identified muzzle: what is known of it, how certain that is, and what to record next."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from archerfish2.identification.statistics import Array
from archerfish2.records.json_files import plain
from archerfish2.reports.report import Report
from archerfish2.reports.style import MUTED, PALETTE, new_figure, plot_style
from archerfish2.reports.table import Estimate, Table, entry_texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from archerfish2.identification.muzzle.identify import MuzzleResult


def muzzle_report(result: "MuzzleResult") -> Report:
    """Judge an identified muzzle: usable is one that neither a lack of fit nor the shots put in question."""
    fit, muzzle, shots = result.lack_of_fit, result.muzzle, result.shots
    shown = {name: _in_degrees(each) for name, each in result.estimates.items()}
    scatter = [
        f"{entry_texts(each)[0]} in {name[:-3]}" for name, each in shown.items() if name in ("pitch_sd", "yaw_sd")
    ]
    used, verdict = f"{np.count_nonzero(result.kept)} of {len(shots)} shots used", str(fit).partition(":")[0].lower()
    doubts = [each.message for each in result.findings if each.code == "too-many-outliers"] + [str(fit)] * fit.matters
    given = ", ".join(f"{name} {getattr(muzzle, name):g}" for name in ("height", "drag", "length") if name not in shown)
    sizes = np.bincount(shots.settings()[0][result.kept])
    more = sizes.size < 3 or sizes.min() < 10 or shots.speed is None
    again = f"archerfish2 identify muzzle {' '.join(map(str, shots.files))}"
    rises = shots.hit_height is None and not muzzle.length and np.ptp(shots.pitch) > np.radians(1)
    steps = (
        (rises, f"Measure how far the muzzle is from the pivot, for it rises with the pitch: {again} --length-m …"),
        (fit.matters, f"Measure angles [°], distances and height again; then: {again} --drag estimate"),
        (more, f"Shoot twenty times at each of three to five settings, with measured speeds: {again} MORE.csv"),
    )
    speed = "{} ({})".format(*entry_texts(shown["speed"]))
    rows = tuple((name.replace("_sd", " scatter").replace("_", " "), each) for name, each in shown.items())
    return Report(
        title=f"Muzzle from {shots.source}",
        headline=f"{speed}, scatter {' and '.join(scatter)}; {used}; {verdict}.",
        usable=not doubts,
        reasons=tuple(doubts),
        known=(str(fit), f"Given, not estimated: {given} (SI units)."),
        next_steps=tuple(text for is_due, text in steps if is_due),
        tables=(Table("Parameters", ("parameter", "estimate, 95 %"), rows),),
        figures=(("Measured less modelled", result.plot),),
        findings=result.findings,
        provenance=plain(muzzle.provenance),
    )


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
