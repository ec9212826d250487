"""Many trainings: settings that are given, or proposed by Optuna, each trained with several seeds and compared.

A sweep's folder is its record: `study.jsonl` is Optuna's journal, `trials/NNNN-SEED` a training and the hits of its
policy. The same call continues a sweep that was ended at any moment, to the same table: a proposal depends on the
sweep's seed, on its place and on the rates of the batches before alone; what is in the journal is not proposed again,
and a training that is finished is not repeated.
"""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import importlib.util
import itertools
import json
import re
import reprlib
import shutil
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np

from archerfish import storage
from archerfish.errors import InputError, file_error, meant, one_line
from archerfish.evaluation.draws import check_counts
from archerfish.learning.config import ConfigLike, GradientConfig, PpoConfig, TrainConfig
from archerfish.learning.train import with_given
from archerfish.records.json_files import plain, read_json, write_json
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.world import make_world
from archerfish.studies.sweep_ray import run_on_ray
from archerfish.studies.sweep_results import Swept, pooled_settings
from archerfish.studies.sweep_trial import HITS, TrialHits, train_and_count, with_parameters
from archerfish.studies.workers import Job, run_jobs, usual_workers
from archerfish.task import Task, TaskLike

MOST_SETTINGS = 10_000
"""Of a sweep."""
STARTUP = 10
"""Settings that are proposed at random before the estimator begins; of few settings the half."""
_SWEEP, _STUDY, _SCHEMA = "sweep.json", "study.jsonl", "archerfish.sweep/1"
_PARTS: dict[str, Any] = {"gradient": GradientConfig, "ppo": PpoConfig}
_RANGE = re.compile(r"([-+.\deE]+?)\.\.([-+.\deE]+)(:log)?")

Vary: TypeAlias = Mapping[str, str | Sequence[Any]]
"""Name of a setting, as "gradient.learning_rate" → values, or a text: "V1,V2,…", "LOW..HIGH" or "LOW..HIGH:log"."""


