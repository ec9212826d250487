"""What `identify_axis` takes: files, recordings, arrays by name, frames; and how many pieces it fits."""

import numpy as np
import pytest

from archerfish2.errors import InputError
from archerfish2.identification.axis.identify import identify_axis, read_sources
from archerfish2.logs.recording import Recording

TIME = 0.01 * np.arange(400)
U = np.sin(TIME**2)
Y = np.append(0.0, U[:-1])
ARRAYS = {"time_s": TIME, "u": U, "y": Y}


class Frame:
    """What a data frame has."""

    columns = tuple(ARRAYS)

    def __getitem__(self, name):
        return ARRAYS[name]


@pytest.mark.parametrize("logs", [ARRAYS, [ARRAYS], Frame(), (Frame(),), Recording.from_arrays(U, Y, 0.01)])
def test_arrays_by_name_and_frames_are_logs(logs):
    (log,) = read_sources(logs).fitted
    assert log.period_s == pytest.approx(0.01)
    assert np.array_equal(log.outputs[:, 0], Y)


@pytest.mark.parametrize("arguments", [(U, Y), (U, Y, 0.01), (np.stack([TIME, U, Y], 1),), (list(U),)])
def test_arrays_without_names_lead_to_a_recording(arguments):
    with pytest.raises(InputError, match=r"pass archerfish\.Recording\.from_arrays\(u, y, period_s\)"):
        identify_axis(*arguments)


def test_of_very_many_pieces_the_longest_are_fitted_and_that_is_said():
    pieces = [Recording.from_arrays(U[place : place + 50], Y[place : place + 50], 0.01) for place in range(60)]
    read = read_sources([*pieces, Recording.from_arrays(U, Y, 0.01)])
    assert len(read.fitted) == 40
    assert max(map(len, read.fitted)) == 400
    (finding,) = read.findings
    assert (finding.code, finding.samples) == ("many-pieces", 21 * 50)


def test_a_period_of_no_gimbal_is_a_finding():
    assert [each.code for each in read_sources(Recording.from_arrays(U, Y, 5)).findings] == ["time-unit"]
