from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from archerfish.identification.axis.state_space import plant_poles, simulate
from archerfish.identification.validation.confidence_bands import (
    band,
    drawn_dc_gains,
    drawn_outputs,
    drawn_poles,
    drawn_responses,
    parameter_errors,
)
from archerfish.identification.validation.free_run import free_run
from archerfish.identification.validation.frequency import plant_response
from archerfish.records.plant import dc_gain


@pytest.fixture
def uncertain(resonant_plant):
    """A plant of two inputs with delay and feedthrough, and five draws around it."""
    plant = resonant_plant(delay=2, feedthrough=0.3, inputs=2)
    rng = np.random.default_rng(4)
    names = ("A", "B", "C", "D")
    draws = {
        name: getattr(plant, name) + 0.01 * rng.standard_normal((5, *getattr(plant, name).shape)) for name in names
    }
    return replace(plant, draws=draws, draw_delays=np.array([2, 2, 0, 3, 2]))


def each_draw(plant):
    alone = replace(plant, draws={}, draw_delays=np.zeros(0, np.int64))
    return [
        replace(alone, delay_samples=int(plant.draw_delays[k]), **{name: plant.draws[name][k] for name in plant.draws})
        for k in range(5)
    ]


def test_draws_respond_as_plants_of_their_own(uncertain, white):
    frequency = np.array([0.5, 5.0, 30.0])
    np.testing.assert_allclose(
        drawn_responses(uncertain, frequency), [plant_response(each, frequency) for each in each_draw(uncertain)]
    )
    np.testing.assert_allclose(
        drawn_outputs(uncertain, white), [simulate(each, white) for each in each_draw(uncertain)], atol=1e-10
    )
    np.testing.assert_allclose(drawn_dc_gains(uncertain), [dc_gain(each) for each in each_draw(uncertain)])


def test_drawn_poles_stand_in_the_places_of_the_plants(uncertain):
    poles = plant_poles(uncertain)
    drawn = drawn_poles(uncertain, poles)
    assert np.abs(drawn - poles).max() < 0.1
    for row, each in zip(drawn, each_draw(uncertain), strict=True):
        np.testing.assert_allclose(np.sort_complex(row), np.sort_complex(plant_poles(each)), atol=1e-9)


def test_parameter_errors_are_what_a_draw_changes_in_the_residual(uncertain, white, record):
    recording = record(uncertain, white, initial_state=np.array([1.0, -1.0, 0.5, 2.0]))
    draw = each_draw(uncertain)[0]
    changed = free_run(uncertain, recording).residual - free_run(draw, recording).residual
    # The free run of a draw has its own modes; the plant's are near.
    difference = changed[:, 0] - parameter_errors(uncertain, recording.inputs)[0]
    assert np.linalg.norm(difference[50:]) < 0.01 * np.linalg.norm(changed[50:])


def test_a_band_holds_the_central_95_percent():
    low, high = band(norm.ppf((np.arange(100_000) + 0.5) / 100_000)[:, None])
    assert (low.item(), high.item()) == pytest.approx((-1.96, 1.96), abs=1e-3)


def test_a_plant_without_draws_has_none(resonant_plant, white):
    plant = resonant_plant()
    assert drawn_responses(plant, np.ones(3)).shape == (0, 3, 1, 1)
    assert drawn_outputs(plant, white[:, :1]).shape == (0, 600, 1)
    assert drawn_poles(plant, plant_poles(plant)).shape == (0, 4)
    assert drawn_dc_gains(plant).shape == (0, 1, 1)
    assert parameter_errors(plant, white[:, :1]).shape == (0, 600)
