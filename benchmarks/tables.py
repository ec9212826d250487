"""The tables of hit rates in README and docs, written from the committed results of a run.

    python benchmarks/tables.py runs/reproduce/results.json   # take the results of a run, and write the tables
    python benchmarks/tables.py                               # write the tables from what was taken before

Takes what the tables need into benchmarks/results/reproduce.json: the cells, paired differences, seed, commit and
versions; of a run whose code was changed and not committed, nothing is taken. Beside them it keeps a probe: the hits of
classical controllers in the first engagements of each cell, which a test repeats. A table stands between
`<!-- table NAME -->` and `<!-- /table -->`; a test compares.
"""

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_evaluation
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.evaluation.evaluate import cells
from archerfish.records import storage
from machine import describe_machine

ROOT = Path(__file__).parents[1]
RESULT = Path(__file__).parent / "results" / "reproduce.json"
PAGES = ("README.md", "docs/transfer.md", "docs/baselines.md")
"""Pages that may hold such tables."""
PROBE = ("kalman", "kalman-lq")
"""Controllers of the probe: what moves the one with a model of the gimbal or without moves the others too."""
PROBE_ENGAGEMENTS = 20
COLUMNS = {
    "history": "policy",
    "paper": "six numbers",
    "kalman": "Kalman",
    "kalman-tuned": "Kalman, tuned",
    "kalman-lq": "Kalman + preview LQ",
    "imm-lq": "IMM + preview LQ",
    "parabola-lq": "parabola + preview LQ (told the rule)",
    "oracle": "oracle (told the path)",
}
"""Controller → heading, in the order of the columns."""
PRINTED = {"history": "paper's PPO", "kalman": "paper's Kalman"}
"""Controller → heading of the paper's own column, which stands before it."""
Rows = Sequence[Sequence[str]]
_MARKED = re.compile(r"(<!-- table ([\w-]+) -->\n)(.*?)(<!-- /table -->)", re.DOTALL)


def rates(results: dict[str, Any], setting: str, limit: str) -> str:
    """Write the hit rates of a setting in percent: a row per target and range, a column per controller.

    Args:
      results: as `take` writes them.
      setting: of the cells.
      limit: command limit.
    """
    found = [cell for cell in results["cells"] if (cell["setting"], cell["command_limit"]) == (setting, limit)]
    shot = {(cell["controller"], cell["policy_seed"], *_place(cell)): cell for cell in found}
    seeds = {cell["controller"]: cell["policy_seed"] for cell in reversed(found)}
    places = list(dict.fromkeys(_place(cell) for cell in found))
    controllers = [each for each in COLUMNS if each in seeds]
    headings, columns = ["target, range"], [[_place_words(place) for place in places]]
    for name in controllers:
        column = [shot[name, seeds[name], *place] for place in places]
        if name in PRINTED:
            headings.append(PRINTED[name])
            columns.append([_number(cell["paper"]) for cell in column])
        headings.append(COLUMNS[name])
        columns.append([_rate(cell, with_interval=name == "history") for cell in column])
    if any(cell.get("bound") is not None for cell in found):
        headings.append("proven bound")
        columns.append([_bound([cell for cell in found if _place(cell) == place]) for place in places])
    return _markdown(headings, list(zip(*columns, strict=True)))


def differences(results: dict[str, Any], setting: str, limit: str) -> str:
    """Write by how many points the policy is above each controller, paired, with 95 % intervals.

    Args:
      results: as `take` writes them.
      setting: of the comparisons.
      limit: command limit.
    """
    found = [
        each
        for each in results["comparisons"]
        if (each["setting"], each["command_limit"], each["controller"]) == (setting, limit, "history")
    ]
    seed = min((each["policy_seed"] for each in found), default=0)
    found = [each for each in found if each["policy_seed"] == seed]
    places = list(dict.fromkeys(_place(each) for each in found))
    against = [name for name in COLUMNS if any(each["against"] == name for each in found)]
    points = {(each["against"], *_place(each)): each for each in found}
    rows = [[_place_words(place), *(_points(points[name, *place]) for name in against)] for place in places]
    return _markdown(["policy less", *(COLUMNS[name] for name in against)], rows)


