"""One evaluation as a task: some controllers in one world on the same engagements as all others."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from archerfish.cli.setting import Setting
from archerfish.controllers.policy import policy_from_record
from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.evaluate import Entrant, Ground, Outcome, compete, perfect_aim
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.records.policy import PolicyRecord
from archerfish.simulation.setting import make_world


@dataclass(frozen=True)
class EvaluationTask:
    """An evaluation, as data: it can be handed to another process."""

    setting: Setting
    """The robot."""
    command_limit: str
    """What the gimbal may be asked."""
    engagements: int
    """Number per cell."""
    seed: int
    """Of engagements and dispersion."""
    controllers: tuple[str, ...] = ()
    """Classical controllers by name; "perfect" scores perfect aim."""
    policies: tuple[PolicyRecord, ...] = ()
    """Trained policies."""


def make_ground(task: EvaluationTask) -> Ground:
    """Build the world and draw the engagements; equal tasks give equal draws, in any process."""
    setting, conditions = task.setting, task.setting.conditions
    world = make_world(setting.pitch, setting.yaw, setting.muzzle, setting.limits, task.command_limit, conditions)
    suites = table_suites(conditions, world.plants)
    trials = draw_trials(suites, task.engagements, conditions.decisions, task.seed)
    return Ground(world, trials, task.command_limit, setting.name, conditions)


def run_evaluation(task: EvaluationTask, advance: Callable[[float, str], None] = lambda *_: None) -> list[Outcome]:
    """Let the controllers of a task fight.

    Args:
      task: who, where.
      advance: hears how many controllers are done, and of the latest one.

    Raises:
      InputError: if a controller is unknown.
    """
    ground, done = make_ground(task), []
    classical = [name for name in task.controllers if name != "perfect"]
    bench = Workbench(
        model=gimbal_model(task.setting.pitch, task.setting.yaw, task.setting.conditions.control_period_s),
        muzzle=muzzle_from_record(task.setting.muzzle),
        limits=named_limits(task.command_limit, task.setting.limits, task.setting.conditions.line_of_sight_lead),
        conditions=task.setting.conditions,
    )
    entrants = [Entrant(name, make_controller(name, bench)) for name in classical]
    entrants += [_policy_entrant(policy) for policy in task.policies]

    def report(name: str) -> None:
        done.append(name)
        advance(len(done), f"{task.command_limit} {name}")

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


def _after(before: float, advance: Callable[[float, str], None]) -> Callable[[float, str], None]:
    def further(done: float, note: str = "") -> None:
        advance(before + done, note)

    return further


def _policy_entrant(policy: PolicyRecord) -> Entrant:
    seed = policy.training.get("seed")
    return Entrant(policy.observation, policy_from_record(policy), 0 if seed is None else int(seed))
