import numpy as np
import pytest

from archerfish.identification.axis.modal_form import sections_from_poles, state_matrices
from archerfish.identification.axis.simulation_fit import (
    Penalty,
    design_rows,
    fit_linear_parameters,
    penalty_rows,
    span,
    transfer_columns,
)
from archerfish.identification.axis.spectra import delayed, spectrum
from archerfish.identification.axis.state_space import free_responses, plant_poles, simulate
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import make_recording

POLES = np.array([0.85 + 0.25j, 0.85 - 0.25j, 0.6, 0.2])
OTHER = np.array([0.8 + 0.3j, 0.8 - 0.3j, 0.5])


def noise_logs(counts, inputs, outputs):
    """Logs without any relation between input and output: every parameter matters, no residual is zero."""
    rng = np.random.default_rng(sum(counts))
    names = [f"u{index}" for index in range(inputs)], [f"y{index}" for index in range(outputs)]
    return [
        make_recording(
            rng.standard_normal((count, inputs)) + 2.0,
            rng.standard_normal((count, outputs)) - 1.0,
            0.01,
            input_names=names[0],
            output_names=names[1],
        )
        for count in counts
    ]


def least_squares_in_time(sections, logs, delay, feedthrough):
    """Fit initial states, an offset of each log, and all that is shared, in one stacked problem per output."""
    A, _, C = state_matrices(sections, np.ones((sum(s.size for s in sections), 1, 1)))
    zeros = np.zeros((1, 1))
    shared, own = [], []
    for each in logs:
        driven = delayed(each.inputs, delay)
        columns = [
            simulate(PlantRecord(A, unit[:, None], C, zeros, 0, 0.01), driven[:, [channel]])[:, 0]
            for unit in np.eye(len(A))
            for channel in range(driven.shape[1])
        ]
        shared.append(np.column_stack([*columns, driven]) if feedthrough else np.column_stack(columns))
        free = free_responses(PlantRecord(A, A[:, :1], C, zeros, 0, 0.01), len(each))[:, 0]
        own.append(np.column_stack([free, np.ones(len(each))]))
    width = own[0].shape[1]
    local = np.zeros((sum(map(len, own)), width * len(own)))
    rows = np.cumsum([0, *map(len, own)])
    for index, block in enumerate(own):
        local[rows[index] : rows[index + 1], index * width : (index + 1) * width] = block
    matrix = np.hstack([np.concatenate(shared), local])
    target = np.concatenate([each.outputs for each in logs])
    solution = np.linalg.lstsq(matrix, target)[0]
    return solution[: shared[0].shape[1]], float(np.sum((target - matrix @ solution) ** 2))


@pytest.mark.parametrize("counts", [(120,), (121,), (80, 61, 44)])
@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (2, 1), (1, 2)])
@pytest.mark.parametrize(("delay", "feedthrough"), [(0, False), (0, True), (3, True)])
@pytest.mark.parametrize("poles", [POLES, OTHER])
def test_it_is_the_least_squares_of_the_time_domain(counts, inputs, outputs, delay, feedthrough, poles):
    logs = noise_logs(counts, inputs, outputs)
    sections = sections_from_poles(poles)
    shared, cost = least_squares_in_time(sections, logs, delay, feedthrough)
    fit = fit_linear_parameters(sections, [spectrum(each, delay) for each in logs], feedthrough)
    order = poles.size
    assert fit.cost == pytest.approx(cost, rel=1e-10)
    assert fit.misfit == pytest.approx(cost, rel=1e-10)
    np.testing.assert_allclose(fit.numerators.reshape(order * inputs, outputs), shared[: order * inputs], atol=1e-9)
    expected = shared[order * inputs :] if feedthrough else np.zeros((inputs, outputs))
    np.testing.assert_allclose(fit.feedthrough, expected, atol=1e-9)


