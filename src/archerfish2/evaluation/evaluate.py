"""The evaluation of any controllers in any world: engagements drawn once, hits counted, differences paired."""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from archerfish2 import progress, provenance
from archerfish2.arrays import is_tree, leaves, map_arrays, single_precision
from archerfish2.compiled import has_jax, import_jax
from archerfish2.controllers.registry import GRIDS, NAMES, Tuning, check_decision, make_controller, object_plugin
from archerfish2.errors import InputError
from archerfish2.evaluation.hit_rate import hit_rate, paired_difference
from archerfish2.evaluation.published import with_bounds
from archerfish2.evaluation.results import Cell, Comparison, Kind, Results, pairs_to_compare
from archerfish2.evaluation.rollout import count, count_perfect_aim
from archerfish2.evaluation.suites import draw
from archerfish2.evaluation.tuning import BUDGET, tune
from archerfish2.paper.tables import printed_rate
from archerfish2.plugins import find_plugin
from archerfish2.protocols import Controller, Engagement, Seen, Shot, World, aim
from archerfish2.robot import Robot
from archerfish2.simulation.world import SimulatedWorld, make_world
from archerfish2.task import Suite, Task

PERFECT = "perfect"
"""Name of perfect aim, which only dispersion makes miss."""


class Contender(NamedTuple):
    """A controller under the name that results give it."""

    name: str  # its own
    controller: Controller | None  # for the length that is shot; None: perfect aim
    kind: Kind
    seed: int | None = None  # of a policy's training


class _Shot(NamedTuple):
    """What one contender did in all cells of one length."""

    contender: Contender
    hit: NDArray[np.bool_]  # (cells, engagements, T)
    fired: NDArray[np.bool_]  # (cells, engagements, T)
    yaw_acceleration: float | None


def evaluate(
    controllers: Any = ("kalman", "kalman-lq", "oracle"),
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
    *,
    world: Any = None,
    engagements: int = 500,
    seed: int = 0,
    tuned: bool = True,
) -> Results:
    """Count the hits of controllers on the same engagements with the same dispersion draws.

    Args:
      controllers: names as `make_controller` takes them, "perfect" for perfect aim, policies, or objects with `reset`
        and `step`; or a mapping from the names that results give them.
      robot: its records, or their folder; the paper's if not given.
      task: or its name or TOML file.
      world: where to shoot instead of in the robot's simulator: a `World`, a function of robot and task that returns
        one, "./FILE.py:NAME" of either, or anything with `world(robot, task)`.
      engagements: per cell, at least 2.
      seed: of engagements and dispersion.
      tuned: whether classical controllers are tuned for robot and task first, on draws that no evaluation has; what
        was tuned before is kept.

    Raises:
      InputError: if something that was given can't be used, or a user's code fails.
    """
    robot, task = load_robot(robot), load_task(task)
    if not 2 <= engagements <= 1_000_000:
        raise InputError(f"engagements must be 2…1000000 for an interval, got {engagements}; give more of them")
    if seed < 0:
        raise InputError(f"seed must be at least 0, got {seed}; choose another")
    found = find_world(world, robot, task)
    named = _named(controllers)
    durations: dict[str, float] = {}
    with _timed(durations, "checks"):
        check_controllers(named, found, robot, task)
    with _timed(durations, "tuning"):
        tuning = _tune([value for _, value in named if isinstance(value, str)], robot, task) if tuned else {}
    with _timed(durations, "evaluation"):
        shots = _shoot(named, tuning, found, robot, task, (engagements, seed))
    cells: list[Cell] = []
    comparisons: list[Comparison] = []
    for suites, outcomes in shots:
        cells += [_cell(suite, index, shot, found, task) for shot in outcomes for index, suite in enumerate(suites)]
        comparisons += _comparisons(suites, outcomes, found, task)
    simulated = isinstance(found, SimulatedWorld) and world is None
    return Results(
        seed=seed,
        commit=provenance.code_commit(),
        versions=provenance.library_versions(),
        tasks=(task,),
        robots={found.name: {"robot": robot.name, "digest": robot.digest()}},
        tuning={f"{found.name}/{task.command_limit}": tuning} if tuning else {},
        cells=with_bounds(cells, robot, task, seed) if simulated else tuple(cells),
        comparisons=tuple(comparisons),
        durations=durations,
    )


def load_robot(robot: Robot | str | Path | None) -> Robot:
    """Return a robot, or that of a folder; the paper's if none is given."""
    return Robot.paper() if robot is None else robot if isinstance(robot, Robot) else Robot.load(robot)


def load_task(task: Task | str | Path) -> Task:
    """Return a task, or that of a name or TOML file."""
    return task if isinstance(task, Task) else Task.load(task)


