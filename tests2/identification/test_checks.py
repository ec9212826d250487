"""Findings about inputs and outputs: on axes that are known, sound and with one fault each."""

import numpy as np
import pytest
from scipy import signal

from archerfish2.identification.axis.checks import exchanged_columns, log_findings, plant_findings
from archerfish2.identification.axis.fit import fit_axis
from archerfish2.identification.simulation import simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

PLANT = PlantRecord.second_order(5, 0.6, 0.02, 0.01)
TIME = 0.01 * np.arange(1500)
INPUTS = {
    "noise": np.random.default_rng(0).normal(size=1500),
    "levels": np.random.default_rng(1).normal(size=30).repeat(50),
    "sweep": signal.chirp(TIME, 0.2, 15, 20),
    "early step": np.minimum(np.arange(1500) // 10, 1).astype(float),
}


def recorded(u, noise=0.02, gain=1.0, seed=0, plant=PLANT):
    y = gain * simulate(plant, u[:, None])
    return Recording.from_arrays(u, y + noise * y.std() * np.random.default_rng(seed).normal(size=y.shape), 0.01)


def codes(findings):
    return [(each.code, each.severity) for each in findings]


@pytest.mark.parametrize("name", INPUTS)
def test_a_sound_log_gives_no_findings_even_under_noise_as_large_as_the_response(name):
    logs = [recorded(INPUTS[name]), recorded(INPUTS[name], 1.0)]
    assert log_findings(logs, 1) == []
    late = PLANT.replace(delay_samples=60)
    assert log_findings([recorded(INPUTS[name], plant=late)], 1) == []
    assert plant_findings(PLANT, logs[0]) == []


@pytest.mark.parametrize("name", INPUTS)
def test_an_output_that_does_not_respond_is_found(name):
    # 30 logs of noise, coloured as often as white, at a false alarm of 1e-4 each.
    for seed in range(30):
        noise = signal.lfilter([1], [1, -0.95 * (seed % 2)], np.random.default_rng(9 + seed).normal(size=1500))
        log = Recording.from_arrays(INPUTS[name], noise, 0.01)
        assert codes(log_findings([log], 1)) == [("no-response", "refused")]
    assert codes(log_findings([log, recorded(INPUTS[name])], 1)) == [("no-response", "warning")]


def test_a_log_that_is_too_short_and_one_sine_alone_are_found():
    short = recorded(INPUTS["noise"][:50])
    assert codes(log_findings([short], 4)) == [("too-short", "refused")]
    assert log_findings([short], 1) == []
    sines = [recorded(np.sin(2 * np.pi * hz * TIME) + 3) for hz in (3.3, 3.31, 4)]
    (found,) = log_findings(sines[:2], 2)
    assert codes([found]) == [("single-sine", "refused")]
    assert "3.3" in found.message
    assert log_findings([sines[0], sines[2]], 2) == []


def test_inputs_that_are_one_are_found():
    u, v = INPUTS["noise"], INPUTS["sweep"]
    logs = [
        Recording.from_arrays(np.stack([u, v, w], 1), recorded(u).outputs, 0.01, input_names=("u", "v", "w"))
        for w in (1e3 * u - v, INPUTS["levels"])
    ]
    assert codes(log_findings(logs[:1], 1)) == [("dependent-inputs", "refused")]
    assert log_findings(logs, 1) == log_findings(logs[1:], 1) == []


@pytest.mark.parametrize(
    ("gain", "expected"), [(57.3, "degrees-radians"), (1 / 57.3, "degrees-radians"), (-1.0, "sign-flip")]
)
def test_units_and_signs_are_seen_in_the_gain(gain, expected):
    plant = PLANT.replace(B=gain * PLANT.B)
    assert codes(plant_findings(plant, recorded(INPUTS["levels"], gain=gain))) == [(expected, "warning")]
    assert plant_findings(plant.replace(B=3 * plant.B), recorded(INPUTS["levels"], gain=3 * gain)) == []


@pytest.mark.parametrize("name", ["noise", "levels", "sweep"])
def test_exchanged_columns_are_found_by_trying(name):
    def fit(recordings, order):
        return fit_axis(recordings, order).plant

    log = recorded(INPUTS[name])
    wrong = Recording.from_arrays(log.outputs, log.inputs, 0.01, input_names=("y",), output_names=("u",))
    found = exchanged_columns(fit([wrong], 2), wrong, [wrong], fit)
    assert codes([found]) == [("swapped", "warning")]
    assert found.remedy == 'take "u" as the input and "y" as the output'
    assert exchanged_columns(fit([log], 2), log, [log], fit) is None
