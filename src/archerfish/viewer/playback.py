"""Where a film stands: play, pause, slow motion, scrub. It knows no clock; it is told how much time went by."""

import math
import threading
from dataclasses import dataclass, replace

PACES = {"real time": 1.0, "half": 0.5, "a fifth": 0.2, "a twentieth": 0.05}
"""Name on the page → seconds of the film per second."""


@dataclass(frozen=True)
class Playback:
    """A film that is being watched."""

    duration: float
    """[s]."""
    time: float = 0.0
    """Where it stands [s]."""
    playing: bool = True
    """Whether it goes on."""
    pace: float = 1.0
    """Seconds of the film per second."""


def advanced(playback: Playback, elapsed: float) -> Playback:
    """Return where a film stands after some seconds; at its end it stops.

    Args:
      playback: as it was.
      elapsed: seconds that went by [s].
    """
    if not playback.playing:
        return playback
    time = playback.time + max(elapsed, 0.0) * playback.pace
    if time < playback.duration:
        return replace(playback, time=time)
    return replace(playback, time=playback.duration, playing=False)


def toggled(playback: Playback) -> Playback:
    """Return a film paused or going on; at its end it begins anew."""
    if not playback.playing and playback.time >= playback.duration:
        return replace(playback, time=0.0, playing=True)
    return replace(playback, playing=not playback.playing)


def scrubbed(playback: Playback, time: float) -> Playback:
    """Return a film put to a time [s], and paused there; left as it was by what is no time."""
    if not math.isfinite(time):  # a client says what it likes
        return playback
    return replace(playback, time=min(max(time, 0.0), playback.duration), playing=False)


def engagement_at(time: float, shown_s: float, count: int) -> tuple[int, float]:
    """Return which engagement a film shows and the time since its beginning [s].

    Args:
      time: of the film [s].
      shown_s: of each engagement [s].
      count: engagements.
    """
    index = min(max(int(time / shown_s + 1e-9), 0), count - 1)
    return index, time - index * shown_s


class Film:
    """The playback that the page's thread and its controls share."""

    def __init__(self) -> None:
        self._lock, self._playback = threading.Lock(), Playback(1.0)

    @property
    def playback(self) -> Playback:
        """Where it stands."""
        return self._playback

    def begin(self, duration: float) -> None:
        """Begin another film of a length [s] at the same pace."""
        with self._lock:
            self._playback = Playback(duration, pace=self._playback.pace)

    def advance(self, elapsed: float) -> Playback:
        """Let some seconds go by [s], and return where it stands."""
        with self._lock:
            self._playback = advanced(self._playback, elapsed)
            return self._playback

    def grow(self, duration: float) -> None:
        """Go to the end of a film that is being made, if it is not paused."""
        with self._lock:
            if self._playback.playing:
                self._playback = replace(self._playback, time=duration, duration=duration)

    def toggle(self) -> None:
        """Pause, or go on."""
        with self._lock:
            self._playback = toggled(self._playback)

    def repeat(self) -> None:
        """Begin anew if it is over: for someone who comes late."""
        with self._lock:
            over = self._playback.time >= self._playback.duration
            self._playback = toggled(self._playback) if over and not self._playback.playing else self._playback

    def scrub(self, time: float) -> None:
        """Go to a time [s], and pause there."""
        with self._lock:
            self._playback = scrubbed(self._playback, time)

    def set_pace(self, pace: float) -> None:
        """Go on at so many seconds of the film per second."""
        with self._lock:
            self._playback = replace(self._playback, pace=pace)
