"""The tables of README and docs, written from committed results.

    python benchmarks/tables.py runs/reproduce runs/transfer   # take the results of runs, and write the tables
    python benchmarks/tables.py                                # write the tables from what was taken before

Takes what the tables need of `archerfish reproduce` and `archerfish transfer --seeds 0 1 2` into
benchmarks/results/reproduce.json and transfer.json; of a run whose code was changed and not committed, or that was cut
short, nothing is taken. Beside the first it keeps a probe: hits of classical controllers in the first engagements of
each cell, which a test repeats. A table stands between `<!-- table NAME -->` and `<!-- /table -->`; a test compares.
"""

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_evaluation
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.evaluation.evaluate import cells
from archerfish.records import storage
from machine import describe_machine
from markdown_table import markdown
from motion_tables import eq7, motion_differences, motions, unseen
from strangers_judging import Row

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results"
REPRODUCE, TRANSFER = "reproduce", "transfer"
"""Runs that are taken, by the names of their files."""
IDENTIFICATION, ROBOTS, MOTIONS, UNSEEN = "identification", "other_robots", "motions", "unseen_motions"
STRANGERS = "strangers"
"""Benchmarks whose figures are written too."""
WITHOUT_RULE, WITH_RULE = ("kalman", "kalman-lq", "imm-lq"), "parabola-lq"
MOVING_FROM_2_M = (5, 6, 7)
"""Cells of moving targets at 2–5 m."""
DROPS = ("drop_settled_at_most", "drop_at_most")
LOGS = ("robot arm", "CD player arm", "hair dryer", "Silverbox", "quarter drone, steps")
OTHER_LOGS = ("quarter drone, sweep", "coupled drives", "ball and hoop", "flexible structure")
"""Logs that its table shows."""
PAGES = (
    "README.md",
    "docs/transfer.md",
    "docs/baselines.md",
    "docs/gradients.md",
    "docs/identification.md",
    "docs/targets.md",
)
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
CELL = ("target", "range_m")
_WHO = ("setting", "command_limit", "controller", "policy_seed")
_DIFFERENCE = ("difference", "low", "high")
KEPT = {
    "cells": (_WHO, ("hits", "shots", "withheld", "low", "high", "paper", "bound", "bound_error", "bound_kind")),
    "comparisons": ((*_WHO, "against"), _DIFFERENCE),
    "drops": ((*_WHO, "settled"), _DIFFERENCE),
}
"""Part of the results → its fields that are the same for all cells, and those that are kept of every cell."""
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
        headings.append("proven bound (without the path)")
        columns.append([_bound([cell for cell in found if _place(cell) == place]) for place in places])
    return markdown(headings, list(zip(*columns, strict=True)))


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
    return markdown(["policy less", *(COLUMNS[name] for name in against)], rows)


def trainings(results: dict[str, Any], setting: str, limit: str) -> str:
    """Write the policy's hit rate and its paired differences for each training, eight cells in a row.

    Args:
      results: as `take` writes them.
      setting: of the cells.
      limit: command limit.
    """
    where = (setting, limit, "history")
    mine = [each for each in results["cells"] if _where(each) == where]
    pairs = [each for each in results["comparisons"] if _where(each) == where]
    against = [name for name in COLUMNS if any(each["against"] == name for each in pairs)]
    rows = []
    for seed in sorted({each["policy_seed"] for each in mine}):
        lower = [
            " ".join(
                f"{100 * each['low']:+.1f}".replace("-", "−")
                for each in pairs
                if each["policy_seed"] == seed and each["against"] == name
            )
            for name in against
        ]
        rates = " ".join(_rate(each, with_interval=False) for each in mine if each["policy_seed"] == seed)
        rows.append([str(seed), rates, *lower])
    return markdown(["seed", "policy, %", *(f"less {COLUMNS[name]}" for name in against)], rows)


def drops(results: dict[str, Any], setting: str, limit: str) -> str:
    """Write how far hit rates fall from the simulator to a robot, in points: eight cells in a row.

    Args:
      results: as `take` writes them.
      setting: the robot.
      limit: command limit.
    """
    found = [each for each in results["drops"] if _where(each)[:2] == (setting, limit)]
    rows = []
    for name in COLUMNS:
        mine = [each for each in found if each["controller"] == name]
        seed = min((each["policy_seed"] for each in mine if each["policy_seed"] is not None), default=None)
        for settled in (False, True):
            values = [each for each in mine if each["policy_seed"] == seed and each["settled"] is settled]
            if values:
                points = " ".join(f"{100 * each['difference']:.1f}".replace("-", "−") for each in values)
                rows.append([COLUMNS[name], "settled" if settled else "all", points])
    return markdown(["controller", "shots", "points lost"], rows)


