import numpy as np
import pytest

from archerfish.figures.pole_map import PoleMap, pole_figure
from archerfish.figures.style import svg_text

# 10 Hz, damping 0.5, sampled at 1 kHz; and a pair near half the sampling rate.
SLOW = np.exp(2 * np.pi * 10 * 1e-3 * (-0.5 + 1j * np.sqrt(0.75)))
POLES = np.array([SLOW, SLOW.conjugate(), -0.7 + 0.5j, -0.7 - 0.5j])


def pole_map(draws=7):
    drawn = np.tile(POLES, (draws, 1)) * 0.99
    return PoleMap(POLES, drawn, np.array([True, True, False, False]), 1e-3, (2.0, 50.0))


def test_a_pair_stands_at_its_frequency_and_damping():
    figure = pole_figure(pole_map())
    draws, known, guess = figure.axes[1].lines
    assert (known.get_xdata(), known.get_ydata()) == (pytest.approx([10.0]), pytest.approx([0.5]))
    assert len(guess.get_xdata()) == 1
    assert len(draws.get_xdata()) == 14
    assert svg_text(figure).startswith("<svg")


def test_the_plane_shows_all_poles_by_what_is_known_of_them():
    _, draws, known, guess = pole_figure(pole_map()).axes[0].lines
    assert [len(each.get_xdata()) for each in (draws, known, guess)] == [28, 2, 2]
    assert known.get_marker() != guess.get_marker()


def test_a_pole_at_zero_is_a_delay_and_has_no_frequency():
    poles = PoleMap(np.array([0.9, 0.0]), np.array([[0.9, 0.0]]), np.array([True, True]), 1e-3, (2.0, 50.0))
    assert len(pole_figure(poles).axes[1].lines[-1].get_xdata()) == 1


def test_poles_without_draws_are_drawn_alone():
    assert len(pole_figure(pole_map(draws=0)).axes[1].lines) == 2
