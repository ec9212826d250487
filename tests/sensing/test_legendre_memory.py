import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from numpy.testing import assert_allclose
from scipy.integrate import quad

from archerfish.sensing.legendre_memory import constant_history, legendre_matrices, with_sample

ORDER, WINDOW, PERIOD = 12, 1.0, 0.02


def remembered(signal, start: float, end: float) -> np.ndarray:
    """Coefficients after a signal sampled at each period, its first value held for ever before."""
    transition, push = legendre_matrices(ORDER, WINDOW, PERIOD)
    memory = constant_history(np.asarray(signal(start)), push)
    for step in range(round((end - start) / PERIOD)):
        memory = with_sample(transition, push, memory, np.asarray(signal(start + step * PERIOD)))
    return memory


def history(memory: np.ndarray, ago: np.ndarray) -> np.ndarray:
    """The signal `ago` seconds back, as the definition has it."""
    return legval(2.0 * ago / WINDOW - 1.0, memory)


@pytest.mark.parametrize(
    ("signal", "tolerance"),
    [
        (lambda time: 2.0 * time - 0.7, 0.03),
        (lambda time: np.sin(5.0 * time), 0.08),
        (lambda time: time**2, 0.05),
    ],
)
def test_the_last_second_can_be_read_off(signal, tolerance) -> None:
    memory = remembered(signal, 0.0, 3.0)
    ago = np.linspace(0.05, 0.95, 91)
    # Each sample is held for a period: on average the signal is seen half a period late.
    assert_allclose(history(memory, ago), signal(3.0 - ago - PERIOD / 2), atol=tolerance)


def test_what_is_older_than_the_window_is_forgotten() -> None:
    transition, push = legendre_matrices(ORDER, WINDOW, PERIOD)
    memory = constant_history(np.asarray(5.0), push)
    for _ in range(300):
        memory = with_sample(transition, push, memory, np.asarray(0.0))
    assert_allclose(memory, 0.0, atol=1e-6)


def test_a_constant_history_stays() -> None:
    transition, push = legendre_matrices(ORDER, WINDOW, PERIOD)
    memory = constant_history(np.asarray(0.7), push)
    assert_allclose(history(memory, np.linspace(0, 1, 7)), 0.7)
    assert_allclose(with_sample(transition, push, memory, np.asarray(0.7)), memory, atol=1e-10)


def test_short_steps_approach_the_projection_of_the_history() -> None:
    # The first coefficients are the integrals of the history against the polynomials, for a signal that a few carry.
    transition, push = legendre_matrices(ORDER, WINDOW, 0.001)
    signal, memory = (lambda time: np.sin(3.0 * time)), np.zeros(ORDER)
    for step in range(3000):
        memory = with_sample(transition, push, memory, np.asarray(signal(0.001 * step)))
    for degree in range(4):
        unit = np.eye(ORDER)[degree]
        projection, _ = quad(lambda share, unit=unit: signal(3.0 - share) * legval(2.0 * share - 1.0, unit), 0.0, 1.0)
        assert memory[degree] == pytest.approx((2 * degree + 1) * projection, abs=4e-3)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    samples = np.random.default_rng(73).normal(size=(3, *shape))

    def everything(matrices, samples):
        memory = constant_history(samples[0], matrices[1])
        for sample in samples[1:]:
            memory = with_sample(*matrices, memory, sample)
        return memory

    memory = agree_in_jax(everything, legendre_matrices(ORDER, WINDOW, PERIOD), samples, rtol=1e-4, atol=1e-4)
    assert memory.shape == (*shape, ORDER)