def fits(results: dict[str, Any], cases: Sequence[str]) -> str:
    """Write test and training fits in percent: a row per tool and setting, a column per log.

    Args:
      results: of benchmarks/identification.py.
      cases: logs.
    """
    found = {(each["tool"], each["setting"], each["case"]): each for each in results["rows"]}
    rows = [
        [f"{tool}, {setting}", *(_fit(found[tool, setting, case]) for case in cases)]
        for tool, setting in dict.fromkeys((each["tool"], each["setting"]) for each in results["rows"])
    ]
    return markdown(["test / training fit, %", *cases], rows)


def strangers(results: dict[str, Any]) -> str:
    """Write how often verdicts and intervals were right: a row for each share that has a bar.

    Args:
      results: of benchmarks/strangers.py.
    """
    rows = []
    for each in results["counts"]:
        low, high = each["low_bar"], each["high_bar"]
        if low is None and high is None:
            continue
        ends = (("≥", low), ("≤", high))
        bar = [f"{sign} {100 * end:g} %" for sign, end in ends if end is not None]
        first, last = (f"{100 * end:.1f}" for end in each["interval_95"])
        share = f"{100 * each['count'] / each['of']:.1f} % ({first}–{last})"
        rows.append([each["name"], share, f"{each['count']} of {each['of']}", ", ".join(bar)])
    return markdown(["", "share (95 %)", "logs", "aim"], rows)


def strangers_by_fault(results: dict[str, Any]) -> str:
    """Write how often verdicts were right: a row for each fault.

    Args:
      results: of benchmarks/strangers.py.
    """
    logs = [Row(**dict(zip(results["fields"], each, strict=True))) for each in results["rows"]]
    rows = []
    for fault in sorted({each.fault for each in logs}, key=lambda name: (name == "none", name)):
        here = [each for each in logs if each.fault == fault]
        wrong = sum(each.usable_said and not each.usable_true for each in here)
        refused = sum(each.good and not each.usable_said for each in here)
        rows.append([fault, *(str(each) for each in (len(here), sum(one.right for one in here), wrong, refused))])
    headings = ("fault", "logs", "verdict right", "called usable, and not so", "good, and not called usable")
    return markdown(headings, rows)


def robots(results: dict[str, Any]) -> str:
    """Write how the policy does on other robots, in points, the least of three trainings: a row per robot.

    Args:
      results: of benchmarks/other_robots.py.
    """
    rows = []
    for robot in results["robots"]:
        places = [each for each in robot["places"] if each["setting"] == robot["robot"]]
        moving = [
            min(each["points_above_at_least"][name][cell] for each in places for cell in MOVING_FROM_2_M)
            for name in WITHOUT_RULE
        ]
        elsewhere = min(
            each["points_above"][name][cell]
            for each in places
            for name in WITHOUT_RULE
            for cell in range(MOVING_FROM_2_M[0])
        )
        rule = min(min(each["points_above"][WITH_RULE]) for each in places)
        drops = (f"{robot[name]['history']:.1f} / {robot[name]['kalman']:.1f}" for name in DROPS)
        points = (f"{each:+.1f}".replace("-", "−") for each in (*moving, elsewhere, rule))
        rows.append([f"`{robot['robot']}`", *drops, *points])
    headings = (
        "robot",
        "policy / Kalman lose at most, settled",
        "whole",
        *(f"less {COLUMNS[name]}, moving 2–5 m ≥" for name in WITHOUT_RULE),
        "less any of them elsewhere ≥",
        f"less {COLUMNS[WITH_RULE]} ≥",
    )
    return markdown(headings, rows)


TABLES: dict[str, tuple[str, Callable[[dict[str, Any]], str]]] = (
    {
        f"{kind}-{name}": (run, lambda results, write=write, place=place: write(results, *place))
        for name, (run, *place) in {
            "paper-gate": (REPRODUCE, "paper", "gate"),
            "paper-box": (REPRODUCE, "paper", "box"),
            "paper-los-2deg": (REPRODUCE, "paper", "los-2deg"),
            "identified-infantry": (TRANSFER, "identified-infantry", "gate"),
            "infantry": (TRANSFER, "infantry", "gate"),
            "worn": (TRANSFER, "worn", "gate"),
        }.items()
        for kind, write in (
            ("rates", rates),
            ("differences", differences),
            ("trainings", trainings),
            ("drops", drops),
        )
    }
    | {
        "fits": (IDENTIFICATION, lambda results: fits(results, LOGS)),
        "other-fits": (IDENTIFICATION, lambda results: fits(results, OTHER_LOGS)),
        "robots": (ROBOTS, robots),
        "strangers": (STRANGERS, strangers),
        "strangers-by-fault": (STRANGERS, strangers_by_fault),
    }
    | {
        "motions-simulator": (MOTIONS, lambda results: motions(results, "identified-infantry")),
        "motions-robot": (MOTIONS, lambda results: motions(results, "infantry")),
        "motion-differences": (MOTIONS, motion_differences),
        "eq7": (MOTIONS, eq7),
        "unseen": (UNSEEN, unseen),
    }
)
"""Name between the markers → run that it is of, and what writes the table."""


