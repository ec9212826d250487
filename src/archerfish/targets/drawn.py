"""Motions with parameters of their own: drawn per engagement from one table, one motion alone or all of them mixed."""

import functools
from collections.abc import Callable, Mapping
from itertools import accumulate
from types import MappingProxyType
from typing import Any, NamedTuple

from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.targets.circle import circle_way
from archerfish.targets.parabola import paper_way, parabola_way
from archerfish.targets.passing import pass_way
from archerfish.targets.path import Path, path_about
from archerfish.targets.singer import KNOTS, singer_way
from archerfish.targets.sinusoid import sinusoid_way
from archerfish.targets.still import still_way
from archerfish.targets.stop_and_go import stop_and_go_way
from archerfish.targets.strafe import strafe_way
from archerfish.targets.variation import CHANCES as VARIATIONS
from archerfish.targets.variation import varied

WAYS: Mapping[str, Callable[[Array, Array], Array]] = MappingProxyType(
    {
        "still": still_way,
        "parabola": parabola_way,
        "pass": pass_way,
        "strafe": strafe_way,
        "stop-and-go": stop_and_go_way,
        "sinusoid": sinusoid_way,
        "circle": circle_way,
        "singer": singer_way,
    }
)
"""Motion → its level way at `path.TIMES`, of uniform draws, shape B + (n,), and the engagement's length [s]."""
ANY = "any"
"""All of them and the paper's own eq (7), mixed by `MIXTURE`."""
DRAWN = (ANY, *WAYS)
"""All names that `drawn_motion` takes."""
MIXTURE: Mapping[str, float] = MappingProxyType(
    {
        "still": 3.0,
        "parabola": 1.5,
        "pass": 5.0,
        "strafe": 1.0,
        "stop-and-go": 5.0,
        "sinusoid": 0.6,
        "circle": 0.6,
        "singer": 2.0,
        "paper": 6.0,
    }
)
"""Motion → how often a policy for any of them meets it. Motions where a classical tracker is nearly as good as can be
count more, for there the policy has most to lose; with equal weights it takes every target that stops for one that
turns back. Chosen on draws that no evaluation has."""
CHANCES = 5 + 2 * KNOTS
"""Uniform draws per engagement: which motion, then as many as the motion with the most needs. `ANY` takes some more, of
its variations."""


class _Empty(NamedTuple):
    """No arrays."""


@functools.cache
def drawn_motion(name: str) -> Any:
    """Return a motion for `Scenario.motion`: an empty NamedTuple, so that a compiled program can be given it.

    It has a function `path(place, chance, duration)` that returns a `Path`, and `chances`, the uniform draws that this
    takes. Always the same one of a name, so that nothing is compiled twice.

    Args:
      name: one of `WAYS`, or `ANY`.
    """
    ways = {**WAYS, "paper": paper_way}
    mixed = name == ANY
    weights = MIXTURE if mixed else {name: 1.0}
    starts = tuple(accumulate((each / sum(weights.values()) for each in weights.values()), initial=0.0))[:-1]

    chances = CHANCES + VARIATIONS * mixed

    def path(place: Array, chance: Array, duration: Array) -> Path:
        xp = namespace(place, chance)
        way: Array = 0.0
        for each, begin in zip(weights, starts, strict=True):
            if each == "paper" and mixed:
                # All before are varied; eq (7) stays as the paper has it.
                way = varied(way, chance[..., CHANCES:])
            way = xp.where((chance[..., 0] >= begin)[..., None, None], ways[each](chance[..., 1:], duration), way)
        return path_about(place, way, duration)

    return type("DrawnMotion", (_Empty,), {"path": staticmethod(path), "chances": chances})()
