"""The protocols between controllers, targets and worlds: what is seen, what is commanded, what became of a shot.

Any controller shoots in any world. Controllers have no randomness inside and get no absolute times, only ages, so the
same one runs batched inside a compiled simulator and one at a time on a robot. B is any batch shape, () on the robot.

Frame O: gravity up, fixed axes (x forward, y left, z up at the beginning), origin at the gimbal's pivot when the
engagement begins. Angles are in O; yaw is continuous, not wrapped; the mechanical yaw is `angle[..., 1] - base.yaw`.
"""

from contextlib import suppress
from typing import Any, NamedTuple, Protocol

import numpy as np

from archerfish.arrays import Array, is_tree, leaves, map_arrays, single_precision
from archerfish.compiled import has_jax, import_jax
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import Muzzle
from archerfish.errors import InputError
from archerfish.plugins import find_plugin


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


def _check_call(build: Any) -> None:
    """Refuse what can't be called with a robot and a task."""
    import inspect  # slow to load

    with suppress(ValueError):  # of what has no signature
        signature = inspect.signature(build)
        try:
            signature.bind("robot", "task")
        except TypeError as error:
            problem = f"is called with robot and task, but takes {signature}"
            raise InputError(f"{problem}; take both, or give an object with reset and step") from error


def own_controller(controller: Any, robot: Any, task: Any) -> Controller:
    """Find a controller of a user's own, or build it by a function of robot and task, in float32 if it is compiled.

    Raises:
      InputError: if it can't be found, its code fails, or it is no controller.
    """
    plugin = find_plugin(controller, "controller")
    with plugin.running():
        built: Any = plugin.value
        if isinstance(built, type) or (callable(built) and not hasattr(built, "step")):
            _check_call(built)
            built = built(robot, task)
        kind = f"a {type(built).__name__}"
        if hasattr(built, "predict") and not hasattr(built, "step"):
            raise InputError(f"is {kind} with predict; wrap it: authors.Player(model, env.unwrapped.observer)")
        if not all(callable(getattr(built, name, None)) for name in ("reset", "step")):
            raise InputError(f"is {kind}, expected reset(seen, truth) and step(state, seen); write both")
        if getattr(built, "compiled", is_tree(built)):
            if not is_tree(built) or {np.asarray(leaf).dtype.kind for leaf in leaves(built)} - set("fiub"):
                raise InputError(f"is {kind}, expected a tree of arrays; make it one, or write compiled = False in it")
            built = single_precision(built)
        made: Controller = built
        return made


def check_decision(controller: Any, seen: Seen, truth: Truth | None = None) -> None:
    """Let a controller decide once, in NumPy and, where it is compiled, traced; refuse what is no decision.

    What is refused is said in one line that names the controller's file and line.

    Args:
      controller: to try; what it does is not judged.
      seen: at a first decision, of a few engagements; NumPy's arrays, shape (n,).
      truth: of these engagements, for one that needs it.

    Raises:
      InputError: if its code fails, it returns anything but a state and a command, the command has other shapes or
        types, or angles that are not finite, or a compiled controller's state changes its structure.
    """
    plugin, code = find_plugin(controller, "controller"), getattr(controller.step, "__code__", None)
    place = f"line {code.co_firstlineno}: " if code else ""
    with plugin.running():
        state = controller.reset(seen, truth)
        answer = controller.step(state, seen)
        if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[1], Command):
            raise InputError(
                f"{place}step returns a {type(answer).__name__}, expected (state, Command); see protocols.aim"
            )
        after, command = answer
        for name, shape in Command((2,), (2,), (), ())._asdict().items():
            value, expected = np.asarray(getattr(command, name)), (*seen.elapsed.shape, *shape)
            if value.shape != expected:
                raise InputError(f"{place}step commands {name} of shape {value.shape}, expected {expected}; correct it")
            if name == "fire" and value.dtype.kind != "b":
                raise InputError(f"{place}step commands fire of {value.dtype}, expected bool; compare, as in x > 0.5")
            if name in ("angle", "rate") and not np.all(np.isfinite(value)):
                raise InputError(f"{place}step commands {name} that are not finite, expected rad; correct it")
        if getattr(controller, "compiled", is_tree(controller)):
            if _outline(after) != _outline(state):
                raise InputError(f"{place}step returns a state unlike that of reset, expected equal shapes; correct it")
            if has_jax():
                import_jax().eval_shape(lambda c, now, truth: c.step(c.reset(now, truth), now), controller, seen, truth)


def _outline(state: Any) -> str:
    """Describe structure, shapes and kinds of numbers; not the precision, which a compiled program makes one."""
    return repr(map_arrays(lambda each: f"{np.asarray(each).dtype.kind}{np.shape(each)}", state))
