"""One evaluation as a task: some controllers in one world on the same engagements as all others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from archerfish.cli.setting import Setting, setting_world
from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.controllers.roster import Tuning, Workbench, find_controller, make_controller
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.bounds.cell_bounds import CellBounds
from archerfish.evaluation.evaluate import Entrant, Ground, Outcome, compete, ground_bounds, perfect_aim
from archerfish.evaluation.rehearsal import rehearse
from archerfish.evaluation.results import MOTION_TABLES
from archerfish.evaluation.suites import Suite, draw_trials, motion_suites, table_suites
from archerfish.evaluation.trial import fight
from archerfish.evaluation.tuning import GRIDS, Tuned, tune
from archerfish.paper.conditions import Conditions
from archerfish.paper.tuning import paper_settings
from archerfish.records.errors import InputError
from archerfish.records.extensions import own_code
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.kalman_filter import noise_from_record
from archerfish.targets.drawn import ANY, WAYS
from archerfish.targets.own_motion import check_paths, find_motion
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.engagement_world import Known, RobotWorld

TUNING_ENGAGEMENTS = 64
"""Engagements per cell of the tuning stream, where there are no more cells than in the paper's tables."""
CONTROLLER_NAMES = {"tracked": "history", "multimodel": "policy"}
"""Kind of a policy's observation → name in the results, where they differ: on a robot, `history` tracks."""


@dataclass(frozen=True)
class EvaluationTask:
    """An evaluation, as data: it can be handed to another process."""

    setting: Setting
    """The robot as far as it is known."""
    command_limit: str
    """What the gimbal may be asked."""
    engagements: int
    """Number per cell."""
    seed: int
    """Of engagements and dispersion."""
    controllers: tuple[str, ...] = ()
    """Controllers as `find_controller` takes them; "perfect" scores perfect aim."""
    policies: tuple[PolicyRecord, ...] = ()
    """Trained policies."""
    robot: str = ""
    """Name or file of the virtual robot to shoot with; the setting's simulator if empty."""
    tables: tuple[str, str] = ("II", "III")
    """The paper's tables that the cells stand beside."""
    tuning: Mapping[str, Tuning] = field(default_factory=dict)
    """Controller → its settings; `with_tuning` finds those that are missing."""
    motion: str = ""
    """How moving targets move, as `find_motion` takes it; as eq (7) says if empty."""
    target: str = "paper"
    """The paper's targets, or one of `targets.drawn`: then the tables and the motion above don't count."""
    seconds: float = 1.0
    """Length of an engagement [s] where the targets are not the paper's, one of `MOTION_TABLES`."""

    @property
    def conditions(self) -> Conditions:
        """Conditions of the engagements."""
        conditions = self.setting.conditions
        return conditions if self.target == "paper" else replace(conditions, engagement_s=self.seconds)

    def suites(self, plants: int) -> tuple[Suite, ...]:
        """Return the cells.

        Args:
          plants: number of posterior draws of the world's plant.
        """
        if self.target != "paper":
            names = tuple(WAYS) if self.target == ANY else (self.target,)
            return motion_suites(self.conditions, self.seconds, plants, names)
        return table_suites(self.conditions, plants, self.tables, find_motion(self.motion) if self.motion else None)


def make_ground(task: EvaluationTask) -> Ground:
    """Build the world and draw the engagements; equal tasks give equal draws, in any process."""
    setting, conditions = task.setting, task.conditions
    simulator = setting_world(setting, task.command_limit)
    motion = find_motion(task.motion) if task.motion else None
    suites = task.suites(simulator.plants)
    trials = draw_trials(suites, task.engagements, conditions.decisions, task.seed, normals=simulator.normals)
    if motion:
        check_paths(motion, trials.engagements.motion, conditions.engagement_s)
    if task.robot:
        robot = load_robot(task.robot)
        world = RobotWorld(robot, _known(task), conditions.control_period_s)
        return Ground(world, trials, task.command_limit, robot.schema.name, conditions)
    return Ground(simulator, trials, task.command_limit, setting.name, conditions)


