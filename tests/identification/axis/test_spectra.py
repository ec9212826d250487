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
    for one, other, every in zip(some, masked, whole, strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one, every[[0, 3, 9]])
