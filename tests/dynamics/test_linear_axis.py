from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.linear_axis import (
    advance,
    gimbal_angle,
    gimbal_draws,
    gimbal_model,
    gimbal_rate,
    ramp_response,
    refined,
    rest_state,
)
from archerfish.paper.gimbal import printed_plants
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord, dc_gain

PERIOD_S = 0.02
TICKS = 20


def plants(delay: int = 0, feedthrough: float = 0.0) -> tuple[PlantRecord, PlantRecord]:
    pitch, yaw = (
        replace(plant, delay_samples=delay, D=np.array([[feedthrough]])) for plant in printed_plants().values()
    )
    return pitch, yaw


def tick_by_tick(plant: PlantRecord, commands: np.ndarray, start: float, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate at the ends of the periods, one tick at a time, from rest at a command of `start`.

    A feedthrough shows the command of the tick just ended, as a held command is still in force at a period's end.
    """
    past = [start] * (plant.delay_samples + 1)
    x = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B[:, 0]) * start
    before = output = (plant.C @ x).item() + plant.D.item() * start
    angles, rates = [], []
    for command in commands:
        for _ in range(ticks):
            past = [*past[1:], command]
            x = plant.A @ x + plant.B[:, 0] * past[0]
            before, output = output, (plant.C @ x).item() + plant.D.item() * past[0]
        angles.append(output)
        rates.append((output - before) / plant.sample_period_s)
    return np.array(angles), np.array(rates)


def run(model, commands: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    state = rest_state(model, start)
    angles, rates = [], []
    for command in commands:
        state = advance(model, state, command)
        angles.append(gimbal_angle(model, state))
        rates.append(gimbal_rate(model, state))
    return np.array(angles), np.array(rates)


@pytest.mark.parametrize("feedthrough", [0.0, 0.2])
@pytest.mark.parametrize("delay", [0, 3, 20, 27])
@pytest.mark.parametrize("ticks", [1, TICKS])
def test_n_tick_steps_are_n_single_ticks(delay, feedthrough, ticks, agree_in_jax) -> None:
    both = plants(delay, feedthrough)
    model = gimbal_model(*both, ticks * 1e-3)
    rng = np.random.default_rng(5)
    start, commands = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.5, 0.5, (40, 2))
    expected = [tick_by_tick(plant, commands[:, axis], start[axis], ticks) for axis, plant in enumerate(both)]
    angle, rate = (np.stack(each, axis=-1) for each in zip(*expected, strict=True))
    exact_angle, exact_rate = run(model, commands, start)
    assert_allclose(exact_angle, angle, rtol=0, atol=1e-12)
    assert_allclose(exact_rate, rate, rtol=0, atol=1e-9)
    single = type(model)(*(each.astype(np.float32) for each in model))
    found_angle, found_rate = run(single, commands.astype(np.float32), start.astype(np.float32))
    assert found_angle.dtype == np.float32
    assert np.max(np.abs(found_angle - angle)) <= 1e-6 * np.max(np.abs(angle))
    assert np.max(np.abs(found_rate - rate)) <= 2e-6 * np.max(np.abs(rate))


def test_axes_of_different_order_and_delay_share_a_model() -> None:
    pitch, _ = plants(delay=27)
    first_order = PlantRecord(
        A=np.array([[0.9]]),
        B=np.array([[0.1]]),
        C=np.eye(1),
        D=np.zeros((1, 1)),
        delay_samples=0,
        sample_period_s=5e-3,
    )
    model = gimbal_model(pitch, first_order, PERIOD_S)
    angle, _ = run(model, np.ones((3, 2)), np.zeros(2))
    assert_allclose(angle[:, 1], 1.0 - 0.9 ** np.array([4, 8, 12]))  # by hand: four ticks a period
    assert_allclose(angle[:, 0], tick_by_tick(pitch, np.ones(3), 0.0, TICKS)[0], atol=1e-12)


@pytest.mark.parametrize("delay", [0, 27])
def test_a_held_command_ends_at_the_dc_gain(delay) -> None:
    both = plants(delay, feedthrough=0.1)
    model = gimbal_model(*both, PERIOD_S)
    angle, rate = run(model, np.full((150, 2), 0.3), np.zeros(2))
    assert_allclose(angle[-1], [0.3 * dc_gain(plant).item() for plant in both], rtol=1e-8)
    assert_allclose(rate[-1], 0.0, atol=1e-6)


def test_printed_dc_gains() -> None:
    model = gimbal_model(*plants(), PERIOD_S)
    assert_allclose(gimbal_angle(model, rest_state(model, np.ones(2))), [1.031, 1.0], atol=5e-4)


@pytest.mark.parametrize("latency", [0.0, 0.013])
def test_behind_a_ramp_a_gimbal_is_late_by_its_lead(latency: float) -> None:
    period, slope = 0.02, 0.7
    model = gimbal_model(**printed_plants(), period_s=period, latency_s=latency)
    found = ramp_response(model, period)
    state = rest_state(model, np.zeros(2))
    for decision in range(400):
        state = advance(model, state, np.full(2, slope * decision * period))
    # When the pellet of a decision leaves, a period later, the gimbal is where the command of `lead` earlier sends it.
    assert_allclose(gimbal_angle(model, state), found.gain * slope * (400 * period - found.lead), rtol=1e-9)
    assert_allclose(found.gain, [dc_gain(plant).item() for plant in printed_plants().values()])


def test_rest_stays_at_rest() -> None:
    model = gimbal_model(*plants(delay=27, feedthrough=0.1), PERIOD_S)
    command = np.array([0.1, -0.7])
    state = rest_state(model, command)
    assert_allclose(advance(model, state, command), state, atol=1e-12)
    assert_allclose(gimbal_rate(model, state), 0.0, atol=1e-12)


def test_left_and_right_are_mirror_images() -> None:
    model = gimbal_model(*plants(delay=3), PERIOD_S)
    commands = np.random.default_rng(2).uniform(-0.5, 0.5, (10, 2))
    left, right = run(model, commands, np.zeros(2)), run(model, -commands, np.zeros(2))
    assert_allclose(left, -np.array(right), rtol=0, atol=0)


def test_draws_are_models_of_their_own_matrices() -> None:
    rng = np.random.default_rng(4)
    both = []
    for plant, count in zip(plants(delay=3), (3, 4), strict=True):
        draws = {name: np.repeat(getattr(plant, name)[None], count, axis=0) for name in "ABCD"}
        draws["B"] = draws["B"] * rng.uniform(0.8, 1.2, (count, 1, 1))
        both.append(replace(plant, draws=draws))
    models = gimbal_draws(*both, PERIOD_S)
    assert models.transition.shape[:2] == (3, 2)  # as many pairs as both axes have
    second = gimbal_model(*(replace(plant, B=plant.draws["B"][2], draws={}) for plant in both), PERIOD_S)
    for found, expected in zip(models, second, strict=True):
        assert_allclose(found[2], expected)


def test_a_draw_may_have_a_delay_of_its_own() -> None:
    # 27 ticks are one decision period of 20 ticks and seven: the state is longer than that of 3 ticks.
    both = []
    for plant, delays in zip(plants(delay=3), ([3, 27], [5, 0]), strict=True):
        draws = {name: np.repeat(getattr(plant, name)[None], 2, axis=0) for name in "ABCD"}
        both.append(replace(plant, draws=draws, draw_delays=np.array(delays)))
    models = gimbal_draws(*both, PERIOD_S)
    commands = np.random.default_rng(2).uniform(-0.5, 0.5, (10, 2))
    for index in range(2):
        alone = [
            replace(each, delay_samples=int(each.draw_delays[index]), draws={}, draw_delays=np.zeros(0, np.int64))
            for each in both
        ]
        expected = run(gimbal_model(*alone, PERIOD_S), commands, np.zeros(2))
        found = run(type(models)(*(part[index] for part in models)), commands, np.zeros(2))
        assert_allclose(np.array(found), np.array(expected), atol=1e-12)


def test_without_draws_there_is_no_posterior() -> None:
    assert gimbal_draws(*plants(), PERIOD_S) is None


@pytest.mark.parametrize("period_s", [0.0205, 0.0004])
def test_a_period_between_ticks_is_refused(period_s) -> None:
    with pytest.raises(InputError, match=r"multiple of the plant's sampling period 0\.001 s, got 0\.0"):
        gimbal_model(*plants(), period_s)


def test_a_plant_of_two_inputs_is_refused() -> None:
    pitch, yaw = plants()
    with pytest.raises(InputError, match="needs one input, got 2"):
        gimbal_model(pitch, replace(yaw, B=np.hstack([yaw.B, yaw.B]), D=np.zeros((1, 2))), PERIOD_S)


@pytest.mark.parametrize("own_plant", [False, True])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, own_plant, agree_in_jax) -> None:
    model = gimbal_model(*plants(delay=27, feedthrough=0.1), PERIOD_S)
    if own_plant:
        model = type(model)(*(np.broadcast_to(each, (*shape, *each.shape)) for each in model))
    start, command = np.random.default_rng(6).uniform(-0.5, 0.5, (2, *shape, 2))

    def everything(model, start, command):
        state = advance(model, rest_state(model, start), command)
        return state, gimbal_angle(model, state), gimbal_rate(model, state)

    state, angle, _ = agree_in_jax(everything, model, start, command, atol=1e-5)
    assert state.shape[:-1] == angle.shape == (*shape, 2)


def test_a_refined_plant_answers_held_commands_as_before() -> None:
    a = np.array([[0.7, 0.2], [-0.2, 0.7]])
    plant = PlantRecord(a, np.array([[0.1], [0.3]]), np.array([[1.0, 0.2]]), np.array([[0.05]]), 2, 0.01)
    finer = refined(plant, 1e-3)
    assert (finer.sample_period_s, finer.delay_samples) == (pytest.approx(1e-3), 20)
    command = np.random.default_rng(1).normal(size=40)
    state, small = np.zeros(2), np.zeros(2)
    for u in command:
        state = plant.A @ state + plant.B[:, 0] * u
        for _ in range(10):
            small = finer.A @ small + finer.B[:, 0] * u
        assert_allclose(small, state, atol=1e-12)


def test_a_plant_without_a_logarithm_is_not_refined() -> None:
    a = np.array([[0.7, 0.0], [0.0, -0.2]])
    plant = PlantRecord(a, np.array([[0.1], [0.3]]), np.array([[1.0, 0.2]]), np.zeros((1, 1)), 2, 0.01)
    assert refined(plant, 1e-3) is plant
    assert refined(replace(plant, A=np.abs(a), sample_period_s=1e-3), 1e-3).sample_period_s == 1e-3
