# %% [markdown]
# # 3. My controller
#
# A controller has two methods. `reset(seen, truth)` returns its state at the beginning of an engagement, and
# `step(state, seen)` returns the next state and a command. This one is an alpha-beta filter: it predicts the target's
# position, and corrects position and velocity by fixed shares of the error.

# %%
import archerfish as af
from archerfish.authors import aim, first_detection, intercept


class AlphaBeta:
    compiled = False  # plain NumPy: any Python code is allowed

    def __init__(self, robot, task, alpha=0.8, beta=0.4):
        self.muzzle, self.period_s, self.alpha, self.beta = robot.muzzle_model(), task.period_s, alpha, beta

    def reset(self, seen, truth=None):
        position = first_detection(seen).place  # [m], shape (N, 3), of N engagements at once
        return position, 0.0 * position

    def step(self, state, seen):
        position, velocity = state
        elapsed = seen.elapsed[:, None]  # [s] since the last decision, 0 at the first one
        position = position + velocity * elapsed
        error = first_detection(seen).place - position
        position = position + self.alpha * error
        velocity = velocity + self.beta * error / (elapsed + 1e-9) * (elapsed > 0)
        delay = self.period_s + 0.0 * seen.elapsed  # from this decision until its pellet leaves [s]
        angle = intercept(lambda time: position + velocity * time[:, None], delay, self.muzzle).angle
        return (position, velocity), aim(angle)


# %% [markdown]
# `evaluate` takes the class itself, and calls it with robot and task. A controller with `compiled = False` is stepped
# in Python, for all engagements at once.

# %%
task = af.Task.load("paper").replace(ranges_m=((3, 4),))
controllers = {"ours": AlphaBeta, "slower": lambda robot, task: AlphaBeta(robot, task, beta=0.1), "kalman": "kalman"}
results = af.evaluate(controllers, None, task, engagements=200, seed=0, tuning="start")
print(results)

# %% [markdown]
# Compare by the paired interval. If it contains zero, these engagements don't show a difference.

# %%
for pair in results.compare("ours", "kalman"):
    difference, low, high = 100 * pair.difference, 100 * pair.low, 100 * pair.high
    print(f"{pair.motion} targets: {difference:+.1f} points ({low:+.1f} to {high:+.1f})")

# %% [markdown]
# Save the class to a file, and every command takes it, too:
# `archerfish evaluate --controllers kalman ./mine.py:AlphaBeta`.
#
# Next: [the virtual robot](tutorial_4.md). Compiled controllers, targets, plants and worlds of your own are in
# [Bring your own](bring_your_own.md).
