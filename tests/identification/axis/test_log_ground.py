import numpy as np

from archerfish.identification.axis.log_ground import prepare_ground
from archerfish.identification.axis.spectra import spectrum
from archerfish.records.recording import make_recording

RNG = np.random.default_rng(0)
RUNNING = make_recording(RNG.standard_normal(300), RNG.standard_normal(300), 0.01)
RESTING = make_recording(*(np.append(np.zeros(20), RNG.standard_normal(280)) for _ in range(2)), 0.01)
SCALE = np.array([2.0])


def test_only_a_log_that_is_cut_out_loses_its_beginning():
    ground = prepare_ground([RUNNING, RESTING], 10, SCALE)
    assert ground.skips == [10, 0]
    for found, recording, skip in zip(ground.spectra(4), (RUNNING, RESTING), (10, 0), strict=True):
        expected = spectrum(recording, 4, SCALE, skip)
        np.testing.assert_allclose(found.inputs, expected.inputs, atol=1e-12)
        np.testing.assert_allclose(found.outputs, expected.outputs, atol=1e-12)


def test_it_gets_back_what_shorter_delays_don_t_need():
    ground = prepare_ground([RUNNING, RESTING], 10, SCALE).reaching_back(3)
    assert ground.skips == [3, 0]
    assert [each.outputs.size for each in ground.spectra(3)] == [148, 150]


def test_a_few_lines_are_the_same_for_every_delay():
    few = prepare_ground([RUNNING], 10, SCALE).thinned(80)
    assert few.lines[0].size <= 80
    np.testing.assert_array_equal(few.spectra(0)[0].lag, few.spectra(7)[0].lag)
