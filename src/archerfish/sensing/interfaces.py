"""The two protocols that carry everything: controllers decide, worlds answer.

Any controller shoots in any world. Controllers have no randomness inside and know no absolute times, only ages, so the
same one runs batched inside a compiled simulator and one at a time on a robot.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import Muzzle
from archerfish.targets.motion import TargetMotion


class Seen(NamedTuple):
    """What a controller sees at a decision; B is any batch shape, () on the robot. P armor plates; P = 1 here."""

    elapsed: Array
    """Time since the last decision [s], shape B."""
    angle: Array
    """Pitch and yaw of the gimbal, latest feedback [rad], shape B + (2,)."""
    rate: Array
    """Their rates [rad/s], shape B + (2,)."""
    gimbal_age: Array
    """Time since that feedback was sampled [s], shape B."""
    command: Array
    """Command in force, after all limits [rad], shape B + (2,)."""
    plate: Array
    """Armor plates in the base frame, as seen last [m], shape B + (P, 3)."""
    normal_yaw: Array
    """Azimuth of each plate's normal [rad], shape B + (P,)."""
    plate_age: Array
    """Time since each plate's exposure [s], shape B + (P,)."""
    fresh: Array
    """Whether a plate was exposed anew since the last decision, shape B + (P,)."""
    base: Array
    """Own chassis: vx, vy [m/s], yaw rate [rad/s], yaw [rad], shape B + (4,)."""
    muzzle_speed: Array
    """Muzzle speed to expect [m/s], shape B."""
    heat_left: Array
    """Shots that the referee's heat limit still allows, shape B."""


class Command(NamedTuple):
    """What a controller asks for."""

    angle: Array
    """Pitch and yaw [rad], shape B + (2,)."""
    rate: Array
    """Feed-forward rates [rad/s], shape B + (2,); zero where the wire has none."""
    fire: Array
    """Whether to fire, true or false, shape B; a decision without fire sends no pellet."""
    hit_probability: Array
    """The controller's own estimate, 0…1, shape B; NaN where it has none."""
    fallback: Array
    """Whether a simpler controller that predicts better has more than half of the aim, shape B."""


class Shot(NamedTuple):
    """What became of one decision."""

    fired: Array
    """Whether a pellet left the muzzle, shape B."""
    miss: Array
    """Pellet minus armor in y and z where the pellet crosses the armor's x [m], NaN without one, shape B + (2,)."""
    flight_time: Array
    """[s], NaN without one, shape B."""
    angle: Array
    """Pitch and yaw at the moment of firing [rad], shape B + (2,)."""


class Truth(NamedTuple):
    """What only the oracle is told."""

    motion: TargetMotion
    """The target's path."""
    gimbal: GimbalModel
    """The plant, shape (2, ...) or B + (2, ...)."""
    muzzle: Muzzle
    """The muzzle."""


class Controller(Protocol):
    """Turns what is seen into a command.

    One that has a attribute `needs_truth` that is true is told the truth at the beginning: the oracle, and no other.
    """

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        """Return the state at the beginning of an engagement; the truth is given to the oracle alone."""

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide."""


class Engagement(NamedTuple):
    """One meeting with one target."""

    motion: TargetMotion
    """The target's path."""
    start: Array
    """Pitch and yaw of the resting gimbal at the beginning [rad], shape B + (2,)."""
    plant: Array
    """Which posterior draw of the plant this engagement has, shape B; unused where the world has one plant."""


@runtime_checkable
class World(Protocol):
    """Something to shoot in: the simulation (pure: runs inside one compiled scan) or a robot (a loop)."""

    @property
    def period_s(self) -> float:
        """Decision period [s]."""

    @property
    def pure(self) -> bool:
        """Whether `step` may be traced and compiled."""

    def reset(self, engagements: Engagement, draws: Array) -> tuple[Any, Seen]:
        """Begin engagements with the standard normals of all their steps, shape B + (T, K)."""

    def step(self, state: Any, command: Command) -> tuple[Any, Seen, Shot]:
        """Hold a command for one decision period, then fire if it says so.

        The draws of a decision are its own: a withheld shot leaves those of later ones as they are.
        """

    def truth(self, engagements: Engagement) -> Truth:
        """Return what the oracle may know."""


def fire_always(angle: Array) -> Command:
    """Return a command that fires always, with no feed-forward and no estimate of its own.

    Args:
      angle: pitch and yaw [rad], shape B + (2,).
    """
    zero = 0.0 * angle[..., 0]
    return Command(
        angle=angle,
        rate=0.0 * angle,
        fire=zero == 0.0,
        hit_probability=zero + float("nan"),
        fallback=zero > 0.0,
    )


def without_withheld(shot: Shot) -> Shot:
    """Return a shot with no miss and no flight time where no pellet left the muzzle: every world reports it alike.

    Args:
      shot: as computed for every decision, shape B.
    """
    xp = namespace(shot.miss)
    return shot._replace(
        miss=xp.where(shot.fired[..., None], shot.miss, float("nan")),
        flight_time=xp.where(shot.fired, shot.flight_time, float("nan")),
    )
