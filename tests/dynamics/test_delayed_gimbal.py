from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.delayed_gimbal import (
    DelayedGimbal,
    DelayedState,
    angle_and_rate,
    delayed_gimbal,
    longest_wait,
    rest_under,
    run,
    send,
)
from archerfish.dynamics.linear_axis import advance, gimbal_angle, gimbal_model, rest_state
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

TICK, TICKS = 0.001, 20
PERIOD = TICK * TICKS
ONE = np.asarray(0)


def axis(frequency_hz: float, delay: int, feedthrough: float = 0.0) -> PlantRecord:
    """A damped second order of steady gain one (less a feedthrough)."""
    pole = np.exp(2 * np.pi * frequency_hz * TICK * (-0.6 + 0.8j))
    a = np.array([[2 * pole.real, -(abs(pole) ** 2)], [1.0, 0.0]])
    gain = 1 - 2 * pole.real + abs(pole) ** 2
    c = np.array([[0.5, 0.5]]) * (1.0 - feedthrough)
    return PlantRecord(a, np.array([[gain], [0.0]]), c, np.array([[feedthrough]]), delay, TICK)


def slow(plant: PlantRecord, order: int = 3) -> PlantRecord:
    """The same axis behind a first-order lag: of a higher order than the other axis."""
    a = np.zeros((order, order))
    a[:2, :2], a[2, 2], a[:2, 2:] = plant.A, 0.9, plant.B
    return replace(plant, A=a, B=np.array([[0.0], [0.0], [0.1]]), C=np.pad(plant.C, ((0, 0), (0, 1))))


PITCH, YAW = axis(12.0, 3, feedthrough=0.1), slow(axis(5.0, 7))


def with_draws(plant: PlantRecord, gains: list[float], delays: list[int]) -> PlantRecord:
    several = {name: np.repeat(getattr(plant, name)[None], len(gains), axis=0) for name in "ABCD"}
    several["B"] = several["B"] * np.array(gains)[:, None, None]
    return replace(plant, draws=several, draw_delays=np.array(delays))


class ByTheTick:
    """An axis simulated tick by tick, its commands a list of arrivals: what the products must come to."""

    def __init__(self, plant: PlantRecord, start: float) -> None:
        self.plant, self.now, self.arrivals = plant, 0, [(-(10**6), start)]
        self.state = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B[:, 0]) * start

    def send(self, command: float, latency: float) -> None:
        arrival = self.now + round(latency / TICK) + self.plant.delay_samples
        self.arrivals.append((max(arrival, self.arrivals[-1][0]), command))

    def in_force(self, tick: int) -> float:
        return [command for arrival, command in self.arrivals if arrival <= tick][-1]

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.state = self.plant.A @ self.state + self.plant.B[:, 0] * self.in_force(self.now)
            self.now += 1

    def angle_and_rate(self) -> tuple[float, float]:
        command = self.in_force(self.now)
        next_state = self.plant.A @ self.state + self.plant.B[:, 0] * command
        angles = [(self.plant.C @ state + self.plant.D[:, 0] * command).item() for state in (self.state, next_state)]
        return angles[0], (angles[1] - angles[0]) / TICK


def agrees(gimbal: DelayedGimbal, draw: np.ndarray, state: DelayedState, axes: list[ByTheTick]) -> None:
    angle, rate = angle_and_rate(gimbal, draw, state)
    expected = [each.angle_and_rate() for each in axes]
    assert_allclose(angle, [each[0] for each in expected], rtol=0, atol=1e-12)
    assert_allclose(rate, [each[1] for each in expected], rtol=0, atol=1e-9)


