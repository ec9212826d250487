from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from archerfish.identification.axis.gimbal import search_axis, weight_within
from archerfish.identification.axis.order_choice import USUAL_ORDERS, choose_order
from archerfish.identification.axis.structure_evidence import gather, neighbours, pursued
from archerfish.identification.excitation.signals import linear_sweep
from archerfish.records.plant import PlantRecord, dc_gain
from archerfish.records.recording import make_recording

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


def test_poles_built_anew_at_shorter_delays_find_the_lag_that_a_delay_has_replaced(record):
    plant = servo(6.0, 0.6, lag_hz=15.0, delay=13, period=0.002)
    time = 0.002 * np.arange(6000)
    sines = sum(np.sin(2 * np.pi * each * time + each**2) for each in np.geomspace(0.3, 24.0, 20))
    search = search_axis([record(plant, sines / np.abs(sines).max(), noise=0.01)], 3, max_delay=40)
    late = search.found.best._replace(delay=21)
    evidence = gather([search.found.best, late], search.found.ground)
    found, criterion = pursued(late, 3, [21, 19, 16, 11], evidence)
    assert criterion < evidence.criterion(late) - 100
    beside, criterion = min(neighbours(found, evidence, 40), key=lambda each: each[1])
    assert criterion < evidence.criterion(search.found.best) + 10
    assert beside.delay == pytest.approx(13, abs=2)


def test_a_higher_order_is_taken_where_it_lasts(shared_data):
    # A real dryer, the half that is fitted: what the likeliest order leaves is not noise alone.
    u, y = np.loadtxt(shared_data / "identification" / "rgp" / "dryer.dat")[:500].T
    choice = choose_order([make_recording(u - u.mean(), y - y.mean(), 0.08)], orders=USUAL_ORDERS)
    likeliest = min(choice.trials, key=lambda each: each.criterion).order
    assert len(choice.result.plant.A) > likeliest


def test_the_estimate_is_the_delay_that_is_likeliest_within_a_sample(second_order, record):
    log = record(second_order(6.0, 0.5, 4), linear_sweep(1.0, PERIOD, high_hz=20.0), noise=0.1)
    result = choose_order([log], orders=USUAL_ORDERS).result
    weights = result.delay_weights
    here = result.plant.delay_samples - bool(result.structures[0].known.feedthrough)
    assert weight_within(weights, here) >= 0.9 * max(weight_within(weights, each) for each in weights)


def servo(bandwidth_hz, damping, *, lag_hz, delay, period):
    frequency, lag = 2 * np.pi * bandwidth_hz, 2 * np.pi * lag_hz
    A = np.array([[0.0, 1.0, 0.0], [-(frequency**2), -2 * damping * frequency, frequency**2], [0.0, 0.0, -lag]])
    B = np.array([[0.0], [0.0], [lag]])
    A_held, B_held, C, D, _ = cont2discrete((A, B, np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1))), period)
    return PlantRecord(A_held, B_held, C, D, delay, period, "test", ("u",), ("y",))
