"""Feedback is told in recorded loops, and not in open loops whose plant misses something."""

import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.doctor.relation import relation_findings
from archerfish.identification.validation.free_run import common_offset, free_run
from archerfish.identification.validation.residual_tests import residual_tests
from archerfish.records.csv_table import read_csv_columns
from archerfish.records.recording import make_recording

PERIOD, COUNT = 1e-3, 6000
TIME = PERIOD * np.arange(COUNT)


def sweep(size, low=2.0, high=50.0, time=TIME):
    return size * np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * time[-1])))


def position_loop(command, *, limit=np.inf, friction=0.0, period=PERIOD, steps=4):
    """Answer of an axis held to a command three samples late, in angle; limit and friction are accelerations."""
    angle, rate, angles = 0.0, 0.0, []
    for wanted in np.concatenate([np.zeros(3), command[:-3]]):
        angles.append(angle)
        for _ in range(steps):
            push = np.clip(60.0**2 * (wanted - angle) - 60.0 * rate, -limit, limit)
            rate += period / steps * (push - friction * np.tanh(rate / 1e-3))
            angle += period / steps * rate
    return np.array(angles)


def resonance(signal, hz, share):
    pole = np.exp(-0.015 + 2j * np.pi * hz * PERIOD)
    scale = 1 - 2 * pole.real + abs(pole) ** 2
    return signal + share * lfilter([0, 0, scale], [1, -2 * pole.real, abs(pole) ** 2], signal)


def fast_sweep_that_saturates():
    time = 5e-3 * np.arange(3000)
    command = sweep(0.05, 0.2, 20.0, time)
    return command, position_loop(command, limit=20.0, period=5e-3, steps=20), 4


def slow_sweep(order, size=0.02, **faults):
    command = sweep(size)
    return command, position_loop(command, **faults), order


def too_low_an_order():
    command = sweep(0.02)
    return command, resonance(resonance(position_loop(command), 12.0, 0.2), 30.0, 0.3), 2


OPEN_LOOPS = {
    "saturation": lambda: slow_sweep(4, limit=67.0),
    "heavy saturation": lambda: slow_sweep(4, size=0.08, limit=20.0),
    "saturation at 200 Hz": fast_sweep_that_saturates,
    "Coulomb friction": lambda: slow_sweep(4, friction=5.0),
    "both": lambda: slow_sweep(4, limit=67.0, friction=3.0),
    "too low an order": too_low_an_order,
}


def judged(recording, order):
    result = identify_axis([recording], order)
    own = common_offset(result.plant, [recording], drift=result.drift)
    run = free_run(result.plant, recording, own, drift=result.drift)
    return residual_tests((recording.outputs - run.simulated)[:, 0], recording.inputs)


@pytest.mark.parametrize("noise", [1e-5, 1e-4])
@pytest.mark.parametrize("fault", OPEN_LOOPS)
def test_a_model_error_under_a_sweep_is_no_feedback(fault, noise):
    command, angle, order = OPEN_LOOPS[fault]()
    measured = angle + noise * np.random.default_rng(0).standard_normal(angle.size)
    recording = make_recording(command, measured, PERIOD if command.size == COUNT else 5e-3)
    assert not judged(recording, order).feedback
    assert "feedback" not in {each.code for each in relation_findings(recording, 20)}


@pytest.mark.parametrize("name", ["sinal1_semi_estatica", "sinal2_degraus", "sinal3_swept_sine", "sinal4_multiseno"])
def test_a_recorded_loop_is_told_by_its_actuator_and_not_by_its_set_point(shared_data, name):
    path = shared_data / "identification" / "quarter_drone" / f"{name}_malha_fechada.csv"
    table = read_csv_columns(path, ("Tempo_s", "Referencia", "Saida_y", "Controle_u"))
    for column, expected in (("Referencia", False), ("Controle_u", True)):
        signals = [np.asarray(table.columns[each]) for each in (column, "Saida_y")]
        recording = make_recording(*signals, 0.01)
        assert judged(recording, 4).feedback is expected
        assert ("feedback" in {each.code for each in relation_findings(recording, 20)}) is expected