@pytest.mark.parametrize("longest", [0.0, 0.008, 0.035, 0.11])
def test_commands_of_random_latency_act_as_they_do_tick_by_tick(longest) -> None:
    rng = np.random.default_rng(11)
    gimbal = delayed_gimbal(PITCH, YAW, PERIOD)
    state = rest_under(gimbal, ONE, np.array([0.1, -0.2]), longest_wait(gimbal, longest / TICK))
    axes = [ByTheTick(PITCH, 0.1), ByTheTick(YAW, -0.2)]
    under_way = []
    for _ in range(60):
        command, latency = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.0, longest)
        state = send(gimbal, ONE, state, command, np.asarray(latency))
        for each, wanted in zip(axes, command, strict=True):
            each.send(wanted, latency)
        under_way.append(np.sum(state.due > 0.0, axis=-1).max())
        # Where the gimbal is at any moment until the next command.
        part = int(rng.integers(0, TICKS + 1))
        for ticks in (part, TICKS - part):
            state = run(gimbal, ONE, state, np.asarray(float(ticks)))
            for each in axes:
                each.run(ticks)
            agrees(gimbal, ONE, state, axes)
    assert max(under_way) >= np.ceil((longest / TICK + 7) / TICKS)  # several at once where latencies are long


def test_no_command_overtakes_the_one_before_it() -> None:
    gimbal = delayed_gimbal(PITCH, YAW, PERIOD)
    state = rest_under(gimbal, ONE, np.zeros(2), longest_wait(gimbal, 60))
    state = send(gimbal, ONE, state, np.array([0.1, 0.1]), np.asarray(0.050))
    state = run(gimbal, ONE, state, np.asarray(20.0))
    state = send(gimbal, ONE, state, np.array([0.3, 0.3]), np.asarray(0.0))
    assert_allclose(state.due[..., -2:], [[33.0, 33.0], [37.0, 37.0]])
    assert np.all(np.diff(state.due, axis=-1) >= 0.0)


@pytest.mark.parametrize("pieces", [[20], [0, 20], [1] * 20, [7, 0, 13]])
def test_parts_of_a_period_compose_to_the_whole(pieces) -> None:
    gimbal = delayed_gimbal(PITCH, YAW, PERIOD)
    state = rest_under(gimbal, ONE, np.array([0.1, 0.2]), 4)
    state = send(gimbal, ONE, state, np.array([-0.2, 0.4]), np.asarray(0.006))
    whole = run(gimbal, ONE, state, np.asarray(20.0))
    for ticks in pieces:
        state = run(gimbal, ONE, state, np.asarray(float(ticks)))
    for found, expected in zip(state, whole, strict=True):
        assert_allclose(found, expected, atol=1e-13)


def test_a_gimbal_at_rest_stays_at_rest_at_its_steady_gain() -> None:
    pitch = with_draws(PITCH, [1.0, 2.0], [0, 3])
    gimbal = delayed_gimbal(pitch, YAW, PERIOD)
    draw, start = np.array([0, 1]), np.array([[0.1, -0.3], [0.1, -0.3]])
    state = rest_under(gimbal, draw, start, 4)
    for _ in range(5):
        state = run(gimbal, draw, send(gimbal, draw, state, start, np.zeros(2)), np.full(2, 20.0))
    angle, rate = angle_and_rate(gimbal, draw, state)
    # Of pitch nine tenths pass the plant, whose second draw has twice the gain, and one tenth passes it by.
    assert_allclose(angle, [[0.1, -0.3], [0.1 * (2 * 0.9 + 0.1), -0.3]], atol=1e-12)
    assert_allclose(rate, 0.0, atol=1e-10)


def test_draws_have_delays_of_their_own() -> None:
    pitch, yaw = with_draws(PITCH, [1.0, 1.5, 2.0], [0, 2, 5]), with_draws(YAW, [1.0, 0.5, 0.2], [9, 1, 4])
    gimbal = delayed_gimbal(pitch, yaw, PERIOD)
    assert gimbal.delay.tolist() == [[0, 9], [2, 1], [5, 4]]
    draw = np.array([2, 0, 1])
    state = rest_under(gimbal, draw, np.zeros((3, 2)), longest_wait(gimbal, 0.0))
    state = send(gimbal, draw, state, np.ones((3, 2)), np.zeros(3))
    state = run(gimbal, draw, state, np.full(3, 12.0))
    angle, _ = angle_and_rate(gimbal, draw, state)
    for member, index in enumerate(draw):
        for column, plant in enumerate((pitch, yaw)):
            own = {name: array[index] for name, array in plant.draws.items()}
            one = ByTheTick(PlantRecord(**own, delay_samples=int(plant.draw_delays[index]), sample_period_s=TICK), 0.0)
            one.send(1.0, 0.0)
            one.run(12)
            assert angle[member, column] == pytest.approx(one.angle_and_rate()[0], abs=1e-12)


