"""Controllers by name, each built for a robot and a task, and a user's own; what is tuned of them, on which grids."""

import difflib
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish2.arrays import is_tree, leaves, map_arrays, single_precision
from archerfish2.compiled import has_jax, import_jax
from archerfish2.controllers.kalman import ConstantVelocity, DirectAim, Predictor
from archerfish2.controllers.manoeuvring import Manoeuvring
from archerfish2.controllers.oracle import make_oracle
from archerfish2.controllers.parabola import make_parabola_aware, make_parabola_filter
from archerfish2.controllers.preview_aim import SMOOTHING, Hold, make_preview_aim
from archerfish2.errors import InputError
from archerfish2.paper.conditions import assumed_conditions, paper_tuning
from archerfish2.plugins import FORMS, find_plugin, is_plugin
from archerfish2.protocols import Command, Seen, Truth
from archerfish2.records.record import Struct
from archerfish2.robot import Robot
from archerfish2.task import Task
from archerfish2.tracking.interacting_models import ModelRates
from archerfish2.tracking.kalman_filter import INITIAL_SPEED, TrackerNoise, noise_from_record

STOP_RATE, STILL, EXACT_SD = 0.1, 0.5, 2e-4
"""What interacting models assume: rate of stopping [1/s], share that stands at first, standard deviation of detections
by a camera without noise [m]: a larger value, which does a Kalman filter good, hides turns."""


class Tuning(Struct, frozen=True, kw_only=True, eq=True):
    """What is tuned of a controller; each has a use for some of it."""

    acceleration_sd: Annotated[float, Meta(ge=0.0, le=1e100)]
    """Process noise of the Kalman filter, as a standard deviation of the target's acceleration [m/s²]."""
    extra_lead_s: Annotated[float, Meta(ge=-10.0, le=10.0)] = 0.0
    """Lead beyond what the controller has a model of, as for the lag of a gimbal; negative where targets turn back
    before pellets arrive [s]."""
    smoothing: Annotated[float, Meta(ge=1e-100, le=1e100)] = SMOOTHING
    """Weight of the changes of the command in a preview, against squared angle errors."""
    initial_speed: Annotated[float, Meta(ge=1e-100, le=1e100)] = INITIAL_SPEED
    """Standard deviation of the target's speed at the first detection that the filter assumes [m/s]."""
    velocity_decay: Annotated[float, Meta(ge=0.0, le=1e100)] = 1.0
    """Share of the estimated velocity at which the target is predicted to go on, 0…1."""
    turn_rate: Annotated[float, Meta(ge=0.0, le=1e100)] = 1.0
    """How often a target is taken to turn back [1/s]."""


class Grid(NamedTuple):
    """Values of one setting: start · ratioⁱ, or start + step · i, for whole i."""

    start: float  # value at i = 0, where a search begins
    ratio: float = 1.0  # between neighbours
    step: float = 0.0  # between neighbours of a setting that has either sign
    last: int | None = None  # largest i, where the setting has a natural bound

    def value(self, index: int) -> float:
        """Return the value at an index."""
        return float(f"{self.start * self.ratio**index + self.step * index:.9g}")


_LEAD, _SMOOTHING = {"extra_lead_s": Grid(0.0, step=0.02)}, {"smoothing": Grid(0.1, 4.0)}
_SPEED = {"initial_speed": Grid(0.25, 2.0)}
_TRACKER = {"acceleration_sd": Grid(4.0, 2.0), **_SPEED, "velocity_decay": Grid(1.0, 1.25, last=0), **_LEAD}
_MODELS = {"turn_rate": Grid(1.0, 2.0), "acceleration_sd": Grid(0.5, 2.0), **_SPEED}
GRIDS: Mapping[str, Mapping[str, Grid]] = {
    "kalman": _TRACKER,
    "kalman-lq": {**_TRACKER, **_SMOOTHING},
    "imm-lq": {**_MODELS, **_SMOOTHING, **_LEAD},
    "parabola-lq": {**_SMOOTHING, **_LEAD},
}
"""Name → what is tuned of a controller, in the order of the search."""


