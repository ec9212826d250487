"""The page of a recording: the gimbal as it turned, and its angles over time."""

import time
from typing import Any

import numpy as np

from archerfish.viewer.panel import TOLD_EVERY_S, FilmCallbacks, Player
from archerfish.viewer.playback import Film
from archerfish.viewer.recordings import GimbalRecording, angles_at
from archerfish.viewer.scene import Scene, look_from
from archerfish.viewer.wording import plain

MOST_POINTS = 2000
"""Of a curve in the plot; more can't be told apart."""


class ReplayPage:
    """The page; `turn` is called again and again by one thread."""

    def __init__(self, server: Any, recording: GimbalRecording) -> None:
        self._server, self._recording = server, recording
        self._told = server.gui.add_markdown("…")
        self._film = Film()
        self._film.begin(float(recording.time[-1]))
        names = [f"{axis}{kind}" for kind in ("", " command") for axis in ("pitch", "yaw")]
        callbacks = FilmCallbacks(self._film.toggle, self._film.scrub, self._film.set_pace, self._look)
        self._player = Player(server, callbacks, names, "Angles", "°")
        step = max(1, -(-recording.time.size // MOST_POINTS))
        curves = np.degrees(np.concatenate([recording.angle, recording.command], axis=1)[::step])
        self._player.plot(recording.time[::step], tuple(curves.T))
        self._scene = Scene(server)
        self._scene.show_target(False)
        self._told_at = -1.0
        look_from(server.initial_camera, "behind the robot", 1.0)

    def _look(self, client: Any, view: str) -> None:
        if client is not None:
            look_from(client.camera, view, 1.0)

    def turn(self, elapsed: float) -> None:
        """Let some seconds go by, and draw.

        Args:
          elapsed: since the last turn [s].
        """
        playback, recording = self._film.advance(elapsed), self._recording
        angle, command = angles_at(recording, playback.time)
        with self._server.atomic():
            self._scene.point_gimbal(angle, command)
            self._scene.caption(recording.source)
        now = time.monotonic()
        if playback.playing and now - self._told_at < TOLD_EVERY_S:
            return
        self._told_at = now
        self._player.tell(playback.time, playback.duration, playback.playing)
        pitch, yaw = np.degrees(angle)
        rows = [
            f"**{plain(recording.source)}**, {recording.time[-1]:.1f} s",
            f"At {playback.time:.2f} s: pitch {pitch:+.2f}°, yaw {yaw:+.2f}°",
            *map(plain, recording.remarks),
        ]
        text = "\n\n".join(rows)
        if self._told.content != text:
            self._told.content = text
