import numpy as np

from archerfish.identification.axis.log_ground import prepare_ground
from archerfish.identification.axis.modal_form import section_poles
from archerfish.identification.axis.starting_points import Start, best_cost, distinct, first_guesses, unlike
from archerfish.identification.axis.state_space import plant_poles

NEAR, NEARLY, FAR = (np.array([-1.8, 0.9]),), (np.array([-1.8001, 0.9]),), (np.array([-0.5, 0.1]),)


def test_guesses_hold_the_plant_of_a_clean_log(white, resonant_plant, record):
    recording = record(resonant_plant(4), white[:, 0])
    ground = prepare_ground([recording], 8, recording.outputs.std(axis=0)).thinned(200)
    guesses = first_guesses(ground, 4, 8)
    assert {each.delay for each in guesses} == {0, 1, 2, 4, 8}
    best = min(guesses, key=lambda each: each.cost)
    assert best.delay == 4
    np.testing.assert_allclose(
        np.sort_complex(section_poles(best.sections)), np.sort_complex(plant_poles(resonant_plant())), atol=1e-6
    )


def test_poles_that_lead_to_the_same_minimum_are_tried_once():
    starts = [Start(2.0, 4, FAR), Start(1.0, 4, NEAR), Start(1.1, 4, NEARLY), Start(0.5, 9, FAR)]
    assert unlike(starts, 5) == [FAR, NEAR]
    assert distinct(starts, 5, 5) == [NEAR, FAR]  # of the nearest delay, the best first
    assert distinct(starts, 5, 1) == [NEAR]


def test_a_delay_without_guesses_has_no_cost():
    starts = [Start(2.0, 4, FAR), Start(1.0, 4, NEAR)]
    assert best_cost(starts, 4) == 1.0
    assert best_cost(starts, 5) == np.inf
