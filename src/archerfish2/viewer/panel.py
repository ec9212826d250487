"""The controls of the page: what is chosen, how it is played, and what is said of it."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from viser import uplot

from archerfish2.targets.kinds import KINDS
from archerfish2.viewer.choice import LIMITS, Choice, Setup
from archerfish2.viewer.motions import Floats, motion_names
from archerfish2.viewer.scene import VIEWPOINTS

PACES = {"real time": 1.0, "half": 0.5, "a fifth": 0.2, "a twentieth": 0.05}
"""Name on the page → seconds shown per second."""
PLOT_COLOURS = ("rgb(0,114,178)", "rgb(213,94,0)")


class PlayerCallbacks(NamedTuple):
    """What happens when a control of the player is used."""

    toggle: Callable[[], None]  # pause, or continue
    scrub: Callable[[float], None]  # go to a time [s]
    pace: Callable[[float], None]  # seconds shown per second
    look: Callable[[Any, str], None]  # a client looks from a viewpoint


class Player:
    """Play, pause, slow motion, scrub, and a plot."""

    def __init__(self, server: Any, callbacks: PlayerCallbacks) -> None:
        gui = server.gui
        with gui.add_folder("Play"):
            self._button = gui.add_button("Pause")
            self._slider = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0)
            pace = gui.add_dropdown("Pace", tuple(PACES))
            view = gui.add_dropdown("View", tuple(VIEWPOINTS))
        with gui.add_folder("Aim error"):
            lines = [
                uplot.Series(label=label, stroke=colour, width=1.5)
                for label, colour in zip(("pitch", "yaw"), PLOT_COLOURS, strict=True)
            ]
            self._plot = gui.add_uplot(
                (np.zeros(1), np.zeros(1), np.zeros(1)),
                (uplot.Series(label="time [s]"), *lines),
                scales={"x": uplot.Scale(time=False)},
                axes=(uplot.Axis(label="time [s]"), uplot.Axis(label="mrad")),
                aspect=1.6,
            )
        self._scrub, self._handled = callbacks.scrub, 0.0
        self._button.on_click(lambda _: callbacks.toggle())
        self._slider.on_update(lambda event: self._scrubbed() if event.client is not None else None)
        pace.on_update(lambda _: callbacks.pace(PACES[pace.value]))
        view.on_update(lambda event: callbacks.look(event.client, view.value))

    def _scrubbed(self) -> None:
        self._handled = self._slider.value
        self._scrub(self._handled)

    def show(self, time: float, duration: float, playing: bool) -> None:
        """Show where it is: a time and a duration [s], and whether it is playing."""
        label = "Pause" if playing else "Play"
        if self._button.label != label:
            self._button.label = label
        # A client's value is there before its callback runs: written over now, it would be lost.
        if self._slider.value != self._handled:
            return
        longest = round(max(duration, 0.02), 2)
        if self._slider.max != longest:
            if self._slider.value > longest:
                self._handled = self._slider.value = 0.0
            self._slider.max = longest
        value = round(min(time, longest), 2)
        if abs(self._slider.value - value) >= 0.01:
            self._handled = self._slider.value = value

    def plot(self, time: Floats, curves: Sequence[Floats]) -> None:
        """Plot curves over time [s], of shape (N,) each."""
        if time.size:
            self._plot.data = (np.asarray(time, np.float64), *(np.asarray(curve, np.float64) for curve in curves))


class Controls:
    """What a trial is chosen with, and what is said of it."""

    def __init__(
        self, server: Any, setup: Setup, first: Choice, changed: Callable[[], None], swapped: Callable[[], None]
    ) -> None:
        gui, names, muzzle = server.gui, tuple(setup.controllers), setup.robot.muzzle
        other = next(name for name in names if name != first.controller)
        self._first, self._seed = first, first.seed
        self._said = gui.add_markdown("…")
        with gui.add_folder("Trial"):
            self._controller = gui.add_dropdown("Controller", names, initial_value=first.controller)
            self._other = gui.add_dropdown("Other controller", names, initial_value=other)
            swap = gui.add_button("Same engagements, other controller")
            self._motion = gui.add_dropdown("Target", motion_names(setup.task), initial_value=first.motion)
            hint = f"the largest, of eq (7), of a motion of your own and of a dragged target; not of {', '.join(KINDS)}"
            self._distance = gui.add_slider("Distance [m]", *LIMITS["distance"], 0.1, first.distance)
            self._speed = gui.add_slider("Speed [m/s]", *LIMITS["speed"], 0.05, first.speed, hint=hint)
            hint = f"times {1e3 * muzzle.pitch_sd:.2g} and {1e3 * muzzle.yaw_sd:.2g} mrad in pitch and yaw"
            self._dispersion = gui.add_slider("Dispersion [×]", *LIMITS["dispersion"], 0.1, first.dispersion, hint=hint)
            hint = "added to the robot's; the controller doesn't know of it"
            most = (0, round(1e3 * LIMITS["camera_latency"][1]), 5, 0)
            self._camera = gui.add_slider("Camera latency [ms]", *most, hint=hint)
            self._link = gui.add_slider("Command latency [ms]", *most, hint=hint)
            new = gui.add_button("New engagements")
        inputs = (self._controller, self._motion, self._distance, self._speed, self._dispersion)
        for control in (*inputs, self._camera, self._link):
            control.on_update(lambda _: changed())
        swap.on_click(lambda _: swapped())

        def renew() -> None:
            self._seed += 1
            changed()

        new.on_click(lambda _: renew())

    def choice(self) -> Choice:
        """Return what is chosen now."""
        return Choice(
            controller=self._controller.value,
            motion=self._motion.value,
            distance=self._distance.value,
            speed=self._speed.value,
            dispersion=self._dispersion.value,
            camera_latency=1e-3 * self._camera.value,
            command_latency=1e-3 * self._link.value,
            engagements=self._first.engagements,
            seed=self._seed,
        )

    def swap(self) -> None:
        """Exchange the two controllers."""
        self._controller.value, self._other.value = self._other.value, self._controller.value

    def say(self, text: str) -> None:
        """Show a text, Markdown."""
        if self._said.content != text:
            self._said.content = text
