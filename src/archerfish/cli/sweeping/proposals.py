"""Who proposes what to try next: the grid, or Optuna's sampler by ask and tell.

A proposer is a generator. It yields the configurations of a round, and is sent their scores when the whole round is
done. What comes next therefore depends on the scores alone, not on which trial finished first, and a sweep that goes on
after its driver was killed asks the same questions and is told the same answers.
"""

import importlib.util
import warnings
from collections.abc import Generator, Sequence
from typing import Any

from archerfish.cli.sweeping.axes import Axis, Values, grid
from archerfish.cli.sweeping.parameters import Value
from archerfish.records.errors import InputError

Configuration = dict[str, Value]
Proposer = Generator[list[Configuration], list[float], None]
"""Yields a round of configurations, is sent their scores, greater being better."""


def proposed_grid(axes: Sequence[Axis]) -> Proposer:
    """Propose every combination, in one round."""
    yield grid(axes)


def proposed_samples(axes: Sequence[Axis], count: int, batch: int, sampler: str, seed: int) -> Proposer:
    """Propose what Optuna's sampler asks for; a configuration that comes again is told its score, not tried again.

    Args:
      axes: lists and ranges.
      count: proposals in all, repeated ones included.
      batch: proposals in a round.
      sampler: "tpe" or "random".
      seed: of the sampler.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # In memory: the results of the trials are the only record, and the study is rebuilt from them.
    study = optuna.create_study(direction="maximize", sampler=_sampler(optuna, sampler, seed))
    space = {axis.name: _distribution(optuna, axis) for axis in axes}
    scores: dict[tuple[Value, ...], float] = {}
    for start in range(0, count, batch):
        asked = []
        for _ in range(min(batch, count - start)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
                asked.append(study.ask(space))
        keys = [tuple(trial.params[axis.name] for axis in axes) for trial in asked]
        fresh = [key for key in dict.fromkeys(keys) if key not in scores]
        if fresh:
            told = yield [dict(zip(space, key, strict=True)) for key in fresh]
            scores |= zip(fresh, told, strict=True)
        for trial, key in zip(asked, keys, strict=True):
            study.tell(trial, scores[key])


def require_optuna() -> None:
    """Refuse to sample where Optuna is not installed.

    Raises:
      InputError: saying what to install.
    """
    if importlib.util.find_spec("optuna") is None:
        raise InputError("--trials needs optuna, which is not installed; pip install 'archerfish[sweep]'")


def _sampler(optuna: Any, name: str, seed: int) -> Any:
    return optuna.samplers.TPESampler(seed=seed) if name == "tpe" else optuna.samplers.RandomSampler(seed=seed)


def _distribution(optuna: Any, axis: Axis) -> Any:
    if isinstance(axis, Values):
        return optuna.distributions.CategoricalDistribution(axis.values)
    if axis.whole:
        return optuna.distributions.IntDistribution(int(axis.low), int(axis.high), log=axis.log)
    return optuna.distributions.FloatDistribution(axis.low, axis.high, log=axis.log)