def find_world(world: Any, robot: Robot, task: Task) -> World:
    """Return the robot's simulator, or the world that was given instead; see `evaluate`.

    Raises:
      InputError: if it lacks what a world has, has another decision period than the task, or its code fails.
    """
    if world is None:
        return make_world(robot, task)
    plugin = find_plugin(world, "world") if isinstance(world, str) else object_plugin(world, "world")
    with plugin.running():
        found = plugin.value
        if hasattr(found, "world"):
            found = found.world(robot, task)
        elif isinstance(found, type) or (callable(found) and not hasattr(found, "begin")):
            found = found(robot, task)
        names = ("name", "compiled", "period_s", "normals", "plants", "begin", "see", "step", "truth")
        missing = [name for name in names if not hasattr(found, name)]
        if missing:
            raise InputError(f"a {type(found).__name__} lacks {', '.join(missing)}; give it what `World` has")
        if abs(found.period_s - task.period_s) > 1e-6:
            periods = f"{found.period_s:g} s, the task's {task.period_s:g} s"
            raise InputError(f"the decision period of a {type(found).__name__} is {periods}; make them equal")
        return _checked(single_precision(found) if is_tree(found) else found, task)


def _checked(world: Any, task: Task) -> World:
    """Let a world pass one decision, in NumPy and, where it is compiled, traced."""
    cells = task.replace(lengths_s=task.lengths_s[:1]).cells()[:1]

    def decision(world: Any, engagement: Engagement, normals: Any) -> tuple[Any, Any]:
        state = world.begin(engagement, normals)
        state, shot = world.step(state, aim(world.see(state).command), normals[:, 0])
        return world.see(state), shot

    drawn = draw(cells, 3, 0, "stopping", world.normals, world.plants)
    for kind, answer in zip((Seen, Shot), decision(world, *drawn), strict=True):
        if not isinstance(answer, kind) or any(np.shape(each)[:1] != (3,) for each in leaves(answer)):
            expected = f"expected a {kind.__name__} of arrays as long as there are engagements"
            raise InputError(f"a {type(world).__name__} returns a {type(answer).__name__}, {expected}; correct it")
    if world.compiled and has_jax():
        import_jax().eval_shape(decision, world, *drawn)
    checked: World = world
    return checked


def _named(controllers: Any) -> list[tuple[str, Any]]:
    """Return the controllers with the names that results give them; equal names of one seed get -2, -3."""
    if isinstance(controllers, str) or callable(controllers) or hasattr(controllers, "step"):
        controllers = (controllers,)
    pairs: Iterable[tuple[str, Any]]
    pairs = controllers.items() if isinstance(controllers, Mapping) else ((_name(each), each) for each in controllers)
    named: dict[tuple[str, int | None], Any] = {}
    for name, value in pairs:
        names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
        free = next(each for each in names if (each, _seed(value)) not in named)
        named[free, _seed(value)] = value
    if not named:
        raise InputError('controllers: there is none; give one, such as "kalman"')
    return [(name, value) for (name, _), value in named.items()]


def _name(controller: Any) -> str:
    if isinstance(controller, str):
        return controller.rpartition(":")[2]
    facts = getattr(controller, "facts", None)
    return "policy" if facts is not None else getattr(controller, "__name__", type(controller).__name__)


def _seed(controller: Any) -> int | None:
    seed: int | None = getattr(getattr(controller, "facts", None), "seed", None)
    return seed


def _contender(name: str, value: Any, robot: Robot, task: Task, tuning: Mapping[str, Tuning]) -> Contender:
    if isinstance(value, str) and value == PERFECT:
        return Contender(name, None, "perfect")
    kind: Kind = "classical" if isinstance(value, str) and value in NAMES else "user"
    if getattr(value, "facts", None) is not None:
        return Contender(name, value, "policy", _seed(value))
    chosen = tuning.get(value) if isinstance(value, str) else None
    return Contender(name, make_controller(value, robot, task, chosen), kind)


def check_controllers(named: list[tuple[str, Any]], world: World, robot: Robot, task: Task) -> None:
    """Let a user's controllers and policies decide once, before anything takes long; refuse unknown names.

    Args:
      named: names, and controllers as `evaluate` takes them.
      world: where they are to shoot.
      robot: its records.
      task: of any lengths.

    Raises:
      InputError: if one can't be made, its code fails, or what it returns is no decision.
    """
    part = task.replace(lengths_s=task.lengths_s[:1])
    made = [_contender(name, value, robot, part, {}) for name, value in named]
    if any(each.controller is None for each in made) and not hasattr(world, "shoot"):
        raise InputError(f"perfect aim needs a simulator with shoot(), {world.name} has none; leave {PERFECT} out")
    own = [each for each in made if each.kind in ("user", "policy")]
    if own:
        engagement, normals = draw(part.cells()[:1], 3, 0, "stopping", world.normals, world.plants)
        seen = map_arrays(np.asarray, world.see(world.begin(engagement, normals)))
        for each in own:
            truth = world.truth(engagement) if getattr(each.controller, "needs_truth", False) else None
            check_decision(each.controller, seen, truth)