TABLES: dict[str, Callable[[dict[str, Any]], str]] = {
    f"{kind}-{name}": lambda results, write=write, place=place: write(results, *place)
    for name, place in {
        "paper-gate": ("paper", "gate"),
        "paper-box": ("paper", "box"),
        "paper-los-2deg": ("paper", "los-2deg"),
        "identified-infantry": ("identified-infantry", "gate"),
        "infantry": ("infantry", "gate"),
        "worn": ("worn", "gate"),
    }.items()
    for kind, write in (("rates", rates), ("differences", differences))
}
"""Name between the markers → what writes the table."""


def rendered(page: str, results: dict[str, Any]) -> str:
    """Return the text of a page with its tables written again.

    Args:
      page: its text.
      results: as `take` writes them.
    """
    return _MARKED.sub(lambda found: f"{found[1]}\n{TABLES[found[2]](results)}\n\n{found[4]}", page)


def probe() -> list[dict[str, Any]]:
    """Count the hits of the classical controllers in the first engagements of each cell of the paper's setting."""
    setting = load_setting(SettingFiles())
    task = EvaluationTask(setting, "gate", PROBE_ENGAGEMENTS, 0, PROBE)
    counted = cells(make_ground(task), run_evaluation(task))
    names = ("controller", "table", "range_m", "hits", "shots")
    return [{name: _plain(getattr(cell, name)) for name in names} for cell in counted]


def take(path: Path) -> None:
    """Take what the tables need from the results of a run.

    Args:
      path: its results.json.
    """
    facts = storage.read_json(path)
    if facts["commit"].endswith("-dirty") or facts["quick"]:
        raise SystemExit(f"{path}: made by changed code or a quick run; commit, and run archerfish reproduce again")
    names = ("seed", "commit", "versions", "durations", "conditions", "cells", "comparisons", "drops")
    kept = {name: facts[name] for name in names}
    storage.write_json(RESULT, {**kept, "machine": describe_machine(), "probe": probe()})


def main() -> None:
    """Take the results of a run, if one is named, and write the tables of all pages."""
    if len(sys.argv) > 1:
        take(Path(sys.argv[1]))
    results = storage.read_json(RESULT)
    for name in PAGES:
        path = ROOT / name
        before = path.read_text()
        after = rendered(before, results)
        if after != before:
            storage.write_text(path, after)
        Console().print(f"{name}: {'written' if after != before else 'as it was'}")


def _place(cell: dict[str, Any]) -> tuple[Any, ...]:
    return cell["target"], *cell["range_m"]


def _place_words(place: Sequence[Any]) -> str:
    target, low, high = place
    return f"{'still' if target == 'static' else 'moving'}, {low:g}–{high:g} m"


def _rate(cell: dict[str, Any], *, with_interval: bool) -> str:
    shots = cell["shots"] + cell.get("withheld", 0)
    value = f"{100 * cell['hits'] / shots:.1f}"
    return f"**{value} ({100 * cell['low']:.1f}–{100 * cell['high']:.1f})**" if with_interval else value


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _bound(cell: Iterable[dict[str, Any]]) -> str:
    """Return the bound that holds for everyone but the oracle."""
    found = [each["bound"] for each in cell if each.get("bound") is not None and each["controller"] != "oracle"]
    return f"{100 * min(found):.1f}" if found else ""


def _points(each: dict[str, Any]) -> str:
    low, middle, high = (f"{100 * each[name]:+.1f}".replace("-", "−") for name in ("low", "difference", "high"))
    return f"{middle} ({low} to {high})"


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _markdown(headings: Sequence[str], rows: Rows) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(
        f"| {' | '.join(line)} |".replace("| --- |", "|---|").replace("---| ---", "---|---") for line in lines
    )


if __name__ == "__main__":
    main()
