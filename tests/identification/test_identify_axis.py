"""One axis from logs to verdict: order, delay, drift and gain against plants that are known; what is said and saved."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal, stats

from archerfish.identification.axis.bootstrap import draw_plants, interval
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.axis.plateaus import plateau_gain
from archerfish.identification.axis.report import shortfalls
from archerfish.identification.axis.result import validation_residual
from archerfish.identification.axis.sources import read_sources
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording
from archerfish.records.plant import PlantRecord

PERIOD_S = 5e-3
PLANT = PlantRecord.second_order(4.0, 0.6, 6 * PERIOD_S, PERIOD_S, gain=1.03)
TIME = PERIOD_S * np.arange(2000)
SWEEP = np.sin(2 * np.pi * (0.2 * TIME + 0.75 * TIME**2))  # to 15 Hz
STEPS = np.repeat([0.0, 0.4, -0.2, 0.3, 0.0], 400)


def recorded(u, noise=0.01, seed=0, plant=PLANT, memory=0.0, drift=0.0, source="log"):
    """Simulate a log, noise in shares of the output's deviation, white or an autoregression of first order."""
    y = simulate(plant, u[:, None])[:, 0]
    e = np.random.default_rng(seed).standard_normal(len(u) + 500)
    e = signal.lfilter([np.sqrt(1 - memory**2)], [1, -memory], e)[500:]
    slow = drift * np.linspace(-1, 1, len(u)) ** 3
    return Recording.from_arrays(u, y + noise * y.std() * e + slow + 2, PERIOD_S, source=source)


@pytest.fixture(scope="module")
def found():
    logs = [recorded(SWEEP, source="sweep"), recorded(STEPS, seed=1, source="steps")]
    return identify_axis(logs, validate=[recorded(STEPS[::-1], seed=2, source="held")], axis="pitch")


def test_order_delay_gain_and_poles_are_those_of_the_plant_within_their_intervals(found):
    assert (len(found.record.A), found.dead_time_samples.value, found.record.axis) == (2, 6, "pitch")
    (gain,), (pole,) = found.dc_gain, found.poles
    for each, true in ((gain, 1.03), (pole.frequency_hz, 4.0), (pole.damping, 0.6)):
        assert each.low < each.value < each.high
        assert each.low - 0.002 < true < each.high + 0.002
        assert each.high - each.low < 0.02 * true
    assert pole.determined
    assert len(found.record.draws["A"]) > 90
    assert np.abs(np.linalg.eigvals(found.record.draws["A"])).max() < 1
    assert [each.held_back for each in found.fits] == [True, False, False]
    assert min(each.fit_percent for each in found.fits) > 98


def test_the_validation_residual_is_the_largest_that_lasts_three_decisions_in_a_log_that_was_held_back(found):
    (held,) = [fit for fit in found.fits if fit.held_back]
    residual = np.abs(held.recording.outputs[:, 0] - held.run.outputs[:, 0])
    lasting = [min(residual[at], residual[at + 4], residual[at + 8]) for at in range(2000 - 8)]  # 20 ms are 4 samples
    assert found.record.validation_residual == max(lasting)
    spike, plateau, brief = np.zeros((3, 2000))
    spike[900], plateau[900:909], brief[900:908] = 5.0, 0.2, 5.0

    def with_residual(extra, is_held=True):
        outputs = held.run.outputs + extra[:, None]
        return replace(held, recording=replace(held.recording, outputs=outputs), held_back=is_held)

    assert [validation_residual([with_residual(extra)]) for extra in (spike, brief)] == [0.0, 0.0]
    assert validation_residual([with_residual(-plateau), with_residual(spike)]) == pytest.approx(0.2)
    assert validation_residual([with_residual(plateau, is_held=False)]) is None
    assert validation_residual([]) is None


def test_a_log_that_is_repeated_counts_once_and_one_that_is_fitted_is_not_held_back():
    log, steps = recorded(SWEEP, source="sweep"), recorded(STEPS, seed=1, source="steps")
    slower = Recording.from_arrays(steps.inputs[::2], steps.outputs[::2], 2 * PERIOD_S, source="slower")
    read = read_sources([log, replace(log, source="copy"), slower], log)
    assert read.held_back == []
    findings = [f"{each.code} {each.place} {each.samples}" for each in read.findings]
    assert findings == ["repeated-log copy 2000", "not-held-back sweep 0", "other-period sweep 0"]
    fitted = [(each.source, len(each), each.period_s) for each in read.fitted]
    assert fitted == [(name, 1000, 2 * PERIOD_S) for name in ("sweep", "slower")]


def test_a_log_of_another_sign_is_named_and_nothing_else_is_blamed():
    logs = [recorded(SWEEP, source="sweep"), recorded(STEPS, seed=1, source="steps")]
    turned = Recording.from_arrays(STEPS, -logs[1].outputs, PERIOD_S, source="turned")
    found = identify_axis([logs[0], turned], validate=logs[1], order=2)
    (reason,) = found.report.reasons
    assert reason.startswith("turned: this log alone has a steady gain of -1.03, the others one of 1.03: bring all")


