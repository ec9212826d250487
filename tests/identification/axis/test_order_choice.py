from dataclasses import replace

import numpy as np
import pytest

from archerfish.identification.axis.order_choice import USUAL_ORDERS, choose_order
from archerfish.identification.excitation.signals import linear_sweep
from archerfish.records.plant import dc_gain

PERIOD = 1e-3


@pytest.mark.parametrize("delay", [0, 7, 60])
def test_the_order_and_the_delay_of_a_noisy_sweep_are_found_together(second_order, record, delay):
    log = record(second_order(6.0, 0.5, delay), linear_sweep(4.0, PERIOD, high_hz=30.0), noise=0.01)
    result = choose_order([log], orders=USUAL_ORDERS).result
    assert len(result.plant.A) == 2
    assert abs(result.plant.delay_samples - delay) <= 1
    assert result.delay_range[0] <= delay <= result.delay_range[1]
    assert result.delay_certainty() > 0.65
    assert sum(result.delay_weights.values()) == pytest.approx(1.0)


def test_orders_far_from_the_best_are_left_out(second_order, record):
    log = record(second_order(6.0, 0.5, 2), linear_sweep(4.0, PERIOD, high_hz=30.0), noise=0.01)
    trials = choose_order([log], orders=USUAL_ORDERS).trials
    assert [each.order for each in trials] == [1, 2, 3, 4]
    assert min(trials, key=lambda each: each.criterion).order == 2


@pytest.mark.parametrize("drift", ["ramp", "wander"])
def test_a_drifting_output_costs_neither_order_nor_gain(second_order, record, drift):
    log = record(second_order(6.0, 0.5, 5), linear_sweep(4.0, PERIOD, high_hz=30.0), noise=0.01)
    time = np.linspace(-1, 1, len(log))
    away = 2.0 * time if drift == "ramp" else 0.3 * np.sin(2.0 * time + 0.3)
    result = choose_order([replace(log, outputs=log.outputs + away[:, None])], orders=USUAL_ORDERS).result
    assert result.drift > 0
    ((low, high),) = result.dc_gain_interval
    assert low <= 1.0 <= high
    assert dc_gain(result.plant).item() == pytest.approx(1.0, abs=0.02 if drift == "ramp" else 0.2)
    assert result.plant.delay_samples == pytest.approx(5, abs=1)
    assert min(result.fit_percent) > 95
