"""Settings of the classical controllers in the simulator of the printed gimbal: tuned once, since it never changes.

`benchmarks/tuning.py` makes tuning.json by the same search that tunes them for a robot.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from archerfish.records import storage


@dataclass(frozen=True)
class PaperTuning:
    """Settings of one controller under one command limit."""

    command_limit: str
    """Name of the command limit."""
    controller: str
    """Name of the controller."""
    settings: Mapping[str, float]
    """Name of a setting → its value."""
    neighbours: Mapping[str, Mapping[str, Any]]
    """Name of a setting → "below" and "above": the next values tried on either side, with their hit rates."""
    hit_rate: float
    """Hits per shot with these settings on the tuning draws, 0…1."""
    tried: int
    """Settings tried."""
    probe_hit_rate: float
    """Hits per shot in few engagements, by which a test sees that it is this code that was tuned."""


def paper_tunings() -> tuple[PaperTuning, ...]:
    """Return all that were tuned."""
    facts = storage.read_json(Path(__file__).with_name("tuning.json"))
    return tuple(
        PaperTuning(**{**each, "settings": MappingProxyType(each["settings"])}) for each in facts["controllers"]
    )


def paper_settings(command_limit: str) -> dict[str, Mapping[str, float]]:
    """Return the settings under a command limit, by the names of the controllers."""
    return {each.controller: each.settings for each in paper_tunings() if each.command_limit == command_limit}
