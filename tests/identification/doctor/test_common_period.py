import numpy as np
import pytest

from archerfish.identification.doctor.common_period import at_common_period
from archerfish.records.recording import make_recording


def log(period, seconds=2.0):
    time = period * np.arange(round(seconds / period))
    return make_recording(np.sign(np.sin(3 * time)), np.sin(2 * time + 0.1), period, source=f"{period}.csv")


def test_logs_of_two_rates_get_the_slower_one():
    recordings, (finding,) = at_common_period([log(0.01), log(0.004)])
    assert [each.sample_period_s for each in recordings] == [0.01, 0.01]
    assert (finding.code, finding.severity, finding.place) == ("other-period", "repaired", "0.004.csv")
    np.testing.assert_allclose(recordings[1].outputs[:, 0], np.sin(2 * recordings[1].time + 0.1), atol=1e-6)
    assert np.mean(np.abs(recordings[1].inputs[:, 0]) > 0.999) > 0.95
    assert recordings[0] is not recordings[1]


@pytest.mark.parametrize("other", [0.01, 0.009995])
def test_periods_that_are_one_are_taken_for_one(other):
    recordings, findings = at_common_period([log(0.01), log(other)])
    assert findings == []
    assert [each.sample_period_s for each in recordings] == [0.01, 0.01]
    assert len(recordings[1]) == len(log(other))
