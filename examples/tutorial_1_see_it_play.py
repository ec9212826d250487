# %% [markdown]
# # 1. See it play
#
# A *robot* is a gimbal with its muzzle, a *task* is a set of targets, and a *controller* decides where the gimbal
# points and when it fires. This tutorial lets two controllers shoot with the paper's robot, counts their hits, and
# draws one engagement.

# %%
import archerfish as af

robot = af.Robot.paper()
task = af.Task.load("paper")  # targets at rest, and targets that move as the paper's do, at 1 to 5 m
print(robot, task)

# %% [markdown]
# `evaluate` lets every controller shoot in the same engagements. `kalman` is classical auto-aim: a Kalman filter
# predicts the target, and the gimbal is commanded to the angles that would hit it. `oracle` is given the target's path
# in advance, so it shows the best that this gimbal can do. 50 engagements per cell keep the tutorial short; the default
# is 500, with intervals that are three times narrower.

# %%
results = af.evaluate(["kalman", "oracle"], robot, task, engagements=50, seed=0)
print(results)

# %% [markdown]
# Every rate has a 95 % interval in parentheses. Both controllers had the same targets and the same dispersion, so their
# difference is known more precisely than either rate:

# %%
print(results.compare("oracle", "kalman"))

# %%
figure = results.plot()
figure.savefig("rates.png")
figure

# %% [markdown]
# Why does `kalman` miss? `rollout` returns every array of every decision. In one second the gimbal has to turn to the
# target and then to follow it, with its limits of rate and acceleration. The plot shows command, gimbal and target.

# %%
shots = af.rollout("kalman", robot, task, engagements=8, seed=0)
late = shots.times > 0.5
print(f"first half second: {shots.hit[:, ~late].mean():.0%} hit, then {shots.hit[:, late].mean():.0%}")
engagement = shots.plot(5)
engagement.savefig("engagement.png")
engagement

# %% [markdown]
# Next: [a robot of your own](tutorial_2.md). All tasks and controllers are listed in [Evaluation](evaluation.md).
