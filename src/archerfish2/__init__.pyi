# The public names, each in a line of its own: __init__.py reads them here, and loads each when it is used.

from archerfish2.codegen.export import export as export
from archerfish2.controllers.policy.policy import Policy as Policy
from archerfish2.errors import InputError as InputError
from archerfish2.evaluation.evaluate import evaluate as evaluate
from archerfish2.evaluation.results import Results as Results
from archerfish2.evaluation.rollout import rollout as rollout
from archerfish2.evaluation.tuning import tune as tune
from archerfish2.identification.axis.identify import identify_axis as identify_axis
from archerfish2.identification.excitation import excite as excite
from archerfish2.identification.muzzle.identify import identify_muzzle as identify_muzzle
from archerfish2.identification.robot import identify_robot as identify_robot
from archerfish2.identification.sensing.identify import identify_sensing as identify_sensing
from archerfish2.learning.config import TrainConfig as TrainConfig
from archerfish2.learning.environment import make_environment as make_environment
from archerfish2.learning.train import resume as resume
from archerfish2.learning.train import train as train
from archerfish2.logs.log import read_log as read_log
from archerfish2.logs.recording import Recording as Recording
from archerfish2.records.muzzle import MuzzleRecord as MuzzleRecord
from archerfish2.records.plant import PlantRecord as PlantRecord
from archerfish2.robot import Robot as Robot
from archerfish2.simulation.world import make_world as make_world
from archerfish2.task import Task as Task
from archerfish2.virtual_robot.virtual_robot import VirtualRobot as VirtualRobot

__version__: str