def _known(task: EvaluationTask) -> Known:
    if task.setting.sensing is None:
        raise InputError("shooting with a robot needs a sensing record; give --sensing, as identify sensing writes it")
    bench = _bench(task, None)
    return Known(task.setting.sensing.camera.time_offset, bench.limits, bench.model, bench.muzzle)


def _bench(task: EvaluationTask, tuning: Tuning | None) -> Workbench:
    setting, conditions = task.setting, task.conditions
    sensing = setting.sensing
    latency = (sensing.link.command_latency or 0.0) if sensing else 0.0
    return Workbench(
        model=gimbal_model(setting.pitch, setting.yaw, conditions.control_period_s, latency),
        muzzle=muzzle_from_record(setting.muzzle),
        limits=named_limits(task.command_limit, setting.limits, conditions.line_of_sight_lead),
        conditions=conditions,
        noise=noise_from_record(sensing, 0.0) if sensing else None,
        tuning=tuning,
    )


def with_tuning(task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None) -> EvaluationTask:
    """Return a task with settings for all its controllers that are tuned, those that it has included.

    In the simulator of the printed gimbal they are stored, since it never changes; for any other robot, and for targets
    that don't move as eq (7) says, they are tuned now, which takes seconds each.

    Args:
      task: the task.
      advance: gets how many are done, and the latest.
    """
    names = untuned(task)
    if is_stored(task):
        stored = paper_settings(task.command_limit)
        found = {name: Tuning(**stored[name]) for name in names if name in stored}
    else:
        tuned = tune_controllers(replace(task, controllers=names), advance)
        found = {each.controller: each.tuning for each in tuned}
    return replace(task, tuning={**found, **task.tuning})


def untuned(task: EvaluationTask) -> tuple[str, ...]:
    """Return the controllers of a task that are to be tuned yet.

    With the printed gimbal, `kalman` is the one that the assumed conditions were calibrated with, and never tuned.
    """
    fixed = {"kalman"} if task.setting.name == "paper" else set()
    return tuple(each for each in task.controllers if each in GRIDS and each not in {*task.tuning, *fixed})


def is_stored(task: EvaluationTask) -> bool:
    """Whether the settings of a task's controllers are stored: in the simulator of the printed gimbal."""
    return task.setting.name == "paper" and not task.motion and task.target == "paper"


def tune_controllers(
    task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None, engagements: int | None = None
) -> list[Tuned]:
    """Tune the controllers of a task that can be, in its setting's simulator, all on the same draws.

    Args:
      task: which controllers, for which robot.
      advance: gets how many are done, and the latest.
      engagements: number per cell; `TUNING_ENGAGEMENTS` if not given.
    """
    count, found = engagements or _tuning_engagements(task), []
    # Who does not know how long an engagement lasts has one setting for all lengths.
    lengths = [task] if task.target == "paper" else [replace(task, seconds=each) for each in MOTION_TABLES]
    grounds = [(each, tuning_ground(each, count)) for each in lengths]
    for name in (each for each in task.controllers if each in GRIDS):
        found.append(tune(name, partial(_mean_rate, grounds, name)))
        advance(len(found), name)
    return found


