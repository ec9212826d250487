import numpy as np
import pytest

from archerfish.identification.axis.state_space import simulate
from archerfish.identification.excitation.parallel_sections import (
    delay_slope,
    frequency_response,
    modes,
    parallel_plant,
    response,
    response_slopes,
    second_order_plant,
)
from archerfish.identification.validation.frequency import plant_response
from archerfish.paper.gimbal import printed_plants
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord


@pytest.fixture
def command():
    return 0.2 + np.cumsum(np.random.default_rng(1).standard_normal(400)) * 0.01


PLANTS = {
    "pitch": printed_plants()["pitch"],
    "yaw": printed_plants()["yaw"],
    "critically damped": second_order_plant(8.0, 1.0, 0.02, 0.005),
    "feedthrough": PlantRecord(np.array([[0.6]]), np.array([[0.2]]), np.array([[1.0]]), np.array([[0.4]]), 3, 0.01),
}


@pytest.mark.parametrize("name", PLANTS)
def test_sections_answer_as_the_plant_does(name, command):
    plant = PLANTS[name]
    sections = parallel_plant(plant)
    moved = (command - command[0])[:, None]
    np.testing.assert_allclose(response(sections, command), simulate(plant, moved)[:, 0], rtol=1e-6, atol=1e-9)
    frequency = np.array([0.5, 3.0, 20.0])
    expected = plant_response(plant, frequency)[:, 0, 0]
    np.testing.assert_allclose(frequency_response(sections, frequency)[0], expected, rtol=1e-6)


def shifted(sections, index, by):
    """Move one parameter; they count through the denominators, the numerators and the feedthrough."""
    flat = np.concatenate([*sections.denominators, *sections.numerators, [sections.feedthrough]])
    flat[index] += by
    sizes = [each.size for each in (*sections.denominators, *sections.numerators)]
    parts = np.split(flat[:-1], np.cumsum(sizes)[:-1])
    half = len(parts) // 2
    return sections._replace(
        denominators=tuple(parts[:half]), numerators=tuple(parts[half:]), feedthrough=float(flat[-1])
    )


@pytest.mark.parametrize("name", ["pitch", "feedthrough"])
def test_slopes_are_those_of_differences(name, command):
    sections, step, frequency = parallel_plant(PLANTS[name]), 1e-7, np.array([2.0, 10.0])
    slopes, gain_slopes = response_slopes(sections, command), frequency_response(sections, frequency)[1]
    for index in range(slopes.shape[1]):
        pair = [shifted(sections, index, sign * step) for sign in (1, -1)]
        for found, function in (
            (slopes[:, index], lambda each: response(each, command)),
            (gain_slopes[:, index], lambda each: frequency_response(each, frequency)[0]),
        ):
            expected = (function(pair[0]) - function(pair[1])) / (2 * step)
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())


def test_modes_move_as_differences_say():
    sections, step = parallel_plant(PLANTS["pitch"]), 1e-7
    for index in range(4):
        up, down = (modes(shifted(sections, index, sign * step)) for sign in (1, -1))
        for mode, above, below in zip(modes(sections), up, down, strict=True):
            expected = (above.frequency_hz - below.frequency_hz) / (2 * step)
            assert mode.frequency_slope[index] == pytest.approx(expected, rel=1e-4, abs=1e-3)
            expected = (above.damping - below.damping) / (2 * step)
            assert mode.damping_slope[index] == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_a_second_order_plant_has_the_mode_it_was_made_with():
    (mode,) = modes(parallel_plant(second_order_plant(12.0, 0.4, 0.003, 1e-3)))
    assert (mode.frequency_hz, mode.damping) == (pytest.approx(12.0), pytest.approx(0.4))


def test_a_later_command_is_a_lesser_output_of_a_ramp():
    sections = parallel_plant(second_order_plant(12.0, 0.7, 0.003, 1e-3))
    # Behind a settled axis of gain 1 a ramp of 2 rad/s comes 2 rad lower per second of delay.
    np.testing.assert_allclose(delay_slope(sections, 2e-3 * np.arange(600))[-100:-1], -2.0, rtol=1e-6)


def test_a_plant_that_integrates_or_has_two_inputs_is_refused():
    eye = np.eye(1)
    with pytest.raises(InputError, match="stable"):
        parallel_plant(PlantRecord(eye, eye, eye, 0 * eye, 0, 0.01))
    with pytest.raises(InputError, match="one input"):
        names = ("a", "b")
        parallel_plant(PlantRecord(0.5 * eye, np.ones((1, 2)), eye, np.zeros((1, 2)), 0, 0.01, input_names=names))
