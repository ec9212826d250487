"""The gimbal's mechanics in MuJoCo: a batch of two-joint models, without contacts, in steps of a tick.

Most of the time of a step of so small a model is the same for a large one, so a model has many gimbals side by side.
They share nothing: each is a tree of its own, which the solver treats as an island of its own. So a gimbal moves the
same to the last bit, however many are beside it in its model.

MuJoCo's Coulomb friction is a soft constraint, so a joint creeps under a load below its friction
(docs/virtual_robot.md has how fast).
"""

import math

import numpy as np
from numpy.typing import NDArray

from archerfish.errors import InputError
from archerfish.virtual_robot.description import GRAVITY_M_S2, TICK_S, Gimbal, GimbalAxis

Array = NDArray[np.float64]

_PER_MODEL = 64
"""Gimbals in a model at most: with more, a gimbal's step takes no less time."""


def gimbal_mjcf(gimbal: Gimbal, count: int = 1) -> str:
    """Return equal gimbals as MJCF; pitch turns about −y, so that the muzzle rises with its angle.

    Args:
      gimbal: of each.
      count: number of gimbals; their joints are yaw and pitch of the first, then of the second, and so on.
    """
    body, yaw = gimbal.pitch_body, gimbal.yaw_body.inertia_kg_m2
    inertia = f"{body.roll_inertia_kg_m2} {body.pitch_inertia_kg_m2} {body.yaw_inertia_kg_m2}"
    one = f"""
    <body>
      <joint axis="0 0 1" {_joint(gimbal.yaw)}/>
      <inertial pos="0 0 0" mass="1" diaginertia="{yaw} {yaw} {yaw}"/>
      <body>
        <joint axis="0 -1 0" {_joint(gimbal.pitch)}/>
        <inertial pos="{body.forward_m} {body.left_m} {body.up_m}" mass="{body.mass_kg}" diaginertia="{inertia}"/>
      </body>
    </body>"""
    # Friction, and a stop that is reached, are all the constraints of a gimbal: two to four rows, on which the
    # Gauss-Seidel solver is faster than Newton's. Its tolerance is far below the encoder's step. Warm starts are
    # accepted for all islands together, and the dense Jacobian rounds otherwise than the sparse one: either would let
    # a gimbal's motion depend on how many are beside it.
    return f"""<mujoco model="gimbals">
  <option timestep="{TICK_S}" integrator="implicitfast" gravity="0 0 -{GRAVITY_M_S2}" solver="PGS" tolerance="1e-12"
      jacobian="sparse">
    <flag contact="disable" warmstart="disable"/>
  </option>
  <worldbody>{count * one}</worldbody>
</mujoco>"""


def _joint(axis: GimbalAxis) -> str:
    # The stops are as stiff as two ticks allow: a time constant below would not be stable.
    return (
        f'type="hinge" armature="{axis.armature_kg_m2}" damping="{axis.damping_n_m_s_per_rad}" '
        f'frictionloss="{axis.friction_n_m}" limited="true" range="{axis.low_deg} {axis.high_deg}" '
        f'solreflimit="{2 * TICK_S} 1"'
    )


class MujocoGimbal:
    """B gimbals in MuJoCo; after `reset`, `angle` [rad] and `rate` [rad/s] are those of pitch and yaw, shape (B, 2)."""

    def __init__(self, gimbal: Gimbal, batch: int) -> None:
        try:
            import mujoco  # of the extra `train`
            from mujoco.batch import Batch
        except ImportError as error:
            remedy = "pip install 'archerfish[train]'"
            raise InputError(f"a virtual robot needs MuJoCo 4, which can't be imported ({error}); {remedy}") from error
        models = math.ceil(batch / _PER_MODEL)
        # Equal shares; the last models may have a gimbal that is not read.
        count = math.ceil(batch / models)
        # One thread: the robots of several processes share the cores.
        self._models = Batch(mujoco.MjModel.from_xml_string(gimbal_mjcf(gimbal, count)), models, 1)
        self._position, self._velocity = self._models.bind("qpos"), self._models.bind("qvel")
        self._applied, self._bias = self._models.bind("qfrc_applied"), self._models.bind("qfrc_bias")
        self._spare = np.zeros((models * count - batch, 2))
        self._batch = batch

    def reset(self, angle: Array, rate: Array | None = None) -> None:
        """Put the gimbals at their angles [rad], shape (B, 2), at rest if no rates [rad/s] are given."""
        self._models.reset()
        self._applied[:] = 0.0
        self._position[:] = self._joints(angle)
        self._velocity[:] = 0.0 if rate is None else self._joints(rate)
        self._read()

    def holding_torque(self) -> Array:
        """Return the torque that holds the load at the present angles [N·m], shape (B, 2)."""
        self._models.forward()
        return self._pitch_yaw(self._bias)

    def step(self, torque: Array) -> None:
        """Apply torques for one tick [N·m], shape (B, 2)."""
        self._applied[:] = self._joints(torque)
        self._models.step()
        self._read()

    def _read(self) -> None:
        self.angle, self.rate = self._pitch_yaw(self._position), self._pitch_yaw(self._velocity)

    def _joints(self, axes: Array) -> Array:
        """Order pitch and yaw of the gimbals as the models' joints are, shape (B, 2) → (models, joints)."""
        return np.concatenate([axes, self._spare])[:, ::-1].reshape(self._applied.shape)

    def _pitch_yaw(self, joints: Array) -> Array:
        """Order values of the models' joints as pitch and yaw of the gimbals, shape (models, joints) → (B, 2)."""
        return np.ascontiguousarray(joints.reshape(-1, 2)[: self._batch, ::-1])
