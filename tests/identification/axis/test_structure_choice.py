import numpy as np
import pytest

from archerfish.identification.axis.pole_refinement import Problem, refine_poles
from archerfish.identification.axis.spectra import row_count, spectrum
from archerfish.identification.axis.structure_choice import Structure


@pytest.fixture
def structure(second_order, record, white):
    def fitted(delay, feedthrough):
        plant = second_order(8.0, 0.5, 2, 5e-3)
        problem = Problem([spectrum(record(plant, white[:, 0], noise=0.1), delay)], feedthrough)
        pole = np.linalg.eigvals(plant.A)[0]
        return Structure(delay, problem, refine_poles((np.array([-2 * pole.real, abs(pole) ** 2]),), problem))

    return fitted


def test_the_criterion_is_twice_the_log_likelihood_and_the_price_of_a_parameter(structure):
    with_it, without = structure(2, True), structure(2, False)
    rows = row_count(without.problem.experiments)
    gained = rows * np.log(without.refinement.cost / with_it.refinement.cost)
    assert 0 <= gained < np.log(rows)  # the feedthrough is not there
    assert with_it.criterion() - without.criterion() == pytest.approx(np.log(rows) - gained)


def test_the_true_delay_has_the_least_criterion(structure):
    assert min(range(5), key=lambda delay: structure(delay, False).criterion()) == 2


def test_coloured_residuals_count_as_fewer(structure):
    right, wrong = structure(2, False), structure(4, False)
    white = wrong.criterion() - right.criterion()
    assert wrong.criterion(4.0) - right.criterion(4.0) == pytest.approx(white / 4)
    assert wrong.criterion(0.5) - right.criterion(0.5) == pytest.approx(white)
