"""Operators before a plant that is known are named with their levels, and none before a linear one."""

import numpy as np
import pytest

from archerfish2.identification.axis.fit import fit_axis
from archerfish2.identification.axis.hammerstein import nonlinearity
from archerfish2.identification.simulation import simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

PERIOD = 0.005


def followed(command, low, high):
    places = [command[0]]
    for wanted in command[1:]:
        places.append(np.clip(places[-1], *sorted((wanted + low, wanted + high))))
    return np.array(places)


def slewed(command, most):
    places = [command[0]]
    for wanted in command[1:]:
        places.append(places[-1] + np.clip(wanted - places[-1], -most, most))
    return np.array(places)


OPERATORS = {
    "saturation": (0.5, lambda u, level: np.clip(u, -level, level)),
    "dead zone": (0.2, lambda u, level: np.sign(u) * np.maximum(np.abs(u) - level, 0)),
    "hysteresis": (0.1, lambda u, level: followed(u, -level, level)),
    "rate limit": (8.0, lambda u, level: slewed(u, level * PERIOD)),
}


def best(operator, seed=0):
    levels = np.repeat(np.append(0.0, np.random.default_rng(seed).uniform(-1, 1, 40)), 50)
    clean = simulate(PlantRecord.second_order(5, 0.6, 2 * PERIOD, PERIOD), operator(levels)[:, None])
    noise = 0.01 * clean.std() * np.random.default_rng(9).normal(size=clean.shape)
    log = Recording.from_arrays(levels, clean + noise, PERIOD)
    return nonlinearity(fit_axis([log], 2), [log])


@pytest.mark.parametrize("name", OPERATORS)
def test_a_nonlinearity_is_named_with_its_level(name):
    level, operator = OPERATORS[name]
    found = best(lambda command: operator(command, level))
    assert found.name == name
    assert found.level == pytest.approx(level, rel=0.3)
    assert found.gained > 100
    assert found.gained_points > 0.2
    assert found.residual_share < 0.7
    if name == "saturation":  # at the largest command the axis goes half as far as its gain says
        assert 0.6 < found.gain_ratio < 0.9
        assert found.agreement_percent < 90


def test_a_linear_axis_has_none():
    assert [best(lambda command: command, seed) for seed in range(3)] == [None] * 3
