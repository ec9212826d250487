"""The paper's Tables I–V, in its own units: degrees, metres and percent."""

from dataclasses import dataclass
from typing import NamedTuple

import msgspec

from archerfish.errors import InputError
from archerfish.paper import Legibility, facts


class LandingRow(NamedTuple):
    """One line of Table I: where pellets fall."""

    pitch_deg: float  # angle α [degrees], muzzle up positive
    yaw_deg: float  # angle β [degrees] in the paper's left-handed frame: right positive
    simulated_m: float  # distance d₁ of the falling point [m]
    real_m: float  # measured distance d₂ of the falling point [m]
    error_percent: float  # |d₁ − d₂| / d₂ as printed [%]


@dataclass(frozen=True)
class LandingTable:
    """Table I."""

    caption: str  # as printed
    legibility: Legibility
    note: str  # what is odd about it
    claimed_error_percent: float  # bound that the text claims for the errors [%]
    rows: tuple[LandingRow, ...]  # nine pairs of angles


class HitRateRow(NamedTuple):
    """One line of Tables II–V: a range and two hit rates."""

    range_m: tuple[float, float]  # distances to the armor (dynamic: to the parabola's vertex) [m]
    ppo_percent: float  # hit rate of the paper's method [%]
    kalman_percent: float  # hit rate of the Kalman filter [%]


@dataclass(frozen=True)
class HitRateTable:
    """One of Tables II–V."""

    name: str  # Roman numeral
    caption: str  # as printed
    legibility: Legibility
    note: str  # what is odd about it
    target: str  # "static" or "dynamic"
    environment: str  # "simulation" or "real"
    shots: int  # stated number of repetitions behind each rate
    rows: tuple[HitRateRow, ...]  # four ranges


def landing_table() -> LandingTable:
    """Return Table I."""
    return msgspec.convert(facts("tables")["I"], LandingTable)


def hit_rate_table(name: str) -> HitRateTable:
    """Return a table of hit rates, "II" to "V".

    Raises:
      InputError: if the paper has no such table.
    """
    if name not in facts("tables") or name == "I":
        raise InputError(f"expected table II, III, IV or V, got {name!r}; the paper has hit rates in these")
    return msgspec.convert({"name": name} | facts("tables")[name], HitRateTable)


def printed_rate(table: str, range_m: tuple[float, float], controller: str, *, is_policy: bool = False) -> float | None:
    """Return the printed hit rate that one of our results is compared with.

    Args:
      table: "II" to "V".
      range_m: smallest and largest distance [m].
      controller: name of our controller: `kalman-paper` belongs to the paper's Kalman column.
      is_policy: whether it is a trained policy, which belongs to the paper's PPO column whatever its name.

    Returns:
      The rate [%], or None where the paper prints none for that range or controller.

    Raises:
      InputError: if the paper has no such table.
    """
    for row in hit_rate_table(table).rows:
        if row.range_m == tuple(range_m):
            return row.ppo_percent if is_policy else row.kalman_percent if controller == "kalman-paper" else None
    return None
