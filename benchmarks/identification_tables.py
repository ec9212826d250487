"""The benchmark of identification as tables to read."""

from collections.abc import Callable, Sequence

from rich.table import Table

from identification_bars import Bar
from peers.roster import NOT_RUN
from peers.running import Score


def fits_table(scores: Sequence[Score]) -> Table:
    """Return the fits of each tool on each case: test / training [%]."""
    return _by_case("fit of the test / training part, %", scores, _fits)


def seconds_table(scores: Sequence[Score]) -> Table:
    """Return the time of each tool on each case: warm / first in its process [s]."""
    return _by_case("processor seconds of a fit, warm / first in its process", scores, _seconds)


def fits_markdown(scores: Sequence[Score], cases: Sequence[str]) -> str:
    """Return the fits of each tool on some cases as a table for the documentation: test / training [%]."""
    cells = {(score.tool, score.setting, score.case): _fits(score) for score in scores}
    settings = dict.fromkeys((score.tool, score.setting) for score in scores)
    lines = [["test / training fit, %", *cases], ["---"] * (len(cases) + 1)]
    lines += [[f"{tool}, {setting}", *(cells[tool, setting, case] for case in cases)] for tool, setting in settings]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def bars_table(bars: Sequence[Bar]) -> Table:
    """Return each bar beside what was found."""
    table = Table("bar", "found", "required", "", title="bars")
    for bar in bars:
        found = "–" if bar.found is None else f"{bar.found:.4g}"
        table.add_row(bar.name, found, f"{'≤' if bar.at_most else '≥'} {bar.required:.4g}", "" if bar.met else "missed")
    return table


def _by_case(title: str, scores: Sequence[Score], cell: Callable[[Score], str]) -> Table:
    cases = list(dict.fromkeys(score.case for score in scores))
    settings = dict.fromkeys((score.tool, score.setting) for score in scores)
    cells = {(score.tool, score.setting, score.case): cell(score) for score in scores}
    table = Table("tool", *cases, title=title)
    for tool, setting in settings:
        table.add_row(f"{tool}, {setting}", *(cells.get((tool, setting, case), "") for case in cases))
    reasons = {f"{score.tool}, {score.setting}, {score.case}": score.problem for score in scores if score.problem}
    table.caption = "\n".join(f"{name}: not run: {reason}" for name, reason in {**NOT_RUN, **reasons}.items())
    return table


def _fits(score: Score) -> str:
    if score.problem:
        return "not run"
    if score.test_fit_percent is None or score.training_fit_percent is None:
        return "unstable"
    return f"{score.test_fit_percent:.2f} / {score.training_fit_percent:.2f}"


def _seconds(score: Score) -> str:
    if score.seconds is None or score.first_seconds is None:
        return "not run"
    return f"{score.seconds:.3f} / {score.first_seconds:.2f}"
