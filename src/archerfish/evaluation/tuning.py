"""Tuning of the classical controllers on draws that no evaluation uses: a pattern search with expanding steps.

What a tracker should believe of its target, how far it should lead, and how smooth the commands of a preview should be,
depends on camera, link, gimbal and command limit. Every setting of a controller has a grid without ends, and settings
are compared on the same engagements with the same dispersion draws (common random numbers). From a start the search
looks at the neighbours on the grid of one setting after the other, goes on with doubled steps in a direction in which
more shots hit (Hooke and Jeeves 1961), and ends where no neighbour hits more: so both neighbours of each chosen value
have been tried, and none is at an edge of what was.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from archerfish.controllers.roster import Tuning

BUDGET = 60
"""Settings that are tried at most, per controller."""
LEAST_GAIN = 2e-4
"""A setting must hit more often by this to be gone to, as a share of all shots; less is chance."""
LONGEST_STEP = 4
"""Of the search, in steps of the grid."""


@dataclass(frozen=True)
class Grid:
    """Values of one setting: start · ratioⁱ, or start + step · i, for whole i."""

    start: float
    """Value at i = 0, where the search begins."""
    ratio: float = 1.0
    """Between neighbours."""
    step: float = 0.0
    """Between neighbours of a setting that has either sign."""
    last: int | None = None
    """Largest i, where the setting has a natural bound."""

    def value(self, index: int) -> float:
        """Return the value at an index."""
        return float(f"{self.start * self.ratio**index + self.step * index:.9g}")


_LEAD = Grid(0.0, step=0.02)
_TRACKER = {
    "acceleration_sd": Grid(4.0, 2.0),
    "initial_speed": Grid(0.25, 2.0),
    "velocity_decay": Grid(1.0, 1.25, last=0),
    "extra_lead_s": _LEAD,
}
_SMOOTHING = Grid(0.1, 4.0)
GRIDS: Mapping[str, Mapping[str, Grid]] = MappingProxyType(
    {
        "kalman": _TRACKER,
        "kalman-tuned": _TRACKER,
        "kalman-lq": {**_TRACKER, "smoothing": _SMOOTHING},
        "imm-lq": {
            "turn_rate": Grid(1.0, 2.0),
            "acceleration_sd": Grid(0.5, 2.0),
            "initial_speed": Grid(0.25, 2.0),
            "smoothing": _SMOOTHING,
            "extra_lead_s": _LEAD,
        },
        "parabola-lq": {"smoothing": _SMOOTHING, "extra_lead_s": _LEAD},
    }
)
"""Controller → what is tuned of it."""


@dataclass(frozen=True)
class Neighbours:
    """A chosen value between those on either side of it, all other settings as chosen."""

    value: float
    """Chosen."""
    below: tuple[float, float] | None
    """Next value below that was tried, and its hit rate; None at a natural bound."""
    above: tuple[float, float] | None
    """The same above."""


@dataclass(frozen=True)
class Tuned:
    """Settings of one controller, and how they were found."""

    controller: str
    """Its name."""
    tuning: Tuning
    """The best settings."""
    hit_rate: float
    """Hits per shot with them, over all cells of the tuning draws, 0…1."""
    tried: tuple[tuple[Tuning, float], ...]
    """Settings tried and their hit rates, in their order."""
    neighbours: Mapping[str, Neighbours]
    """Setting → its neighbours."""


def starting_point(controller: str) -> Tuning | None:
    """Return settings that are near the best ones for many robots; None for a controller that has nothing to tune."""
    grids = GRIDS.get(controller)
    return None if grids is None else _tuning(grids, (0,) * len(grids))


Place = tuple[int, ...]
"""Indices on the grids of all settings."""


@dataclass(frozen=True)
class _Search:
    """What has been tried: every setting once, within the budget."""

    grids: Mapping[str, Grid]
    compute: Callable[[Tuning], float]
    found: dict[Place, float] = field(default_factory=dict)

    def rate(self, at: Place) -> float:
        if at not in self.found:
            self.found[at] = self.compute(_tuning(self.grids, at))
        return self.found[at]

    def beside(self, at: Place, axis: int, by: int) -> Place | None:
        """Return the place beside another, or None beyond a natural bound."""
        index, last = at[axis] + by, tuple(self.grids.values())[axis].last
        return None if last is not None and index > last else (*at[:axis], index, *at[axis + 1 :])

    def neighbours(self, at: Place) -> list[Place]:
        places = (self.beside(at, axis, by) for axis in range(len(at)) for by in (-1, 1))
        return [each for each in places if each is not None]

    def affordable(self, there: Place, at: Place) -> bool:
        """Whether after another place the budget still does for the neighbours of either."""
        return all(len(self.found.keys() | {there, *self.neighbours(each)}) <= BUDGET for each in (there, at))

    def improved(self, at: Place, axis: int) -> Place:
        """Go along one setting while more shots hit, with doubled steps."""
        for direction in (1, -1):
            begun, step = at, direction
            while (there := self.beside(at, axis, step)) is not None and self.affordable(there, at):
                if self.rate(there) < self.rate(at) + LEAST_GAIN:
                    break
                at, step = there, max(-LONGEST_STEP, min(2 * step, LONGEST_STEP))
            if at != begun:
                break
        return at

    def best(self) -> Place:
        at, before = (0,) * len(self.grids), None
        self.rate(at)
        while before != at:
            before = at
            for axis in range(len(at)):
                at = self.improved(at, axis)
        for each in self.neighbours(at):
            self.rate(each)
        return at


def _tuning(grids: Mapping[str, Grid], at: Place) -> Tuning:
    values = {name: grid.value(index) for (name, grid), index in zip(grids.items(), at, strict=True)}
    return Tuning(**{"acceleration_sd": 0.0, **values})


def tune(name: str, rate: Callable[[Tuning], float], grids: Mapping[str, Grid] | None = None) -> Tuned:
    """Choose the settings that hit most.

    Args:
      name: of the controller.
      rate: hit rate with some settings, 0…1; always on the same draws, of the stream "tuning".
      grids: what is tuned; as `GRIDS` says if not given.
    """
    grids = GRIDS[name] if grids is None else grids
    search = _Search(grids, rate)
    best = search.best()
    tried = tuple((_tuning(grids, at), found) for at, found in search.found.items())
    return Tuned(name, _tuning(grids, best), search.rate(best), tried, _neighbours(search, best))


def _neighbours(search: _Search, best: Place) -> dict[str, Neighbours]:
    def beside(axis: int, name: str, by: int) -> tuple[float, float] | None:
        at = search.beside(best, axis, by)
        return None if at is None else (getattr(_tuning(search.grids, at), name), search.rate(at))

    chosen = _tuning(search.grids, best)
    return {
        name: Neighbours(getattr(chosen, name), beside(axis, name, -1), beside(axis, name, 1))
        for axis, name in enumerate(search.grids)
    }
