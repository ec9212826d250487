"""The page: choose, watch, drag, compare."""

import queue
import re
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from archerfish.errors import InputError
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.viewer.choice import Setup, TrialChoice
from archerfish.viewer.film import ellipse
from archerfish.viewer.hand import HandRun
from archerfish.viewer.motions import HAND
from archerfish.viewer.panel import Panel
from archerfish.viewer.scene import Scene, look_from
from archerfish.viewer.trial import Trial, difference_text, moment, rate_text, run_trial, trial_text

PICTURE_S, TEXT_S = 0.04, 0.2
"""Between two pictures, and between two updates of numbers and plot [s]."""
LONGEST_STEP_S = 0.2
"""A busy machine plays slower, rather than jump by more [s]."""


def serve_page(server: Any, page: "Page") -> None:
    """Turn a page while somebody looks at it, until an exception such as Ctrl-C ends it."""
    before = time.monotonic()
    while True:
        time.sleep(PICTURE_S)
        now = time.monotonic()
        if server.get_clients():
            page.turn(min(now - before, LONGEST_STEP_S))
        before = now


class Page:
    """The page. One thread turns it; the callbacks of the controls, in others, leave functions for it to call."""

    def __init__(self, server: Any, setup: Setup, first: TrialChoice) -> None:
        self._server, self._setup = server, setup
        self.calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        """Called at the next turn."""
        self.pace = 1.0
        """Seconds shown per second."""
        self._panel, self._scene = Panel(server, setup, first, self), Scene(server)
        options = {"scale": 0.45, "disable_rotations": True, "depth_test": False, "visible": False}
        self._arrows = server.scene.add_transform_controls("/hand", **options)
        self._time, self._duration, self._playing = 0.0, 1.0, True  # [s], [s]
        self._choice: TrialChoice | None = None
        self._trial: Trial | None = None
        self._run: HandRun | None = None
        self._behind_s = 0.0  # that a dragged target's world is behind the clock
        self._before: tuple[TrialChoice, Trial] | None = None
        self._compared, self._number, self._shown_at = "", -1, -1.0
        self.turn(0.0)
        server.on_client_connect(self._connected)

    def _connected(self, client: Any) -> None:
        self.look(client, "behind the robot")
        self.calls.put(lambda: None if self._playing or self._time < self._duration else self.toggle())

    def look(self, client: Any, view: str) -> None:
        """Let a client look from a viewpoint."""
        look_from(client.camera, view, self._panel.choice().distance)

    def toggle(self) -> None:
        """Pause, or continue; from the beginning if it was over."""
        if not self._playing and self._run is None and self._time >= self._duration:
            self._time = 0.0
        self._playing = not self._playing

    def scrub(self, time: float) -> None:
        """Go to a time [s], and pause."""
        self._time, self._playing = min(max(time, 0.0), self._duration), False

    def turn(self, elapsed: float) -> None:
        """React to the controls, let a time pass, and draw.

        Args:
          elapsed: since the last turn [s].
        """
        while not self.calls.empty():
            self.calls.get()()
        try:
            if (chosen := self._panel.choice()) != self._choice:
                self._begin(chosen)
            elif self._run is not None and self._playing:
                self._continue(self._run, chosen, elapsed)
            elif self._playing:
                self._time = min(self._time + elapsed * self.pace, self._duration)
                self._playing = self._time < self._duration
        except InputError as error:
            self._trial = self._run = None
            self._panel.say(f"**Not possible:** {plain_text(error)}")
        if self._trial is not None:
            self._show(self._trial, chosen)

    def _begin(self, chosen: TrialChoice) -> None:
        """Make the trial of a choice, and play it from its beginning."""
        self._choice, self._compared, self._number = chosen, "", -1
        self._time, self._playing, self._arrows.visible = 0.0, True, chosen.motion == HAND
        if chosen.motion == HAND:
            place = np.array([chosen.distance, 0.0, self._setup.task.height_m])
            self._run, self._before, self._behind_s = HandRun(self._setup, chosen, place), None, 0.0
            self._arrows.position = tuple(place)
            self._trial, self._duration = self._run.trial(), 0.0
        else:
            self._run, self._trial = None, run_trial(self._setup, chosen)
            self._duration = self._trial.shown_s * len(self._trial.hit)
            if self._before is not None and replace(self._before[0], controller=chosen.controller) == chosen:
                name, text = self._before[0].controller, difference_text(self._trial, self._before[1])
                self._compared = f"{chosen.controller} − {name}: {text}, same engagements"
            self._before = (chosen, self._trial)
        self._scene.arrange(chosen.distance, self._trial.hit_radius, ellipse(self._trial, chosen.distance))

    def _continue(self, run: HandRun, chosen: TrialChoice, elapsed: float) -> None:
        """Let the world of a dragged target continue, decision by decision."""
        self._behind_s = min(self._behind_s + elapsed * self.pace, LONGEST_STEP_S)
        while self._behind_s >= self._setup.task.period_s and not run.is_over:
            run.step(np.asarray(self._arrows.position, np.float64))
            self._behind_s -= self._setup.task.period_s
        self._trial = run.trial()
        self._time = self._duration = run.elapsed
        if run.is_over:
            self._run = HandRun(self._setup, chosen, run.place.copy())

    def _show(self, trial: Trial, chosen: TrialChoice) -> None:
        is_run = self._run is not None
        number = 0 if is_run else min(int(self._time / trial.shown_s + 1e-9), len(trial.hit) - 1)
        since, now = self._time - (0.0 if is_run else number * trial.shown_s), time.monotonic()
        with self._server.atomic():
            self._scene.draw(moment(trial, number, since))
        if number == self._number and now - self._shown_at < TEXT_S and self._playing:
            return
        self._panel.show_time(self._time, self._duration, self._playing)
        rows = _run_rows(trial, chosen) if is_run else [*_trial_rows(trial, chosen, number, since), self._compared]
        name, *rows = (plain_text(text) for text in (chosen.controller, *rows, self._setup.note(chosen.controller)))
        self._panel.say("\n\n".join([f"**{name}**", *filter(None, rows)]))
        if is_run or number != self._number:
            known = np.flatnonzero(np.all(np.isfinite(trial.error[number]), axis=-1))[-250:]
            self._panel.plot(trial.fired_at[known], trial.error[number][known])
        self._number, self._shown_at = number, now


