"""Archerfish: from the logs of a two-axis gimbal to a policy that out-shoots classical auto-aim.

Names load when they are used, so importing this imports none of the libraries.
"""

import importlib
from typing import Any

from archerfish2.simulation.registration import name_environments

__version__ = "0.2.0"

# Name=module.
_NAMES = """InputError=errors MuzzleRecord=records.muzzle PlantRecord=records.plant Policy=controllers.policy
Recording=logs.recording Results=evaluation.results Robot=robot Task=task TrainConfig=learning.config
evaluate=evaluation.evaluate excite=identification.excitation export=codegen.export
identify_axis=identification.axis.identify identify_muzzle=identification.muzzle.identify
identify_robot=identification.robot identify_sensing=identification.sensing.identify
make_environment=learning.environments make_world=simulation.world read_log=logs.log rollout=evaluation.rollout
train=learning.train tune=evaluation.tuning"""
_PLACES = dict(each.split("=") for each in _NAMES.split())
__all__ = [*_PLACES, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    return globals().setdefault(name, getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name))


__dir__ = __all__.copy


name_environments()
