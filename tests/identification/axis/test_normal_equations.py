import numpy as np
import pytest

from archerfish.identification.axis.modal_form import sections_from_poles
from archerfish.identification.axis.normal_equations import lay_out, solve, tangent
from archerfish.identification.axis.simulation_fit import Penalty, fit_linear_parameters
from archerfish.identification.axis.spectra import spectrum
from archerfish.records.recording import make_recording

EVEN = np.array([0.85 + 0.25j, 0.85 - 0.25j, 0.6, 0.2])
ODD = np.array([0.8 + 0.3j, 0.8 - 0.3j, 0.5])
ONE = np.array([0.7])


def unrelated(counts, inputs, outputs):
    """Spectra of logs without any relation between input and output: every parameter matters."""
    rng = np.random.default_rng(sum(counts))
    names = [f"u{index}" for index in range(inputs)], [f"y{index}" for index in range(outputs)]
    logs = [
        make_recording(
            rng.standard_normal((count, inputs)),
            rng.standard_normal((count, outputs)),
            0.01,
            input_names=names[0],
            output_names=names[1],
        )
        for count in counts
    ]
    return [spectrum(each, 1) for each in logs]


def wishes(inputs, outputs):
    """Penalty on three points of each transfer function, with targets."""
    rng = np.random.default_rng(1)
    rows = tuple(rng.standard_normal((4, 6)) for _ in range(inputs))
    targets = tuple(rng.standard_normal((4, outputs)) for _ in range(inputs))
    return Penalty(np.array([1.0, np.exp(-0.5j), 0.9 * np.exp(-2j)]), rows, targets)


@pytest.mark.parametrize("counts", [(120,), (121,), (80, 61, 44), (7000,)])
@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (2, 1), (1, 2)])
@pytest.mark.parametrize("poles", [EVEN, ODD, ONE])
@pytest.mark.parametrize("penalised", [False, True])
@pytest.mark.parametrize("feedthrough", [False, True])
def test_they_give_what_the_orthogonal_projection_gives(counts, inputs, outputs, poles, penalised, feedthrough):
    arguments = unrelated(counts, inputs, outputs), feedthrough, wishes(inputs, outputs) if penalised else None
    sections, bench = sections_from_poles(poles), lay_out(*arguments)
    expected, found = fit_linear_parameters(sections, *arguments), solve(sections, bench)
    assert found.solved  # not by the projection itself
    assert found.fit.misfit == pytest.approx(expected.misfit, rel=1e-12)
    for name in ("numerators", "feedthrough", "residuals"):
        np.testing.assert_allclose(getattr(found.fit, name), getattr(expected, name), atol=1e-11)
    curvature, gradient = tangent(found, bench)
    np.testing.assert_allclose(curvature, expected.slopes.T @ expected.slopes, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(gradient, expected.slopes.T @ expected.residuals, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("alike", [0.0, 1e-9])
def test_poles_that_are_all_but_equal_are_left_to_the_projection(alike):
    bench = lay_out(unrelated((200,), 1, 1), True)
    found = solve((np.array([-1.0, 0.25]), np.array([-1.0, 0.25 + alike])), bench)
    assert not found.solved
    assert np.all(np.isfinite(found.fit.numerators))
    assert all(np.all(np.isfinite(each)) for each in tangent(found, bench))


def test_a_log_without_noise_is_left_to_the_projection(white, resonant_plant, record):
    bench = lay_out([spectrum(record(resonant_plant(), white[:, 0], initial_state=np.ones(4)), 0)], True)
    found = solve(sections_from_poles(np.linalg.eigvals(resonant_plant().A)), bench)
    assert not found.solved
    assert found.fit.misfit < 1e-24 * bench.energy
