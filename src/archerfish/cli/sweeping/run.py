"""The sweep itself: rounds of configurations, each in every world with every seed, run by anybody, recorded once."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from archerfish.cli.setting import Setting
from archerfish.cli.sweeping.executor import Executor
from archerfish.cli.sweeping.folder import SweepFolder
from archerfish.cli.sweeping.parameters import Base, Value, make_task, world_name
from archerfish.cli.sweeping.proposals import Configuration, Proposer
from archerfish.cli.sweeping.ranking import score
from archerfish.cli.sweeping.results import check_same, make_result
from archerfish.cli.sweeping.trial import TrialDone, TrialJob, job_configuration, run_trial
from archerfish.cli.training_run import TrainingTask
from archerfish.records.errors import InputError
from archerfish.records.provenance import provenance


@dataclass(frozen=True)
class Plan:
    """What every configuration goes through."""

    base: Base
    """What is not varied."""
    worlds: tuple[dict[str, Value], ...]
    """Parameters of each world; one that is empty where the world is not varied."""
    seeds: tuple[int, ...]
    """Of the trainings."""
    engagements: int
    """Per cell, to score a trial."""
    engagement_seed: int
    """Of these engagements."""
    settings: Mapping[str, Setting]
    """Value of `records` → what was read."""


@dataclass(frozen=True)
class PlannedTrial:
    """A trial before it is run."""

    trial: int
    """Number in the sweep."""
    configuration: int
    """Number of its configuration."""
    values: dict[str, Value]
    """What is varied: name → value."""
    seed: int
    """Of the training."""


def planned_trials(plan: Plan, first: int, configurations: Sequence[Configuration]) -> list[PlannedTrial]:
    """Give the trials of some configurations their numbers: by configuration, then world, then seed.

    Args:
      plan: worlds and seeds.
      first: number of the first of these configurations.
      configurations: in order.
    """
    found: list[PlannedTrial] = []
    for number, configuration in enumerate(configurations, first):
        trial = number * len(plan.worlds) * len(plan.seeds)
        cases = [(world, seed) for world in plan.worlds for seed in plan.seeds]
        found += [
            PlannedTrial(trial + place, number, {**configuration, **world}, seed)
            for place, (world, seed) in enumerate(cases)
        ]
    return found


def run_rounds(
    plan: Plan,
    proposer: Proposer,
    folder: SweepFolder,
    executor: Executor,
    advance: Callable[[float, str], None] = lambda *_: None,
    work: Callable[[TrialJob], TrialDone] = run_trial,
) -> int:
    """Run what is proposed and not yet done, until nothing more is proposed.

    Args:
      plan: what every configuration goes through.
      proposer: of configurations.
      folder: holds the finished trials and takes the others.
      executor: runs trials.
      advance: hears of the number of finished trials, and of the best hit rate of one so far.
      work: what a trial does.

    Returns:
      The number of trials of the sweep, whether they were done before or now.

    Raises:
      InputError: if a finished trial is another one than is proposed now.
    """
    proposed, done = 0, 0
    configurations = next(proposer, None)
    while configurations is not None:
        trials = planned_trials(plan, proposed, configurations)
        for finished in _run_missing(plan, trials, folder, executor, work):
            advance(done + finished, _note(folder))
        proposed, done = proposed + len(configurations), done + len(trials)
        try:
            configurations = proposer.send(_scores(trials, folder))
        except StopIteration:
            configurations = None
    return done


def _run_missing(
    plan: Plan,
    trials: Sequence[PlannedTrial],
    folder: SweepFolder,
    executor: Executor,
    work: Callable[[TrialJob], TrialDone],
) -> Iterator[int]:
    """Run the trials of a round that are not done yet; yield the number of those that are, again and again."""
    jobs: list[TrialJob] = []
    waiting: list[PlannedTrial] = []
    finished = 0
    for each in trials:
        found = folder.results.get(each.trial)
        task, problem = _task(plan, each)
        if found is not None:
            now = _outcome(plan, each, TrialDone(found.problem))
            check_same(found, now)
        elif task is None:
            folder.record(_outcome(plan, each, TrialDone(problem)), None)
        else:
            jobs.append(_job(plan, task))
            waiting.append(each)
            continue
        finished += 1
    yield finished
    for count, (index, done) in enumerate(executor(work, jobs), finished + 1):
        folder.record(_outcome(plan, waiting[index], done), done.files)
        yield count


def _task(plan: Plan, trial: PlannedTrial) -> tuple[TrainingTask | None, str | None]:
    """Make a trial's training; a combination that a sampler has hit upon may not go together."""
    try:
        return make_task(plan.base, trial.values, trial.seed, plan.settings), None
    except InputError as error:
        return None, str(error)


def _job(plan: Plan, task: TrainingTask) -> TrialJob:
    # Other machines don't have the files; what they were is said in the policy all the same.
    return TrialJob(
        task=replace(task, setting=replace(task.setting, inputs=())),
        inputs=provenance(None, task.setting.inputs)["inputs"],
        engagements=plan.engagements,
        engagement_seed=plan.engagement_seed,
        configuration=job_configuration(task, plan.engagements, plan.engagement_seed),
    )


def _outcome(plan: Plan, trial: PlannedTrial, done: TrialDone) -> Any:
    world = world_name(plan.base, trial.values, plan.settings)
    return make_result(done, trial.trial, trial.configuration, world, trial.seed, trial.values)


def _scores(trials: Sequence[PlannedTrial], folder: SweepFolder) -> list[float]:
    numbers = dict.fromkeys(each.configuration for each in trials)
    return [score([folder.results[each.trial] for each in trials if each.configuration == k]) for k in numbers]


def _note(folder: SweepFolder) -> str:
    rates = [each.rate for each in folder.results.values()]
    return f"best {100 * max(rates):.1f} %" if rates else ""
