# The public names, each in a line of its own: __init__.py reads them here, and loads each when it is used.

from archerfish.controllers.policy.policy import Policy as Policy
from archerfish.errors import InputError as InputError
from archerfish.evaluation.evaluate import evaluate as evaluate
from archerfish.evaluation.results import Results as Results
from archerfish.evaluation.rollout import rollout as rollout
from archerfish.evaluation.tuning_search import tune as tune
from archerfish.identification.axis.identify import identify_axis as identify_axis
from archerfish.identification.excitation import excite as excite
from archerfish.identification.muzzle.identify import identify_muzzle as identify_muzzle
from archerfish.identification.robot import identify_robot as identify_robot
from archerfish.identification.sensing.identify import identify_sensing as identify_sensing
from archerfish.learning.config import TrainConfig as TrainConfig
from archerfish.learning.environment import make_environment as make_environment
from archerfish.learning.train import resume as resume
from archerfish.learning.train import train as train
from archerfish.logs.log import read_log as read_log
from archerfish.logs.recording import Recording as Recording
from archerfish.records.muzzle import MuzzleRecord as MuzzleRecord
from archerfish.records.plant import PlantRecord as PlantRecord
from archerfish.robot import Robot as Robot
from archerfish.simulation.world import make_world as make_world
from archerfish.studies.export import export as export
from archerfish.task import Task as Task
from archerfish.virtual_robot.virtual_robot import VirtualRobot as VirtualRobot

__version__: str
