import numpy as np
import pytest

from archerfish.identification.axis.lag_factor import MOST_LAGS, factor_lags
from archerfish.records.recording import make_recording

RNG = np.random.default_rng(0)


def log(count, inputs=2, outputs=1):
    names = [f"u{index}" for index in range(inputs)], [f"y{index}" for index in range(outputs)]
    u, y = RNG.standard_normal((count, inputs)) + 7.0, RNG.standard_normal((count, outputs)) - 3.0
    return make_recording(u, y, 0.01, input_names=names[0], output_names=names[1])


def lagged(recordings, lags, wanted):
    """Signals with lags, each recording's mean over the same samples taken out; `wanted` is (signal, lag)s."""
    blocks = []
    for each in recordings:
        signals = np.concatenate([each.outputs, each.inputs], axis=1)
        rows = np.column_stack([signals[lags - lag : len(each) - lag, signal] for signal, lag in wanted])
        blocks.append(rows - rows.mean(axis=0))
    return np.concatenate(blocks)


def test_products_of_columns_are_those_of_the_lagged_signals():
    recordings = [log(300, outputs=2), log(401, outputs=2)]
    factor = factor_lags(recordings, 4)
    found = np.hstack([factor.output([0, 5]), factor.input([2, 1])])
    wanted = [(0, 0), (1, 0), (0, 5), (1, 5), (2, 2), (3, 2), (2, 1), (3, 1)]
    expected = lagged(recordings, factor.lags, wanted)
    np.testing.assert_allclose(found.T @ found, expected.T @ expected, rtol=1e-10, atol=1e-9)


def test_a_regression_on_lags_is_that_of_the_samples():
    recordings = [log(300), log(250)]
    factor = factor_lags(recordings, 4)
    expected = lagged(recordings, factor.lags, [(0, 0), (0, 1), (1, 0), (2, 0), (1, 3), (2, 3)])
    regressors = np.hstack([factor.output([1]), factor.input([0, 3])])
    found = np.linalg.lstsq(regressors, factor.output([0])[:, 0])[0]
    np.testing.assert_allclose(found, np.linalg.lstsq(expected[:, 1:], expected[:, 0])[0], atol=1e-12)


@pytest.mark.parametrize(("counts", "lags"), [((2000,), MOST_LAGS), ((2000, 60), 20), ((90,), 10)])
def test_lags_are_as_many_as_the_recordings_bear(counts, lags):
    assert factor_lags([log(count) for count in counts], 4).lags == lags


def test_there_are_more_lags_than_the_order():
    assert factor_lags([log(50, inputs=1)], 8).lags == 9


def test_a_recording_too_short_for_the_lags_is_left_out():
    long, short = log(500, inputs=1), log(10, inputs=1)
    both, alone = factor_lags([long, short], 8), factor_lags([long], 8)
    np.testing.assert_allclose(both.output([0, 3]).T @ both.input([1]), lagged_products(long, both.lags), atol=1e-9)
    assert both.lags == 9 < alone.lags


def lagged_products(recording, lags):
    rows = lagged([recording], lags, [(0, 0), (0, 3), (1, 1)])
    return rows[:, :2].T @ rows[:, 2:]
