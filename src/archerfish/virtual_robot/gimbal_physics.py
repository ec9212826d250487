"""The mechanics of a batch of gimbals, behind one protocol: MuJoCo's, or a linear stand-in."""

import importlib.util
import warnings
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.virtual_robot.description import Gimbal
from archerfish.virtual_robot.linear_gimbal import LinearGimbal

Array = NDArray[np.float64]
Physics = Literal["mujoco", "linear"]

STAND_IN_NOTICE = (
    "MuJoCo 4 is not installed: a linear stand-in without friction, gravity and coupling takes the place of the "
    "robot's mechanics, so results are not those of the robot; pip install 'archerfish[train]'"
)


class GimbalPhysics(Protocol):
    """Two axes, pitch and yaw, of B gimbals, moved by torques in steps of a tick."""

    angle: Array
    """True angles now [rad], shape (B, 2)."""
    rate: Array
    """True rates now [rad/s], shape (B, 2)."""

    def reset(self, angle: Array) -> None:
        """Put the gimbals at rest at their angles [rad], shape (B, 2)."""

    def holding_torque(self) -> Array:
        """Return the torque that holds the load at the present angles [N·m], shape (B, 2)."""

    def step(self, torque: Array) -> None:
        """Apply torques for one tick [N·m], shape (B, 2)."""


def mujoco_installed() -> bool:
    """Return whether MuJoCo with its batches, new in version 4, lies in the search path."""
    # Looked up as a file: to find a submodule its package is imported, and what goes wrong in that is not its absence.
    try:
        found = importlib.util.find_spec("mujoco")
    except (ImportError, ValueError):
        return False
    folders = (found.submodule_search_locations if found else None) or []
    return any(path.is_file() for folder in folders for path in Path(folder).glob("batch.*"))


def make_physics(gimbal: Gimbal, batch: int, kind: Physics | None = None) -> GimbalPhysics:
    """Build the mechanics of a batch of gimbals.

    Args:
      gimbal: what moves.
      batch: number of gimbals B.
      kind: MuJoCo's mechanics or the linear stand-in; by default MuJoCo's where it is installed, else the stand-in with
        a warning.

    Raises:
      InputError: if MuJoCo is asked for and not installed, or is installed and can't be imported.
    """
    if kind == "linear":
        return LinearGimbal(gimbal, batch)
    if not mujoco_installed():
        if kind == "mujoco":
            raise InputError(
                "physics \"mujoco\" needs MuJoCo 4, which is not installed; pip install 'archerfish[train]'"
            )
        warnings.warn(STAND_IN_NOTICE, stacklevel=2)
        return LinearGimbal(gimbal, batch)
    return _mujoco_gimbal(gimbal, batch)


def _mujoco_gimbal(gimbal: Gimbal, batch: int) -> GimbalPhysics:
    """Build MuJoCo's mechanics; what keeps an installed MuJoCo from being imported is an error, not its absence."""
    try:
        from archerfish.virtual_robot.mujoco_gimbal import MujocoGimbal  # only where it is installed
    except ImportError as error:
        if _interrupted(error):
            raise KeyboardInterrupt from error
        raise InputError(
            f"MuJoCo is installed but can't be imported ({error}); mend its installation, or pass --physics linear "
            "where the command has it"
        ) from error
    return MujocoGimbal(gimbal, batch)


def _interrupted(error: BaseException | None) -> bool:
    """Return whether an error stands for a Ctrl-C: extension modules wrap one that comes while they are loaded."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False
