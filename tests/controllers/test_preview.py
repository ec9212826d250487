import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import nnls

from archerfish.controllers import preview_aim
from archerfish.controllers.preview import (
    Preview,
    command_bounds,
    command_rows,
    make_preview,
    rows_to_commands,
    track_path,
)
from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.command_limits import NEVER, CommandLimits, gate_limits
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_model, rest_state
from archerfish.paper.gimbal import gate_limits as gate_record
from archerfish.paper.gimbal import printed_plants

PERIOD = 0.02
SMOOTHING = 1e-3
HORIZON = 8


def printed_gimbal() -> GimbalModel:
    plants = printed_plants()
    return gimbal_model(plants["pitch"], plants["yaw"], PERIOD)


MODEL = printed_gimbal()
FREE = CommandLimits(*(np.full(2, value) for value in (-NEVER, NEVER, NEVER, NEVER, NEVER)))


def problem(seed: int, horizon: int = HORIZON) -> tuple[np.ndarray, ...]:
    """State, command, its rate, path, sight."""
    rng = np.random.default_rng(seed)
    command = rng.uniform(-0.2, 0.2, 2)
    state = rest_state(MODEL, command) * rng.uniform(0.8, 1.2, MODEL.input.shape)
    path = rng.uniform(-0.4, 0.4, 2) + np.cumsum(rng.normal(0.0, 0.01, (horizon, 2)), axis=0)
    return state, command, rng.uniform(-1.0, 1.0, 2), path, path + rng.normal(0.0, 0.005, path.shape)


def cost(preview: Preview, axis: int, state, command, path, commands) -> float:
    """The programme's objective, by stepping the plant."""
    angles = []
    for each in commands:
        state = advance(MODEL, state, np.full(2, each))
        angles.append(gimbal_angle(MODEL, state)[axis])
    changes = np.diff(commands, prepend=command[axis])
    return float(0.5 * np.sum((angles - path[:, axis]) ** 2) + 0.5 * preview.smoothing[axis] * np.sum(changes**2))


def by_active_set(preview: Preview, axis: int, state, command, rate, path, sight) -> np.ndarray:
    """The programme as a least-distance problem, solved exactly by Lawson and Hanson's non-negative least squares."""
    response, smoothing, size = preview.response[axis], preview.smoothing[axis], len(path)
    difference = np.eye(size) - np.eye(size, k=-1)
    right = (path[:, axis] - preview.free[axis] @ state[axis]) @ response + smoothing * command[axis] * np.eye(size)[0]
    inverse = np.linalg.inv(np.linalg.cholesky(response.T @ response + smoothing * difference.T @ difference).T)
    optimum = inverse @ inverse.T @ right
    rows = np.stack([command_rows(each).ravel() for each in np.eye(size)], axis=1)
    low, high = (each.ravel() for each in command_bounds(preview, axis, command[axis], rate[axis], sight[:, axis]))
    inequality = np.vstack([rows, -rows])
    bound = np.concatenate([low, -high]) - inequality @ optimum
    matter = np.abs(bound) < 1e4
    system = np.vstack([(inequality @ inverse)[matter].T, bound[matter]])
    wanted = np.eye(size + 1)[-1]
    residual = system @ nnls(system, wanted)[0] - wanted
    assert np.linalg.norm(residual) > 1e-6, "the bounds contradict each other"
    return optimum - inverse @ residual[:-1] / residual[-1]


def test_rows_are_the_commands_and_their_first_and_second_differences() -> None:
    assert_allclose(command_rows(np.array([1.0, 3.0, 2.0])), [[1, 3, 2], [1, 2, -1], [1, 1, -3]])


def test_the_adjoint_is_the_adjoint() -> None:
    rng = np.random.default_rng(41)
    commands, rows = rng.normal(size=(2, 4, 9)), rng.normal(size=(2, 4, 3, 9))
    assert_allclose(
        np.sum(command_rows(commands) * rows, axis=(-1, -2)), np.sum(commands * rows_to_commands(rows), axis=-1)
    )


def test_the_response_is_the_plants() -> None:
    preview = make_preview(MODEL, FREE, PERIOD, HORIZON, SMOOTHING)
    state, *_ = problem(1)
    commands = np.random.default_rng(42).normal(size=(HORIZON, 2))
    predicted = np.stack(
        [preview.response[axis] @ commands[:, axis] + preview.free[axis] @ state[axis] for axis in range(2)], axis=-1
    )
    for step in range(HORIZON):
        state = advance(MODEL, state, commands[step])
        assert_allclose(gimbal_angle(MODEL, state), predicted[step], atol=1e-12)


def test_without_bounds_the_result_is_exact() -> None:
    preview = make_preview(MODEL, FREE, PERIOD, HORIZON, SMOOTHING)
    state, command, rate, path, sight = problem(2)
    found = track_path(preview, state, command, rate, path, sight)
    for axis in range(2):
        # As one tall least-squares problem.
        difference = np.eye(HORIZON) - np.eye(HORIZON, k=-1)
        rows = np.vstack([preview.response[axis], np.sqrt(SMOOTHING) * difference])
        right = np.concatenate(
            [path[:, axis] - preview.free[axis] @ state[axis], np.sqrt(SMOOTHING) * command[axis] * np.eye(HORIZON)[0]]
        )
        assert_allclose(found[:, axis], np.linalg.lstsq(rows, right, rcond=None)[0], atol=1e-9)


