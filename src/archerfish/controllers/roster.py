"""Controllers by name, each built for a gimbal, a muzzle and a command limit: the classical ones, and a user's own."""

from collections.abc import Callable
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np

from archerfish.controllers.direct_aim import DirectAim
from archerfish.controllers.manoeuvring import Manoeuvring
from archerfish.controllers.oracle import make_oracle
from archerfish.controllers.parabola_filter import parabola_filter
from archerfish.controllers.predictors import ConstantVelocity, Hold, ParabolaAware, Predictor, Vertex
from archerfish.controllers.preview_aim import SMOOTHING, make_preview_aim
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import Muzzle
from archerfish.paper.conditions import Conditions
from archerfish.records.errors import InputError
from archerfish.records.extensions import FORMS, Extension, find_extension, is_extension, own_code
from archerfish.sensing.interacting_models import ModelRates
from archerfish.sensing.interfaces import Controller
from archerfish.sensing.kalman_filter import INITIAL_SPEED, TrackerNoise

TURN_RATE, STOP_RATE, STANDING = 1.0, 0.1, 0.5
"""What interacting models suppose of targets: rates of turning back and stopping [1/s], share that stands at first."""
EXACT_SD = 2e-4
"""What they suppose of a camera without noise [m]: a larger value, which does a Kalman filter good, hides turns."""


class Tuning(NamedTuple):
    """What is tuned of a tracking controller; each has a use for some of it."""

    acceleration_sd: float
    """Process noise of the Kalman filter, as a standard deviation of the target's acceleration [m/s²]."""
    extra_lead_s: float = 0.0
    """What a controller leads beyond what it knows of, as for the lag of a gimbal that it doesn't know; negative where
    targets turn back before pellets arrive [s]."""
    smoothing: float = SMOOTHING
    """Weight of the changes of the command in a preview, against squared angle errors."""
    initial_speed: float = INITIAL_SPEED
    """Standard deviation of the target's speed at first sight, as the filter supposes [m/s]."""
    velocity_decay: float = 1.0
    """Share of the estimated velocity at which the target is predicted to go on, 0…1."""
    turn_rate: float = TURN_RATE
    """How often a target is taken to turn back [1/s]."""


class Workbench(NamedTuple):
    """What a controller is built from."""

    model: GimbalModel
    """The plant as identified, shape (2, ...), float64."""
    muzzle: Muzzle
    """The muzzle."""
    limits: CommandLimits
    """What may be asked."""
    conditions: Conditions
    """Period, engagement length, and the tuning of the tracker under the paper's conditions."""
    noise: TrackerNoise | None = None
    """What the camera's record says of its noise; the conditions' where there is none."""
    tuning: Tuning | None = None
    """Of the tracker; the conditions' if not given."""


def _noise(bench: Workbench) -> TrackerNoise:
    position = np.asarray(bench.conditions.kalman_position_sd)
    noise = TrackerNoise(np.asarray(0.0), position, position) if bench.noise is None else bench.noise
    tuning = _tuning(bench)
    return noise._replace(
        acceleration=np.asarray(tuning.acceleration_sd), initial_speed=np.asarray(tuning.initial_speed)
    )


def _tuning(bench: Workbench) -> Tuning:
    conditions = bench.conditions
    return bench.tuning or Tuning(conditions.kalman_acceleration_sd, conditions.kalman_extra_lead_s)


def _tracker(bench: Workbench) -> Predictor:
    return ConstantVelocity(_noise(bench), np.asarray(_tuning(bench).velocity_decay))


def _rule(bench: Workbench) -> ParabolaAware:
    conditions = bench.conditions
    return ParabolaAware(np.asarray(conditions.parabola_curvature), np.asarray(conditions.reversal_half_width))


def _parabola(bench: Workbench) -> Predictor:
    conditions = bench.conditions
    if bench.noise is None:
        return _rule(bench)
    # With noise in what is seen, the rule is worth something to a filter alone.
    return parabola_filter(conditions, _scatter(bench), bench.noise)


def _manoeuvring(bench: Workbench) -> Predictor:
    noise, exact = _noise(bench), np.asarray(EXACT_SD)
    if bench.noise is None:
        noise = noise._replace(along=exact, across=exact)
    rates = ModelRates(*(np.asarray(each) for each in (_tuning(bench).turn_rate, STOP_RATE, STANDING)))
    return Manoeuvring(noise, rates, np.asarray(bench.conditions.hit_radius), np.asarray(_scatter(bench)))


def _scatter(bench: Workbench) -> float:
    """Return the standard deviation of the pellets' azimuth [rad]."""
    return float(np.asarray(bench.muzzle.sd)[..., 1])


def _kalman(bench: Workbench) -> Controller:
    period = np.asarray(bench.conditions.control_period_s)
    lead = period + _tuning(bench).extra_lead_s
    return DirectAim(_tracker(bench), bench.muzzle, bench.limits, lead=lead, period=period)


