"""What a sweep prints and draws: the ranking in the terminal, the picture, the summary."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from archerfish.cli.sweeping.axes import short
from archerfish.cli.sweeping.ranking import Standing
from archerfish.cli.sweeping.results import TrialResult
from archerfish.figures.sweep import SweepPoint, sweep_figure

MOST_ROWS = 20
"""Rows per world in the terminal; the files have all."""


def print_standings(standings: Sequence[Standing], varied: Sequence[str], console: Console | None = None) -> None:
    """Print a table per world, the best configuration first.

    Args:
      standings: as ranked.
      varied: names of the parameters that tell configurations apart.
      console: where to; standard output if not given.
    """
    console = console or Console()
    for world in dict.fromkeys(each.world for each in standings):
        here = [each for each in standings if each.world == world]
        console.print(_table(world, here[:MOST_ROWS], varied))
        if len(here) > MOST_ROWS:
            console.print(f"and {len(here) - MOST_ROWS} more, in summary.json", markup=False, highlight=False)


def _table(world: str, standings: Sequence[Standing], varied: Sequence[str]) -> Table:
    title = f"\n{world}: hit rate in %, ranked by the lower end of its 95 % interval"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column("no.", justify="right")
    for name in varied:
        table.add_column(name.removeprefix("ppo.").removeprefix("gradient."), justify="right")
    for name in ("hits of shots", "rate", "interval", "seeds", "of each seed"):
        table.add_column(name, justify="right", no_wrap=True)
    for place, each in enumerate(standings):
        row = [str(each.configuration), *(short(each.parameters[name]) for name in varied), *_rates(each)]
        table.add_row(*row, style="bold" if place == 0 and not each.failed else "")
    return table


def _rates(standing: Standing) -> list[str]:
    seeds = len(standing.seeds) + standing.failed
    of = f"{len(standing.seeds)} of {seeds}" if standing.failed else str(seeds)
    if not standing.shots:
        return ["failed", "", "", of, ""]
    low, high, lowest, highest = (
        f"{100 * each:.1f}" for each in (standing.low, standing.high, standing.lowest, standing.highest)
    )
    each_seed = f"{lowest}–{highest}" if len(standing.seeds) > 1 else ""
    return [f"{standing.hits} of {standing.shots}", f"{100 * standing.rate:.1f}", f"{low}–{high}", of, each_seed]


def draw_sweep(standings: Sequence[Standing], results: Iterable[TrialResult], varied: Sequence[str]) -> Figure | None:
    """Draw hit rates against what was varied; against the seeds if nothing was; None where nothing was hit or missed.

    Args:
      standings: as ranked.
      results: of all trials.
      varied: names of the parameters that tell configurations apart.
    """
    if varied:
        best = {id(next(each for each in standings if each.world == world)) for world in {s.world for s in standings}}
        points = [
            _point(
                each.world, [each.parameters[name] for name in varied], each.rate, each.low, each.high, id(each) in best
            )
            for each in standings
            if each.shots
        ]
    else:
        points = [
            _point(each.world, [each.seed], each.rate, each.low, each.high, False)
            for each in results
            if each.low is not None and each.high is not None
        ]
    return sweep_figure(list(varied) or ["seed"], points) if points else None


def _point(world: str, values: list[Any], rate: float, low: float, high: float, best: bool) -> SweepPoint:
    return SweepPoint(world, values, 100 * rate, 100 * low, 100 * high, best)


def summarise(standings: Sequence[Standing], results: Iterable[TrialResult], out: str) -> dict[str, Any]:
    """Return what summary.json and --json say.

    Args:
      standings: as ranked.
      results: of all trials.
      out: folder of the sweep.
    """
    trials = sorted(results, key=lambda each: each.trial)
    best = {}
    for each in reversed(standings):
        if each.shots and not each.failed:
            best[each.world] = each
    return {
        "out": out,
        "trials": len(trials),
        "failed": sum(each.problem is not None for each in trials),
        "configurations": len({each.configuration for each in trials}),
        "seconds_of_trials": round(sum(each.seconds for each in trials), 2),
        "best": {world: {**asdict(each), "policy": _policy(each, trials)} for world, each in reversed(best.items())},
        "standings": [asdict(each) for each in standings],
    }


def _policy(standing: Standing, trials: Sequence[TrialResult]) -> str:
    """Return the policy of the training that was the middle one by hit rate: no seed is picked for its luck."""
    here = [each for each in trials if (each.world, each.configuration) == (standing.world, standing.configuration)]
    done = sorted((each for each in here if each.problem is None), key=lambda each: (each.rate, each.trial))
    return f"trials/{done[(len(done) - 1) // 2].trial:04d}/policy.json"
