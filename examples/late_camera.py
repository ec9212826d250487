"""The robot's simulator with a camera whose frames arrive one decision late."""

from typing import Any

import archerfish as af
from archerfish.authors import map_arrays, namespace, tree


@tree()  # compiled together with the controller
class LateCamera:
    simulator: Any

    @property
    def name(self):
        return f"{self.simulator.name}, late camera"

    def begin(self, engagement, normals):
        state = self.simulator.begin(engagement, normals)
        nothing = map_arrays(namespace(normals).zeros_like, self.simulator.see(state).frames)
        return state, nothing  # what the camera shows now is on its way

    def see(self, state):
        return self.simulator.see(state[0])._replace(frames=state[1])

    def step(self, state, command, normals):
        frames = self.simulator.see(state[0]).frames
        age = namespace(normals).where(frames.received, frames.age + self.simulator.period, 0.0)
        after, shot = self.simulator.step(state[0], command, normals)
        return (after, frames._replace(age=age)), shot

    def __getattr__(self, name):  # compiled, period_s, normals, plants, truth
        return getattr(self.simulator, name)


def late_camera(robot, task):
    return LateCamera(af.make_world(robot, task))
