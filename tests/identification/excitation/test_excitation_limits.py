import numpy as np
import pytest

from archerfish.identification.excitation.limits import (
    Budget,
    demand,
    excitation_budget,
    faded,
    fitted,
    sine_amplitude,
    slew_time,
    slewed,
)
from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits

BUDGET = Budget(0.3, 2.0, 60.0)
PERIOD = 1e-3


def test_demand_of_a_sine_is_that_of_calculus():
    time = np.arange(1000) * PERIOD
    asked = demand(0.1 + 0.02 * np.sin(2 * np.pi * 5 * time), PERIOD)
    assert (asked.low, asked.high) == (pytest.approx(0.08, abs=1e-5), pytest.approx(0.12, abs=1e-5))
    assert asked.rate == pytest.approx(0.02 * 2 * np.pi * 5, rel=1e-3)


def test_demand_sees_a_jump_at_either_end():
    assert demand(np.array([0.0, 0.0, 0.1]), 0.01).acceleration == pytest.approx(0.1 / 0.01**2)


def test_sines_keep_to_the_limit_that_binds_at_their_frequency():
    amplitude = sine_amplitude(np.array([0.01, 4.0, 50.0]), BUDGET)
    omega = 2 * np.pi * np.array([4.0, 50.0])
    assert amplitude[0] == pytest.approx(0.3, rel=1e-3)
    assert amplitude[2] == pytest.approx(60.0 / omega[1] ** 2, rel=1e-3)
    assert np.all(amplitude <= np.minimum(0.3, [0.3, *np.minimum(2.0 / omega, 60.0 / omega**2)]))


def test_a_fitted_signal_spends_one_limit_and_keeps_the_others():
    time = np.arange(2000) * PERIOD
    for frequency, name in ((0.5, "high"), (3.0, "rate"), (20.0, "acceleration")):
        window = faded(np.sin(2 * np.pi * frequency * time), 0.5, PERIOD)
        asked = demand(fitted(window, BUDGET, PERIOD), PERIOD)
        shares = {
            "high": max(-asked.low, asked.high) / 0.3,
            "rate": asked.rate / 2,
            "acceleration": asked.acceleration / 60,
        }
        assert max(shares, key=shares.__getitem__) == name
        assert shares[name] == pytest.approx(1.0)


@pytest.mark.parametrize("jump", [0.01, 0.2])
def test_a_slewed_jump_keeps_rate_and_acceleration_and_arrives(jump):
    signal = slewed(np.repeat([0.0, jump], 1000), slew_time(jump, BUDGET), PERIOD)
    asked = demand(signal, PERIOD)
    assert asked.rate <= BUDGET.rate * (1 + 1e-9)
    assert asked.acceleration <= BUDGET.acceleration * (1 + 1e-9)
    assert signal[-1] == pytest.approx(jump)
    assert np.all(np.diff(signal) >= -1e-15)
    # Even acceleration and braking are the quickest way; whole samples cost a little.
    assert max(asked.rate / BUDGET.rate, asked.acceleration / BUDGET.acceleration) > 0.85


def test_a_centre_outside_the_travel_or_a_senseless_share_is_refused():
    limits = AxisLimits(-0.4, 0.2, 10.0, 100.0)
    assert excitation_budget(limits, 0.1, 0.5) == (pytest.approx(0.05), 5.0, 50.0)
    with pytest.raises(InputError, match="inside the travel"):
        excitation_budget(limits, 0.3, 0.5)
    with pytest.raises(InputError, match="share"):
        excitation_budget(limits, 0.0, 1.5)
