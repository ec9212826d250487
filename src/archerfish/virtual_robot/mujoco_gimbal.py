"""The gimbal's mechanics in MuJoCo: a batch of two-joint models, without contacts, in steps of a tick.

MuJoCo holds Coulomb friction by a soft constraint, so a joint creeps under a load below its friction
(docs/virtual_robot.md has how fast).
"""

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S, Gimbal, GimbalAxis

Array = NDArray[np.float64]

GRAVITY = 9.81
"""[m/s²]."""
_MODEL = """
<mujoco model="gimbal">
  <option timestep="{tick}" integrator="implicitfast" gravity="0 0 -{gravity}"><flag contact="disable"/></option>
  <worldbody>
    <body name="yaw">
      <joint name="yaw" axis="0 0 1" {yaw}/>
      <inertial pos="0 0 0" mass="1" diaginertia="{yaw_inertia} {yaw_inertia} {yaw_inertia}"/>
      <body name="pitch">
        <joint name="pitch" axis="0 -1 0" {pitch}/>
        <inertial pos="{center}" mass="{mass}" diaginertia="{inertia}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def gimbal_model(gimbal: Gimbal) -> str:
    """Return a gimbal as MJCF; pitch turns about −y, so that the muzzle rises with its angle."""
    body = gimbal.pitch_body
    return _MODEL.format(
        tick=TICK_S,
        gravity=GRAVITY,
        yaw=_joint(gimbal.yaw),
        pitch=_joint(gimbal.pitch),
        yaw_inertia=gimbal.yaw_body.inertia_kg_m2,
        center=f"{body.forward_m} {body.left_m} {body.up_m}",
        mass=body.mass_kg,
        inertia=f"{body.roll_inertia_kg_m2} {body.pitch_inertia_kg_m2} {body.yaw_inertia_kg_m2}",
    )


def _joint(axis: GimbalAxis) -> str:
    # The stops are as stiff as two ticks allow: a time constant below would not be stable.
    return (
        f'type="hinge" armature="{axis.armature_kg_m2}" damping="{axis.damping_n_m_s_per_rad}" '
        f'frictionloss="{axis.friction_n_m}" limited="true" range="{axis.low_deg} {axis.high_deg}" '
        f'solreflimit="{2 * TICK_S} 1"'
    )


class MujocoGimbal:
    """B gimbals in MuJoCo."""

    def __init__(self, gimbal: Gimbal, batch: int) -> None:
        # One thread: the robots of several processes share the cores.
        self._batch = Batch(mujoco.MjModel.from_xml_string(gimbal_model(gimbal)), batch, 1)
        self._position, self._velocity = self._batch.bind("qpos"), self._batch.bind("qvel")
        # Joints are yaw, pitch in the model; everything here is pitch, yaw.
        self.angle: Array = self._position[:, ::-1]
        self.rate: Array = self._velocity[:, ::-1]
        self._torque: Array = self._batch.bind("qfrc_applied")[:, ::-1]
        self._bias = self._batch.bind("qfrc_bias")

    def reset(self, angle: Array) -> None:
        """Put the gimbals at rest at their angles [rad], shape (B, 2)."""
        self._batch.reset()
        self._torque[:] = 0.0
        self.angle[:] = angle
        self.rate[:] = 0.0

    def holding_torque(self) -> Array:
        """Return the torque that holds the load at the present angles [N·m], shape (B, 2)."""
        self._batch.forward()
        return np.array(self._bias[:, ::-1])

    def step(self, torque: Array) -> None:
        """Apply torques for one tick [N·m], shape (B, 2)."""
        self._torque[:] = torque
        self._batch.step()
