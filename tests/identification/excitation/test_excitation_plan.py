import numpy as np
import pytest

from archerfish.identification.excitation.plan import ExcitationSettings, plan_logs
from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits

LIMITS = AxisLimits(-0.44, 0.17, max_rate=10.0, max_acceleration=80.0)
CENTRE = -0.1


@pytest.mark.parametrize("kind", ["sweep", "multisine", "prbs", "step"])
@pytest.mark.parametrize("amplitude", [None, 0.01])
def test_every_command_keeps_every_limit_and_rests_at_the_centre(kind, amplitude):
    settings = ExcitationSettings(duration_s=6.0, amplitude=amplitude, slew_steps=True, step=0.1)
    for log in plan_logs((kind,), settings, LIMITS, CENTRE):
        command = np.concatenate([[CENTRE] * 2, log.command, [CENTRE] * 2])
        rate = np.diff(command) / 1e-3
        assert LIMITS.low < command.min() < CENTRE < command.max() < LIMITS.high
        assert np.abs(rate).max() <= 0.8 * LIMITS.max_rate * (1 + 1e-6)
        assert np.abs(np.diff(rate)).max() / 1e-3 <= 0.8 * LIMITS.max_acceleration * (1 + 1e-6)
        assert np.abs(log.command[[*range(400), *range(-400, 0)]] - CENTRE).max() < 1e-12
        assert log.demand.acceleration == pytest.approx(np.abs(np.diff(rate)).max() / 1e-3)
        if amplitude and log.name not in ("step", "validation"):
            assert np.abs(log.command - CENTRE).max() <= amplitude


@pytest.mark.parametrize("kind", ["sweep", "multisine", "prbs"])
def test_a_signal_is_as_large_as_the_acceleration_allows(kind):
    log = plan_logs((kind,), ExcitationSettings(), LIMITS, CENTRE, validation=False)[0]
    assert log.demand.acceleration == pytest.approx(0.8 * LIMITS.max_acceleration, rel=1e-6)


@pytest.mark.parametrize(("kind", "derivative"), [("sweep", 2), ("multisine", 2), ("prbs", 0)])
def test_the_whole_band_is_excited(kind, derivative):
    # Where acceleration limits, a flat spectrum of it is the most that all frequencies can have at once; a PRBS is flat
    # in the angle, whatever limits it.
    log = plan_logs((kind,), ExcitationSettings(high_hz=40.0), LIMITS, CENTRE, validation=False)[0]
    signal = np.diff(log.command - CENTRE, derivative)
    power = np.abs(np.fft.rfft(signal)) ** 2
    frequency = np.fft.rfftfreq(len(signal), 1e-3)
    bands = [power[(frequency >= low) & (frequency < low + 4)].mean() for low in range(4, 36, 4)]
    assert min(bands) > 0.05 * max(bands)


def test_steps_jump_unless_they_are_to_be_slewed():
    log = plan_logs(("step",), ExcitationSettings(), LIMITS, CENTRE)[0]
    assert log.jumps
    assert set(np.round(log.command - CENTRE, 9)) == {0.0, *np.round([np.deg2rad(3), -np.deg2rad(3)], 9)}


def test_the_step_that_is_held_back_is_another_one():
    fitted, held_back = plan_logs(("step",), ExcitationSettings(), LIMITS, CENTRE)
    assert (fitted.held_back, held_back.held_back) == (False, True)
    moved = [log.command[np.flatnonzero(log.command != CENTRE)[0]] - CENTRE for log in (fitted, held_back)]
    assert moved[0] > 0 > moved[1]
    assert abs(moved[1]) != pytest.approx(moved[0])


def test_the_seed_makes_another_multisine():
    first, again, other = (
        plan_logs(("prbs",), ExcitationSettings(seed=seed), LIMITS, CENTRE)[0].command for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"high_hz": 600.0}, "half the sampling rate"),
        ({"duration_s": 0.0}, "duration_s must be > 0"),
        ({"settle_s": -1.0}, "settle_s"),
        ({"amplitude": -0.1}, "amplitude must be > 0"),
        ({"amplitude": 0.3}, "leaves the travel"),
        ({"step": 0.3}, "a step of 17.2° leaves the travel"),
        ({"period_s": 20.0}, "does not fit into 10 s"),
    ],
)
def test_what_cant_be_played_is_refused(changes, told):
    with pytest.raises(InputError, match=told):
        plan_logs(("multisine", "step"), ExcitationSettings(**changes), LIMITS, CENTRE)
