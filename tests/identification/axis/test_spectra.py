import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.identification.axis.spectra import (
    Spectrum,
    delayed,
    line_frequency_hz,
    picked,
    real_rows,
    row_count,
    spectrum,
    unsettled,
    with_delay,
)
from archerfish.records.recording import make_recording

RNG = np.random.default_rng(0)


def log(count, inputs=1, outputs=1):
    names = [f"u{index}" for index in range(inputs)], [f"y{index}" for index in range(outputs)]
    u, y = 3.0 + RNG.standard_normal((count, inputs)), RNG.standard_normal((count, outputs)) - 5.0
    return make_recording(u, y, 0.01, input_names=names[0], output_names=names[1])


@pytest.mark.parametrize("count", [50, 51])
def test_the_squares_of_a_spectrum_are_those_of_the_samples_less_their_mean(count):
    recording = log(count, inputs=2, outputs=2)
    found = spectrum(recording, 0)
    for lines, samples in ((found.inputs, recording.inputs), (found.outputs, recording.outputs)):
        products = (samples - samples.mean(axis=0)).T @ (samples - samples.mean(axis=0))
        np.testing.assert_allclose(real_rows(lines).T @ real_rows(lines), products, rtol=1e-12, atol=1e-12)


def test_outputs_are_measured_in_their_scale():
    recording = log(40, outputs=2)
    plain, scaled = spectrum(recording, 0), spectrum(recording, 0, np.array([2.0, 0.5]))
    np.testing.assert_allclose(scaled.outputs * [2.0, 0.5], plain.outputs)
    np.testing.assert_array_equal(scaled.inputs, plain.inputs)


@pytest.mark.parametrize("count", [60, 61])
def test_states_obey_the_difference_equation_line_by_line(count):
    # (1 − a/z) X = b/z U + t·impulse, with t the same number at every line
    u = RNG.standard_normal(count)
    x, _ = lfilter([0.0, 0.7], [1.0, -0.9], u, zi=[2.0])
    found = spectrum(make_recording(u, x, 0.01), 0)
    left = (1 - 0.9 * found.lag) * found.outputs[:, 0] - 0.7 * found.lag * found.inputs[:, 0]
    transient = left / found.impulse
    np.testing.assert_allclose(transient, np.full(transient.size, transient[0].real), atol=1e-12)


def test_inputs_before_the_recording_are_taken_as_held():
    inputs = np.array([[5.0], [6.0], [7.0]])
    np.testing.assert_array_equal(delayed(inputs, 2)[:, 0], [5, 5, 5])
    np.testing.assert_array_equal(delayed(inputs, 0), inputs)


def test_a_delay_is_one_of_the_inputs():
    recording = log(30)
    late = make_recording(delayed(recording.inputs, 4), recording.outputs, 0.01)
    for found, expected in zip(spectrum(recording, 4), spectrum(late, 0), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("count", [20, 21])
def test_lines_have_the_frequencies_of_the_transform(count):
    found = line_frequency_hz(spectrum(log(count), 0), 0.01)
    np.testing.assert_allclose(found, np.fft.rfftfreq(count, 0.01)[1:], rtol=1e-12)


def test_lines_can_be_picked_by_index_and_by_mask():
    whole = spectrum(log(20), 0)
    some = picked(whole, np.array([0, 3, 9]))
    masked = picked(whole, np.isin(np.arange(10), [0, 3, 9]))
    assert isinstance(some, Spectrum)
    assert row_count([some, whole]) == 2 * 13
    for one, other, every in zip(some[:4], masked[:4], whole[:4], strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one, every[[0, 3, 9]])


@pytest.mark.parametrize("skip", [0, 10])
@pytest.mark.parametrize("count", [60, 61])
def test_a_delayed_spectrum_is_that_of_the_delayed_inputs(count, skip):
    recording = log(count, inputs=2)
    lines = np.array([0, 4, 20, 24])
    for delay in (0, 1, 7, 10):
        turned = with_delay(picked(spectrum(recording, 0, skip=skip), lines), recording, delay, skip)
        expected = picked(spectrum(recording, delay, skip=skip), lines)
        np.testing.assert_allclose(turned.inputs, expected.inputs, atol=1e-12)
        np.testing.assert_array_equal(turned.outputs, expected.outputs)


def test_delayed_inputs_reach_back_into_what_is_left_out():
    whole = RNG.standard_normal(80)
    cut = make_recording(whole[20:], np.zeros(60), 0.01)
    known = spectrum(cut, 5, skip=10)
    expected = spectrum(make_recording(whole[25:75], np.zeros(50), 0.01), 0)
    np.testing.assert_allclose(known.inputs, expected.inputs, atol=1e-12)


SWEEP = np.sin(0.001 * np.arange(400.0) ** 2)
LATE_STEP = (np.arange(400) >= 5).astype(float)


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        (SWEEP[100:], 20),  # cut out of a running sweep
        (np.append(np.zeros(20), SWEEP), 20),  # held, but not known to be at rest
        (LATE_STEP, 0),  # what happens at the beginning is all that happens
        (np.ones(300), 20),
        (np.column_stack([np.ones(300), SWEEP[100:]]), 20),
    ],
)
def test_a_log_is_cut_where_it_answers_to_inputs_from_before_it(inputs, expected):
    assert unsettled(inputs.reshape(len(inputs), -1), 20) == expected


def test_no_sample_is_left_out_where_no_delay_is_allowed():
    assert unsettled(SWEEP[100:, None], 0) == 0
