"""Identifies a rigid axis, eqs (1)–(3), from torque and angle. The log is simulated: put your own file in its place."""

import numpy as np

from archerfish.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish.logs.recording import Recording
from rigid_axis_fit import identify_rigid

PERIOD_S, FRICTION = 5e-3, 0.05
AXIS = RigidAxis(mass=0.4, length=0.2, damping=0.03, gravity=9.81)  # 0.016 kg m², 0.785 N m


def simulated_log(seconds=10.0, noise=1e-3):
    time = PERIOD_S * np.arange(round(seconds / PERIOD_S))
    torque = 0.6 * np.sin(2 * np.pi * (0.2 * time + 0.1 * time**2)) + 0.3 * np.sign(np.sin(2.0 * time))
    state, angles = RigidState(np.array(0.0), np.array(0.0)), []
    for push in torque:
        angles.append(float(state.angle))
        held = dry_friction(AXIS, state, push, FRICTION, PERIOD_S)
        state = rigid_step(AXIS, state, push + held, PERIOD_S)
    angles = np.array(angles) + noise * np.random.default_rng(0).standard_normal(len(time))
    return Recording.from_arrays(torque, angles, PERIOD_S, input_names=("torque",), output_names=("angle",))


if __name__ == "__main__":
    # Or ["pitch_torque.csv"], a file with the columns time_s, torque and angle.
    print(identify_rigid([simulated_log()], "pitch").report)  # noqa: T201
