"""Fit of `archerfish identify gimbal`, with no option, beside its peers on short simulated logs of known truth.

Rigs, commands and noise are those of strangers.py, without faults, in logs of 100 to 300 samples. A free run from rest
is held against a noise-free log of the same rig. The peers are told the dead time and choose among orders 1 to 4 by
Bayes's information criterion; ours finds both by itself.

Writes benchmarks/results/short_logs.json, a row for each log, and exits with 1 if a bar is missed.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.records.provenance import provenance
from archerfish.records.storage import write_bytes
from machine import describe_machine
from markdown_table import markdown
from peers.environments import NotRunError, version
from peers.roster import OURS, PEERS, Tool
from short_logs_cases import KINDS, NOISE, SAMPLES, ShortLog, make_short_log
from short_logs_fits import ORDERS, SETTINGS, Chosen, Found, names, our_fit, peer_fits
from strangers_truth import true_delay

RESULT = Path(__file__).parent / "results" / "short_logs.json"
SEED = 2026
RIGS = 100
CHUNK = 10
"""Logs that a peer is given at a time."""
NEAR = 2.0
"""Points by which a fit may be below the best peer's."""
NEAR_SHARE = 0.9
"""Share of the logs where it must be so near."""


class Row(NamedTuple):
    """One log and the fits of what was held back."""

    case: ShortLog
    """The log."""
    ours: Found
    """What ours made of it."""
    peers: dict[str, Chosen]
    """What each peer made of it."""

    @property
    def best_peer(self) -> str:
        """Name of the peer that fits best."""
        return max(self.peers, key=lambda name: self.peers[name].by_criterion.fit_percent)

    @property
    def lead(self) -> float:
        """Points by which ours fits better than the best peer; negative where it fits worse."""
        return self.ours.fit_percent - self.peers[self.best_peer].by_criterion.fit_percent


class Bar(NamedTuple):
    """A figure and what it must be at least."""

    name: str
    """What is held against the bar."""
    found: float
    """The figure."""
    required: float
    """What it must be at least."""

    @property
    def met(self) -> bool:
        """Whether the bar is met."""
        return self.found >= self.required