def _tune(names: list[str], robot: Robot, task: Task) -> dict[str, Tuning]:
    names, tuning = [each for each in dict.fromkeys(names) if each in GRIDS], {}
    with progress.bar("tuning", len(names) or 1, "controllers") as advance:
        for done, name in enumerate(names):

            def report(tried: int, best: float, done: int = done, name: str = name) -> None:
                advance(done + tried / BUDGET, f"{name}: {tried} settings, best {100 * best:.1f} %")

            tuning[name] = tune(name, robot, task, report)
    return tuning


def _shoot(
    named: list[tuple[str, Any]],
    tuning: Mapping[str, Tuning],
    world: World,
    robot: Robot,
    task: Task,
    draws: tuple[int, int],
) -> list[tuple[tuple[Suite, ...], list[_Shot]]]:
    """Let all controllers shoot in the cells of each length; `draws`: engagements per cell, and their seed."""
    engagements, seed = draws
    parts = [task.replace(lengths_s=(length,)) for length in task.lengths_s]
    cells = [part.cells() for part in parts]
    total, done, found = len(named) * sum(engagements * suite.decisions for each in cells for suite in each), 0, []
    with progress.bar("evaluating", total, "shots") as advance:
        for part, suites in zip(parts, cells, strict=True):
            drawn, outcomes = draw(suites, engagements, seed, "evaluation", world.normals, world.plants), []
            decisions = suites[0].decisions
            for name, value in named:

                def report(members: int, before: int = done, each: int = decisions, note: str = name) -> None:
                    advance(before + members * each, note)

                report(0)
                contender = _contender(name, value, robot, part, tuning)
                outcomes.append(_shot(contender, world, drawn, len(suites), report))
                done += len(drawn[1]) * decisions
                advance(done, name)
            found.append((suites, outcomes))
    return found


def _shot(
    contender: Contender, world: World, drawn: tuple[Engagement, Any], cells: int, report: Callable[[int], None]
) -> _Shot:
    if contender.controller is None:
        counted = count_perfect_aim(world, *drawn)
    else:
        counted = count(world, contender.controller, *drawn, report)
    hit, fired = (each.reshape(cells, -1, each.shape[-1]) for each in (counted.hit, counted.fired))
    return _Shot(contender, hit, fired, counted.yaw_acceleration)


def _label(suite: Suite, contender: Contender, world: World, task: Task) -> dict[str, Any]:
    return {
        "world": world.name,
        "motion": suite.motion,
        "range_m": suite.range_m,
        "length_s": suite.length_s,
        "command_limit": task.command_limit,
        "controller": contender.name,
        "seed": contender.seed,
    }


def _cell(suite: Suite, index: int, shot: _Shot, world: World, task: Task) -> Cell:
    hit, fired, contender = shot.hit[index], shot.fired[index], shot.contender
    rate = hit_rate(hit)
    policy, table = contender.kind == "policy", cast(Literal["II", "III"] | None, suite.table)
    return Cell(
        **_label(suite, contender, world, task),
        table=table,
        kind=contender.kind,
        hits=rate.hits,
        shots=int(fired.sum()),
        withheld=int((~fired).sum()),
        engagements=rate.engagements,
        low=rate.low,
        high=rate.high,
        paper=printed_rate(table, suite.range_m, contender.name, is_policy=policy) if table else None,
        yaw_rad_s2=shot.yaw_acceleration,
    )


def _comparisons(suites: tuple[Suite, ...], shots: list[_Shot], world: World, task: Task) -> Iterator[Comparison]:
    contenders = [shot.contender for shot in shots]
    for one, other in pairs_to_compare([(each.name, each.kind) for each in contenders]):
        for index, suite in enumerate(suites):
            difference = paired_difference(shots[one].hit[index], shots[other].hit[index])
            yield Comparison(
                **_label(suite, contenders[one], world, task),
                against=contenders[other].name,
                **difference._asdict(),
            )


@contextmanager
def _timed(durations: dict[str, float], stage: str) -> Iterator[None]:
    begun = time.monotonic()
    yield
    durations[stage] = round(time.monotonic() - begun, 2)
