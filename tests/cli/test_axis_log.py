import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.cli.axis_log import read_axis_log
from archerfish.identification.axis.steady_gain import plateau_gain
from archerfish.records.errors import InputError
from archerfish.records.recording import make_recording


def write(path, time, command, angle):
    rows = [f"{t!r},{u!r},{y!r}" for t, u, y in zip(*(each.tolist() for each in (time, command, angle)), strict=True)]
    path.write_text("\n".join(["time_s,u,y", *rows, ""]))
    return path


def test_an_even_log_that_fits_into_the_decisions_is_taken_as_it_is(tmp_path) -> None:
    time = 0.005 * np.arange(400)
    command, angle = np.sign(np.sin(7 * time)), np.sin(3 * time)
    read = read_axis_log(write(tmp_path / "log.csv", time, command, angle), 0.02)
    assert read.sample_period_s == pytest.approx(0.005)
    assert_allclose(read.inputs[:, 0], command)
    assert_allclose(read.outputs[:, 0], angle)


@pytest.mark.parametrize("rate_hz", [300.0, 120.0, 70.0])
def test_reports_of_another_rate_are_resampled_to_a_fraction_of_the_decision(tmp_path, rate_hz) -> None:
    # Stamped in whole milliseconds, as firmware does: 3, 3, 4 ms for 300 Hz.
    time = np.unique(np.ceil(np.arange(round(3 * rate_hz)) / rate_hz * 1e3 - 1e-9)) / 1e3
    read = read_axis_log(write(tmp_path / "log.csv", time, 0.1 * np.round(time), np.sin(5 * time)), 0.02)
    ticks = 0.02 / read.sample_period_s
    assert ticks == pytest.approx(round(ticks))
    assert read.sample_period_s <= 1 / rate_hz * 1.02
    moments = time[0] + read.sample_period_s * np.arange(len(read))
    assert_allclose(read.outputs[:, 0], np.sin(5 * moments), atol=1e-4)
    # The command keeps its area: it is held between its stamps.
    held = np.sum(0.1 * np.round(time[:-1]) * np.diff(time))
    assert read.inputs.sum() * read.sample_period_s == pytest.approx(held, abs=0.1 * 3 * read.sample_period_s)


@pytest.mark.parametrize("loss", [0.05, 0.1, 0.4])
def test_logs_with_lost_reports_all_get_the_period_of_the_reports(tmp_path, loss) -> None:
    for seed in range(10):
        time = 0.001 * np.flatnonzero(np.random.default_rng(seed).random(5000) >= loss)
        read = read_axis_log(write(tmp_path / "log.csv", time, np.sign(np.sin(7 * time)), np.sin(5 * time)), 0.02)
        assert read.sample_period_s == pytest.approx(0.001)
        assert_allclose(read.outputs[:, 0], np.sin(5 * (time[0] + 0.001 * np.arange(len(read)))), atol=1e-4)


@pytest.mark.parametrize(
    ("time", "complaint"),
    [
        (0.001 * np.arange(50), "50 samples"),
        (np.append(0.001 * np.arange(200), 0.1), "line 202: time does not increase"),
        (0.05 * np.arange(200), "samples every 0.05 s"),
        (0.001 * np.delete(np.arange(600), np.arange(200, 290)), "line 202: 0.091 s since the sample before"),
    ],
)
def test_logs_that_cannot_be_used_are_refused(tmp_path, time, complaint) -> None:
    with pytest.raises(InputError, match=complaint):
        read_axis_log(write(tmp_path / "log.csv", time, time, time), 0.02)


def test_the_plateaus_of_steps_tell_the_gain_whatever_holds_the_axis_back() -> None:
    command = np.repeat([0.0, 0.1, 0.0, -0.1, 0.05, 0.0], 2000)
    # A slow creep after each step, gone by the last fifth of the hold, and a zero of its own.
    since = np.tile(np.arange(2000), 6) / 1000
    angle = 1.03 * command + 0.02 - 0.004 * np.exp(-since / 0.1)
    found = plateau_gain(make_recording(command, angle, 1e-3))
    assert found is not None
    assert found.gain == pytest.approx(1.03, abs=1e-6)
    assert found.low <= 1.03 <= found.high
    assert found.high - found.low < 1e-4
    assert plateau_gain(make_recording(np.sin(command + since), angle, 1e-3)) is None