def main() -> None:
    """Identify all logs by all tools, write the results and print them; exit with 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=RIGS, help="only the first so many; nothing is then written")
    parser.add_argument("--seed", type=int, default=SEED, help="with another one nothing is written")
    parser.add_argument("--as-logged", action="store_true", help="don't tell the peers the dead time; nothing written")
    parser.add_argument("--ours", action="store_true", help="no peers, nothing written")
    parser.add_argument("--out", type=Path, help="write the results to this file, whatever was run")
    options = parser.parse_args()
    begun = time.perf_counter()
    rows = _rows(options)
    seconds = time.perf_counter() - begun
    if options.ours:
        print("\n".join(_line(row) for row in rows))
        print(f"median {np.median([row.ours.fit_percent for row in rows]):.2f} %")
        return
    bars = _bars(rows)
    complete = options.rigs == RIGS and options.seed == SEED and not options.as_logged
    if out := options.out or (RESULT if complete else None):
        _write(out, options, rows, bars, seconds)
    _print(rows, bars, seconds)
    if missed := [bar.name for bar in bars if not bar.met]:
        sys.exit(f"missed: {'; '.join(missed)}")


def _rows(options: argparse.Namespace) -> list[Row]:
    rows = []
    for first in range(0, options.rigs, CHUNK):
        cases = [make_short_log(options.seed, index) for index in range(first, min(first + CHUNK, options.rigs))]
        ours = [our_fit(case) for case in cases]
        peers: list[dict[str, Chosen]] = [{} for _ in cases]
        if not options.ours:
            peers = peer_fits(cases, not options.as_logged)
        rows += [Row(*each) for each in zip(cases, ours, peers, strict=True)]
        print(f"{len(rows)} of {options.rigs} logs", file=sys.stderr, flush=True)
    return rows


def _bars(rows: Sequence[Row]) -> list[Bar]:
    near = float(np.mean([row.lead >= -NEAR for row in rows]))
    bars = [Bar(f"share within {NEAR:g} points of the best peer", near, NEAR_SHARE)]
    median = float(np.median([row.ours.fit_percent for row in rows]))
    for name in names():
        theirs = float(np.median([row.peers[name].by_criterion.fit_percent for row in rows]))
        bars.append(Bar(f"median fit beside {name}", median, theirs))
    return bars


def _print(rows: Sequence[Row], bars: Sequence[Bar], seconds: float) -> None:
    print(f"{len(rows)} logs in {seconds:.0f} s\n")
    ours = [row.ours.fit_percent for row in rows]
    lines = [("Archerfish", *_spread(ours), "", "", "")]
    for name in names():
        theirs = [row.peers[name].by_criterion.fit_percent for row in rows]
        with_order = [row.peers[name].by_truth.fit_percent for row in rows]
        within = np.mean(np.array(ours) >= np.array(theirs) - NEAR)
        ahead = np.mean(np.array(theirs) > np.array(ours))
        lines.append((name, *_spread(theirs), f"{np.median(with_order):.2f}", f"{within:.0%}", f"{ahead:.0%}"))
    best = [row.ours.fit_percent - row.lead for row in rows]
    ahead, within = np.mean([row.lead < 0 for row in rows]), bars[0].found
    lines.append(("best peer of each log", *_spread(best), "", f"{within:.0%}", f"{ahead:.0%}"))
    quantiles = ("held-back fit, %: median", "10 % quantile", "5 % quantile")
    headings = ("", *quantiles, "median, order told", f"ours within {NEAR:g} points", "it is ahead of ours")
    print(markdown(headings, lines))
    for title, value in {
        "excitation": lambda row: row.case.log.excitation,
        "rig": lambda row: row.case.log.rig.family,
        "noise": lambda row: row.case.log.noise_kind,
    }.items():
        print(f"\n{_groups(title, rows, value)}")
    print("\nlogs where ours is further behind:")
    print("\n".join(_line(row) for row in sorted(rows, key=lambda row: row.lead) if row.lead < -NEAR))


def _groups(title: str, rows: Sequence[Row], value: Any) -> str:
    lines = []
    for key in sorted({value(row) for row in rows}):
        some = [row for row in rows if value(row) == key]
        near = sum(row.lead >= -NEAR for row in some)
        ours = np.median([row.ours.fit_percent for row in some])
        lines.append((key, str(len(some)), str(near), f"{ours:.2f}", f"{np.median([row.lead for row in some]):+.2f}"))
    return markdown((title, "logs", f"within {NEAR:g} points", "median fit, %", "median lead, points"), lines)


def _spread(fits: Sequence[float]) -> tuple[str, ...]:
    return (f"{np.median(fits):.2f}", *(f"{np.quantile(fits, share):.2f}" for share in (0.1, 0.05)))


def _line(row: Row) -> str:
    """Describe a log and its fits in one line."""
    log, ours = row.case.log, row.ours
    facts = (
        f"{log.index:4} {log.rig.family}, {log.excitation}, {1 / log.period_s:g} Hz, {log.samples} samples, "
        f"noise {100 * log.noise:.2g} % {log.noise_kind}, order {log.rig.order}, delay {true_delay(log):g}: "
        f"{ours.fit_percent:.2f} (order {ours.order}, delay {ours.delay}{', D' * ours.feedthrough}; {ours.note})"
    )
    if not row.peers:
        return facts
    theirs = row.peers[row.best_peer].by_criterion
    return f"{facts}; {row.best_peer} {theirs.fit_percent:.2f} (order {theirs.order}, {theirs.note})"


def _write(path: Path, options: argparse.Namespace, rows: Sequence[Row], bars: Sequence[Bar], seconds: float) -> None:
    """Write the results, each row in one line."""
    rules = ("fit", "order", "fit with the order told")
    content = {
        "conditions": {
            "seed": options.seed,
            "logs": len(rows),
            "samples": SAMPLES,
            "noise": NOISE,
            "noise_kinds": KINDS,
            "fit": "100 (1 − ‖y − ŷ‖ / ‖y − mean‖) of a free run from rest on a noise-free log of the rig; 0 if worse",
            "signals": "the peers get inputs and output less their means, ours the log as it is",
            "dead_time_told": not options.as_logged,
            "orders": ORDERS,
            "order": "of the peers: by Bayes's information criterion of the free run on the log; variants likewise",
            "settings": SETTINGS,
        },
        "tools": {tool.name: _version(tool) for tool in (OURS, *PEERS)},
        "machine": describe_machine(),
        "provenance": provenance(options.seed),
        "seconds": round(seconds, 1),
        "bars": [bar._asdict() | {"met": bar.met} for bar in bars],
        "fields": [*_facts(rows[0]), *(f"{name}: {rule}" for name in names() for rule in rules)],
    }
    lines = ",\n    ".join(json.dumps(_values(row)) for row in rows)
    text = json.dumps(content, indent=2, ensure_ascii=False)
    write_bytes(path, f'{text[:-2]},\n  "rows": [\n    {lines}\n  ]\n}}\n'.encode())


def _facts(row: Row) -> dict[str, Any]:
    log, ours = row.case.log, row.ours
    return {
        "index": log.index,
        "rig": log.rig.family,
        "excitation": log.excitation,
        "rate_hz": 1 / log.period_s,
        "samples": log.samples,
        "noise": log.noise,
        "noise_kind": log.noise_kind,
        "order": log.rig.order,
        "delay": true_delay(log),
        "fit": ours.fit_percent,
        "found_order": ours.order,
        "found_delay": ours.delay,
        "feedthrough": ours.feedthrough,
        "note": ours.note,
    }


def _values(row: Row) -> list[Any]:
    values = list(_facts(row).values())
    for name in names():
        chosen = row.peers[name]
        values += [chosen.by_criterion.fit_percent, chosen.by_criterion.order, chosen.by_truth.fit_percent]
    return [float(f"{each:.5g}") if isinstance(each, float) else each for each in values]


def _version(tool: Tool) -> str:
    try:
        return version(tool)
    except NotRunError as error:
        return f"not run: {error}"


if __name__ == "__main__":
    main()
