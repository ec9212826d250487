"""The controls of the page: what is chosen, how it is played, and what is said of it."""

from dataclasses import replace
from typing import Any

import numpy as np
from viser import uplot

from archerfish.targets.kinds import KINDS
from archerfish.viewer.choice import DISTANCES_M, SPEEDS_M_S, Setup, TrialChoice
from archerfish.viewer.motions import FloatArray, motion_names
from archerfish.viewer.scene import VIEWPOINTS

PACES = {"real time": 1.0, "half": 0.5, "a fifth": 0.2, "a twentieth": 0.05}
"""Name on the page → seconds shown per second."""
_OWN_SPEEDS = f"The largest, of eq (7), of a motion of your own and of a dragged target; not of {', '.join(KINDS)}."
_LATE = "Added to the robot's; the controller doesn't know of it."
SLIDERS = {
    "distance": ("Distance [m]", *DISTANCES_M, 0.1, "Of the targets' places."),
    "speed": ("Speed [m/s]", *SPEEDS_M_S, 0.05, _OWN_SPEEDS),
    "dispersion": ("Dispersion [×]", 0.0, 4.0, 0.1, "Times that of the robot's muzzle."),
    "camera_latency": ("Camera latency [s]", 0.0, 0.1, 0.005, _LATE),
    "command_latency": ("Command latency [s]", 0.0, 0.1, 0.005, _LATE),
}
"""Field of `TrialChoice` → label, smallest and largest value, step and explanation of its slider."""


class Panel:
    """The controls beside the picture; what they do, the page does."""

    def __init__(self, server: Any, setup: Setup, first: TrialChoice, page: Any) -> None:
        gui, names = server.gui, tuple(setup.controllers)
        other = "kalman" if first.controller == "kalman-lq" else "kalman-lq"
        self._first, self._seed, self._handled = first, first.seed, 0.0
        self._said = gui.add_markdown("…")
        with gui.add_folder("Trial"):
            controller = gui.add_dropdown("Controller", names, initial_value=first.controller)
            self._other = gui.add_dropdown("Other controller", names, initial_value=other)
            swap = gui.add_button("Same engagements, other controller")
            motion = gui.add_dropdown("Target", motion_names(setup.task), initial_value=first.motion)
            self._inputs = {"controller": controller, "motion": motion}
            for field, (*numbers, hint) in SLIDERS.items():
                self._inputs[field] = gui.add_slider(*numbers, getattr(first, field), hint=hint)
            new = gui.add_button("New engagements")
        with gui.add_folder("Play"):
            self._button = gui.add_button("Pause")
            self._time = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0)
            pace, view = gui.add_dropdown("Pace", tuple(PACES)), gui.add_dropdown("View", tuple(VIEWPOINTS))
        with gui.add_folder("Aim error"):
            colours = {"pitch": "rgb(0,114,178)", "yaw": "rgb(213,94,0)"}
            lines = [uplot.Series(label=axis, stroke=colour, width=1.5) for axis, colour in colours.items()]
            self._plot = gui.add_uplot(
                (np.zeros(1), np.zeros(1), np.zeros(1)),
                (uplot.Series(label="time [s]"), *lines),
                scales={"x": uplot.Scale(time=False)},
                axes=(uplot.Axis(label="time [s]"), uplot.Axis(label="mrad")),
                aspect=1.6,
            )
        swap.on_click(lambda _: page.calls.put(self._swap))
        new.on_click(lambda _: page.calls.put(self._renew))
        self._button.on_click(lambda _: page.calls.put(page.toggle))
        self._time.on_update(lambda event: self._scrub(page) if event.client is not None else None)
        pace.on_update(lambda _: setattr(page, "pace", PACES[pace.value]))
        view.on_update(lambda event: page.look(event.client, view.value))

    def _swap(self) -> None:
        first, other = self._inputs["controller"], self._other
        first.value, other.value = other.value, first.value

    def _renew(self) -> None:
        self._seed += 1

    def _scrub(self, page: Any) -> None:
        self._handled = time = self._time.value
        page.calls.put(lambda: page.scrub(time))

    def choice(self) -> TrialChoice:
        """Return what is chosen now."""
        return replace(self._first, seed=self._seed, **{field: it.value for field, it in self._inputs.items()})

    def say(self, text: str) -> None:
        """Show a text, Markdown."""
        if self._said.content != text:
            self._said.content = text

    def show_time(self, time: float, duration: float, playing: bool) -> None:
        """Show a time and a duration [s], and whether it is playing."""
        label = "Pause" if playing else "Play"
        if self._button.label != label:
            self._button.label = label
        # A client's value is there before its callback runs: written over now, it would be lost.
        if self._time.value != self._handled:
            return
        longest = round(max(duration, 0.02), 2)
        if self._time.max != longest:
            if self._time.value > longest:
                self._handled = self._time.value = 0.0
            self._time.max = longest
        value = round(min(time, longest), 2)
        if abs(self._time.value - value) >= 0.01:
            self._handled = self._time.value = value

    def plot(self, time: FloatArray, error: FloatArray) -> None:
        """Plot errors of pitch and yaw [rad], shape (N, 2), over time [s], shape (N,)."""
        if time.size:
            self._plot.data = (time, *(1e3 * error.astype(np.float64).T))