def _tuning_engagements(task: EvaluationTask) -> int:
    """Return how many engagements per cell keep a tuning as short as for the paper's eight cells."""
    return max(1, TUNING_ENGAGEMENTS // (len(WAYS) // 2)) if task.target == ANY else TUNING_ENGAGEMENTS


def _mean_rate(grounds: Sequence[tuple[EvaluationTask, Ground]], name: str, tuning: Tuning) -> float:
    rates = [tuned_rate(task, ground, name, tuning) for task, ground in grounds]
    return sum(rates) / len(rates)


def tuning_ground(task: EvaluationTask, engagements: int) -> Ground:
    """Build the simulator of a task's setting with engagements that no evaluation has.

    Args:
      task: for which robot.
      engagements: number per cell.
    """
    conditions = task.conditions
    world = setting_world(task.setting, task.command_limit)
    suites = replace(task, tables=("II", "III")).suites(world.plants)
    trials = draw_trials(suites, engagements, conditions.decisions, task.seed, "tuning", world.normals)
    return Ground(world, trials, task.command_limit, task.setting.name, conditions)


def tuned_rate(task: EvaluationTask, ground: Ground, name: str, tuning: Tuning) -> float:
    """Return the hit rate of a controller with some settings, 0…1.

    Args:
      task: for which robot.
      ground: from `tuning_ground`.
      name: of the controller.
      tuning: its settings.
    """
    shots = fight(ground.world, make_controller(name, _bench(task, tuning)), ground.trials)
    return float(shots.hits(ground.conditions.hit_radius).mean())


def run_evaluation(task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None) -> list[Outcome]:
    """Let the controllers of a task fight, after tuning those that have no settings yet.

    Args:
      task: who, where.
      advance: receives how many controllers are done, and of the latest one.

    Raises:
      InputError: if a controller is unknown.
    """
    task = with_tuning(task)
    ground, done = make_ground(task), []
    classical = [spec for spec in task.controllers if spec != "perfect"]
    entrants = [classical_entrant(task, spec) for spec in classical]
    entrants += [policy_entrant(policy) for policy in task.policies]

    def report(name: str) -> None:
        done.append(name)
        advance(len(done), f"{ground.setting} {task.command_limit} {name}")

    perfect = [perfect_aim(ground)] if "perfect" in task.controllers else []
    return perfect + compete(ground, entrants, report)


def run_evaluations(
    tasks: Sequence[EvaluationTask], advance: Callable[[float, str], None] = lambda *_: None
) -> list[list[Outcome]]:
    """Run evaluations one after the other in one process, which compiles a controller once for all of them.

    Args:
      tasks: the same controllers under several command limits, say.
      advance: receives how many controllers are done in all, and of the latest one.
    """
    outcomes: list[list[Outcome]] = []
    for task in tasks:
        before = sum(len(each) for each in outcomes)
        outcomes.append(run_evaluation(task, _after(before, advance)))
    return outcomes


def run_bounds(
    task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None
) -> list[CellBounds] | None:
    """Bound what can be hit in the cells of a task.

    Args:
      task: where; its controllers don't matter.
      advance: receives that it is done.
    """
    found = task_bounds(task, make_ground(task))
    advance(1.0, f"{task.command_limit} bounds")
    return found


def task_bounds(task: EvaluationTask, ground: Ground) -> list[CellBounds] | None:
    """Return a bound for each cell of a task; None where there are none, as for targets that are not the paper's.

    Args:
      task: which targets.
      ground: of the task.
    """
    return ground_bounds(ground, task.seed) if task.target == "paper" else None


def _after(before: float, advance: Callable[[float, str], None]) -> Callable[[float, str], None]:
    def further(done: float, note: str = "") -> None:
        advance(before + done, note)

    return further


def policy_label(policy: PolicyRecord) -> tuple[str, int]:
    """Return name and training seed, by which results tell policies apart."""
    seed = policy.training.get("seed")
    return CONTROLLER_NAMES.get(policy.observation, policy.observation), 0 if seed is None else int(seed)


def try_own_code(task: EvaluationTask) -> None:
    """Try what a user brings, before anything takes long: its controllers decide once, its targets move.

    Raises:
      InputError: naming what of it can't be used.
    """
    found = [(spec, find_controller(spec).extension) for spec in task.controllers if spec != "perfect"]
    own = [(spec, extension) for spec, extension in found if extension is not None]
    if own or task.motion:
        ground = make_ground(task)
        for spec, extension in own:
            with own_code(extension):
                rehearse(make_controller(spec, _bench(task, None)), ground.world, ground.trials)


def classical_entrant(task: EvaluationTask, spec: str) -> Entrant:
    """Build a controller for the robot of a task, with the settings that the task has for it.

    Args:
      task: for which robot.
      spec: as `find_controller` takes it.
    """
    return Entrant(find_controller(spec).name, make_controller(spec, _bench(task, task.tuning.get(spec))))


def policy_entrant(policy: PolicyRecord) -> Entrant:
    """Build the controller of a policy under the name that results give it."""
    name, seed = policy_label(policy)
    return Entrant(name, controller_from_record(policy), seed)
