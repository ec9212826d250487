"""The controls of the page: what a person chooses, how the film is played, and what is told of it."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from viser import uplot

from archerfish.viewer.choice import RANGES, Choice, Subject, controller_names, motion_names
from archerfish.viewer.motions import DRAWN_MOTIONS
from archerfish.viewer.playback import PACES
from archerfish.viewer.scene import VIEWPOINTS
from archerfish.viewer.trial import Floats

TOLD_EVERY_S = 0.2
"""Between two updates of numbers and slider [s]."""
PLOT_COLOURS = ("rgb(0,114,178)", "rgb(213,94,0)")


class FilmCallbacks(NamedTuple):
    """What the page does when a control of the film is used."""

    toggle: Callable[[], None]
    """Pause, or go on."""
    scrub: Callable[[float], None]
    """Go to a time of the film [s]."""
    pace: Callable[[float], None]
    """Seconds of the film per second."""
    look: Callable[[Any, str], None]
    """A client wants to look from a viewpoint."""


class Player:
    """Play, pause, slow motion, scrub, and a plot: what films of trials and recordings have in common."""

    def __init__(self, server: Any, callbacks: FilmCallbacks, labels: Sequence[str], title: str, unit: str) -> None:
        gui = server.gui
        with gui.add_folder("Film"):
            self._button = gui.add_button("Pause")
            self._slider = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0)
            pace = gui.add_dropdown("Pace", tuple(PACES))
            view = gui.add_button_group("View", tuple(VIEWPOINTS))
        with gui.add_folder(title):
            self._plot = gui.add_uplot(
                (np.zeros(1), *(np.zeros(1) for _ in labels)),
                (
                    uplot.Series(label="time [s]"),
                    *(
                        uplot.Series(label=each, stroke=PLOT_COLOURS[i % 2], width=1.5, dash=() if i < 2 else (5, 4))
                        for i, each in enumerate(labels)
                    ),
                ),
                scales={"x": uplot.Scale(time=False)},
                axes=(uplot.Axis(label="time [s]"), uplot.Axis(label=unit)),
                aspect=1.5,
            )
        self._button.on_click(lambda _: callbacks.toggle())
        self._scrub, self._handled = callbacks.scrub, 0.0
        self._slider.on_update(lambda event: self._scrubbed() if event.client is not None else None)
        pace.on_update(lambda _: callbacks.pace(PACES.get(pace.value, 1.0)))
        view.on_click(lambda event: callbacks.look(event.client, view.value) if view.value in VIEWPOINTS else None)

    def _scrubbed(self) -> None:
        """Go to the time that a client has put the slider to."""
        self._handled = _number(self._slider)
        self._scrub(self._handled)

    def tell(self, time: float, duration: float, playing: bool) -> None:
        """Show where the film stands.

        Args:
          time: [s].
          duration: [s].
          playing: whether it goes on.
        """
        label = "Pause" if playing else "Play"
        if self._button.label != label:
            self._button.label = label
        # A client's value is there before its callback runs: written over now, it would be lost.
        if math.isfinite(_number(self._slider)) and _number(self._slider) != self._handled:
            return
        # The slider's range must hold its value at every moment.
        longest = round(max(duration, 0.02), 2)
        if self._slider.max != longest:
            if not _number(self._slider) <= longest:
                self._handled = self._slider.value = 0.0
            self._slider.max = longest
        value = round(min(time, longest), 2)
        if not abs(_number(self._slider) - value) < 0.01:
            self._handled = self._slider.value = value

    def plot(self, time: Floats, curves: Sequence[Floats]) -> None:
        """Plot curves over time [s], shape (N,) each."""
        if time.size:
            self._plot.data = (np.asarray(time, np.float64), *(np.asarray(each, np.float64) for each in curves))


_SPEED_HINT = f"says nothing to {', '.join(DRAWN_MOTIONS)}: their speeds are their own"


class Controls:
    """What a trial is chosen with, and what is told of it."""

    def __init__(
        self,
        server: Any,
        subject: Subject,
        first: Choice,
        other: str,
        changed: Callable[[], None],
        swapped: Callable[[], None],
    ) -> None:
        gui, names, deviation = server.gui, controller_names(subject), subject.conditions.dispersion
        self._told = gui.add_markdown("…")
        with gui.add_folder("Engagement"):
            self._controller = gui.add_dropdown("Controller", names, initial_value=first.controller)
            self._other = gui.add_dropdown("Other controller", names, initial_value=other)
            swap = gui.add_button("Same engagement, other controller")
            self._motion = gui.add_dropdown("Target", motion_names(subject), initial_value=first.motion)
            self._distance = gui.add_slider("Distance [m]", *RANGES["distance"], 0.1, first.distance)
            self._speed = gui.add_slider("Speed [m/s]", *RANGES["speed"], 0.05, first.speed, hint=_SPEED_HINT)
            self._dispersion = gui.add_slider(
                "Dispersion [×]", *RANGES["dispersion"], 0.1, first.dispersion, hint=f"times {1e3 * deviation:.2g} mrad"
            )
            camera, link = (round(1e3 * RANGES[name][1]) for name in ("camera_latency", "command_latency"))
            self._camera = gui.add_slider("Added camera latency [ms]", 0, camera, 5, round(1e3 * first.camera_latency))
            self._link = gui.add_slider("Added command latency [ms]", 0, link, 5, round(1e3 * first.command_latency))
            new = gui.add_button("New engagements")
        self._names, self._first, self._seed = names, first, first.seed
        chosen = (self._controller, self._motion, self._distance, self._speed, self._dispersion)
        for each in (*chosen, self._camera, self._link):
            each.on_update(lambda _: changed())
        swap.on_click(lambda _: swapped())

        def renew() -> None:
            self._seed += 1
            changed()

        new.on_click(lambda _: renew())

    def choice(self) -> Choice:
        """Return what is chosen now."""
        return Choice(
            controller=_option(self._controller),
            motion=_option(self._motion),
            distance=_number(self._distance),
            speed=_number(self._speed),
            dispersion=_number(self._dispersion),
            camera_latency=1e-3 * _number(self._camera),
            command_latency=1e-3 * _number(self._link),
            engagements=self._first.engagements,
            seed=self._seed,
        )

    def swap(self) -> None:
        """Let the two controllers change places."""
        first, other = self._controller.value, self._other.value
        if first in self._names and other in self._names:
            self._controller.value, self._other.value = other, first

    def tell(self, text: str) -> None:
        """Say how the trial stands, as Markdown."""
        if self._told.content != text:
            self._told.content = text


def _number(slider: Any) -> float:
    """Return the value of a slider, NaN for what is no number: one bad message must not end the page."""
    try:
        return float(slider.value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _option(dropdown: Any) -> str:
    """Return what is chosen; empty for what was never offered, so that no stranger's words are shown to others."""
    return str(dropdown.value) if dropdown.value in dropdown.options else ""