def sweep(
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    vary: Vary | None = None,
    out: str | Path,
    trials: int | None = None,
    seeds: int = 1,
    config: ConfigLike = None,
    steps: int | None = None,
    engagements: int = 64,
    seed: int = 0,
    batch: int = 4,
    workers: int | None = None,
    ray: str | None = None,
) -> Swept:
    """Train with many settings and seeds, and compare the hit rates of the policies.

    All values are combined, in their order. With `trials`, which a range needs, Optuna's tree-structured Parzen
    estimator (Bergstra et al. 2011) proposes so many settings. Rates are measured in the robot's simulator, in
    engagements of the stream "tuning", which no evaluation has, and which are the same for all trainings.

    Args:
      robot: a robot or its folder; the paper's if not given.
      task: a task, its name or its file.
      vary: what is varied, by the names of `TrainConfig`'s fields; only the seed if not given.
      out: folder for everything; what the same call has begun there is continued.
      trials: settings to propose.
      seeds: trainings of each setting, with the seeds from `seed` on.
      config: settings that are not varied, as of `train`.
      steps: decisions of each training, as of `train`.
      engagements: per cell of the task, at least 2.
      seed: of the proposals, and of the first training of each setting.
      batch: settings that are proposed together, from the rates of those before.
      workers: trainings that run at once; one per core, at most 4, if not given.
      ray: "local" to run them in a Ray on this machine, HOST:PORT in that of a cluster; in processes if not given.

    Raises:
      InputError: if something can't be used, the folder has another sweep or something else, or Optuna or Ray is
        missing.
    """
    robot, task, folder, vary = Robot.of(robot), Task.of(task), Path(out), vary or {}
    base = with_given(TrainConfig.of(config), None, steps, None)
    workers = usual_workers() if workers is None else workers
    for name, value in (
        ("seeds", seeds),
        ("batch", batch),
        ("workers", workers),
        ("trials", 1 if trials is None else trials),
    ):
        if type(value) is not int or not 1 <= value <= MOST_SETTINGS:
            raise InputError(f"{name} must be a whole number of 1 to {MOST_SETTINGS}, got {value!r}; choose another")
    longest = task.replace(lengths_s=task.lengths[-1:])
    check_counts(engagements, seed, 2, longest.cells(), make_world(robot, longest).normals)
    for library in ("optuna", *(["ray"] if ray else [])):
        if importlib.util.find_spec(library) is None:
            raise InputError(f"a sweep needs {library}, which is not installed; pip install 'archerfish[sweep]'")
    space = {name: _distribution(name, given) for name, given in vary.items()}
    grid = _combined(space, base, robot, task)
    if trials is None and any(not hasattr(drawn, "choices") for drawn in space.values()):
        raise InputError("a range needs trials, the number of settings to propose; give it, for instance 20")
    total, together = (trials, batch) if trials else (len(grid), len(grid))
    facts: dict[str, Any] = {"robot": robot.digest(), "task": plain(task), "config": plain(base), "vary": plain(vary)}
    facts |= {"trials": trials, "batch": batch if trials else None, "seeds": seeds, "engagements": engagements}
    given = {"robot": robot, "task": task, "config": base, "engagements": engagements}
    with storage.locked(folder):
        _claim(folder, facts | {"seed": seed})
        study, found = _study(folder / _STUDY, space), list[list[TrialHits]]()
        for first in range(0, total, together):
            places, trainings = range(first, min(first + together, total)), dict[tuple[int, int], Path]()
            for place in places[len(_proposed(study)) - first :]:
                study.sampler = _sampler(seed, place, total, None if trials else grid[place])
                study.ask(space)
            proposed = _proposed(study)
            parameters = [trial.params for trial in proposed]
            for place, own in itertools.product(places, range(seed, seed + seeds)):
                same = parameters.index(parameters[place])  # what is proposed once more is not trained once more
                trainings[same, own] = folder / "trials" / f"{same:04d}-{own}"
            jobs = list[Job]()
            for (place, own), path in trainings.items():
                arguments = given | {"parameters": parameters[place], "seed": own, "folder": path}
                if not (path / HITS).exists():
                    jobs.append(Job(train_and_count, arguments, name=f"setting {place}, seed {own}"))
            if jobs:
                run_on_ray(jobs, workers, ray) if ray else run_jobs("sweep", jobs, workers)
            hits = {key: TrialHits.load(path / HITS) for key, path in trainings.items()}
            for place in places:
                same = parameters.index(parameters[place])
                found.append([hits[same, own] for own in range(seed, seed + seeds)])
                rate = float(np.mean([one.rate for one in found[-1]]))
                study.tell(proposed[place].number, rate, skip_if_finished=True)
        swept = Swept(pooled_settings(parameters, found), f"{robot.name}, task {task.name}")
        swept.save(folder)
        if swept.best is not None:
            shutil.rmtree(folder / "best", ignore_errors=True)
            kept = f"{swept.best.number:04d}-{seed + swept.best.middle}"
            shutil.copytree(folder / "trials" / kept, folder / "best")
    return swept


