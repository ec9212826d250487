"""Findings about inputs and outputs, and operators before a plant: on axes that are known, with one fault each."""

import numpy as np
import pytest
from scipy import signal

from archerfish.errors import InputError
from archerfish.identification.axis.checks import check_logs, exchanged_columns, plant_findings, silent_logs
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.nonlinearity import nonlinearity
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording
from archerfish.records.plant import PlantRecord

PLANT = PlantRecord.second_order(5, 0.6, 0.02, 0.01)
INPUTS = {
    "noise": np.random.default_rng(0).normal(size=1500),
    "levels": np.random.default_rng(1).normal(size=30).repeat(50),
    "sweep": signal.chirp(0.01 * np.arange(1500), 0.2, 15, 20),
    "early step": np.minimum(np.arange(1500) // 10, 1).astype(float),
}


def recorded(u, noise=0.02, plant=PLANT, seed=0):
    y = simulate(plant, u[:, None])
    y += noise * y.std() * np.random.default_rng(seed).normal(size=y.shape)
    return Recording.from_arrays(u, y, plant.sample_period_s)


def codes(findings):
    return [(each.code, each.severity) for each in findings]


def refusal(check, *arguments):
    try:
        check(*arguments)
    except InputError as error:
        return error.code
    return ""


@pytest.mark.parametrize("logs", [5, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", INPUTS)
def test_a_response_is_found_even_late_or_in_noise_as_large_and_its_absence_too(name, logs):
    late = PLANT.replace(delay_samples=170)  # an eighth of the log is searched
    assert silent_logs([recorded(INPUTS[name], 1.0), recorded(INPUTS[name], plant=late)]) == []
    for seed in range(logs):  # of noise, coloured as often as white, at a false alarm of 1e-4 each
        noise = signal.lfilter([1], [1, -0.95 * (seed % 2)], np.random.default_rng(9 + seed).normal(size=1500))
        log = Recording.from_arrays(INPUTS[name], noise, 0.01)
        assert codes(silent_logs([log])) == [("no-response", "warning")]
    assert codes(silent_logs([log, recorded(INPUTS[name])])) == [("no-response", "warning")]


def test_a_response_after_a_long_rest_is_found_and_a_still_log_has_none():
    u = np.append(np.zeros(21_000), INPUTS["levels"])
    still = Recording.from_arrays(np.full(1500, 0.1), np.random.default_rng(0).normal(size=1500), 0.01)
    assert silent_logs([recorded(u, 1.0)]) == []
    assert codes(silent_logs([still, recorded(INPUTS["noise"])])) == [("no-response", "warning")]
    found = fit_axis([recorded(INPUTS["noise"], plant=PLANT.replace(delay_samples=0))], 2)
    assert exchanged_columns(found, recorded(INPUTS["noise"]), [recorded(INPUTS["noise"]), still]) == []
    assert exchanged_columns(found, still, [still]) == []


def test_logs_that_are_too_short_of_one_sine_or_of_inputs_that_are_one_are_found():
    u, v = INPUTS["noise"], INPUTS["sweep"]
    sines = [recorded(np.sin(0.02 * np.pi * hz * np.arange(1500)) + 3) for hz in (3.3, 3.31, 4)]
    three = [np.stack([u, v, w], 1) for w in (1e3 * u - v, INPUTS["levels"])]
    alike, other = (Recording.from_arrays(each, u, 0.01, input_names=("u", "v", "w")) for each in three)
    short, enough = recorded(u[:50]), recorded(u[:150])
    found = [refusal(check_logs, bad, 4) for bad in ([short], sines[:2], [alike])]
    assert found == ["too-short", "single-sine", "dependent-inputs"]
    assert [refusal(check_logs, good, 4) for good in ([enough], sines[::2], [alike, other])] == ["", "", ""]


def test_units_and_signs_are_seen_in_the_gain():
    gains = {57.3: ["degrees-radians"], 1 / 57.3: ["degrees-radians"], -1.0: ["sign-flip"], 1.0: [], -3.0: []}
    for gain, expected in gains.items():
        found = plant_findings(PLANT.replace(B=gain * PLANT.B), recorded(INPUTS["levels"]))
        assert codes(found) == [(code, "warning") for code in expected]


@pytest.mark.parametrize("name", ["noise", "sweep"])
def test_exchanged_columns_are_found_by_trying(name):
    log = recorded(INPUTS[name])
    wrong = Recording.from_arrays(log.outputs, log.inputs, 0.01, input_names=("y",), output_names=("u",))
    (found,) = exchanged_columns(fit_axis([wrong], 2), wrong, [wrong])
    assert (found.code, found.remedy) == ("swapped", 'take "u" as the input and "y" as the output')
    assert exchanged_columns(fit_axis([log], 2), log, [log]) == []


def test_columns_are_not_called_exchanged_where_noise_spoils_either_direction():
    log = recorded(INPUTS["levels"], 0.8)  # of which a plant explains 39 %, and exchanged 50 %
    assert exchanged_columns(fit_axis([log], 2), log, [log]) == []


def followed(command, move):
    places = [command[0]]
    for wanted in command[1:]:
        places.append(move(places[-1], wanted))
    return np.array(places)


OPERATORS = {
    "saturation": (0.5, lambda u: np.clip(u, -0.5, 0.5)),
    "dead zone": (0.2, lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.2, 0)),
    "hysteresis": (0.1, lambda u: followed(u, lambda y, x: np.clip(y, x - 0.1, x + 0.1))),
    "rate limit": (8.0, lambda u: followed(u, lambda y, x: y + np.clip(x - y, -0.04, 0.04))),
    "none": (0.0, lambda u: u),
}


@pytest.mark.parametrize("name", OPERATORS)
def test_a_nonlinearity_is_named_with_its_level_and_a_linear_axis_has_none(name):
    (level, operator), plant = OPERATORS[name], PlantRecord.second_order(5, 0.6, 0.01, 0.005)
    u = np.repeat(np.append(0.0, np.random.default_rng(0).uniform(-1, 1, 40)), 50)
    u = np.append(np.zeros(9000 * (name == "saturation")), u)
    log = Recording.from_arrays(u, recorded(operator(u), 0.01, plant, 9).outputs, 0.005)
    found = nonlinearity(fit_axis([log], 2), [log])
    if name == "none":
        assert found is None
        return
    assert (found.name, found.level) == (name, pytest.approx(level, rel=0.3))
    assert (found.gained > 100, found.residual_share < 0.7) == (True, True)
    if name == "saturation":  # at the largest command the axis goes half as far as its gain says
        assert 0.6 < found.gain_ratio < 0.9
