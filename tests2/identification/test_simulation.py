"""Plants and their draws in motion and over the frequency, and the balanced realisation: against SciPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg, signal

from archerfish2.identification.simulation import balanced, simulate
from archerfish2.records.plant import PlantRecord

A = np.array([[0.9, 0.2, 0.1, 0.0], [-0.2, 0.9, 0.0, 0.1], [0.0, 0.0, 0.7, 0.2], [0.0, 0.0, 0.0, 0.3]])
B = np.array([[0.1, -0.2], [0.2, 0.3], [-0.1, 0.5], [0.4, 0.1]])
C, D = np.array([[1.0, 0.5, -0.3, 0.2]]), np.array([[0.3, 0.0]])


def uncertain():
    """Return a plant of two inputs with five draws around it, and each draw as a plant of its own."""
    rng, plant = np.random.default_rng(4), PlantRecord.from_state_space(A, B, C, D, 0.01, 2)
    draws = {n: getattr(plant, n) + 0.01 * rng.normal(size=(5, *getattr(plant, n).shape)) for n in "ABCD"}
    late = [2, 0, 7, 3, 2]
    alone = [plant.replace(delay_samples=late[k], **{n: draws[n][k] for n in draws}) for k in range(5)]
    return plant.replace(draws=draws, draw_delays=np.array(late)), alone


@pytest.mark.parametrize("count", [1, 2, 99, 2000])
def test_draws_move_as_plants_of_their_own(count):
    plant, alone = uncertain()
    u = np.random.default_rng(3).normal(size=(count, 2))
    found = simulate(plant, u, draws=True)
    for each, y in zip(alone, found, strict=True):
        late = u[np.maximum(np.arange(count) - each.delay_samples, 0)]
        assert_allclose(y, signal.dlsim((each.A, each.B, each.C, each.D, 1.0), late)[1], atol=1e-9)
        assert_allclose(simulate(each, u), y, atol=1e-9)
    assert simulate(alone[0], u, draws=True).shape == (0, count, 1)


def test_the_balanced_realisation_keeps_the_responses_and_has_equal_diagonal_gramians():
    plant, _ = uncertain()
    found, u = balanced(plant), np.random.default_rng(3).normal(size=(300, 2))
    assert_allclose(simulate(found, u), simulate(plant, u), atol=1e-9)
    assert_allclose(simulate(found, u, draws=True), simulate(plant, u, draws=True), atol=1e-9)
    own = [found.A, found.B, found.C], *zip(*(found.draws[name] for name in "ABC"), strict=True)
    for a, b, c in own:
        reach, observe = linalg.solve_discrete_lyapunov(a, b @ b.T), linalg.solve_discrete_lyapunov(a.T, c.T @ c)
        assert_allclose(reach, np.diag(np.diag(observe)), atol=1e-9 * reach.max())
        assert_allclose(observe, np.diag(np.diag(reach)), atol=1e-9 * reach.max())


def test_a_plant_that_is_not_minimal_is_left_as_it_is():
    plant = PlantRecord.from_state_space(np.diag([0.5, 0.4]), [[1.0], [0.0]], np.ones((1, 2)), 0, 0.01)
    assert_allclose(balanced(plant).A, plant.A)
    assert balanced(plant).draws == {}
