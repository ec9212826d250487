"""One evaluation as a task: some controllers in one world on the same engagements as all others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from archerfish.cli.setting import Setting, setting_world
from archerfish.controllers.policy import policy_from_record
from archerfish.controllers.roster import Tuning, Workbench, find_controller, make_controller
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.bounds.cell_bounds import CellBounds
from archerfish.evaluation.evaluate import Entrant, Ground, Outcome, compete, ground_bounds, perfect_aim
from archerfish.evaluation.rehearsal import rehearse
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.evaluation.tuning import GRIDS, Tuned, tune
from archerfish.records.errors import InputError
from archerfish.records.extensions import own_code
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.kalman_filter import noise_from_record
from archerfish.simulation.own_motion import check_paths, find_motion
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.engagement_world import Known, RobotWorld

TUNING_ENGAGEMENTS = 64
"""Engagements per cell of the tuning stream."""
CONTROLLER_NAMES = {"tracked": "history"}
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
    """Controller → its settings, from `tune_controllers`; the paper's conditions hold the others'."""
    motion: str = ""
    """How moving targets move, as `find_motion` takes it; as eq (7) says if empty."""


def make_ground(task: EvaluationTask) -> Ground:
    """Build the world and draw the engagements; equal tasks give equal draws, in any process."""
    setting, conditions = task.setting, task.setting.conditions
    simulator = setting_world(setting, task.command_limit)
    motion = find_motion(task.motion) if task.motion else None
    suites = table_suites(conditions, simulator.plants, task.tables, motion)
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
    setting, conditions = task.setting, task.setting.conditions
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


def tune_controllers(task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None) -> list[Tuned]:
    """Tune the tracking controllers of a task in its setting's simulator, all on the same draws.

    Args:
      task: which controllers, for which robot.
      advance: hears how many are done, and of the latest.
    """
    setting, conditions = task.setting, task.setting.conditions
    world = setting_world(setting, task.command_limit)
    trials = draw_trials(
        table_suites(conditions, world.plants, motion=find_motion(task.motion) if task.motion else None),
        TUNING_ENGAGEMENTS,
        conditions.decisions,
        task.seed,
        "tuning",
        world.normals,
    )
    found = []
    for name in (each for each in task.controllers if each in GRIDS):

        def build(tuning: Tuning, name: str = name) -> Any:
            return make_controller(name, _bench(task, tuning))

        found.append(tune(world, trials, name, build, conditions.hit_radius))
        advance(len(found), name)
    return found


def run_evaluation(task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None) -> list[Outcome]:
    """Let the controllers of a task fight.

    Args:
      task: who, where.
      advance: hears how many controllers are done, and of the latest one.

    Raises:
      InputError: if a controller is unknown.
    """
    ground, done = make_ground(task), []
    classical = [spec for spec in task.controllers if spec != "perfect"]
    entrants = [
        Entrant(find_controller(spec).name, make_controller(spec, _bench(task, task.tuning.get(spec))))
        for spec in classical
    ]
    entrants += [_policy_entrant(policy) for policy in task.policies]

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
      advance: hears how many controllers are done in all, and of the latest one.
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
    found = ground_bounds(make_ground(task), task.seed)
    advance(1.0, f"{task.command_limit} bounds")
    return found


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


def _policy_entrant(policy: PolicyRecord) -> Entrant:
    name, seed = policy_label(policy)
    return Entrant(name, policy_from_record(policy), seed)
