"""The page: choose, watch, drag, compare."""

import re
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np

from archerfish2.errors import InputError
from archerfish2.evaluation.hit_rate import hit_rate
from archerfish2.viewer.choice import Choice, Setup
from archerfish2.viewer.film import ellipse
from archerfish2.viewer.hand import HandRun
from archerfish2.viewer.motions import HAND
from archerfish2.viewer.panel import Controls, Player, PlayerCallbacks
from archerfish2.viewer.scene import Scene, look_from
from archerfish2.viewer.trial import Trial, difference_text, moment, rate_text, run_trial, trial_text

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
    """The page. One thread turns it; the callbacks of the controls, in others, only leave notes for it."""

    def __init__(self, server: Any, setup: Setup, first: Choice) -> None:
        self._server, self._setup, self._choice = server, setup, first
        self._changed, self._swapped = threading.Event(), threading.Event()
        self._changed.set()
        self._lock = threading.Lock()
        self._time, self._duration, self._pace, self._playing = 0.0, 1.0, 1.0, True  # [s], [s], 1
        self._controls = Controls(server, setup, first, self._changed.set, self._swapped.set)
        callbacks = PlayerCallbacks(self._toggle, self._scrub, lambda pace: setattr(self, "_pace", pace), self._look)
        self._player, self._scene = Player(server, callbacks), Scene(server)
        self._arrows = server.scene.add_transform_controls(
            "/hand", scale=0.45, disable_rotations=True, depth_test=False, visible=False
        )
        self._trial: Trial | None = None
        self._run: HandRun | None = None
        self._behind_s = 0.0  # that a dragged target's world is behind the clock
        self._before: tuple[Choice, Trial] | None = None
        self._compared = ""
        self._number, self._shown_at = -1, -1.0
        look_from(server.initial_camera, "behind the robot", first.distance)
        self.turn(0.0)
        server.on_client_connect(self._connected)

    def _toggle(self) -> None:
        with self._lock:
            if not self._playing and self._run is None and self._time >= self._duration:
                self._time = 0.0
            self._playing = not self._playing

    def _connected(self, client: Any) -> None:
        """Show a client the engagements from the beginning, if they are over."""
        self._look(client, "behind the robot")
        if not self._playing and self._time >= self._duration:
            self._toggle()

    def _scrub(self, at: float) -> None:
        with self._lock:
            self._time, self._playing = min(max(at, 0.0), self._duration), False

    def _look(self, client: Any, view: str) -> None:
        if client is not None:
            look_from(client.camera, view, self._choice.distance)

    def turn(self, elapsed: float) -> None:
        """React to what was chosen, let a time pass, and draw.

        Args:
          elapsed: since the last turn [s].
        """
        if self._swapped.is_set():
            self._swapped.clear()
            self._controls.swap()
            self._changed.set()
        try:
            if self._changed.is_set():
                self._changed.clear()
                if (chosen := self._controls.choice()) != self._choice or self._trial is None:
                    self._begin(chosen)
                    elapsed = 0.0
            if self._run is not None and self._playing:
                self._continue(self._run, elapsed)
            elif self._playing:
                with self._lock:
                    self._time = min(self._time + elapsed * self._pace, self._duration)
                    self._playing = self._time < self._duration
        except InputError as error:
            self._trial = self._run = None
            self._controls.say(f"**Not possible:** {plain_text(error)}")
        if self._trial is not None:
            self._show(self._trial)

    def _begin(self, chosen: Choice) -> None:
        """Make the trial of a choice, and play it from its beginning."""
        before, self._choice, self._compared = self._choice, chosen, ""
        self._arrows.visible = chosen.motion == HAND
        if chosen.motion == HAND:
            place = np.array([chosen.distance, 0.0, self._setup.task.height_m])
            if self._run is not None and chosen.distance == before.distance:
                place = self._run.place.copy()
            self._run, self._before, self._behind_s = HandRun(self._setup, chosen, place), None, 0.0
            self._arrows.position = tuple(place)
            self._trial, duration = self._run.trial(), 0.0
        else:
            self._run, self._trial = None, run_trial(self._setup, chosen)
            duration = self._trial.shown_s * len(self._trial.hit)
            if self._before is not None and replace(self._before[0], controller=chosen.controller) == chosen:
                name, text = self._before[0].controller, difference_text(self._trial, self._before[1])
                self._compared = f"{chosen.controller} − {name}: {text}, same engagements"
            self._before = (chosen, self._trial)
        with self._lock:
            self._time, self._duration, self._playing = 0.0, duration, True
        self._number = -1
        self._scene.arrange(chosen.distance, self._trial.hit_radius, ellipse(self._trial, chosen))

    def _continue(self, run: HandRun, elapsed: float) -> None:
        """Let the world of a dragged target continue, decision by decision."""
        self._behind_s = min(self._behind_s + elapsed * self._pace, LONGEST_STEP_S)
        while self._behind_s >= self._setup.task.period_s and not run.is_over:
            run.step(np.asarray(self._arrows.position, np.float64))
            self._behind_s -= self._setup.task.period_s
        self._trial = run.trial()
        with self._lock:
            self._time = self._duration = run.elapsed
        if run.is_over:
            self._run = HandRun(self._setup, self._choice, run.place.copy())

    def _show(self, trial: Trial) -> None:
        count = len(trial.hit)
        number = min(int(self._time / trial.shown_s + 1e-9), count - 1) if self._run is None else 0
        since = self._time - number * trial.shown_s if self._run is None else self._time
        with self._server.atomic():
            self._scene.draw(moment(trial, number, since))
        now = time.monotonic()
        if number == self._number and now - self._shown_at < TEXT_S and self._playing:
            return
        self._player.show(self._time, self._duration, self._playing)
        self._controls.say(self._run_text(trial) if self._run else self._trial_text(trial, number, since))
        if self._run is not None or number != self._number:
            known = np.flatnonzero(np.all(np.isfinite(trial.error[number]), axis=-1))[-250:]
            self._player.plot(trial.fired_at[known], tuple(1e3 * trial.error[number][known].T))
        self._number, self._shown_at = number, now

    def _trial_text(self, trial: Trial, number: int, since: float) -> str:
        crossed = trial.fired_at + trial.flight_time[number] <= since
        hits, chosen = int(np.sum(trial.hit[number] & crossed)), self._choice
        rows = [
            f"**{plain_text(chosen.controller)}** · {plain_text(trial.motions[number])} · {chosen.distance:.1f} m",
            f"Engagement {number + 1} of {len(trial.hit)}: **{hits} of {int(crossed.sum())}** hit",
            f"Whole trial: {trial_text(trial)}",
            plain_text(self._compared),
            plain_text(self._setup.note(chosen.controller)),
        ]
        return "\n\n".join(row for row in rows if row)

    def _run_text(self, trial: Trial) -> str:
        crossed, block = trial.hit[0][: np.isfinite(trial.error[0, :, 0]).sum()], 50
        blocks = crossed[: len(crossed) // block * block].reshape(-1, block).sum(axis=1)
        rate = rate_text(hit_rate(blocks, block)) if len(blocks) > 1 else f"interval after {2 * block} shots"
        x, y, z = trial.place[0, -1]
        rows = [
            f"**{plain_text(self._choice.controller)}** · dragged by hand · at most {self._choice.speed:.2f} m/s",
            f"Target at {x:.2f}, {y:.2f}, {z:.2f} m: drag its arrows",
            f"**{int(crossed.sum())} of {len(crossed)}** hit, {rate}",
            plain_text(self._setup.note(self._choice.controller)),
        ]
        return "\n\n".join(row for row in rows if row)


def plain_text(text: object) -> str:
    """Return a text that Markdown and HTML show as it is, in one line: names and errors of a user's own code."""
    return re.sub(r"[!-/:-@\[-`{-~]", lambda found: f"&#{ord(found[0])};", " ".join(str(text).split()))
