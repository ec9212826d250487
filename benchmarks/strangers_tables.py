"""Counts of the logs of strangers: how often the verdict is right, against the bars, by fault and by excitation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from archerfish.records.plant import USABLE_FIT_PERCENT
from markdown_table import markdown
from strangers_judging import Row
from strangers_logs import NONE


@dataclass(frozen=True)
class Count:
    """How many of some logs have a property."""

    name: str
    """Which property, of which logs."""
    count: int
    """Logs that have it."""
    of: int
    """Logs that there are."""
    interval_95: tuple[float, float]
    """Of the share, by Wilson."""
    low_bar: float | None
    """Share that is wanted at least."""
    high_bar: float | None
    """Share that is wanted at most."""

    @property
    def share(self) -> float:
        """Share of the logs, 0…1; not a number without logs."""
        return self.count / self.of if self.of else float("nan")

    @property
    def missed(self) -> bool:
        """Whether the share is beyond a bar."""
        low, high = self.low_bar, self.high_bar
        return bool(self.of) and not (0 if low is None else low) <= self.share <= (1 if high is None else high)


def counts(rows: Sequence[Row]) -> list[Count]:
    """Count all that has a bar, and a few more."""
    good = [row for row in rows if row.good]
    clean = [row for row in rows if row.good_clean]
    known = [row for row in rows if row.fault == NONE and not row.refused]
    tried = [row for row in rows if row.gaining]
    obeyed = [row for row in rows if row.obeyed_fit is not None]
    found = [
        _count("verdict right", rows, lambda row: row.right, 0.97),
        _count("called usable, and not so", rows, lambda row: row.usable_said and not row.usable_true, None, 0.01),
        _count("good, and refused or called unusable", good, lambda row: not row.usable_said, None, 0.03),
        _count("the same, noise not held against the log", clean, lambda row: not row.usable_said),
        _count("refused", rows, lambda row: row.refused),
        _count("plant usable", rows, lambda row: row.usable_true),
        _count("steady gain inside its interval (no fault)", known, _gain_inside, 0.90, 0.98),
        _count("dead time inside its range (no fault)", known, _delay_inside, 0.90, 0.98),
        _count("with advice, of those that an option betters", tried, lambda row: bool(row.advice), 0.80),
        _count("bettered by the first advice", obeyed, _bettered, 0.90),
    ]
    for kind in sorted({row.noise_kind for row in known}):
        some = [row for row in known if row.noise_kind == kind]
        found.append(_count(f"steady gain inside, {kind} noise (no fault)", some, _gain_inside))
        found.append(_count(f"dead time inside, {kind} noise (no fault)", some, _delay_inside))
    found += [_count(f"{name} (no fault)", known, test) for name, test in _CRITERIA.items()]
    for words, bound in _OTHER_DEFINITIONS.items():
        found += _counts_by(words, rows, bound)
    return found


def _counts_by(words: str, rows: Sequence[Row], bound: Callable[[Row], bool]) -> list[Count]:
    """Count verdicts by a definition of usable that bounds the dead time in another way."""

    def usable(row: Row) -> bool:
        return row.gain_right and (row.held_back_fit or 0.0) >= USABLE_FIT_PERCENT and bound(row)

    def right(row: Row) -> bool:
        return row.right if row.refused else row.usable_said == usable(row)

    good = [row for row in rows if (row.good if row.refused else usable(row))]
    return [
        _count(f"verdict right, {words}", rows, right),
        _count(f"called usable, and not so, {words}", rows, lambda row: row.usable_said and not usable(row)),
        _count(f"good, and refused or called unusable, {words}", good, lambda row: not row.usable_said),
    ]


def _count(
    name: str, rows: Sequence[Row], test: Callable[[Row], bool], low: float | None = None, high: float | None = None
) -> Count:
    count = sum(test(row) for row in rows)
    if not rows:
        return Count(name, 0, 0, (0.0, 1.0), low, high)
    ends = binomtest(count, len(rows)).proportion_ci(method="wilson")
    return Count(name, count, len(rows), (float(ends.low), float(ends.high)), low, high)


def _gain_inside(row: Row) -> bool:
    return row.interval is not None and row.interval[0] <= row.gain_true <= row.interval[1]


def _delay_inside(row: Row) -> bool:
    """Tell whether the range holds the dead time, in either way to count it, or the whole samples on its two sides."""
    if row.delay_range is None:
        return False
    low, high = row.delay_range
    return low - 1 - 1e-3 < row.delay_true < high + 1 + 1e-3 if row.delay_true % 1 else _whole_inside(row, low, high)


def _whole_inside(row: Row, low: float, high: float) -> bool:
    late = row.delay_true + (1 if row.feedthrough else 0)
    return any(low - 1e-3 * late - 1e-6 <= each <= high + 1e-3 * late + 1e-6 for each in {row.delay_true, late})


def _bettered(row: Row) -> bool:
    return row.obeyed_fit is not None and max(row.obeyed_fit, 0.0) > row.fit_floor


_CRITERIA: dict[str, Callable[[Row], bool]] = {
    "held-back fit of 80 %": lambda row: (row.held_back_fit or 0.0) >= USABLE_FIT_PERCENT,
    "steady gain right": lambda row: row.gain_right,
    "dead time right": lambda row: row.delay_right,
    "half the step in time": lambda row: row.rise_right,
}
_OTHER_DEFINITIONS: dict[str, Callable[[Row], bool]] = {
    "by half the step instead of the dead time": lambda row: row.rise_right,
    "by fit and gain alone": lambda _: True,
}


def fits(rows: Iterable[Row]) -> tuple[float, float]:
    """Return median and 5 % quantile of the held-back fit of the plants that there are [%]."""
    found = [row.held_back_fit for row in rows if row.held_back_fit is not None]
    if not found:
        return float("nan"), float("nan")
    return float(np.median(found)), float(np.quantile(found, 0.05))


def count_table(found: Sequence[Count]) -> str:
    """Write the counts as a table."""
    lines = []
    for each in found:
        low, high = (100 * end for end in each.interval_95)
        bar = [f"≥ {100 * each.low_bar:g} %"] if each.low_bar is not None else []
        bar += [f"≤ {100 * each.high_bar:g} %"] if each.high_bar is not None else []
        share = f"{100 * each.share:.1f} % ({low:.1f}–{high:.1f})" if each.of else "–"
        lines.append((each.name, share, f"{each.count}/{each.of}", ", ".join(bar), "missed" * each.missed))
    return markdown(("", "share (95 %)", "logs", "bar", ""), lines)


def group_table(rows: Sequence[Row], name: str) -> str:
    """Write the shares by fault, excitation or another field of the rows as a table."""
    lines = [_group_line(str(key), [row for row in rows if getattr(row, name) == key]) for key in _values(rows, name)]
    headings = (name, "logs", "right", "falsely usable", "good refused", "refused", "usable", "gain in", "delay in")
    return markdown((*headings, "fit: median", "5 %"), [*lines, _group_line("all", rows)])


def _values(rows: Sequence[Row], name: str) -> list[object]:
    return sorted({getattr(row, name) for row in rows})


def _group_line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    good = [row for row in rows if row.good]
    known = [row for row in rows if not row.refused]
    shares = [
        _count("", rows, lambda row: row.right),
        _count("", rows, lambda row: row.usable_said and not row.usable_true),
        _count("", good, lambda row: not row.usable_said),
        _count("", rows, lambda row: row.refused),
        _count("", rows, lambda row: row.usable_true),
        _count("", known, _gain_inside),
        _count("", known, _delay_inside),
    ]
    cells = [f"{100 * each.share:.0f} %" if each.of else "–" for each in shares]
    return (name, str(len(rows)), *cells, *(f"{each:.1f}" for each in fits(rows)))


def row_line(row: Row) -> str:
    """Describe a log and its verdict in one line."""
    said = "refused" if row.refused else "usable" if row.usable_said else "unusable"
    facts = f"{row.index:5} {said:8} {row.rig}, {row.excitation}, {row.fault}"
    facts += f" {row.severity:.3g}" * (row.severity != 0)
    facts += f", {row.rate_hz:g} Hz, {row.samples} samples, noise {100 * row.noise:.2g} % {row.noise_kind}"
    if row.held_back_fit is None or row.fit is None or row.interval is None or row.delay_range is None:
        return f"{facts}: {row.reason}{_gains(row)}"
    low, high = row.interval
    return (
        f"{facts}: fit {row.fit:.1f}, held back {row.held_back_fit:.1f}, "
        f"gain {row.gain:.4g} ({low:.4g}…{high:.4g}) for {row.gain_true:.4g}{'' if row.gain_right else ' wrong'}, "
        f"delay {row.delay:.3g} ({row.delay_range[0]:.3g}–{row.delay_range[1]:.3g}, "
        f"{'D' if row.feedthrough else 'no D'}) for {row.delay_true:.3g}{'' if row.delay_right else ' wrong'}"
        f"{'' if row.rise_right else ', rise wrong'}{': ' * bool(row.reason)}{row.reason}{_gains(row)}"
    )


def _gains(row: Row) -> str:
    gains = [f"{name} {row.options[name]:.1f}" for name in row.gaining]
    advised = [f"advice {', '.join(row.advice)} ({row.obeyed_fit})"] if row.advice else []
    return "".join(f" [{words}]" for words in (*gains, *advised))


def option_table(rows: Sequence[Row]) -> str:
    """Write how often each option was tried and bettered the held-back fit as a table."""
    names = sorted({name for row in rows for name in row.options})
    lines = []
    for name in names:
        tried = [row for row in rows if name in row.options]
        gained = [max(row.options[name], 0.0) - row.fit_floor for row in tried if name in row.gaining]
        median = f"{np.median(gained):.1f}" if gained else "–"
        best = sum(name == max(row.options, key=lambda each: row.options[each]) for row in tried if row.gaining)
        lines.append((name, str(len(tried)), str(len(gained)), median, str(best)))
    return markdown(("option", "tried", "gains", "median points", "best of those that gain"), lines)
