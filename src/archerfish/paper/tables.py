"""The paper's Tables I–V, in its own units: degrees, metres and percent."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from archerfish.paper.legibility import Legibility
from archerfish.records import storage
from archerfish.records.errors import InputError

COLUMN_OF_CONTROLLER = {"history": "ppo_percent", "paper": "ppo_percent", "kalman": "kalman_percent"}
"""Which printed column stands beside a controller of ours; the paper prints nothing for the others."""


@dataclass(frozen=True)
class LandingRow:
    """One line of Table I: where pellets fall."""

    pitch_deg: float
    """Pitch angle α [degrees], muzzle up positive."""
    yaw_deg: float
    """Yaw angle β [degrees] in the paper's left-handed frame: right positive."""
    simulated_m: float
    """Simulated distance d₁ of the falling point [m]."""
    real_m: float
    """Measured distance d₂ of the falling point [m]."""
    error_percent: float
    """|d₁ − d₂| / d₂ as printed [%]."""


@dataclass(frozen=True)
class LandingTable:
    """Table I."""

    name: str
    """Roman numeral."""
    caption: str
    """As printed."""
    legibility: Legibility
    """How well it can be read."""
    note: str
    """What is odd about it."""
    claimed_error_percent: float
    """Bound that the text claims for the errors [%]."""
    rows: tuple[LandingRow, ...]
    """Nine pairs of angles."""


@dataclass(frozen=True)
class HitRateRow:
    """One line of Tables II–V: a range and two hit rates."""

    range_m: tuple[float, float]
    """Smallest and largest distance to the armor (dynamic: to the parabola's vertex) [m]."""
    ppo_percent: float
    """Hit rate of the paper's method [%]."""
    kalman_percent: float
    """Hit rate of the Kalman filter [%]."""


@dataclass(frozen=True)
class HitRateTable:
    """One of Tables II–V."""

    name: str
    """Roman numeral."""
    caption: str
    """As printed."""
    legibility: Legibility
    """How well it can be read."""
    note: str
    """What is odd about it."""
    target: str
    """"static" or "dynamic"."""
    environment: str
    """"simulation" or "real"."""
    shots: int
    """Stated number of repetitions behind each rate."""
    rows: tuple[HitRateRow, ...]
    """Four ranges."""


@functools.cache
def _facts() -> dict[str, Any]:
    return dict(storage.read_json(Path(__file__).with_name("tables.json")))


def landing_table() -> LandingTable:
    """Return Table I."""
    facts = _facts()["I"]
    rows = tuple(LandingRow(**dict(zip(facts["columns"], row, strict=True))) for row in facts["rows"])
    legibility, claimed = Legibility(facts["legibility"]), float(facts["claimed_error_percent"])
    return LandingTable("I", facts["caption"], legibility, facts["note"], claimed, rows)


def hit_rate_table(name: str) -> HitRateTable:
    """Return a table of hit rates, "II" to "V".

    Raises:
      InputError: if the paper has no such table.
    """
    if name not in _facts() or name == "I":
        raise InputError(f'table must be one of "II", "III", "IV", "V", got {name!r}')
    facts = _facts()[name]
    rows = tuple(HitRateRow((float(low), float(high)), *rates) for (low, high), *rates in facts["rows"])
    described = {field: facts[field] for field in ("caption", "note", "target", "environment", "shots")}
    return HitRateTable(name=name, legibility=Legibility(facts["legibility"]), rows=rows, **described)


def printed_table(name: str) -> LandingTable | HitRateTable:
    """Return any table of the paper, "I" to "V".

    Raises:
      InputError: if the paper has no such table.
    """
    return landing_table() if name == "I" else hit_rate_table(name)


def printed_rate(table: str, range_m: tuple[float, float], controller: str) -> float | None:
    """Return the printed hit rate that stands beside one of our results.

    Args:
      table: "II" to "V".
      range_m: smallest and largest distance [m].
      controller: name of our controller; both our policies stand beside the paper's PPO column.

    Returns:
      The rate [%], or None where the paper prints none for that range or controller.

    Raises:
      InputError: if the paper has no such table.
    """
    column = COLUMN_OF_CONTROLLER.get(controller)
    rows = {row.range_m: row for row in hit_rate_table(table).rows}
    row = rows.get((float(range_m[0]), float(range_m[1])))
    return None if column is None or row is None else float(getattr(row, column))
