"""Fits a line to what the last frames show. Not compiled, like a network of PyTorch: any attributes, any state."""

import numpy as np

from archerfish.authors import aim, first_detection, intercept


class LineFit:
    compiled = False  # called with NumPy's arrays, once per decision for all engagements at once: B is (N,)

    def __init__(self, robot, task):
        self.muzzle, self.period_s, self.frames = robot.muzzle_model(), task.period_s, 6

    def reset(self, seen, truth=None):
        return []

    def step(self, state, seen):
        latest = first_detection(seen)
        state = [(time - seen.elapsed[:, None], *rest) for time, *rest in state]  # times count from now
        state = [*state, (-latest.age[:, None], latest.fresh[:, None] + 1e-6, latest.place)][-self.frames :]
        times, weights, places = (np.stack(each) for each in zip(*state, strict=True))

        def mean(values):
            return np.sum(weights * values, axis=0) / np.sum(weights, axis=0)

        middle, centre = mean(times), mean(places)
        velocity = mean((times - middle) * (places - centre)) / (mean((times - middle) ** 2) + 1e-6)
        delay = self.period_s + 0.0 * seen.elapsed
        return state, aim(intercept(lambda t: centre + velocity * (t[:, None] - middle), delay, self.muzzle).angle)
