"""The page of trials: choose, watch, drag, compare."""

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np

from archerfish.records.errors import InputError
from archerfish.viewer.choice import Choice, Subject
from archerfish.viewer.hand import HandRun
from archerfish.viewer.motions import HAND
from archerfish.viewer.panel import TOLD_EVERY_S, Controls, FilmCallbacks, Player
from archerfish.viewer.playback import Film, Playback, engagement_at
from archerfish.viewer.scene import Scene, look_from
from archerfish.viewer.score import blocks, compared, count_words, difference_words, rate_words, score
from archerfish.viewer.trial import Floats, Trial, moment, run_trial
from archerfish.viewer.wording import plain

MOST_CATCHING_UP_S = 0.1
"""What a busy machine loses of a dragged target's time is left out beyond this [s]."""


class TrialPage:
    """The page; `turn` is called again and again by one thread, the controls only leave notes for it."""

    def __init__(self, server: Any, subject: Subject, first: Choice, other: str) -> None:
        self._subject, self._server = subject, server
        self._changed, self._swapped = threading.Event(), threading.Event()
        self._changed.set()
        self._film = Film()
        self._controls = Controls(server, subject, first, other, self._changed.set, self._swapped.set)
        callbacks = FilmCallbacks(self._film.toggle, self._film.scrub, self._film.set_pace, self._look)
        self._player = Player(server, callbacks, ("pitch", "yaw"), "Aim error", "mrad")
        self._scene = Scene(server)
        self._gizmo = server.scene.add_transform_controls(
            "/hand", scale=0.45, disable_rotations=True, depth_test=False, visible=False
        )
        self._choice = first
        self._trial: Trial | None = None
        self._run: HandRun | None = None
        self._owed = 0.0
        self._before: tuple[Choice, Trial] | None = None
        self._compared = ""
        self._engagement, self._told_at = -1, -1.0
        look_from(server.initial_camera, "behind the robot", first.distance)
        # Whoever opens the page finds the trial made, and the film going.
        self.turn(0.0)
        server.on_client_connect(lambda _: self._film.repeat() if self._run is None else None)

    def _look(self, client: Any, view: str) -> None:
        if client is not None:
            look_from(client.camera, view, self._choice.distance)

    def turn(self, elapsed: float) -> None:
        """Answer what was chosen, let some seconds go by, and draw.

        Args:
          elapsed: since the last turn [s].
        """
        if self._swapped.is_set():
            self._swapped.clear()
            self._controls.swap()
            self._changed.set()
        if self._changed.is_set():
            self._changed.clear()
            chosen = self._controls.choice()
            if self._trial is None or chosen != self._choice:
                self._begin(chosen)
                elapsed = 0.0
        if self._run is not None:
            self._continue_run(self._run, elapsed)
        self._show(self._film.playback if self._run else self._film.advance(elapsed))

    def _begin(self, chosen: Choice) -> None:
        """Make the trial of a choice, and play it from its beginning."""
        try:
            if chosen.motion == HAND:
                self._begin_run(chosen)
            else:
                self._begin_film(chosen)
        except InputError as error:
            self._refuse(error)
            self._choice = chosen
            return
        self._choice = chosen
        self._engagement = -1
        if self._trial is not None:
            self._scene.arrange(chosen.distance, self._trial.hit_radius, self._trial.spread)
        self._gizmo.visible = chosen.motion == HAND

    def _refuse(self, error: InputError) -> None:
        """Say why there is nothing to see, until another choice is made."""
        self._controls.tell(f"**Not possible:** {plain(error)}")
        self._trial, self._run = None, None

    def _begin_film(self, chosen: Choice) -> None:
        trial = run_trial(self._subject, chosen)
        self._compared = ""
        if self._before is not None and replace(self._before[0], controller=chosen.controller) == chosen:
            theirs, before = self._before
            if theirs.controller != chosen.controller:
                found = compared(trial, before)
                self._compared = difference_words(chosen.controller, theirs.controller, found)
        self._before = (chosen, trial)
        self._trial, self._run = trial, None
        self._film.begin(trial.shown_s * len(trial.miss))

    def _begin_run(self, chosen: Choice) -> None:
        place = np.array([chosen.distance, 0.0, self._subject.conditions.armor_height])
        if self._run is not None and chosen.distance == self._choice.distance:
            place = self._run.place.copy()
        self._run = HandRun(self._subject, chosen, place)
        self._gizmo.position = tuple(place)
        self._trial, self._compared, self._before = self._run.trial(), "", None
        self._film.begin(0.0)
        self._owed = 0.0

    def _continue_run(self, run: HandRun, elapsed: float) -> None:
        """Let a dragged target's world go on, one decision after the other."""
        playback, period = self._film.playback, self._subject.conditions.control_period_s
        if not playback.playing:
            return
        self._owed = min(self._owed + elapsed * playback.pace, MOST_CATCHING_UP_S)
        try:
            while self._owed >= period and not run.over:
                run.step(_held_at(self._gizmo.position, run.place))
                self._owed -= period
            again = HandRun(self._subject, self._choice, run.place.copy()) if run.over else run
        except InputError as error:
            self._refuse(error)
            return
        self._trial = run.trial()
        self._film.grow(run.elapsed)
        self._run = again

    def _show(self, playback: Playback) -> None:
        if self._trial is None:
            return
        trial = self._trial
        count = len(trial.miss)
        if self._run is None:
            engagement, since = engagement_at(playback.time, trial.shown_s, count)
        else:
            engagement, since = 0, playback.time
        with self._server.atomic():
            self._scene.draw(moment(trial, engagement, since))
        now = time.monotonic()
        if engagement == self._engagement and now - self._told_at < TOLD_EVERY_S and playback.playing:
            return
        self._told_at = now
        self._player.tell(playback.time, playback.duration, playback.playing)
        text = self._told_of_run(trial) if self._run else self._told_of_film(trial, engagement, since)
        self._controls.tell(text)
        self._plot(trial, engagement)
        self._engagement = engagement

    def _plot(self, trial: Trial, engagement: int) -> None:
        """Plot a film's engagement once, and the last seconds of a run as they come."""
        if self._run is None and engagement == self._engagement:
            return
        judged = np.all(np.isfinite(trial.error[engagement]), axis=-1)
        shown = np.flatnonzero(judged)[-250:]
        self._player.plot(trial.fired_at[shown], tuple(1e3 * trial.error[engagement][shown].T))

    def _told_of_film(self, trial: Trial, engagement: int, since: float) -> str:
        now, chosen = score(trial, engagement, since), self._choice
        self._scene.caption(f"{chosen.controller}: {now.hits} of {now.landed} hit")
        names = f"**{plain(chosen.controller)}** · {plain(chosen.motion)}"
        rows = [
            f"{names} · {chosen.distance:.1f} m · {chosen.speed:.2f} m/s",
            f"Engagement {engagement + 1} of {len(trial.miss)}: **{now.hits} of {now.landed}** hit",
            f"So far: {rate_words(now.so_far)}",
            f"Whole trial: {count_words(trial)}, 95 % intervals by engagement",
        ]
        return "\n\n".join([*rows, *([f"*{plain(self._compared)}*"] if self._compared else [])])

    def _told_of_run(self, trial: Trial) -> str:
        landed = np.isfinite(trial.flight_time[0])
        hit, chosen = trial.hit[0][landed], self._choice
        block = self._subject.conditions.decisions
        self._scene.caption(f"{chosen.controller}: {int(hit.sum())} of {hit.size} hit")
        x, y, z = trial.place[0, -1]
        return "\n\n".join(
            [
                f"**{plain(chosen.controller)}** · dragged by hand · at most {chosen.speed:.2f} m/s",
                f"Target at {x:.2f}, {y:.2f}, {z:.2f} m: drag its arrows",
                f"**{int(hit.sum())} of {hit.size}** hit: {rate_words(blocks(hit, block))} of {block} shots",
            ]
        )


def _held_at(position: Any, place: Floats) -> Floats:
    """Return where the hand holds the target [m], shape (3,); where it is, if a client says what is no place."""
    try:
        wanted: Floats = np.asarray(position, np.float64)
    except (TypeError, ValueError, OverflowError):
        return place
    return wanted if wanted.shape == (3,) and np.all(np.isfinite(wanted)) else place