def _distribution(name: str, given: Any) -> Any:
    """Return what Optuna draws a setting from.

    Raises:
      InputError: if there is no such setting, or it can't have these values.
    """
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    kinds = {field.name: field.type for field in msgspec.structs.fields(TrainConfig) if field.name not in _PARTS}
    for part, config in _PARTS.items():
        kinds |= {f"{part}.{field.name}": field.type for field in msgspec.structs.fields(config)}
    if name not in kinds:
        remedy = meant(name, kinds, f"settings are {', '.join(kinds)}")
        raise InputError(f"vary: there is no setting {one_line(name)[:100]!r}; {remedy}")
    kind = msgspec.inspect.type_info(kinds[name])
    is_whole = any(isinstance(one, msgspec.inspect.IntType) for one in getattr(kind, "types", (kind,)))
    if isinstance(given, str) and (match := _RANGE.fullmatch(given)):
        try:
            number: Any = int if is_whole else float
            low, high, is_log = number(match[1]), number(match[2]), bool(match[3])
            return (IntDistribution if is_whole else FloatDistribution)(low, high, log=is_log)
        except ValueError as error:
            what = "whole numbers " * is_whole + "LOW..HIGH, with :log above 0"
            raise InputError(f"vary {name}: expected {what}, got {given}; correct it") from error
    values = [_value(text) for text in given.split(",")] if isinstance(given, str) else [*given]
    is_plain = all(value is None or isinstance(value, bool | int | float | str) for value in values)
    if not values or not is_plain or len(set(map(repr, values))) < len(values):
        expected = "different numbers or words V1,V2,… or a range LOW..HIGH"
        raise InputError(f"vary {name}: expected {expected}, got {one_line(reprlib.repr(given))}; correct it")
    return CategoricalDistribution(values)


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _combined(space: Mapping[str, Any], base: TrainConfig, robot: Robot, task: Task) -> list[dict[str, Any]]:
    """Return all combinations of values, of a range its ends, after each has been checked.

    Raises:
      InputError: if a training can't have one, there are too many, or a setting is of another trainer.
    """
    values = [getattr(drawn, "choices", None) or (drawn.low, drawn.high) for drawn in space.values()]
    if (number := int(np.prod([len(each) for each in values]))) > MOST_SETTINGS:
        raise InputError(f"vary: expected at most {MOST_SETTINGS} settings, got {number}; leave values out")
    combined = [dict(zip(space, chosen, strict=True)) for chosen in itertools.product(*values)]
    trainers = {with_parameters(base, parameters).resolved(robot, task).trainer for parameters in combined}
    for name in space:
        if name.partition(".")[0] in {*_PARTS} - trainers:
            raise InputError(f"vary {name}: the trainer is {min(map(str, trainers))}; leave it out, or set the trainer")
    return combined


def _claim(folder: Path, facts: dict[str, Any]) -> None:
    """Write down what a sweep is of, or check that it is the one that is there.

    Raises:
      InputError: if it is another one, or the folder has something else.
    """
    path = folder / _SWEEP
    facts = json.loads(json.dumps({"schema": _SCHEMA, **facts}))
    if not path.exists():
        if others := sorted(each.name for each in folder.iterdir() if each.name != storage.LOCK):
            raise file_error(folder, f"has files of something else, as {others[0]}", "choose another folder")
        write_json(path, facts)
    begun: Any = read_json(path, "choose another folder")
    for name, value in facts.items():
        if begun.get(name) != value:
            had, now = one_line(reprlib.repr(begun.get(name))), one_line(reprlib.repr(value))
            remedy = "choose another folder, or give the same to continue"
            raise file_error(folder, f"has a sweep with {name} = {had}, expected {now}", remedy)


def _study(path: Path, space: Mapping[str, Any]) -> Any:
    """Open the journal of a sweep; a line or a proposal that a process left half-written when it was killed is void."""
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)
    path.with_name(f"{path.name}.lock").unlink(missing_ok=True)  # the folder's own lock is held
    if path.exists():
        whole, _, rest = path.read_bytes().rpartition(b"\n")
        if rest:
            storage.write_bytes(path, whole + b"\n" if whole else b"")
    record = JournalStorage(JournalFileBackend(str(path)))
    study = optuna.create_study(storage=record, study_name="sweep", direction="maximize", load_if_exists=True)
    for trial in _proposed(study):
        if trial.params.keys() != space.keys():
            study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    return study


def _proposed(study: Any) -> list[Any]:
    """Return the proposals in their order, without those that are void."""
    return [trial for trial in study.get_trials(deepcopy=False) if trial.state.name != "FAIL"]


def _sampler(seed: int, place: int, total: int, parameters: dict[str, Any] | None) -> Any:
    """Return what proposes the settings of a place: the given ones, or those of an estimator with a seed of its own."""
    from optuna import samplers

    own = int(np.random.SeedSequence([seed, place]).generate_state(1)[0])
    if parameters is None:
        return samplers.TPESampler(n_startup_trials=min(STARTUP, total // 2), seed=own)
    return samplers.PartialFixedSampler(parameters, samplers.RandomSampler(seed=own))