@pytest.mark.parametrize("inputs", [1, 2])
@pytest.mark.parametrize("delay", [0, 3])
def test_the_true_poles_leave_no_residual_and_give_the_plant_back(white, inputs, delay, resonant_plant, record):
    plant = resonant_plant(delay, feedthrough=0.4, inputs=inputs)
    recordings = [
        record(plant, white[:400, :inputs], offset=2.0, initial_state=np.ones(4)),
        record(plant, white[400:, :inputs], offset=-1.0),
    ]
    sections = sections_from_poles(plant_poles(plant))
    fit = fit_linear_parameters(sections, [spectrum(each, delay) for each in recordings], True)
    A, B, C = state_matrices(sections, fit.numerators)
    again = PlantRecord(A, B, C, fit.feedthrough.T, delay, plant.sample_period_s)
    assert np.abs(fit.residuals).max() < 1e-11
    np.testing.assert_allclose(again.D, plant.D, atol=1e-11)
    fresh = np.random.default_rng(3).standard_normal((100, inputs))
    np.testing.assert_allclose(simulate(again, fresh), simulate(plant, fresh), atol=1e-10)


def moved_residuals(sections, index, step, *arguments):
    moved = np.concatenate(sections)
    moved[index] += step
    stops = np.cumsum([section.size for section in sections])[:-1]
    return fit_linear_parameters(tuple(np.split(moved, stops)), *arguments, with_slopes=False).residuals


def wishes(inputs, outputs):
    """Penalty on two points of each transfer function, with targets."""
    rng = np.random.default_rng(1)
    rows = tuple(rng.standard_normal((3, 4)) for _ in range(inputs))
    targets = tuple(rng.standard_normal((3, outputs)) for _ in range(inputs))
    return Penalty(np.array([1.0, np.exp(-0.5j)]), rows, targets)


@pytest.mark.parametrize("penalised", [False, True])
def test_slopes_give_the_gradient_of_the_cost(penalised):
    # d(cost)/da = −2 slopesᵀ residuals whatever the residual, as those of the projected problem would
    logs = noise_logs((80, 61), 1, 2)
    arguments = [spectrum(each, 1) for each in logs], True, wishes(1, 2) if penalised else None
    sections = sections_from_poles(OTHER)
    fit = fit_linear_parameters(sections, *arguments)
    for index in range(3):
        costs = [np.sum(moved_residuals(sections, index, step, *arguments) ** 2) for step in (1e-5, -1e-5)]
        expected = (costs[0] - costs[1]) / 2e-5
        assert -2 * fit.slopes[:, index] @ fit.residuals == pytest.approx(expected, rel=1e-6)


def test_slopes_are_those_of_the_projected_residual_at_the_solution(white, resonant_plant, record):
    # At zero residual Kaufman's derivative is exact: −∂r/∂a equals the slopes.
    plant = resonant_plant()
    arguments = [spectrum(record(plant, white[:, 0], initial_state=np.ones(4)), 0)], False
    sections = sections_from_poles(plant_poles(plant))
    fit = fit_linear_parameters(sections, *arguments)
    for index in range(4):
        sides = [moved_residuals(sections, index, step, *arguments) for step in (1e-6, -1e-6)]
        np.testing.assert_allclose(fit.slopes[:, index], -(sides[0] - sides[1]) / 2e-6, atol=1e-4)


def test_the_penalty_is_least_squares_with_more_rows():
    logs, sections, penalty = noise_logs((90,), 2, 1), sections_from_poles(OTHER), wishes(2, 1)
    experiment = spectrum(logs[0], 0)
    fit = fit_linear_parameters(sections, [experiment], True, penalty)
    parameters = np.concatenate([fit.numerators.reshape(-1, 1), fit.feedthrough])

    def squares(parameters):
        miss = 0.0
        for rows, targets, columns in zip(
            penalty.rows, penalty.targets, transfer_columns(sections, penalty.lag, 2, True), strict=True
        ):
            gains = columns @ parameters
            miss += np.sum((rows @ np.concatenate([gains.real, gains.imag]) - targets) ** 2)
        return miss

    assert fit.cost - fit.misfit == pytest.approx(squares(parameters))
    # The least of the sum: the data's gradient and the penalty's cancel.
    data, _ = design_rows(sections, experiment, True, fit)
    for index in range(parameters.size):
        step = np.zeros_like(parameters)
        step[index] = 1e-6
        pull = (squares(parameters + step) - squares(parameters - step)) / 2e-6
        assert 2 * data[:, index] @ fit.residuals[: len(data)] == pytest.approx(pull, rel=1e-5, abs=1e-6)


