import numpy as np
import pytest

from archerfish.identification.axis.gimbal import search_axis
from archerfish.identification.axis.nonlinearity import nonlinear_fits
from archerfish.identification.axis.state_space import simulate
from archerfish.records.recording import make_recording

PERIOD = 0.005


def levels(seed=0, count=40, hold=50):
    rng = np.random.default_rng(seed)
    return np.repeat(np.append(0.0, rng.uniform(-1, 1, count)), hold)


def play(command, half):
    place, found = 0.0, []
    for each in command:
        place = min(max(place, each - half), each + half)
        found.append(place)
    return np.array(found)


def slewed(command, most):
    place, found = 0.0, []
    for each in command:
        place += min(max(each - place, -most), most)
        found.append(place)
    return np.array(found)


OPERATORS = {
    "saturation": (0.5, lambda u, level: np.clip(u, -level, level)),
    "dead zone": (0.2, lambda u, level: np.sign(u) * np.maximum(np.abs(u) - level, 0)),
    "hysteresis": (0.1, play),
    "rate limit": (8.0, lambda u, level: slewed(u, level * PERIOD)),
}


def logged(second_order, change, seed=0):
    command = levels(seed)
    clean = simulate(second_order(5.0, 0.6, 2, PERIOD), change(command)[:, None])
    noise = 0.01 * clean.std() * np.random.default_rng(9).standard_normal(clean.shape)
    return make_recording(command, clean + noise, PERIOD)


def best(log):
    found = search_axis([log], 2).found
    return nonlinear_fits(found.ground, found.best)[0]


@pytest.mark.parametrize("name", OPERATORS)
def test_a_nonlinearity_is_named_with_its_level(second_order, name):
    level, operator = OPERATORS[name]
    fit = best(logged(second_order, lambda command: operator(command, level)))
    assert fit.name == name
    assert fit.level == pytest.approx(level, rel=0.3)
    assert fit.gained > 100
    assert fit.residual_share < 0.7


def test_a_linear_axis_has_none(second_order):
    for seed in range(3):
        found = search_axis([logged(second_order, lambda command: command, seed)], 2).found
        # The bar from which one is named is 15.
        assert all(each.gained < 15 for each in nonlinear_fits(found.ground, found.best))


def test_a_saturation_tells_how_wrong_the_linear_gain_is(second_order):
    fit = best(logged(second_order, lambda command: np.clip(command, -0.5, 0.5)))
    # At the largest command the axis goes half as far as its gain says, and the linear plant lies in between.
    assert 0.6 < fit.gain_ratio < 0.9
    assert fit.agreement_percent < 90