def _trial_rows(trial: Trial, chosen: TrialChoice, number: int, since: float) -> list[str]:
    crossed = trial.fired_at + trial.flight_time[number] <= since
    return [
        f"Engagement {number + 1} of {len(trial.hit)} ({trial.motions[number]}, {chosen.distance:.1f} m)",
        f"{trial.hit[number][crossed].sum()} of {crossed.sum()} hit",
        f"Whole trial: {trial_text(trial)}",
    ]


def _run_rows(trial: Trial, chosen: TrialChoice) -> list[str]:
    crossed, block = trial.hit[0][: np.isfinite(trial.error[0, :, 0]).sum()], 50
    hits = crossed[: len(crossed) // block * block].reshape(-1, block).sum(axis=1)
    rate = rate_text(hit_rate(hits, block)) if len(hits) > 1 else f"interval after {2 * block} shots"
    x, y, z = trial.place[0, -1]
    return [
        f"Target at {x:.2f}, {y:.2f}, {z:.2f} m, at most {chosen.speed:.2f} m/s: drag its arrows",
        f"{crossed.sum()} of {len(crossed)} hit, {rate}",
    ]


def plain_text(text: object) -> str:
    """Return a text that Markdown and HTML show as it is, in one line: names and errors of a user's own code."""
    return re.sub(r"[!-/:-@\[-`{-~]", lambda found: f"&#{ord(found[0])};", " ".join(str(text).split()))