def tuning_at(name: str, place: tuple[int, ...] | None = None) -> Tuning:
    """Return the settings at indices of the grids of a name, where the search begins if none are given."""
    grids = GRIDS.get(name, {})
    values = zip(grids.items(), place or (0,) * len(grids), strict=True)
    return Tuning(**{"acceleration_sd": 0.0} | {setting: grid.value(index) for (setting, grid), index in values})


NAMES = ("kalman", "kalman-paper", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle")
"""Of the controllers here. One of a user's own needs no line: see `make_controller`."""


def _build(name: str, robot: Robot, task: Task, tuning: Tuning) -> Any:
    if name == "oracle":
        return make_oracle(robot, task)
    muzzle, sensing, period = robot.muzzle_model(), robot.sensing, np.asarray(task.period_s)
    sd = np.asarray(EXACT_SD if name == "imm-lq" else assumed_conditions().kalman_position_sd)
    acceleration = np.asarray(tuning.acceleration_sd)
    noise = noise_from_record(sensing, tuning.acceleration_sd) if sensing else TrackerNoise(acceleration, sd, sd)
    noise = noise._replace(initial_speed=np.asarray(tuning.initial_speed))
    predictor: Predictor = Hold() if name == "no-lead" else ConstantVelocity(noise, np.asarray(tuning.velocity_decay))
    if name in ("kalman", "kalman-paper"):
        return DirectAim(predictor, muzzle, robot.command_limits(task), period + tuning.extra_lead_s, period)
    if name == "imm-lq":
        rates = ModelRates(*(np.asarray(each) for each in (tuning.turn_rate, STOP_RATE, STILL)))
        predictor = Manoeuvring(noise, rates, np.asarray(task.hit_radius_m), muzzle.sd[1])
    if name == "parabola-lq":  # with noise in the detections, the rule is worth something to a filter alone
        predictor = make_parabola_filter(task, muzzle.sd[1], noise) if sensing else make_parabola_aware(task)
    return make_preview_aim(predictor, robot, task, smoothing=tuning.smoothing, lead_s=tuning.extra_lead_s)


def make_controller(controller: Any, robot: Robot, task: Task, tuning: Tuning | None = None) -> Any:
    """Build a controller in float32.

    Args:
      controller: one of `NAMES`, or one of a user's own: a name as `find_plugin` takes it, or an object. It has
        `reset` and `step`, or is a function of robot and task that returns such an object.
      robot: that it is built for.
      task: of one length for the oracle.
      tuning: of one of `NAMES`; where its search begins if not given.

    Raises:
      InputError: if it can't be found, is not for this robot or task, its code fails, or what is built is none.
    """
    name = controller if isinstance(controller, str) else ""
    if name == "kalman-paper":
        if robot.digest() != type(robot).paper().digest():
            raise InputError(f"kalman-paper has settings of the paper's robot alone, got {robot.name}; take kalman")
        tuning = tuning or Tuning(**paper_tuning(task.command_limit)[name])
    if name in NAMES:
        return single_precision(_build(name, robot, task, tuning or tuning_at(name)))
    if name and not is_plugin(name, "controller") and not name.endswith(".py"):
        near = difflib.get_close_matches(name.lower(), NAMES, 1)
        meant = f"perhaps you meant {near[0]}" if near else "name one of these"
        expected = f"{', '.join(NAMES)}, or one of your own ({FORMS})"
        raise InputError(f"controller must be one of {expected}, got {name!r}; {meant}")
    plugin = find_plugin(controller, "controller")
    with plugin.running():
        built = plugin.value
        if isinstance(built, type) or (callable(built) and not hasattr(built, "step")):
            built = built(robot, task)
        kind = f"a {type(built).__name__}"
        if not all(callable(getattr(built, each, None)) for each in ("reset", "step")):
            raise InputError(f"is {kind}, expected reset(seen, truth) and step(state, seen); write both")
        if not getattr(built, "compiled", is_tree(built)):
            return built
        if not is_tree(built) or {np.asarray(each).dtype.kind for each in leaves(built)} - set("fiub"):
            raise InputError(f"is {kind}, expected a tree of arrays; make it one, or write compiled = False in it")
        return single_precision(built)


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
