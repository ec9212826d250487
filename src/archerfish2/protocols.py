"""The protocols between controllers, targets and worlds: what is seen, what is commanded, what became of a shot.

Any controller shoots in any world. Controllers have no randomness inside and get no absolute times, only ages, so the
same one runs batched inside a compiled simulator and one at a time on a robot. B is any batch shape, () on the robot.

Frame O: gravity up, fixed axes (x forward, y left, z up at the beginning), origin at the gimbal's pivot when the
engagement begins. Angles are in O; yaw is continuous, not wrapped; the mechanical yaw is `angle[..., 1] - base.yaw`.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from archerfish2.arrays import Array
from archerfish2.dynamics.linear_axis import GimbalModel
from archerfish2.dynamics.muzzle import Muzzle


class Frames(NamedTuple):
    """Camera frames received since the last decision, oldest first: F frames with S slots each, fixed per world.

    Slots carry no identity. Unused places are zeros with a False in the mask. At the first decision these are the
    latest frames before it.
    """

    received: Array  # bool; a frame that shows nothing counts, B + (F,)
    age: Array  # since its exposure [s], B + (F,)
    found: Array  # bool, B + (F, S)
    position: Array  # centre of a plate in O [m], B + (F, S, 3)
    normal_yaw: Array  # azimuth of its outward normal [rad], B + (F, S)


class GimbalFeedback(NamedTuple):
    """The latest feedback of the gimbal."""

    angle: Array  # pitch and yaw [rad], B + (2,)
    rate: Array  # [rad/s], B + (2,)
    age: Array  # since it was sampled [s], B


class Base(NamedTuple):
    """The own chassis, in O."""

    position: Array  # of the gimbal's pivot [m], B + (3,)
    velocity: Array  # [m/s], B + (3,)
    yaw: Array  # [rad], B
    yaw_rate: Array  # [rad/s], B


class Barrel(NamedTuple):
    """What the barrel can do."""

    speed: Array  # expected muzzle speed [m/s], B
    shots_left: Array  # what the heat limit allows, B; 1e6 without a referee


class Seen(NamedTuple):
    """What a controller sees at a decision."""

    elapsed: Array  # since the last decision [s], 0 at the first, B
    gimbal: GimbalFeedback
    command: Array  # in force, after all limits [rad], B + (2,)
    frames: Frames
    base: Base
    barrel: Barrel


def seen_ahead(count: int) -> Seen:
    """Return what is seen at a first decision, with all at rest and a plate 3 m ahead, in float32, shape (count,)."""
    zero, two, three = (np.zeros((count, *shape), np.float32) for shape in ((), (2,), (3,)))
    yes, ahead = np.ones((count, 1), bool), np.tile(np.array([3.0, 0.0, 0.0], np.float32), (count, 1, 1, 1))
    frames = Frames(yes, zero[:, None], yes[..., None], ahead, zero[:, None, None])
    return Seen(zero, GimbalFeedback(two, two, zero), two, frames, Base(three, three, zero, zero), Barrel(zero, zero))


class Command(NamedTuple):
    """What a controller asks for."""

    angle: Array  # pitch and yaw [rad], B + (2,)
    rate: Array  # feed-forward [rad/s], B + (2,)
    fire: Array  # bool, B; a decision without fire sends no pellet
    hit_probability: Array  # the controller's own estimate, B; NaN where it has none


def aim(angle: Array) -> Command:
    """Return a command that fires, with no feed-forward and no hit probability.

    Args:
      angle: pitch and yaw [rad], shape B + (2,).
    """
    zero = 0.0 * angle[..., 0]
    return Command(angle, 0.0 * angle, zero == 0.0, zero + float("nan"))


class Plates(NamedTuple):
    """Where the P armor plates of a target are."""

    position: Array  # centres in O [m], B + (P, 3)
    normal_yaw: Array  # azimuth of the outward normals [rad], B + (P,)


class Target(Protocol):
    """A target: a tree of arrays that begin with B."""

    @property
    def plates(self) -> int:
        """P, number of plates."""

    def at(self, time: Array) -> Plates:
        """Return the plates at times since the engagement began.

        Args:
          time: from -0.3 s on [s], shape B, or (N,) + B for N times at once, which lead in the result, too.
        """


class Shot(NamedTuple):
    """What became of a decision; a hit is `fired & (margin >= 0)`."""

    fired: Array  # bool, B
    plate: Array  # int32, B: the plate of the largest margin, for a miss too; -1 only without pellet
    miss: Array  # left, as the shooter has it, and up of the plate's centre [m], B + (2,); NaN without pellet, 1e3 if
    #              the pellet crosses no plate's plane
    margin: Array  # to the edge of the hit area [m], B; -1e3 without pellet or crossing
    flight_time: Array  # [s], B; NaN without pellet or crossing
    angle: Array  # pitch and yaw at the moment of firing [rad], B + (2,)


class Engagement(NamedTuple):
    """One engagement with one target."""

    target: Target
    start: Array  # pitch and yaw of the resting gimbal [rad], B + (2,)
    plant: Array  # which posterior draw, int32, B
    duration: Array  # [s], B


class Truth(NamedTuple):
    """What only the oracle gets: the target's path, and the best estimates of gimbal and muzzle."""

    target: Target
    gimbal: GimbalModel
    muzzle: Muzzle


class Controller(Protocol):
    """Turns what is seen into commands.

    A class with `needs_truth = True` gets the truth at reset. `compiled` may be absent: a tree is compiled, any other
    object is called with NumPy batches.
    """

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        """Return the state at the beginning of an engagement."""

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide; the first step gets the `Seen` of the reset."""


class World(Protocol):
    """Something to shoot in: a simulator that is compiled with the controller, or a robot that is stepped."""

    @property
    def name(self) -> str:
        """Name, by which results call it."""

    @property
    def compiled(self) -> bool:
        """Whether its functions may be traced and compiled."""

    @property
    def period_s(self) -> float:
        """Decision period [s]."""

    @property
    def normals(self) -> int:
        """Standard normals that a decision takes; the pellet's (elevation, azimuth, speed) come first."""

    @property
    def plants(self) -> int:
        """Number of posterior draws that engagements choose from."""

    def begin(self, engagement: Engagement, normals: Array) -> Any:
        """Begin engagements of batch shape B.

        Args:
          engagement: arrays that begin with B.
          normals: standard normals of all decisions, shape B + (T, normals). The first detection takes the last
            decision's, whose own nobody sees; a world that is stepped seeds its noise with [..., 0, :2].
        """

    def see(self, state: Any) -> Seen:
        """Return what a controller sees now."""

    def step(self, state: Any, command: Command, normals: Array) -> tuple[Any, Shot]:
        """Hold a command for a period, then fire if it says so.

        Args:
          state: of the engagements.
          command: before the limits.
          normals: standard normals of this decision, shape B + (normals,).
        """

    def truth(self, engagement: Engagement) -> Truth:
        """Return what the oracle may have."""
