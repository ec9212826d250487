# Types of the names that load when they are used; see __init__.py.

from archerfish2.codegen.export import export as export
from archerfish2.controllers.policy import Policy as Policy
from archerfish2.errors import InputError as InputError
from archerfish2.evaluation.evaluate import evaluate as evaluate
from archerfish2.evaluation.results import Results as Results
from archerfish2.evaluation.rollout import rollout as rollout
from archerfish2.evaluation.tuning import tune as tune
from archerfish2.learning.config import TrainConfig as TrainConfig
from archerfish2.learning.environments import make_environment as make_environment
from archerfish2.learning.train import train as train
from archerfish2.records.muzzle import MuzzleRecord as MuzzleRecord
from archerfish2.records.plant import PlantRecord as PlantRecord
from archerfish2.robot import Robot as Robot
from archerfish2.simulation.world import make_world as make_world
from archerfish2.task import Task as Task

__version__: str
