"""A trial as one animated page that needs no server and no network."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from archerfish.records import storage
from archerfish.viewer.choice import Choice
from archerfish.viewer.playback import engagement_at
from archerfish.viewer.scene import Scene, look_from
from archerfish.viewer.score import rate_words, score
from archerfish.viewer.server import close_server, open_server
from archerfish.viewer.trial import Trial, moment

FRAMES_PER_S = 25
"""Pictures per second of the film."""


def write_film(
    path: Path, choice: Choice, trial: Trial, advance: Callable[[float, str], None] = lambda *_: None
) -> None:
    """Write a trial as a self-contained animated HTML page, whole.

    Args:
      path: of the page.
      choice: what the trial is of.
      trial: the trial.
      advance: hears how many pictures are done.

    Raises:
      InputError: if the file can't be written.
    """
    storage.write_text(path, film_page(choice, trial, advance))


def film_page(choice: Choice, trial: Trial, advance: Callable[[float, str], None] = lambda *_: None) -> str:
    """Return the page of `write_film`."""
    server = open_server("127.0.0.1", 0, "Archerfish")
    try:
        scene = Scene(server)
        scene.arrange(choice.distance, trial.hit_radius, trial.spread)
        look_from(server.initial_camera, "behind the robot", choice.distance)
        _draw(scene, choice, trial, 0.0)
        recorder: Any = server.get_scene_serializer()
        pictures = film_pictures(trial)
        for picture in range(pictures):
            _draw(scene, choice, trial, picture / FRAMES_PER_S)
            recorder.insert_sleep(1.0 / FRAMES_PER_S)
            advance(picture + 1, "")
        return str(recorder.as_html())
    finally:
        close_server(server)


def film_pictures(trial: Trial) -> int:
    """Return how many pictures a film has."""
    return round(trial.shown_s * len(trial.miss) * FRAMES_PER_S)


def _draw(scene: Scene, choice: Choice, trial: Trial, time: float) -> None:
    engagement, since = engagement_at(time, trial.shown_s, len(trial.miss))
    scene.draw(moment(trial, engagement, since))
    now = score(trial, engagement, since)
    rate = f"; so far {rate_words(now.so_far)}" if now.so_far else ""
    scene.caption(f"{choice.controller}: {now.hits} of {now.landed} hit{rate}")
