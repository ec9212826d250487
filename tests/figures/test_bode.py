import numpy as np
import pytest

from archerfish.figures.bode import BodeData, bode_figure
from archerfish.figures.style import svg_text

FREQUENCY = np.geomspace(0.1, 50, 50)
RESPONSE = np.exp(-0.2j * FREQUENCY) / (1 + 1j * FREQUENCY / 5)


@pytest.fixture
def bode():
    gains = np.linspace(0.9, 1.1, 201)[:, None]
    kept = slice(10, 30)
    coherence = np.linspace(0, 1, 20)
    return BodeData(
        FREQUENCY, RESPONSE, gains * RESPONSE, FREQUENCY[kept], RESPONSE[kept] * 1.01, coherence, (1.0, 20.0)
    )


def test_measured_points_lie_on_the_turn_of_the_model_where_they_are_coherent(bode):
    figure = bode_figure(bode)
    magnitude, phase, coherence = figure.axes
    model, dots = phase.lines
    assert len(dots.get_xdata()) == 10
    np.testing.assert_allclose(dots.get_ydata(), model.get_ydata()[20:30], atol=1e-9)
    assert model.get_ydata()[-1] < -600
    assert len(magnitude.lines) == 2
    np.testing.assert_allclose(coherence.lines[0].get_ydata(), bode.coherence)
    assert svg_text(figure).startswith("<svg")


def test_the_band_holds_the_central_95_percent_of_the_draws(bode):
    outline = bode_figure(bode).axes[0].collections[0].get_paths()[0].vertices
    at_start = outline[np.isclose(outline[:, 0], FREQUENCY[0]), 1]
    expected = 20 * np.log10(np.array([0.905, 1.095]) * abs(RESPONSE[0]))
    assert (at_start.min(), at_start.max()) == pytest.approx(tuple(expected), abs=1e-3)


def test_what_was_not_excited_is_called_unknown(bode):
    words = [text.get_text() for text in bode_figure(bode).axes[0].texts]
    assert [" ".join(each.split()) for each in words] == 2 * ["nothing known here"]
    everything = bode_figure(bode._replace(excited_hz=(0.01, 100.0)))
    assert not everything.axes[0].texts


def test_a_model_without_draws_or_measured_response_is_drawn_all_the_same(bode):
    none = np.zeros(0)
    figure = bode_figure(bode._replace(drawn=np.zeros((0, 50)), measured_hz=none, measured=none, coherence=none))
    assert len(figure.axes[0].lines) == 1
    assert not figure.axes[0].collections