def rendered(page: str, results: Mapping[str, dict[str, Any]]) -> str:
    """Return the text of a page with its tables written again.

    Args:
      page: its text.
      results: run → its results, as `take` writes them.
    """

    def written(found: re.Match[str]) -> str:
        run, write = TABLES[found[2]]
        return f"{found[1]}\n{write(results[run])}\n\n{found[4]}"

    return _MARKED.sub(written, page)


def committed() -> dict[str, dict[str, Any]]:
    """Return the results that were taken, by run."""
    runs = (REPRODUCE, TRANSFER, IDENTIFICATION, ROBOTS, MOTIONS, UNSEEN, STRANGERS)
    found = {run: storage.read_json(RESULTS / f"{run}.json") for run in runs}
    for run in (REPRODUCE, TRANSFER):
        found[run] |= {name: _rows(found[run][name], *fields) for name, fields in KEPT.items()}
    return found


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
      path: its folder.
    """
    facts = storage.read_json(path / "results.json")
    if facts["commit"].endswith("-dirty") or facts["quick"]:
        raise SystemExit(f"{path}: made by changed code or a quick run; commit, and run it again")
    run = REPRODUCE if any(each["setting"] == "paper" for each in facts["cells"]) else TRANSFER
    kept = {name: facts[name] for name in ("seed", "commit", "versions", "durations")} | {
        # The commit is that of the run, not the one that its tables are written at.
        "machine": {name: value for name, value in describe_machine().items() if name not in facts},
        **{name: _columns(facts[name], *fields) for name, fields in KEPT.items()},
    }
    storage.write_json(RESULTS / f"{run}.json", kept | ({"probe": probe()} if run == REPRODUCE else {}))


def _columns(rows: Sequence[dict[str, Any]], of: Sequence[str], values: Sequence[str]) -> list[dict[str, Any]]:
    """Gather rows that differ in their cell alone: a list per value, in the order of the cells."""
    found: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in of), []).append(row)
    return [
        dict(zip(of, key, strict=True)) | {name: [row[name] for row in same] for name in (*CELL, *values)}
        for key, same in found.items()
    ]


def _rows(columns: Sequence[dict[str, Any]], of: Sequence[str], values: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows that `_columns` gathered."""
    names = (*CELL, *values)
    return [
        {name: group[name] for name in of} | dict(zip(names, cell, strict=True))
        for group in columns
        for cell in zip(*(group[name] for name in names), strict=True)
    ]


def main() -> None:
    """Take the results of the runs that are named, if any, and write the tables of all pages."""
    for folder in sys.argv[1:]:
        take(Path(folder))
    results = committed()
    for name in PAGES:
        path = ROOT / name
        before = path.read_text()
        after = rendered(before, results)
        if after != before:
            storage.write_text(path, after)
        Console().print(f"{name}: {'written' if after != before else 'as it was'}")


def _where(cell: dict[str, Any]) -> tuple[str, str, str]:
    return cell["setting"], cell["command_limit"], cell["controller"]


def _place(cell: dict[str, Any]) -> tuple[Any, ...]:
    return cell["target"], *cell["range_m"]


def _place_words(place: Sequence[Any]) -> str:
    target, low, high = place
    return f"{'still' if target == 'static' else 'moving'}, {low:g}–{high:g} m"


def _rate(cell: dict[str, Any], *, with_interval: bool) -> str:
    shots = cell["shots"] + cell.get("withheld", 0)
    value = f"{100 * cell['hits'] / shots:.1f}"
    return f"**{value} ({100 * cell['low']:.1f}–{100 * cell['high']:.1f})**" if with_interval else value


def _fit(row: dict[str, Any]) -> str:
    test, training = row["test_fit_percent"], row["training_fit_percent"]
    return "unstable" if test is None else f"{test:.2f} / {training:.2f}".replace("-", "−")


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


if __name__ == "__main__":
    main()
