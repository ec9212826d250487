import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.records.recording import make_recording, read_recording_csv, slice_recording, write_recording_csv


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def read(path, **options):
    return read_recording_csv(path, "time_s", ["u"], ["y"], **options)


def test_a_written_recording_is_read_back_exactly(tmp_path):
    rng = np.random.default_rng(1)
    recording = make_recording(
        rng.standard_normal((50, 2)), rng.standard_normal(50), 0.004, input_names=("u1", "u2"), output_names=("y",)
    )
    write_recording_csv(tmp_path / "log.csv", recording)
    again = read_recording_csv(tmp_path / "log.csv", "time_s", ["u1", "u2"], ["y"])
    np.testing.assert_array_equal(again.inputs, recording.inputs)
    np.testing.assert_array_equal(again.outputs, recording.outputs)
    np.testing.assert_array_equal(again.time, recording.time)
    assert again.sample_period_s == pytest.approx(0.004, rel=1e-12)
    assert again.input_names == ("u1", "u2")


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_are_found_by_name_whatever_the_delimiter_and_order(tmp_path, delimiter):
    rows = [["y", "note", "u", "time_s"], ["1", "a", "10", "0"], ["2", "b", "20", "0.1"], ["3", "c", "30", "0.2"]]
    path = write(tmp_path / "log.csv", "\n".join(delimiter.join(row) for row in rows))
    recording = read(path)
    np.testing.assert_array_equal(recording.inputs[:, 0], [10, 20, 30])
    np.testing.assert_array_equal(recording.outputs[:, 0], [1, 2, 3])
    assert recording.source == "log.csv"


def test_quotes_blank_lines_empty_fields_and_a_byte_order_mark_are_no_obstacle(tmp_path):
    path = write(tmp_path / "log.csv", '\ufeff"time_s","u","y",\n0,1,2,\n\n0.1,3,4,\n0.2,5,6,\n\n')
    np.testing.assert_array_equal(read(path).outputs[:, 0], [2, 4, 6])


def test_a_log_without_stamps_takes_its_period_from_the_caller(tmp_path):
    path = write(tmp_path / "log.csv", "u,y\n1,2\n3,4\n5,6\n")
    recording = read(path, sample_period_s=0.02)
    np.testing.assert_allclose(recording.time, [0, 0.02, 0.04])
    assert recording.sample_period_s == 0.02


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("time_s,u,y\n", "has a first line but no data"),
        ("time_s,u,angle\n0,1,2\n", 'line 1: no column "y"; the columns are "time_s", "u", "angle"'),
        ("time_s,u,y,y\n0,1,2,3\n", 'line 1: 2 columns are named "y"'),
        ("time_s,u,y\n0,1,2\n0.1,one,2\n", 'line 3: column "u" is "one", expected a number'),
        ("time_s,u,y\n0,1,2\n\n0.1,1,\n", 'line 4: column "y" is empty'),
        ("time_s,u,y\n0,1,2\n0.1,1\n", "line 3: the last line breaks off"),
        ("time_s,u,y\n0,1,2\n0.1,1,nan\n", 'line 3: column "y" is empty or nan, expected a number'),
        ("time_s,u,y\n0,1,2\n0.1,inf,2\n", 'line 3: column "u" is inf'),
        ("time_s,u,y\n0,1,2\n", "one sample only"),
        ("time_s,u,y\n0,1,2\n0.1,1,2\n0.1,1,2\n", "line 4: time 0.1 s does not come after 0.1 s"),
        ("time_s,u,y\n0,1,2\n0.2,1,2\n0.1,1,2\n", "line 4: time 0.1 s does not come after 0.2 s"),
        ("time_s,u,y\n0,1,2\n0.1,1,2\n0.2,1,2\n0.4,1,2\n", "line 5: 0.2 s since the sample before"),
    ],
)
def test_a_bad_log_is_refused_with_its_line(tmp_path, text, message):
    path = write(tmp_path / "log.csv", text)
    with pytest.raises(InputError) as caught:
        read(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.csv: no such file; check the path"):
        read(tmp_path / "nothing.csv")


def test_a_binary_file_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"\x89PNG\r\n\x00\x81")
    with pytest.raises(InputError, match="can't be read"):
        read(path)


def test_jitter_below_the_limit_passes(tmp_path):
    stamps = [0, 0.1, 0.209, 0.3, 0.4]
    path = write(tmp_path / "log.csv", "time_s,u,y\n" + "".join(f"{stamp},1,2\n" for stamp in stamps))
    assert read(path).sample_period_s == pytest.approx(0.1)


def test_a_slice_keeps_its_time_and_names():
    recording = make_recording(np.arange(10.0), np.arange(10.0) ** 2, 0.5, source="log")
    part = slice_recording(recording, 3, 6)
    np.testing.assert_array_equal(part.time, [1.5, 2.0, 2.5])
    np.testing.assert_array_equal(part.outputs[:, 0], [9, 16, 25])
    assert (len(part), part.source) == (3, "log[3:6]")


@pytest.mark.parametrize(("start", "stop"), [(3, 3), (-1, 4), (5, 11)])
def test_a_slice_outside_the_recording_is_refused(start, stop):
    with pytest.raises(InputError, match="give a range inside the recording"):
        slice_recording(make_recording(np.arange(10.0), np.arange(10.0), 0.5), start, stop)


@pytest.mark.parametrize(
    ("inputs", "outputs", "message"),
    [
        (np.arange(3.0), np.arange(4.0), "recording.outputs must have shape"),
        (np.arange(3.0), np.array([0, np.nan, 1]), "recording.outputs holds a value that is not finite"),
        (np.zeros(0), np.zeros(0), "holds no samples"),
    ],
)
def test_signals_that_do_not_belong_together_are_refused(inputs, outputs, message):
    with pytest.raises(InputError, match=message):
        make_recording(inputs, outputs, 0.1)