def test_a_pole_that_alternates_behind_an_operator_stays_real():
    u = np.random.default_rng(3).choice([-1.0, 0.0, 1.0], 400)
    y = signal.lfilter([0, 1.0], [1, 0.6], np.clip(u, -0.5, 0.5))
    found = identify_axis([Recording.from_arrays(u, y + 1e-3 * u[::-1], PERIOD_S)], order=1, feedthrough=False)
    assert found.record.A.item() == pytest.approx(-0.6, abs=0.01)


def test_the_plant_is_that_of_scipy_with_its_delay_as_states(found):
    A, B, C, D, period_s = found.record.to_state_space()
    moving = STEPS[:, None] - STEPS[0]
    assert_allclose(found.simulate(moving), signal.dlsim((A, B, C, D, period_s), moving)[1], atol=1e-12)


def test_the_order_is_the_one_that_predicts_held_back_logs_best(found):
    orders = {each.order: each for each in found.candidates if each.fit_percent is not None}
    assert set(orders) == set(range(1, 9))
    best = max(orders.values(), key=lambda each: each.held_back_percent - 0.2 * each.order)
    assert best.order == len(found.record.A)
    assert sum(each.weight for each in found.candidates) == pytest.approx(1)


def test_the_report_says_what_is_known_and_all_of_it_is_saved(found, tmp_path, has_units):
    has_units(found.report, 6)
    assert found.report.usable
    assert "order 2, delay 30.00 ms" in str(found).replace("30.0 ms", "30.00 ms")
    found.save(tmp_path)
    assert_allclose(PlantRecord.load(tmp_path / "pitch.json").A, found.record.A)
    page = (tmp_path / "pitch.html").read_text()
    assert page.count("<svg") == 6


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_intervals_hold_what_they_state(memory):
    """Of 20 logs at 95 % each fewer than 15 cover with a probability of 3e-4; of two figures and spectra, 1e-3."""
    true, covered, gains = np.append(1.03, np.abs(np.log(np.linalg.eigvals(PLANT.A)[0]))), [], []
    for seed in range(20):
        log = recorded(SWEEP, 0.1, seed, memory=memory)
        fit = fit_axis([log], 2, 6, feedthrough=False)
        drawn = draw_plants(fit, 60, seed)
        values = [[e.dc_gain.item(), np.abs(np.log(np.linalg.eigvals(e.A).astype(complex))).min()] for e in drawn]
        low, high = interval(np.array(values))
        covered.append((low <= true) & (true <= high))
        gains.append((fit.plant.dc_gain.item(), np.std(values, axis=0)[0]))
    assert np.sum(covered, axis=0).min() >= 15
    found, drawn_sd = np.array(gains).T  # nor are they too wide
    assert 0.7 < drawn_sd.mean() / found.std(ddof=1) < 1.35


def test_a_drift_is_part_of_the_structure_where_it_explains_the_log(found):
    result = identify_axis([recorded(SWEEP, 0.01, drift=1.0)])
    assert all(each.drift for each in result.candidates if each.weight)
    assert result.dc_gain[0].value == pytest.approx(1.03, rel=0.02)
    assert not any(each.drift for each in found.candidates if each.weight)


def test_a_gain_that_no_log_reaches_is_not_known_and_the_next_step_is_a_command():
    fast = np.sin(2 * np.pi * (5 * TIME + 0.5 * TIME**2))  # from 5 Hz, above the corner
    result = identify_axis([recorded(fast, 0.2)], axis="yaw")
    assert [each.code for each in shortfalls(result)] == ["gain"]
    assert not result.report.usable
    assert "archerfish excite yaw --kinds step" in result.report.reasons[0]


def test_noise_is_told_from_what_the_input_still_explains():
    assert identify_axis([recorded(SWEEP, 0.3)], order=2).report.usable  # 70 % of a log that noise alone spoils
    result = identify_axis([recorded(SWEEP)], order=1)
    assert shortfalls(result)[0].code == "fit"
    assert "Past inputs still explain" in " ".join(result.report.doubts)


def test_a_gain_is_held_where_it_is_given():
    given = identify_axis([recorded(SWEEP), recorded(STEPS, seed=1)], order=2, dc_gain=1.2)
    assert given.record.dc_gain.item() == pytest.approx(1.2, rel=1e-4)
    assert "The steady gain is 1.2" in str(given.report)  # without an interval of rounding errors
    assert "contradicts the logs" in given.report.reasons[0]


def test_the_slope_of_plateaus_is_that_of_a_regression():
    levels, rest = np.array([0.0, 1.0, 0.0, -1.0, 0.0, 1.0]), np.array([0.02, 1.01, -0.01, -1.02, 0.01, 0.99])
    found = plateau_gain([Recording.from_arrays(levels.repeat(100), rest.repeat(100), 0.02)])
    # Friction is not significant, so the slope is the plain one, and its interval the wider one of both regressions.
    columns = np.column_stack([np.ones(6), levels, np.sign(np.append(0, np.diff(levels)))])
    left = rest - columns @ np.linalg.lstsq(columns, rest)[0]
    error = np.sqrt(left @ left / 3 * np.linalg.inv(columns.T @ columns)[1, 1])
    assert found.value == pytest.approx(stats.linregress(levels, rest).slope)
    assert found.high - found.value == pytest.approx(stats.t.ppf(0.975, 3) * error, rel=1e-6)