ACTIVE = {
    "range": FREE._replace(low=np.full(2, -0.1), high=np.full(2, 0.15)),
    "rate": FREE._replace(max_rate=np.array([4.0, 6.0])),
    "acceleration": FREE._replace(max_acceleration=np.array([128.0, 67.0])),
    "lead": FREE._replace(max_lead=np.array([NEVER, 0.035])),
    "all": CommandLimits(*(np.full(2, value) for value in (-0.45, 0.45, 8.0, 200.0, 1.0))),
}


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize("name", ACTIVE)
def test_active_bounds_give_what_a_general_solver_gives(name, seed) -> None:
    # Bounds of several kinds against each other converge slowly.
    iterations, slack = (5000, 5e-4) if name == "all" else (1500, 1e-5)
    preview = make_preview(MODEL, ACTIVE[name], PERIOD, HORIZON, SMOOTHING)
    state, command, rate, path, sight = problem(seed)
    found = track_path(preview, state, command, rate, path, sight, iterations)
    for axis in range(2):
        expected = by_active_set(preview, axis, state, command, rate, path, sight)
        low, high = command_bounds(preview, axis, command[axis], rate[axis], sight[:, axis])
        rows = command_rows(found[:, axis])
        assert np.all(rows >= low - slack)
        assert np.all(rows <= high + slack)
        ours, theirs = (cost(preview, axis, state, command, path, each) for each in (found[:, axis], expected))
        assert ours == pytest.approx(theirs, rel=1e-3, abs=1e-7)
        assert_allclose(found[0, axis], expected[0], atol=2e-3)


def test_the_usual_iterations_find_the_first_command_to_a_few_milliradians() -> None:
    preview = make_preview(MODEL, gate_limits(gate_record()), PERIOD, preview_aim.HORIZON, preview_aim.SMOOTHING)
    errors = []
    for seed in range(20):
        state, command, rate, path, sight = problem(seed, preview_aim.HORIZON)
        path = 0.4 * path  # slews of up to 15°
        found = track_path(preview, state, command, rate, path, sight)
        exact = [by_active_set(preview, axis, state, command, rate, path, sight)[0] for axis in range(2)]
        errors.append(found[0] - exact)
    assert np.sqrt(np.mean(np.square(errors))) < 4e-3


def test_the_bounds_count_from_the_command_in_force() -> None:
    preview = make_preview(MODEL, ACTIVE["all"], PERIOD, HORIZON, SMOOTHING)
    command, rate = 0.1, 2.0
    low, high = command_bounds(preview, 0, np.asarray(command), np.asarray(rate), np.zeros(HORIZON))
    # Going on at the rate in force is a series with no second difference from there.
    rows = command_rows(command + rate * PERIOD * np.arange(1, HORIZON + 1))
    assert_allclose(rows[1] - 0.5 * (low + high)[1], rate * PERIOD, atol=1e-12)
    assert_allclose(rows[2] - 0.5 * (low + high)[2], 0.0, atol=1e-12)
    assert_allclose(0.5 * (high - low)[1], 8.0 * PERIOD)
    assert_allclose(0.5 * (high - low)[2], 200.0 * PERIOD**2)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    preview = make_preview(MODEL, ACTIVE["all"], PERIOD, HORIZON, SMOOTHING)
    count = int(np.prod(shape))
    batch = [
        np.reshape(np.stack(each), (*shape, *each[0].shape)) for each in zip(*map(problem, range(count)), strict=True)
    ]
    found = agree_in_jax(track_path, preview, *batch, atol=1e-4)
    assert found.shape == (*shape, HORIZON, 2)


def by_plain_iterations(preview: Preview, axis: int, state, command, rate, path, sight, count, relaxation):
    """The iterations in their usual form, with bounded rows and duals apart and L as a matrix."""
    size = len(path)
    rows = np.stack([command_rows(each).ravel() for each in np.eye(size)], axis=1)
    low, high = (each.ravel() for each in command_bounds(preview, axis, command[axis], rate[axis], sight[:, axis]))
    penalty = np.repeat(preview.penalty[axis], size)
    right = (path[:, axis] - preview.free[axis] @ state[axis]) @ preview.response[axis]
    right[0] += preview.smoothing[axis] * command[axis]
    commands = preview.optimum[axis] @ right
    kept = np.clip(rows @ commands, low, high)
    dual = rows @ commands - kept
    for _ in range(count):
        commands = preview.inverse[axis] @ (right + rows.T @ (penalty * (kept - dual)))
        unbound = relaxation * rows @ commands + (1.0 - relaxation) * kept + dual
        kept = np.clip(unbound, low, high)
        dual = unbound - kept
    return commands


@pytest.mark.parametrize("relaxation", [1.0, 1.6])
def test_the_iterations_are_the_plain_ones_but_for_rounding(relaxation: float) -> None:
    preview = make_preview(MODEL, ACTIVE["all"], PERIOD, HORIZON, SMOOTHING)
    for seed in range(4):
        state, command, rate, path, sight = problem(seed)
        found = track_path(preview, state, command, rate, path, sight, 40, relaxation)
        single = single_precision((preview, state, command, rate, path, sight))
        rounded = track_path(*single, 40, relaxation)
        assert rounded.dtype == np.float32
        for axis in range(2):
            plain = by_plain_iterations(preview, axis, state, command, rate, path, sight, 40, relaxation)
            assert_allclose(found[:, axis], plain, atol=1e-12)
            assert_allclose(rounded[:, axis], plain, atol=1e-5)
