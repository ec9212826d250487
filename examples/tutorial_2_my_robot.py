# %% [markdown]
# # 2. My robot
#
# From logs of a gimbal to a policy for it, in four steps: record, identify, train, evaluate. The gimbal of this
# tutorial is a model in a few lines, so that you can run it anywhere; with a real robot you replace `play`.
#
# First the commands. `excite` plans a sweep and steps within the limits of an axis, and a second set of them that is
# held back to test the result.

# %%
from pathlib import Path

import numpy as np
from scipy import signal

import archerfish as af

GIMBAL = {"pitch": (11.0, 0.6), "yaw": (8.0, 0.8)}  # natural frequency [Hz] and damping, for you to change
noise = np.random.default_rng(0)


def play(axis, commands):
    """Return the angles that a gimbal reaches [rad], shape (N, 1), with the noise of an encoder."""
    plant = af.PlantRecord.second_order(*GIMBAL[axis], delay_s=4e-3)
    A, B, C, D, dt = plant.to_state_space()
    angles = signal.dlsim((A, B, C, D, dt), commands - commands[0])[1] + commands[0]
    return angles + 2e-4 * noise.standard_normal(angles.shape)


for axis, plan in {"pitch": af.excite("pitch"), "yaw": af.excite("yaw")}.items():
    for name, log in plan.logs.items():
        recorded = af.Recording.from_arrays(log.inputs, play(axis, log.inputs), log.period_s)
        recorded.write_csv(Path("tutorial_logs") / name)

# %% [markdown]
# The folder now has `pitch_sweep.csv`, `pitch_step.csv`, the same with `_validation`, and those of the yaw. The file
# names say what each log is. `identify_robot` reads the folder; what there are no logs of (muzzle, camera, limits) is
# taken from the paper's robot, and called *assumed*.

# %%
found = af.identify_robot("tutorial_logs", out="tutorial_robot")
print(found)

# %% [markdown]
# `usable` means that the model predicts the held-back logs well enough to train on. Draw the step responses of
# both axes:

# %%
found.plot()

# %% [markdown]
# Train a policy for this robot. 300,000 decisions are only a first look; leave out `steps` for a training of full
# length, which takes minutes.

# %%
robot = found.record
policy = af.train(robot, "paper", steps=300_000, seed=0, out="tutorial_robot/policy")
results = af.evaluate({"policy": policy, "kalman": "kalman"}, robot, "paper", engagements=50, tuning="start")
print(results.compare("policy", "kalman"))

# %% [markdown]
# `tuning="start"` saves the minutes in which `kalman` would be tuned for this robot, so the comparison favours the
# policy; leave it out before you believe a difference. On the command line the same is `archerfish identify
# tutorial_logs --out tutorial_robot`, `archerfish train tutorial_robot` and `archerfish evaluate tutorial_robot`.
#
# Next: [a controller of your own](tutorial_3.md). What to record on a real robot is in [Your robot](your_robot.md).
