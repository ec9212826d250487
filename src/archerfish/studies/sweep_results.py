"""What a sweep found: the hit rate of each setting, as a table, as a plot and on a page."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.evaluation.hit_rate import CONFIDENCE, hit_rate, weighted_mean
from archerfish.provenance import code_commit, library_versions
from archerfish.reports.report import Report, Reported
from archerfish.reports.style import Figure, look, new_figure, plot_style
from archerfish.reports.table import Entry, Estimate, Table, entry_texts
from archerfish.storage import write_bytes
from archerfish.studies.sweep_trial import TrialHits

_NONE = Estimate(math.nan, math.nan, math.nan, "%")


class Compared(NamedTuple):
    """A setting, with all its trainings together."""

    number: int  # its place, from 0 on
    parameters: dict[str, Any]  # what is varied
    hits: int  # of all its trainings
    decisions: int  # that they were counted over
    rate: Estimate  # hits per decision with the interval over engagements and seeds [%]; NaN if a training failed
    rates: tuple[float, ...]  # of each training, in the order of the seeds [%]
    problem: str  # why a training came to nothing; "" if none did

    @property
    def middle(self) -> int:
        """Place of the training with the middle rate, of two the lower one."""
        return int(np.argsort(self.rates, kind="stable")[(len(self.rates) - 1) // 2])


def pooled_settings(
    parameters: Sequence[Mapping[str, Any]], found: Sequence[Sequence[TrialHits]]
) -> tuple[Compared, ...]:
    """Pool the trainings of each setting.

    Trainings share their engagements, so hits are added up in each of them; to that interval comes, in squares,
    Student's interval of the mean over seeds, whose variance is pooled over the settings. With one seed it is that of
    these very trainings.

    Args:
      parameters: of each setting.
      found: by setting, the hits of its trainings.
    """
    whole = [trained for trained in found if not any(one.problem for one in trained)]
    freedom = sum(len(trained) - 1 for trained in whole)
    squares = sum(float(np.var([one.rate for one in trained])) * len(trained) for trained in whole)
    spread = math.sqrt(squares / freedom) if freedom else 0.0
    settings = []
    for number, (own, trained) in enumerate(zip(parameters, found, strict=True)):
        problem = next((one.problem for one in trained if one.problem), "")
        half_width = 100 * spread / math.sqrt(len(trained)) * (_quantile(freedom) if freedom else 0.0)
        hits, decisions = np.sum([one.total for one in trained], axis=0).tolist()
        rate = _NONE if problem else _widened(_pooled(trained), half_width)
        rates = tuple(100 * one.rate for one in trained)
        settings.append(Compared(number, dict(own), hits, decisions, rate, rates, problem))
    return tuple(settings)


def _quantile(freedom: int) -> float:
    from scipy.special import stdtrit  # slow to load

    return float(stdtrit(freedom, (1 + CONFIDENCE) / 2))


def _pooled(trained: Sequence[TrialHits]) -> Estimate:
    """Return the rate of trainings that share their engagements [%]."""
    estimates, weights = list[Estimate](), list[int]()
    for place, decisions in enumerate(trained[0].decisions):
        together = np.sum([one.hits[place] for one in trained], axis=0)
        counted = hit_rate(together, decisions * len(trained))
        estimates.append(Estimate(100 * counted.rate, 100 * counted.low, 100 * counted.high, "%"))
        weights.append(counted.decisions)
    return weighted_mean(estimates, weights)


def _widened(rate: Estimate, half_width: float) -> Estimate:
    low = rate.value - math.hypot(rate.value - rate.low, half_width)
    high = rate.value + math.hypot(rate.high - rate.value, half_width)
    return Estimate(rate.value, max(0.0, low), min(100.0, high), "%")


@dataclass(frozen=True, repr=False)
class Swept(Reported):
    """What a sweep found; printed as its report."""

    settings: tuple[Compared, ...]
    """In their order."""
    trained_for: str
    """Robot and task."""

    @property
    def best(self) -> Compared | None:
        """The setting that hits at least so much: with the highest lower end of its interval; None if all failed."""
        whole = [setting for setting in self.settings if not setting.problem]
        return max(whole, key=lambda setting: setting.rate.low, default=None)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per setting for a data frame; rates in %."""
        rows = []
        for one in self.settings:
            counts = {"hits": one.hits, "decisions": one.decisions, "rate": one.rate.value}
            interval = {"low": one.rate.low, "high": one.rate.high}
            by_seed = {f"rate_of_seed_{place}": rate for place, rate in enumerate(one.rates)}
            rows.append(
                {"setting": one.number, **one.parameters, **counts, **interval, **by_seed, "problem": one.problem}
            )
        return rows

    @property
    def report(self) -> Report:
        """The report, which prints, and writes a page."""
        rows = list[tuple[Entry, ...]]()
        for one in self.settings:
            parameters, counts = map(_shown, one.parameters.values()), f"{one.hits} of {one.decisions}"
            lowest, highest = f"{min(one.rates):.1f}", f"{max(one.rates):.1f}"
            spread = "failed" if one.problem else lowest if lowest == highest else f"{lowest}–{highest}"
            rows.append((str(one.number), *parameters, counts, one.rate, spread))
        columns = ("setting", *self.settings[0].parameters, "hits of decisions", "rate [%]", "trainings [%]")
        note = "In parentheses: the 95 % interval, over engagements and seeds; trainings: the lowest and the highest."
        return Report(
            title=f"Sweep for {self.trained_for}",
            headline=_headline(self.best, self.settings),
            known=("Measured in engagements that no evaluation has, the same for all settings.",),
            doubts=tuple(f"setting {one.number}: {one.problem}" for one in self.settings if one.problem),
            next_steps=("Evaluate the policy that is kept: of many, the best one looks too good.",)
            if self.best
            else (),
            tables=(Table("Hit rates", columns, tuple(rows), note),),
            figures=(("Hit rate against what is varied, with 95 % intervals", self.plot),),
            provenance={"commit": code_commit(), **library_versions()},
        )

    def plot(self) -> Figure:
        """Draw the hit rate against each parameter, or against the seeds if none is varied."""
        whole = [setting for setting in self.settings if not setting.problem]
        names = [*self.settings[0].parameters] or ["setting"]
        with plot_style():
            figure, axes = new_figure(len(names), 1, height=2.8 * len(names))
            for name, panel in zip(names, axes[:, 0], strict=True):
                values: list[Any] = [setting.parameters.get(name, "all") for setting in whole]
                if not all(type(value) in (int, float) for value in values):
                    labels = list(dict.fromkeys(map(str, values)))
                    values = [labels.index(str(value)) for value in values]
                    panel.set_xticks(range(len(labels)), labels)
                elif whole and 0 < 10 * min(values) < max(values):
                    panel.set_xscale("log")
                rates = [setting.rate for setting in whole]
                below = [rate.value - rate.low for rate in rates]
                above = [rate.high - rate.value for rate in rates]
                style = {**look(0), "linestyle": ""}
                panel.errorbar(values, [rate.value for rate in rates], yerr=(below, above), **style, capsize=2)
                panel.set(xlabel=name, ylabel="hits [%]")
        return figure

    def save(self, folder: Path) -> None:
        """Write results.csv and report.html into a folder.

        Raises:
          InputError: if one can't be written.
        """
        stream, rows = io.StringIO(), self.to_dicts()
        writer = csv.DictWriter(stream, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_bytes(folder / "results.csv", stream.getvalue().encode())
        self.report.write_page(folder / "report.html")


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _headline(best: Compared | None, settings: Sequence[Compared]) -> str:
    if best is None:
        return f"No training came to a policy: {settings[0].problem}"
    given = ", ".join(f"{name} = {_shown(value)}" for name, value in best.parameters.items())
    rate, interval = entry_texts(best.rate)
    text = f"Best is setting {best.number}{given and f' ({given})'}: {rate} % ({interval})"
    # The rate of a setting that failed is no number.
    level = sum(one.rate.high >= best.rate.low for one in settings if one is not best)
    return text + f"; of {len(settings) - 1} others {level} have an interval that overlaps" * (len(settings) > 1)
