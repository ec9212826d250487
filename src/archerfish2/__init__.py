"""Archerfish: from the logs of a two-axis gimbal to a policy that out-shoots classical auto-aim.

Names load when they are used, so importing this imports nothing else.
"""

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from archerfish2.controllers.policy import Policy as Policy
    from archerfish2.errors import InputError as InputError
    from archerfish2.evaluation.evaluate import evaluate as evaluate
    from archerfish2.evaluation.results import Results as Results
    from archerfish2.evaluation.trajectory import rollout as rollout
    from archerfish2.evaluation.tuning import tune as tune
    from archerfish2.learning.config import TrainConfig as TrainConfig
    from archerfish2.learning.environments import make_environment as make_environment
    from archerfish2.learning.train import train as train
    from archerfish2.records.muzzle import MuzzleRecord as MuzzleRecord
    from archerfish2.records.plant import PlantRecord as PlantRecord
    from archerfish2.robot import Robot as Robot
    from archerfish2.simulation.world import make_world as make_world
    from archerfish2.task import Task as Task

_PLACES = {
    "InputError": "errors",
    "MuzzleRecord": "records.muzzle",
    "PlantRecord": "records.plant",
    "Policy": "controllers.policy",
    "Results": "evaluation.results",
    "Robot": "robot",
    "Task": "task",
    "TrainConfig": "learning.config",
    "evaluate": "evaluation.evaluate",
    "make_environment": "learning.environments",
    "make_world": "simulation.world",
    "rollout": "evaluation.trajectory",
    "train": "learning.train",
    "tune": "evaluation.tuning",
}
__all__ = [*_PLACES, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
