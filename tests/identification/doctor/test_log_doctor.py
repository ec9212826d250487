"""What the doctor must not do: raise false alarms, or repair what it can't."""

import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.doctor.log_doctor import examine_log
from archerfish.identification.doctor.relation import relation_findings
from archerfish.identification.doctor.signals import signal_findings, single_sine_hz, unwrapped
from archerfish.identification.doctor.time_stamps import held_mean
from archerfish.records.log_files import read_log
from archerfish.records.log_table import LogTable, stated_unit
from archerfish.records.recording import make_recording

COUNT = 3000
TIME = 0.01 * np.arange(COUNT)


def sweep(_):
    return np.sin(2 * np.pi * (0.2 * TIME + (20 - 0.2) * TIME**2 / (2 * TIME[-1])))


def multisine(rng):
    lines = np.arange(1, 60, 2)
    return sum(
        np.cos(10 * np.pi * k * TIME / TIME[-1] + phase)
        for k, phase in zip(lines, rng.uniform(0, 6.3, 30), strict=True)
    )


def steps(rng):
    return np.repeat(rng.uniform(-1, 1, COUNT // 50), 50)


def binary(rng):
    return np.repeat(rng.choice([-1.0, 1.0], COUNT // 4), 4)


def white(rng):
    return rng.standard_normal(COUNT)


@pytest.mark.parametrize("noise", [0.001, 0.05])
@pytest.mark.parametrize("excite", [sweep, multisine, steps, binary, white])
@pytest.mark.parametrize("seed", range(4))
def test_a_sound_open_loop_raises_no_alarm(excite, noise, seed):
    rng = np.random.default_rng(seed)
    u = excite(rng)
    y = lfilter([0, 0, 0.045], [1, -1.7, 0.745], u)
    coloured = lfilter([1], [1, -0.9], rng.standard_normal(COUNT))
    recording = make_recording(u, y + noise * y.std() * coloured / coloured.std(), 0.01)
    assert signal_findings(recording) + relation_findings(recording, 20) == []


@pytest.mark.parametrize("gain", [0.3, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_loop_closed_over_a_noisy_output_is_told(gain, seed):
    rng = np.random.default_rng(seed)
    reference, noise = steps(rng), 0.05 * rng.standard_normal(COUNT)
    u, y = np.zeros(COUNT), np.zeros(COUNT)
    for k in range(2, COUNT):
        y[k] = 1.7 * y[k - 1] - 0.745 * y[k - 2] + 0.045 * u[k - 2] + noise[k]
        u[k] = gain * (reference[k] - y[k])
    assert "feedback" in {each.code for each in relation_findings(make_recording(u, y, 0.01), 20)}


def test_what_is_held_is_averaged_as_an_integral():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 1.5, 40))
    signal = rng.standard_normal((40, 1))
    grid = time[0] + np.arange(int(time[-1] - time[0]))
    fine = np.linspace(0, 1, 20001)[:-1]
    expected = [signal[np.searchsorted(time, start + fine, side="right") - 1].mean() for start in grid]
    np.testing.assert_allclose(held_mean(time, signal, grid, 1.0)[:, 0], expected, atol=1e-3)
    even = np.arange(40.0)
    np.testing.assert_allclose(held_mean(even, signal, even[:-1], 1.0), signal[:-1], atol=1e-12)


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
def test_a_wrapped_angle_is_unwrapped_exactly(turn):
    angle = turn * (1.3 * np.sin(TIME) + 0.2)
    found, jumps = unwrapped(angle % turn)
    np.testing.assert_allclose(found - found[0], angle - angle[0], atol=1e-9 * turn)
    assert jumps > 5


@pytest.mark.parametrize(
    "signal",
    [np.repeat([0.0, 360.0, 0.0], 100), np.pi * np.sign(np.sin(TIME)), 3.0 * np.sin(TIME), np.zeros(100)],
)
def test_steps_of_a_turn_are_no_wraps(signal):
    found, jumps = unwrapped(signal)
    assert jumps == 0
    np.testing.assert_array_equal(found, signal)


@pytest.mark.parametrize("frequency", [0.313, 2.0, 17.77])
def test_a_single_sine_is_recognised_and_two_are_not(frequency):
    sine = 3 + np.sin(2 * np.pi * frequency * TIME + 0.4)
    assert single_sine_hz(sine, 0.01) == pytest.approx(frequency, rel=3e-3)
    assert single_sine_hz(sine + 0.2 * np.sin(2 * np.pi * 5 * TIME), 0.01) is None


@pytest.mark.parametrize(
    ("name", "unit"),
    [("tempo_ms", "ms"), ("time [us]", "us"), ("angle (deg)", "deg"), ("rate_rad_s", "rad/s"), ("time_s", "s"),
     ("gimbals", ""), ("dreams", ""), ("u", "")],
)  # fmt: skip
def test_units_are_taken_from_names_that_state_them(name, unit):
    assert stated_unit(name) == unit


def test_resampling_a_jittered_log_comes_close_to_the_even_one():
    rng = np.random.default_rng(3)
    u = lfilter(np.ones(20) / 20, [1], steps(rng))
    y = lfilter([0, 0.05], [1, -0.95], u)
    at = TIME + 0.002 * rng.uniform(-1, 1, COUNT)
    columns = {"u": np.interp(at, TIME, u), "y": np.interp(at, TIME, y) + 1e-3 * y.std() * rng.standard_normal(COUNT)}
    table = LogTable(columns, at, "time_s", np.arange(2, COUNT + 2), "line", "log.csv")
    (recording,), findings = examine_log(table, ["u"], ["y"], order=2)
    assert [each.code for each in findings] == ["jitter"]
    expected = np.interp(recording.time + at[0], TIME, y)
    assert np.abs(recording.outputs[:, 0] - expected).max() < 5e-3 * np.ptp(y)


DRONE = ("u_pct", "angulo_deg", "tempo_ms")
REFERENCE = ("Referencia", "Saida_y", "Tempo_s")
SHARED = [
    ("slicot_sysid/robot_arm_dat.mat", "robot_arm_dat[0]", "robot_arm_dat[1]", 0.01, set()),
    ("slicot_sysid/CD_player_arm_dat.mat", "CD_player_arm_dat[0]", "CD_player_arm_dat[2]", 1 / 2048, {"feedback"}),
    ("slicot_sysid/flexible_structure_dat.mat", "flexible_structure_dat[0]", "flexible_structure_dat[2]", 0.01, None),
    ("rgp/ballbeam.dat", "1", "2", 0.1, set()),
    ("rgp/dryer.dat", "1", "2", 0.08, set()),
    ("rgp/flutter.dat", "1", "2", 0.01, {"excited-band"}),
    ("drgp_vss/actuator.mat", "X[0]", "y", 0.05, set()),
    ("drgp_vss/drive.mat", "u1", "z1", 0.02, set()),
    ("drgp_vss/cascaded.mat", "X", "y", 4.0, set()),
    ("drgp_vss/damper.mat", "X", "y", 0.005, set()),
    ("quarter_drone/dados_14_drone.csv", *DRONE, {"time-unit", "jitter", "feedback"}),
    ("quarter_drone/14_drone_seq_20260529_195254.csv", *DRONE, {"time-unit", "gap", "jitter", "feedback"}),
    ("quarter_drone/sinal1_semi_estatica_malha_fechada.csv", *REFERENCE, set()),
    ("quarter_drone/sinal2_degraus_malha_fechada.csv", *REFERENCE, set()),
    ("quarter_drone/sinal3_swept_sine_malha_fechada.csv", *REFERENCE, set()),
    ("quarter_drone/sinal4_multiseno_malha_fechada.csv", *REFERENCE, set()),
    ("quarter_drone/sinal4_multiseno_malha_fechada.csv", "Controle_u", "Saida_y", "Tempo_s", {"feedback"}),
    ("ball_and_hoop/closedLoop.mat", "u", "y", "time", {"saturation"}),
    ("ball_and_hoop/fixedStepSequence.mat", "u", "y", "time", set()),
    ("ball_and_hoop/randomStepSequence.mat", "u", "y", "time", set()),
    ("silverbox/SNLS80mV.csv", "V1", "V2", 1 / 610.35, set()),
]  # fmt: skip


def _name_of(value):
    # The order of a set is another one in every process, and tests that run side by side must have the same names.
    return str(sorted(value)) if isinstance(value, set) else str(value)


@pytest.mark.parametrize(("name", "u", "y", "clock", "codes"), SHARED, ids=lambda each: _name_of(each)[:40])
def test_recorded_logs_are_usable_with_no_option_beyond_their_columns(shared_data, name, u, y, clock, codes):
    stamped = isinstance(clock, str)
    table = read_log(shared_data / "identification" / name, [u], [y], time=clock if stamped else None)
    recordings, findings = examine_log(table, [u], [y], order=4, sample_period_s=None if stamped else clock)
    found = {each.code for each in findings}
    if codes is not None:
        assert found == codes - {"excited-band"}
    if "gap" in found:
        assert [len(each) for each in recordings] == [1598, 3424, 1012]
        (period,) = {each.sample_period_s for each in recordings}
        assert period == pytest.approx(0.01, rel=2e-3)
    else:
        assert len(recordings) == 1