def test_design_rows_are_the_derivatives_of_the_model(white, resonant_plant, record):
    # Beside the transient, which is taken out: the projected derivative of the noise-free residual at fixed b and D.
    plant = resonant_plant(1, 0.3)
    experiment = spectrum(record(plant, white[:, 0], initial_state=np.ones(4)), 1)
    sections = sections_from_poles(plant_poles(plant))
    fit = fit_linear_parameters(sections, [experiment], True)
    by_linear, by_sections = design_rows(sections, experiment, True, fit)
    # With b and D fitted again the rest of the design must be what `slopes` are.
    again = span(by_linear).remove(by_sections[0])
    np.testing.assert_allclose(again, fit.slopes, atol=1e-8)


def test_penalty_rows_are_the_derivatives_of_the_wishes():
    penalty, sections = wishes(1, 1), sections_from_poles(OTHER)
    fit = fit_linear_parameters(sections, [spectrum(noise_logs((70,), 1, 1)[0], 0)], True)
    parameters = np.concatenate([fit.numerators.reshape(-1, 1), fit.feedthrough])

    def wished(coefficients):
        gains = transfer_columns((coefficients[:2], coefficients[2:]), penalty.lag, 1, True)[0] @ parameters
        return penalty.rows[0] @ np.concatenate([gains.real, gains.imag])[:, 0]

    by_linear, by_sections = penalty_rows(sections, penalty, 1, True, fit)
    place = np.concatenate(sections)
    np.testing.assert_allclose(by_linear @ parameters[:, 0], wished(place), atol=1e-12)
    for index, step in enumerate(1e-6 * np.eye(3)):
        slope = (wished(place + step) - wished(place - step)) / 2e-6
        np.testing.assert_allclose(by_sections[0][:, index], slope, rtol=1e-6, atol=1e-8)


def test_transfer_columns_are_the_resolvent():
    sections = sections_from_poles(OTHER)
    numerators = np.random.default_rng(2).standard_normal((3, 2, 1))
    A, B, C = state_matrices(sections, numerators)
    z = np.exp(0.7j)
    expected = (C @ np.linalg.solve(z * np.eye(3) - A, B + 0j))[0] + [0.5, -0.25]
    parameters = np.concatenate([numerators.reshape(-1), [0.5, -0.25]])
    for column, gain in zip(transfer_columns(sections, np.array([1 / z]), 2, True), expected, strict=True):
        assert column @ parameters == pytest.approx(gain)


def test_equal_poles_do_not_break_the_fit(white, resonant_plant, record):
    sections = (np.array([-1.0, 0.25]), np.array([-1.0, 0.25]))
    fit = fit_linear_parameters(sections, [spectrum(record(resonant_plant(), white[:, 0]), 0)], True)
    assert np.all(np.isfinite(fit.numerators))
    assert np.all(np.isfinite(fit.slopes))


@pytest.mark.parametrize("likeness", [1.0, 1e-3, 1e-7])
def test_a_span_is_that_of_numpys_qr_however_alike_the_columns_are(likeness):
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((200, 5)) * [1.0, 1e-8, 1e6, 1.0, 1.0]
    columns[:, 4] = columns[:, 3] + likeness * rng.standard_normal(200)
    target = rng.standard_normal((200, 2))
    basis = np.linalg.qr(columns)[0]
    found = span(columns)
    np.testing.assert_allclose(found.basis.T @ found.basis, np.eye(5), atol=1e-13)
    np.testing.assert_allclose(found.basis @ found.basis.T, basis @ basis.T, atol=1e-14 / likeness + 1e-13)
    np.testing.assert_allclose(found.remove(target), target - basis @ (basis.T @ target), atol=1e-14 / likeness + 1e-13)
    fitted = columns @ found.coefficients(target)
    np.testing.assert_allclose(fitted, basis @ (basis.T @ target), atol=1e-14 / likeness + 1e-12)


@pytest.mark.parametrize("alike", [0.0, 1e-15])
def test_columns_that_rounding_alone_tells_apart_span_one_direction(alike):
    rng = np.random.default_rng(0)
    column = rng.standard_normal(100)
    found = span(np.column_stack([column, column * (1 + alike), rng.standard_normal(100), np.zeros(100)]))
    assert found.basis.shape == (100, 2)
    target = rng.standard_normal(100)
    assert np.abs(found.coefficients(target)).max() < 1.0
