"""The controls of a film, without a browser."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

pytest.importorskip("viser")

from archerfish.viewer.panel import FilmCallbacks, Player


class Slider(SimpleNamespace):
    def on_update(self, function: Any) -> None:
        self.called = function


def player() -> tuple[Player, Slider, list[float]]:
    server, scrubbed = MagicMock(), list[float]()
    slider = Slider(value=0.0, max=1.0)
    server.gui.add_slider.return_value = slider
    callbacks = FilmCallbacks(lambda: None, scrubbed.append, lambda _: None, lambda *_: None)
    return Player(server, callbacks, ("pitch", "yaw"), "Aim error", "mrad"), slider, scrubbed


def client_sets(slider: Slider) -> None:
    slider.called(SimpleNamespace(client=object()))


def test_a_time_that_a_client_has_set_is_kept_until_the_film_goes_there() -> None:
    film, slider, scrubbed = player()
    film.tell(0.0, 7.8, playing=False)
    slider.value = 0.8  # has arrived; its callback runs a moment later
    film.tell(0.0, 7.8, playing=False)
    assert slider.value == 0.8
    client_sets(slider)
    assert scrubbed == [0.8]
    film.tell(0.8, 7.8, playing=False)
    assert slider.value == 0.8


def test_the_slider_follows_a_film_that_plays() -> None:
    film, slider, _ = player()
    film.tell(1.0, 7.8, playing=True)
    film.tell(2.0, 7.8, playing=True)
    assert slider.value == 2.0


def test_what_is_no_time_is_written_over() -> None:
    film, slider, _ = player()
    film.tell(1.0, 7.8, playing=True)
    slider.value = "much"
    client_sets(slider)
    film.tell(2.0, 7.8, playing=True)
    assert slider.value == 2.0
