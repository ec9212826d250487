"""An identified muzzle and its report: what is known of it, how certain that is, and what to record next."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from archerfish2.identification.muzzle.checks import Flags, LackOfFit
from archerfish2.identification.muzzle.flight import RANGES, SHAPING, vertical
from archerfish2.identification.statistics import Array, converted
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import Shots
from archerfish2.records.json_files import plain
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import MUTED, new_figure, plot_style
from archerfish2.reports.table import Estimate, Table, entry_texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LARGE_OFFSET = np.radians(2.0)  # beyond what a mounted barrel has
_NOTE = "Offset: mean angle off the barrel, up or left positive; scatter: standard deviation; 1° is 17 mm per metre."


@dataclass(frozen=True, eq=False)
class MuzzleResult:
    """An identified muzzle, and how well it explains N shots."""

    muzzle: MuzzleRecord
    estimates: dict[str, Estimate]  # by field of the record, in SI units; the other fields were given
    shots: Shots
    kept: Flags  # which shots were used, (N,)
    expected: Array  # landing distance, or height of the hit, of each shot by the model [m], (N,)
    expected_sd: Array  # standard deviation of each by the model [m], (N,)
    lack_of_fit: LackOfFit  # of the flight model
    findings: tuple[Finding, ...]  # what was repaired, and what may spoil the estimate

    def __repr__(self) -> str:
        return str(self.report)

    def save(self, folder: str | Path) -> None:
        """Write muzzle.json and muzzle.html.

        Raises:
          InputError: if they can't be written.
        """
        self.muzzle.save(Path(folder) / "muzzle.json")
        self.report.write_page(Path(folder) / "muzzle.html")

    def plot(self) -> "Figure":
        """Draw measured less expected distances or heights, a setting after the other, each in the order of fire."""
        number, names = self.shots.settings()
        order, place = np.argsort(number, kind="stable"), np.arange(len(self.shots))
        left, band = (100 * each[order] for each in (vertical(self.shots) - self.expected, 1.96 * self.expected_sd))
        used = self.kept[order]
        with plot_style():
            figure, [[axes]] = new_figure()
            axes.fill_between(place, -band, band, step="mid", color=MUTED, alpha=0.25, lw=0, label="95 % by the model")
            axes.plot(place[used], left[used], ".", label="measured")
            axes.plot(place[~used], left[~used], "x", label="left out")
            axes.set_xticks([place[number[order] == each].mean() for each in range(len(names))], names)
            axes.set(xlabel="setting", ylabel="measured less model [cm]")
            figure.legend(loc="outside lower center", ncols=3)
        return figure

    @property
    def report(self) -> Report:
        """Judge the muzzle: usable is one that neither a lack of fit nor the shots put in question."""
        fit, muzzle, shots, landed = self.lack_of_fit, self.muzzle, self.shots, self.shots.hit_height is None
        shown = {name: _in_degrees(each) for name, each in self.estimates.items()}
        text = {name: entry_texts(each) for name, each in shown.items()}
        scatter = " and ".join(f"{text[name][0]} in {name[:-3]}" for name in ("pitch_sd", "yaw_sd") if name in text)
        used = f"{np.count_nonzero(self.kept)} of {len(shots)} shots used"
        doubts = [each.message for each in self.findings if each.code == "too-many-outliers"] + [str(fit)] * fit.matters
        ends = (name for name in shown if name in SHAPING and self.estimates[name].value in RANGES[name])
        doubts += [f"The {name.replace('_', ' ')} ran to an end of its range: shoot at more settings." for name in ends]
        units = {"drag": "1/m", "length": "m"} | ({"height": "m"} if landed else {})
        given = {name: getattr(muzzle, name) for name in units if name not in shown}
        known = ", ".join(f"{name} {value:g} {units[name]}" for name, value in given.items())
        sizes = np.bincount(shots.settings()[0][self.kept])
        more = sizes.size < 3 or sizes.min() < 10 or shots.speed is None
        doubtful = [name for name in ("pitch_offset", "yaw_offset") if abs(getattr(muzzle, name)) > _LARGE_OFFSET]
        rises = landed and not muzzle.length and np.ptp(shots.pitch) > np.radians(1)
        given_so = "".join(f" --{name}-m {given[name]:g}" for name in ("height", "length") if given.get(name))
        again = f"archerfish2 identify muzzle {' '.join(map(str, shots.files))}"
        rise = "The muzzle rises with the pitch: measure how far it is from the pivot"
        settings = "Shoot twenty times at each of three to five settings, with measured speeds"
        steps = (
            (rises, f"{rise}: {again}{given_so} --length-m METRES"),
            (
                fit.matters and "drag" not in shown,
                f"Measure angles [°], distances and height again; then: {again}{given_so} --drag estimate",
            ),
            (more, f"{settings}: {again} MORE.csv{given_so}"),
        )
        rows = tuple((name.replace("_sd", " scatter").replace("_", " "), each) for name, each in shown.items())
        return Report(
            f"Muzzle from {shots.source}",
            f"{' ('.join(text['speed'])}), scatter {scatter}; {used}; {str(fit).partition(':')[0].lower()}.",
            usable=not doubts,
            reasons=tuple(doubts),
            known=(str(fit), f"Taken as given: {known}."),
            doubts=tuple(f"The {each.replace('_', ' ')} is large: check signs and the zero." for each in doubtful),
            next_steps=tuple(step for is_due, step in steps if is_due),
            tables=(Table("Parameters", ("parameter", "estimate, 95 %"), rows, _NOTE),),
            figures=(("Measured less modelled, shot by shot", self.plot),),
            findings=self.findings,
            provenance=plain(muzzle.provenance),
        )


def _in_degrees(each: Estimate) -> Estimate:
    return converted(each, np.degrees, "°") if each.unit == "rad" else each
