import numpy as np
import pytest

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.records.plant import PlantRecord

PERIOD = 1e-3


def integrated(plant):
    """The same axis with the integral of its output as its output."""
    A = np.block([[plant.A, np.zeros((2, 1))], [PERIOD * plant.C, np.ones((1, 1))]])
    B = np.vstack([plant.B, [[0.0]]])
    return PlantRecord(A, B, np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 1)), plant.delay_samples, PERIOD)


SIGNALS = {
    "sweep": linear_sweep(5.0, PERIOD),
    "steps": np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 60), 50),
    "step": step(1.0, PERIOD),
}


def told(recording, order=4):
    return [each for each in identify_axis([recording], order).remarks if "integrates" in each]


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("signal", SIGNALS)
def test_an_axis_that_integrates_is_said_to(second_order, record, signal, noise):
    (remark,) = told(record(integrated(second_order(8.0, 0.5, 3)), SIGNALS[signal], noise=noise))
    assert "name the rate of the output as the output" in remark


@pytest.mark.parametrize("signal", SIGNALS)
def test_an_axis_that_comes_to_rest_is_not(second_order, record, signal):
    # The rule asks for a pole within four deviations of 1 that makes half of the response at the lowest excited
    # frequency; of 120 noisy logs of axes that come to rest none was called an integrator.
    for seed in range(3):
        assert not told(record(second_order(8.0, 0.5, 3), SIGNALS[signal], noise=0.05, seed=seed))


def test_a_slow_axis_is_told_from_one_that_integrates(record):
    # A time constant of 3 s, three times as long as the step is seen.
    pole = np.exp(-PERIOD / 3.0)
    slow = PlantRecord(np.array([[pole]]), np.array([[1 - pole]]), np.eye(1), np.zeros((1, 1)), 2, PERIOD)
    assert not told(record(slow, SIGNALS["step"], noise=0.02))


def test_a_drifting_encoder_does_not_make_an_integrator(second_order, record):
    recording = record(second_order(8.0, 0.5, 3), SIGNALS["sweep"], noise=0.02)
    drift = 0.003 * np.cumsum(np.random.default_rng(1).standard_normal(recording.outputs.shape), axis=0)
    recording.outputs[:] += drift
    assert not told(recording)


def test_first_order_integrators_are_told_too(record):
    plant = PlantRecord(np.eye(1), np.full((1, 1), PERIOD), np.eye(1), np.zeros((1, 1)), 1, PERIOD)
    assert told(record(plant, SIGNALS["steps"], noise=0.02), order=1)
