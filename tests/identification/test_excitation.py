"""Commands that excite an axis: their limits, spectra and prediction, and the command excite."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish.cli.excite import Excite
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.excitation import ExcitationSettings, demand, excite, multisine, plan_command, prbs
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.records.plant import PlantRecord

LIMITS = AxisLimits(low=-0.44, high=0.17, max_rate=10.0, max_acceleration=80.0)
CENTRE, PERIOD = -0.135, 1e-3
KINDS = ("sweep", "multisine", "prbs", "step")


def test_an_axis_without_ends_is_moved_within_a_turn():
    endless, turn = LIMITS.replace(low=None, high=None), LIMITS.replace(low=-np.pi, high=np.pi)
    settings = ExcitationSettings()
    np.testing.assert_array_equal(*(plan_command("sweep", limits, settings, 0.01) for limits in (endless, turn)))


def test_a_multisine_has_its_harmonics_alone_and_a_low_peak_of_its_second_derivative():
    harmonics = np.arange(3, 63)
    amplitude = np.linspace(1.0, 2.0, 60) / harmonics**2
    signal = multisine(2000, harmonics, amplitude)
    found = np.abs(np.fft.rfft(signal)) * 2 / len(signal)
    assert_allclose(found[3:63], amplitude)
    assert_allclose(np.delete(found, harmonics), 0.0, atol=1e-12)
    curvature = np.diff(signal, 2)
    assert np.abs(curvature).max() / curvature.std() < 1.9  # 2.9 to 3.6 with random phases


def test_a_period_of_prbs_is_balanced_and_white():
    chips = prbs(2 * 127, 2, 7)[::2]
    assert_array_equal(prbs(2 * 127, 2, 7)[1::2], chips)
    assert (set(chips), abs(chips.sum())) == ({-1.0, 1.0}, 1.0)
    assert_array_equal([chips @ np.roll(chips, lag) for lag in range(1, 127)], -1.0)


@pytest.mark.parametrize("held_back", [False, True])
@pytest.mark.parametrize("amplitude", [None, 0.01])
@pytest.mark.parametrize("kind", KINDS)
def test_a_command_is_as_large_as_the_limits_allow_and_rests_at_the_centre(kind, amplitude, held_back):
    settings = ExcitationSettings(duration_s=6.0, amplitude=amplitude, slew_steps=True, step=0.1)
    command = plan_command(kind, LIMITS, settings, PERIOD, held_back)
    rate = np.diff(np.pad(command, 2, mode="edge")) / PERIOD
    moved = [np.abs(each).max() for each in (command - CENTRE, rate, np.diff(rate) / PERIOD)]
    used = np.divide(moved, [0.8 * 0.305, 8.0, 64.0])
    assert_allclose(demand(command - CENTRE, PERIOD), moved)
    assert max(used) <= 1 + 1e-6
    assert_allclose(command[[*range(400), *range(-400, 0)]], CENTRE, atol=1e-12)
    if kind == "step":
        assert_allclose(moved[0], 0.07 if held_back else 0.1)
    else:
        assert (max(used) > 1 - 1e-6) if amplitude is None else (moved[0] <= amplitude)


@pytest.mark.parametrize(("kind", "derivative"), [("sweep", 2), ("multisine", 2), ("prbs", 0)])
def test_all_frequencies_of_the_band_are_excited(kind, derivative):
    # Where acceleration limits, a flat spectrum of it is the most that all frequencies can have at once.
    command = plan_command(kind, LIMITS, ExcitationSettings(high_hz=40.0), PERIOD)
    signal = np.diff(command - CENTRE, derivative)
    frequency, power = np.fft.rfftfreq(len(signal), PERIOD), np.abs(np.fft.rfft(signal)) ** 2
    bands = [power[(frequency >= low) & (frequency < low + 4)].mean() for low in range(4, 36, 4)]
    assert min(bands) > 0.05 * max(bands)


@pytest.mark.parametrize(("held_back", "levels"), [(False, [-3.0, 0.0, 3.0]), (True, [-2.1, 0.0, 1.5])])
def test_steps_jump_unless_they_are_slewed_and_others_are_held_back(held_back, levels):
    command = plan_command("step", LIMITS, ExcitationSettings(), PERIOD, held_back)
    assert_array_equal(np.unique(np.round(np.degrees(command - CENTRE), 6)), levels)


def test_the_prediction_is_the_spread_of_real_identifications():
    period_s, noise = 0.01, 2e-3
    plant = PlantRecord.second_order(5.0, 0.5, 0.03, period_s)
    settings = ExcitationSettings(low_hz=0.5, high_hz=20.0, duration_s=6.0, amplitude=0.1, step=0.1, hold_s=0.5)
    limits = AxisLimits(low=-0.5, high=0.5, max_rate=100.0, max_acceleration=1e5)
    planned = excite("yaw", limits, validation=False, plant=plant, noise_sd=noise, settings=settings)
    logs = [(each.inputs, simulate(plant, each.inputs)) for each in planned.logs.values()]
    found = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        noisy = [Recording(u, y + noise * rng.standard_normal(u.shape), period_s) for u, y in logs]
        fit = fit_axis(noisy, 2, 3)
        pole = np.log(fit.poles[0]) / period_s
        found.append([fit.plant.dc_gain.item(), abs(pole) / (2 * np.pi), -pole.real / abs(pole)])
    pole = planned.expected.poles[0]
    expected = planned.expected.dc_gain[0], pole.frequency_hz, pole.damping
    half = [(each.high - each.low) / 2 for each in expected]
    # 8 fits give a standard deviation to ±50 % at 95 %, 100 draws of a bootstrap to ±14 %.
    assert_allclose(half, 1.96 * np.std(found, axis=0, ddof=1), rtol=0.7)
    assert_allclose([each.value for each in expected], [1.0, 5.0, 0.5], atol=2 * max(half))
    assert planned.expected.dead_time_samples.low <= 3 <= planned.expected.dead_time_samples.high


def test_the_printed_second_pair_of_pitch_is_not_determined_by_a_sweep():
    plant = printed_plants()["pitch"]
    planned = excite("pitch", kinds=("sweep",), validation=False, plant=plant)
    assert planned.limits.high == gate_limits().pitch.high
    poles = planned.expected.poles
    assert [each.determined for each in poles] == [True, *[False] * (len(poles) - 1)]


def test_the_command_writes_what_to_play_and_reports_the_outcome(tmp_path):
    LimitsRecord(pitch=LIMITS, yaw=LIMITS).save(tmp_path / "limits.json")
    ending = Excite(axis="pitch", limits=tmp_path / "limits.json", duration_s=2.0, out=tmp_path / "plan").run()
    names = [f"pitch_{kind}{end}.csv" for kind in ("sweep", "step") for end in ("", "_validation")]
    others = {"pitch_excitation.html", "pitch_excitation.json", "run.json", "run.lock"}
    assert {each.name for each in (tmp_path / "plan").iterdir()} == {*names, *others}
    table = np.loadtxt(tmp_path / "plan" / names[0], delimiter=",", skiprows=1)
    assert_allclose(table[:, 1], plan_command("sweep", LIMITS, ExcitationSettings(duration_s=2.0), PERIOD))
    assert_allclose(table[:, 0], PERIOD * np.arange(3000), atol=1e-9)
    assert all(
        text in ending.found for text in ("Steps jump", "steady gain", "validation.csv  held back", "4584", "-7.73°")
    )


def test_a_command_is_not_written_over_a_log(tmp_path, refused):
    plan = excite("pitch", LIMITS, kinds=("step",), validation=False)
    (tmp_path / "pitch_step.csv").write_text("a log")
    refused("pitch_step.csv: is there already, and may be a log; move it", plan.save, tmp_path)
    assert (tmp_path / "pitch_step.csv").read_text() == "a log"


def test_a_gimbal_without_a_file_of_limits_is_excited_within_its_travel_at_its_own_rate(tmp_path):
    few = {"kinds": ("sweep",), "no_validation": True, "sample_period_s": 0.01}
    Excite(axis="pitch", range_deg=(0.0, 20.0), max_rate_deg_s=100.0, out=tmp_path, **few).run()
    time, command, _ = np.loadtxt(tmp_path / "pitch_sweep.csv", delimiter=",", skiprows=1).T
    assert (command[0], time[1]) == (pytest.approx(np.radians(10.0)), 0.01)
    assert np.abs(np.diff(command)).max() / 0.01 < 0.8 * np.radians(100.0) + 1e-9
    frequency, power = np.fft.rfftfreq(len(command), 0.01), np.abs(np.fft.rfft(command - command[0])) ** 2
    assert power[frequency > 42.0].max() < 1e-3 * power[(frequency > 30.0) & (frequency < 38.0)].mean()


MIMO = PlantRecord.from_state_space(0.5 * np.eye(2), np.eye(2), np.eye(2), 0.0, PERIOD)
REFUSED = [
    ({"settings": ExcitationSettings(high_hz=600.0)}, "low_hz < high_hz < 500, .* got 2, 600 and 10; .* --high-hz"),
    ({"settings": ExcitationSettings(period_s=20.0), "kinds": ("prbs",)}, "prbs: .* duration_s of 20 or more"),
    ({"settings": ExcitationSettings(amplitude=0.3)}, r"sweep: 17.2° about -7.73°, expected up to 14°.* --centre-deg"),
    ({"settings": ExcitationSettings(step=0.3), "kinds": ("step",)}, "step: 17.2° .* the travel by --range-deg"),
    ({"plant": MIMO}, r"shape \(2, 2\).* expected .*\(1, 1\)"),
    ({"noise_sd": -1.0}, "noise_sd ≥ 0"),
]


@pytest.mark.parametrize(("options", "complaint"), REFUSED)
def test_what_can_not_be_played_is_refused(options, complaint, refused):
    refused(complaint, excite, "pitch", LIMITS, **options)
    refused("settle_s", ExcitationSettings, settle_s=-1.0)
    refused("duration_s", ExcitationSettings, duration_s=math.nan)