def _preview(predictor: Callable[[Workbench], Predictor]) -> Callable[[Workbench], Controller]:
    def build(bench: Workbench) -> Controller:
        period = bench.conditions.control_period_s
        tuning = bench.tuning or Tuning(bench.conditions.kalman_acceleration_sd)
        return make_preview_aim(
            predictor(bench), bench.muzzle, bench.model, bench.limits, period, tuning.smoothing, tuning.extra_lead_s
        )

    return build


def _oracle(bench: Workbench) -> Controller:
    conditions = bench.conditions
    return make_oracle(
        bench.model,
        bench.muzzle,
        bench.limits,
        conditions.control_period_s,
        conditions.decisions,
        conditions.hit_radius,
    )


CONTROLLERS: dict[str, Callable[[Workbench], Controller]] = {
    "kalman": _kalman,
    "kalman-tuned": _kalman,
    "kalman-lq": _preview(_tracker),
    "imm-lq": _preview(_manoeuvring),
    "parabola-lq": _preview(_parabola),
    "no-lead": _preview(lambda bench: Hold()),  # noqa: ARG005
    "vertex": _preview(lambda bench: Vertex(_rule(bench))),
    "oracle": _oracle,
}
"""Name → builder. One of your own needs no line here: see `find_controller`."""
RESERVED = (*CONTROLLERS, "perfect", "history", "paper", "policy")
"""What results and the page call the built-in controllers, perfect aim and trained policies."""


class Listed(NamedTuple):
    """A controller that can be built."""

    name: str
    """By which results call it."""
    build: Callable[[Workbench], Any]
    """Builds it."""
    extension: Extension | None
    """Where it comes from, if it is a user's own."""


def find_controller(spec: str) -> Listed:
    """Find a controller by name.

    Args:
      spec: one of `CONTROLLERS`; or one of a user's own: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point of
        the group `archerfish.controllers`. It is a function that is given a `Workbench` and returns a controller, or a
        class with such a function, `build`.

    Raises:
      InputError: if it can't be found, its code fails, or results would confuse its name with another's.
    """
    if spec in CONTROLLERS:
        return Listed(spec, CONTROLLERS[spec], None)
    if not is_extension(spec, "controller") and not spec.endswith(".py"):
        near = get_close_matches(spec.lower(), CONTROLLERS, 1)
        meant = f"; perhaps you meant {near[0]}" if near else ""
        raise InputError(
            f"controller must be one of {', '.join(CONTROLLERS)}, or one of your own ({FORMS}), got {spec!r}{meant}"
        )
    found = find_extension(spec, "controller")
    if found.name in RESERVED:
        raise InputError(f"{found.where}: results already have a controller {found.name!r}; call yours something else")
    build = found.value
    if isinstance(build, type):
        build = getattr(build, "build", None)
    if not callable(build):
        raise InputError(
            f"{found.where}: expected a function of a workbench that returns a controller, or a class with such a "
            f"classmethod build(cls, bench), got {_article(found.value)}; docs/adding.md has one of each"
        )
    return Listed(found.name, build, found)


def make_controller(name: str, bench: Workbench) -> Any:
    """Build a controller in float32.

    Args:
      name: as `find_controller` takes it.
      bench: what it is built from.

    Raises:
      InputError: if it can't be found, its building fails, or what is built is no controller.
    """
    return build_controller(find_controller(name), bench)


def build_controller(listed: Listed, bench: Workbench) -> Any:
    """Build a controller in float32 that was found before.

    Args:
      listed: as `find_controller` returns it.
      bench: what it is built from.

    Raises:
      InputError: if the building of one of a user's own fails, or what is built is no controller.
    """
    if listed.extension is None:
        return single_precision(listed.build(bench))
    with own_code(listed.extension):
        built = listed.build(bench)
        _check_built(built)
        return single_precision(built)


def _check_built(built: Any) -> None:
    lacking = [each for each in ("reset", "step") if not callable(getattr(built, each, None))]
    if lacking or isinstance(built, type):
        raise InputError(
            f"builds {_article(built)} without {' and '.join(lacking) or 'fields'}, expected a controller: a "
            "NamedTuple of arrays with reset(seen, truth) and step(state, seen)"
        )
    if not hasattr(built, "_fields"):
        raise InputError(f"builds {_article(built)}, expected a NamedTuple, for it is handed to a compiled program")
    for name, value in zip(built._fields, built, strict=True):
        kinds: list[str] = []
        map_arrays(lambda each, kinds=kinds: kinds.append(np.asarray(each).dtype.kind), value)
        if set(kinds) - set("fiub"):
            raise InputError(f"{type(built).__name__}.{name} is {_article(value)}, expected an array or a number")


def _article(value: Any) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