def test_an_axis_without_draws_serves_all_draws_of_the_other() -> None:
    gimbal = delayed_gimbal(with_draws(PITCH, [1.0, 2.0, 3.0], [0, 1, 2]), YAW, PERIOD)
    assert gimbal.rest.shape[0] == 3
    assert_allclose(gimbal.transition[1, :, 1], gimbal.transition[0, :, 1])


def test_without_latency_it_is_the_gimbal_of_whole_periods() -> None:
    rng = np.random.default_rng(12)
    whole, delayed = gimbal_model(PITCH, YAW, PERIOD), delayed_gimbal(PITCH, YAW, PERIOD)
    start = np.array([0.2, -0.1])
    coarse, fine = rest_state(whole, start), rest_under(delayed, ONE, start, longest_wait(delayed, 0.0))
    for command in rng.uniform(-0.5, 0.5, (30, 2)):
        coarse = advance(whole, coarse, command)
        fine = run(delayed, ONE, send(delayed, ONE, fine, command, np.asarray(0.0)), np.asarray(20.0))
        assert_allclose(angle_and_rate(delayed, ONE, fine)[0], gimbal_angle(whole, coarse), atol=1e-11)


def test_a_constant_latency_is_a_longer_delay_of_the_plant() -> None:
    whole = gimbal_model(PITCH, YAW, PERIOD, latency_s=0.026)
    delayed = delayed_gimbal(PITCH, YAW, PERIOD)
    coarse, fine = rest_state(whole, np.zeros(2)), rest_under(delayed, ONE, np.zeros(2), longest_wait(delayed, 26))
    for command in np.random.default_rng(13).uniform(-0.5, 0.5, (30, 2)):
        coarse = advance(whole, coarse, command)
        fine = run(delayed, ONE, send(delayed, ONE, fine, command, np.asarray(0.026)), np.asarray(20.0))
        assert_allclose(angle_and_rate(delayed, ONE, fine)[0], gimbal_angle(whole, coarse), atol=1e-11)


def test_axes_of_different_sampling_periods_are_refused() -> None:
    with pytest.raises(InputError, match=r"same sampling period, got 0\.001 s for pitch and 0\.002 s for yaw"):
        delayed_gimbal(PITCH, replace(YAW, sample_period_s=0.002), PERIOD)


def test_a_period_that_is_no_multiple_of_the_sampling_period_is_refused() -> None:
    with pytest.raises(InputError, match="multiple of the plant's sampling period"):
        delayed_gimbal(PITCH, YAW, 0.0205)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(14)
    gimbal = delayed_gimbal(with_draws(PITCH, [1.0, 2.0], [0, 3]), with_draws(YAW, [1.0, 0.5], [7, 2]), PERIOD)
    draw = rng.integers(0, 2, shape, dtype=np.int32)

    def moved(gimbal, draw, commands, latencies, ticks):
        state = rest_under(gimbal, draw, commands[0], 5)
        for command, latency in zip(commands[1:], latencies, strict=True):
            state = run(gimbal, draw, send(gimbal, draw, state, command, latency), ticks)
        return state, angle_and_rate(gimbal, draw, state)

    commands, latencies = rng.uniform(-0.3, 0.3, (3, *shape, 2)), rng.uniform(0.0, 0.03, (2, *shape))
    # Rates are differences of angles over a thousandth of a second.
    ticks = np.full(shape, 13.0)
    _, (angle, rate) = agree_in_jax(moved, gimbal, draw, commands, latencies, ticks, rtol=1e-4, atol=1e-3)
    assert angle.shape == rate.shape == (*shape, 2)
    if shape:
        first = (0,) * len(shape)
        at = (slice(None), *first)
        alone = moved(gimbal, draw[first], commands[at], latencies[at], ticks[first])
        assert_allclose(alone[1][0], angle[first], atol=1e-5)