def test_the_first_output_decides_and_a_rate_may_have_no_steady_gain():
    rng, u = np.random.default_rng(0), 0.1 * np.random.default_rng(1).standard_normal(1500).cumsum()
    angle = signal.lfilter([0, 0, 0.1], [1, -0.9], u)
    outputs = np.stack([angle, np.gradient(angle)], axis=1) + 0.01 * rng.standard_normal((1500, 2))
    result = identify_axis([Recording.from_arrays(u, outputs, 0.01, output_names=("angle", "rate"))])
    assert result.report.usable
    assert [each.value for each in result.dc_gain] == pytest.approx([1, 0], abs=2e-3)


def test_a_dead_time_between_two_samples_is_the_same_delay_in_text_table_and_record():
    fine = PlantRecord.second_order(4.0, 0.6, 5.5 * PERIOD_S, PERIOD_S / 2)
    y = simulate(fine, STEPS.repeat(2)[:, None])[::2]
    result = identify_axis([Recording.from_arrays(STEPS, y, PERIOD_S)], order=2)
    plant = result.record
    assert (plant.delay_samples, bool(plant.D.any())) == (6, True)
    first = int(np.argmax(np.abs(result.simulate(np.ones(20))) > 1e-9))
    assert first - 1 == plant.dead_time_samples == result.dead_time_samples.value == 5
    assert "order 2, delay 25.00 ms" in result.report.headline
    assert result.report.tables[0].rows[0][1].value == pytest.approx(25)


def test_a_log_that_is_resampled_to_divide_the_decisions_is_said():
    log = Recording.from_arrays(recorded(SWEEP).inputs, recorded(SWEEP).outputs, 3e-3)
    read = read_sources([log], divides_s=0.02)
    assert [finding.code for finding in read.findings] == ["other-period"]
    assert read.fitted[0].period_s == pytest.approx(0.02 / 6)
    assert read_sources([recorded(SWEEP)], divides_s=0.02).findings == ()


ARRAYS = {"time_s": TIME, "u": SWEEP, "y": STEPS}
FRAME = type("Frame", (), {"columns": (*ARRAYS,), "__getitem__": lambda _, name: ARRAYS[name]})()


@pytest.mark.parametrize("logs", [ARRAYS, [ARRAYS], FRAME, (FRAME,), Recording.from_arrays(SWEEP, STEPS, PERIOD_S)])
def test_arrays_by_name_and_frames_are_logs(logs):
    (log,) = read_sources(logs).fitted
    assert log.period_s == pytest.approx(PERIOD_S)
    assert np.array_equal(log.outputs[:, 0], STEPS)


@pytest.mark.parametrize("arguments", [(SWEEP, STEPS, 0.01), (np.stack([TIME, SWEEP, STEPS], 1),), (list(SWEEP),)])
def test_arrays_without_names_lead_to_a_recording(arguments, refused):
    refused(r"pass archerfish\.Recording\.from_arrays\(u, y, period_s\)", identify_axis, *arguments)


def test_of_very_many_pieces_the_longest_are_fitted_and_that_is_said():
    pieces = [Recording.from_arrays(SWEEP[place : place + 50], STEPS[350:400] + TIME[:50], 0.01) for place in range(60)]
    read = read_sources([*pieces, Recording.from_arrays(SWEEP, STEPS, 0.01)])
    assert (len(read.fitted), max(map(len, read.fitted))) == (40, 2000)
    (finding,) = read.findings
    assert (finding.code, finding.samples) == ("many-pieces", 21 * 50)


def test_a_period_of_no_gimbal_is_a_finding():
    assert [each.code for each in read_sources(Recording.from_arrays(SWEEP, STEPS, 5)).findings] == ["time-unit"]


QUIET = Recording.from_arrays(SWEEP, np.random.default_rng(0).normal(size=len(SWEEP)), PERIOD_S, source="quiet.csv")
REFUSED = {
    "no-response": (lambda: identify_axis([QUIET]), 'quiet.csv: "y" does not respond to u; check the columns'),
    "single-sine": (lambda: identify_axis([recorded(np.sin(9 * TIME))]), "single sine"),
    "too-short": (lambda: identify_axis([recorded(SWEEP[:40])]), "too few"),
    None: (lambda: identify_axis([]), "expected a log or more"),
}


@pytest.mark.parametrize("code", REFUSED)
def test_logs_that_determine_nothing_are_refused(code, refused):
    call, complaint = REFUSED[code]
    assert code in {refused(complaint, call).code, None}


WRONG = [("order", "2"), ("max_delay", -1), ("seed", -2), ("feedthrough", "no"), ("axis", "roll/2")]


@pytest.mark.parametrize(("name", "value"), WRONG)
def test_an_argument_that_fits_no_fit_is_refused_by_its_name(name, value, refused):
    refused(f"{name}: expected .*, got {value!r}", identify_axis, [QUIET], **{name: value})
