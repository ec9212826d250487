"""What is read from files, and what is refused with its line or left out and counted."""

import io
import os
import sys
import zipfile

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from archerfish.logs.log import read_log, signals_in
from archerfish.logs.recording import MAX_BYTES
from archerfish.logs.stamps import time_unit
from archerfish.storage import file_hash

COUNT = 40
U, Y = np.arange(COUNT) % 7 + 0.5, np.arange(COUNT) / 8
ROWS = [f"{k / 100:.2f},{u:.1f},{y:.3f}" for k, (u, y) in enumerate(zip(U, Y, strict=True))]
NOTED = [f"{row},ok" for row in ROWS]


def text(changed=None, rows=ROWS, names="time_s,u,y", separator=",", end="\n"):
    """A table, some lines of which are changed, by number."""
    lines = [names, *rows]
    for number, line in (changed or {}).items():
        lines[number - 1] = line
    return (end.join(lines) + end).replace(",", separator)


def noted(changed=None, **more):
    return text(changed, NOTED, "time_s,u,y,note", **more)


def read(folder, content, name="log.csv", **more):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_log(folder / name, **more)


NUMBERED = {"time": "1", "inputs": ["2"], "outputs": ["3"]}
ACCEPTED = {
    "commas": (text(), {}),
    "semicolons": (text(separator=";"), {}),
    "blanks without names": (text(separator="  ").partition("\n")[2], NUMBERED),
    "names after a mark": ("# " + text(separator=" "), {}),
    "a byte order mark": (b"\xef\xbb\xbf" + text().encode(), {}),
    "UTF-16": (text().encode("utf-16"), {}),
    "carriage returns": (text(end="\r"), {}),
    "both line ends": (text(end="\r\n"), {}),
    "blank lines": ("\n\n" + text(end="\n \n"), {}),
    "the end mark of DOS": (text() + "\x1a", {}),
    "quoted names, an empty one": (text(names='"time_s","u","y",', rows=[f"{row}," for row in ROWS]), {}),
    "quoted fields": (noted({4: '0.02,2.5,0.250,"a, ""b"""', 6: '"0.04",4.5,0.500,5" plate'}), {}),
    "no line ends within fields": (noted({5: "0.03,3.5,\f0.375,a\x85b\u2028c\x1cd\ve"}), {}),
    "marks within lines": (noted({5: "0.03,3.5,0.375,#5 at 80 %"}), {}),
    "a line of the separator": ("sep=;\n" + text(separator=";"), {}),
    "a quoted line of the separator": ('"sep=\t"\r\n' + text(separator="\t"), {}),
    "lines of separators at the end": (text() + ",,\n,,,,\n", {}),
}

REFUSED = {
    "empty": ("", "empty", "is empty, or ends within its first line; pass a log"),
    "names alone": ("time_s,u,y\n", "no-data", "has names but no samples"),
    "another encoding": (text({5: "0.03,3.5,时间"}).encode("gbk"), "encoding", "line 5: is no UTF-8 text"),
    "zero bytes": (text({9: "0.07,\0,0"}), "encoding", "line 9: is no UTF-8 text"),
    "another column": (text(names="time_s,u,angle"), "no-column", 'line 1: .* "y"; .* "time_s", "u", "angle"; name'),
    "a title": ("Log of Monday,\n" + text(), "no-column", 'line 1: .* the columns are "Log of Monday"; name'),
    "a name twice": (text(names="time_s,u,u"), "column-twice", 'line 1: 2 columns are named "u"; rename'),
    "a digit separator": (text({9: "0.07,1_0,1"}), "not-a-number", 'line 9: column "u" is "1_0"'),
    "thousands": ("time_s;u;y\n" + "0;1,000;2,000\n" * 30, "not-a-number", 'line 2: column "u" is "1,000"'),
    "an infinity": (text({9: "0.07,inf,2"}), "infinite", 'line 9: "u" is inf, expected a number within'),
    "too few fields": (text({9: "0.07,0.5"}), "row-length", "line 9: 2 fields, expected the 3 of the first"),
    "too many fields": (text({9: "0.07,0.5,1,4"}), "row-length", "line 9: 4 fields, expected the 3"),
    "decimal commas": ("time_s,u,y\n0,0,1,5,2,5\n", "row-length", "line 2: 6 fields.*decimal commas need semicolons"),
    "a value missing between blanks": (text({9: "0.07,1"}, separator=" "), "row-length", "line 9: 2 fields"),
    "an open quotation mark": (text({9: '0.07,"0.5,1'}), "row-length", "line 9: can't be cut.*; close or remove"),
    # A value is missing in line 3; the note of line 5 would hide the lines up to 15.
    "a note that ends later": (noted({3: "0.01,,0,", 5: '0.03,3.5,0,"a', 15: '0.1,6,1,b"'}), "row-length", "line 5: "),
    "a long note": (noted({5: f'0.03,3.5,0,"{"a" * 140_000}"'}), "row-length", "line 5: .*larger than field limit"),
    "a sample taken out": (text({9: "#0.07,0.5,1"}), "comment", "line 9: begins as a comment, or .*; remove"),
    "time that goes back": (text() + ROWS[0] + "\n", "time-backward", "line 42: time 0 s .* after 0.39 s; cut"),
    "coarse stamps": (text({9: "0.06,1,2"}), "time-duplicate", "line 9: time 0.06 s does not come after 0.06 s"),
    "a short log": (text(rows=ROWS[:24]), "too-short", "at most 24 samples without a gap, expected 25"),
    "one sample": (text(rows=ROWS[:1]), "too-short", "rows with all signals: 1, expected 2"),
    "no sample with all signals": (text(rows=["0,1,", "1,2,"]), "missing-values", "rows with all signals: 0"),
}

REPAIRED = {
    "a torn number": (text() + "0.40,5.5,2.3", {"truncated": 1}, {}),
    "zero bytes after it": (text() + "0.40,5.5,2.3" + "\0" * 512, {"truncated": 1}, {}),
    "zero bytes": (text().encode() + bytes(512), {"truncated": 0}, {}),
    "decimal commas": (text(separator=";").replace(".", ","), {"decimal-comma": 0}, {}),
    "names again": (text() + "time_s,u,y\n", {"names-again": 0}, {}),
    "a repeated line": (text() + ROWS[-1] + "\n", {"time-duplicate": 1}, {}),
    "words for missing inputs": (text({9: "0.07,NA,0.875", 10: "0.08,null,1.000"}), {"held-input": 0}, {}),
    "no input at first": (text({2: "0.00,,0.000", 3: "0.01,,0.125"}), {"late-input": 2}, {}),
    "a first line without a value": (text({2: "0.00,nan,0"}).partition("\n")[2], {"late-input": 1}, NUMBERED),
    "no output at last": (text({41: "0.39,1,"}), {"missing-values": 1}, {}),
    "no stamp at last": (text({41: ",1,2"}), {"missing-values": 1}, {}),
}


@pytest.mark.parametrize(("content", "arguments"), ACCEPTED.values(), ids=ACCEPTED)
def test_tables_of_all_kinds_are_read_exactly(tmp_path, content, arguments):
    log = read(tmp_path, content, **arguments)
    (recording,) = log.recordings
    assert_array_equal(recording.inputs[:, 0], U)
    assert_array_equal(recording.outputs[:, 0], Y)
    assert (log.findings, log.samples, recording.period_s, recording.source) == ((), COUNT, 0.01, "log.csv")
    assert log.sha256 == file_hash(tmp_path / "log.csv")


@pytest.mark.parametrize(("content", "found", "arguments"), REPAIRED.values(), ids=REPAIRED)
def test_what_is_left_out_or_read_otherwise_is_reported_and_counted(tmp_path, content, found, arguments):
    log = read(tmp_path, content, **arguments)
    assert {each.code: each.samples for each in log.findings if each.severity == "repaired"} == found
    assert log.samples == len(log.recordings[0]) + sum(found.values())
    assert (len(log.recordings), log.recordings[0].period_s) == (1, 0.01)


def test_a_table_with_the_name_of_a_compressed_one_is_read_as_what_it_is(tmp_path):
    assert_array_equal(read(tmp_path, text(), "log.csv.gz").recordings[0].outputs[:, 0], Y)


def test_what_is_no_file_too_large_or_of_another_format_is_refused(tmp_path, refused):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("gone")
    (tmp_path / "large").touch()
    os.truncate(tmp_path / "large", MAX_BYTES + 1)
    kinds = {"link": "there is no", "pipe": "there is no", "": "is a folder, and no bag's", "large": "has 512 MB"}
    for name, found in kinds.items():
        refused(f"{found}.*; ", read_log, tmp_path / name)
    for arguments in ({"time": None}, {"sample_period_s": 0.0}, {"sample_period_s": np.nan}, {"inputs": []}):
        refused("(sample_period_s|no input).*; ", read_log, "x", **arguments)
    formats = {
        b"\x1f\x8b": "compressed",
        b"\x89HDF": "HDF5",
        b"\x93NUMPY": "single NumPy",
        b"BZh": "compressed",
    }
    for content, found in formats.items():
        refused(f"log.csv: is (an? )?{found}.*; ", read, tmp_path, content + bytes(9))


def test_the_error_of_an_hdf5_file_says_how_to_convert_it(tmp_path, refused):
    refused(r"h5py\.File\(FILE\); numpy\.savez", read, tmp_path, b"\x89HDF" + bytes(9))


def test_a_unit_of_time_is_taken_from_a_name_that_states_it():
    names = "tempo_ms timeMillis MS | TimeUS t_[us] micros t(µs) | t_nsec stamp_nanoseconds | time_s status dreams t"
    for unit, group in zip(("ms", "us", "ns", "s"), names.split(" | "), strict=True):
        assert {time_unit(name) for name in group.split()} == {unit}


@pytest.mark.parametrize("name", ["time_min", "t [h]", "hours", "minutes", "timeMin", "t_hrs", "h"])
def test_stamps_in_minutes_or_hours_are_refused(tmp_path, refused, name):
    refused("minutes or hours.*seconds", read, tmp_path, text(names=f"{name},u,y"), time=name)


T = np.arange(COUNT) / 100


@pytest.mark.parametrize("form", ["text", "npz"])
def test_a_missing_signal_is_named_where_it_can_be_with_those_that_are_there(tmp_path, form, refused):
    for header, names in (("time_ms,u_deg,y", "time_ms u_deg y"), ("time_ms,u,y_deg,y_rate", "NAME u NAME")):
        content = text(names=header) if form == "text" else npz(**dict.fromkeys(header.split(","), U))
        call = r'read_log\(FILE, time="{}", inputs="{}", outputs="{}"\), or in logs.toml: time = "{}"'
        refused(call.format(*names.split(), names.split()[0]), read, tmp_path, content)


def test_arrays_and_frames_are_read_as_a_file_of_them_is(tmp_path, refused):
    stamps, lost = np.delete(T, [7, 20]), np.delete(np.column_stack([U, Y]), [7, 20], axis=0)
    arrays = {"time_ms": 1e3 * stamps, "u": lost[:, 0], "y": list(lost[:, 1]), "x": lost}
    expected = read(tmp_path, npz(**arrays), time="time_ms")
    frame = type("Frame", (), {"columns": (*arrays,), "__getitem__": lambda _, name: arrays[name]})()
    for source in (arrays, frame):
        for names in ({}, {"inputs": "x[0]", "outputs": "x[1]"}):
            log = read_log(source, time="time_ms", **names)
            assert [finding.code for finding in log.findings] == ["time-unit", "jitter"]
            assert_array_equal(log.recordings[0].outputs, expected.recordings[0].outputs)
    assert (log.samples, log.recordings[0].period_s) == (38, expected.recordings[0].period_s)
    refused('table: has no array "time_s"; the arrays are "time_ms"', read_log, arrays)
    refused("table: signals have 38 and 40", read_log, arrays | {"u": U}, time="time_ms")
    for bare in (lost, lost.tolist()):
        refused(r"archerfish.Recording.from_arrays\(u, y, period_s\)", read_log, bare)


def test_a_log_is_drawn_with_a_panel_for_each_signal_and_no_line_across_a_gap(tmp_path):
    late = np.append(T, T + 9)
    log = read_log({"time_s": late, "u": np.append(U, U), "y": np.append(Y, Y)})
    panels = log.plot().axes
    assert [panel.get_title("left") for panel in panels] == ["u", "y"]
    assert np.isnan(panels[1].lines[0].get_ydata()).sum() == len(log.recordings) - 1 == 1


def test_the_signals_of_a_file_are_listed_by_the_names_that_read_log_takes(tmp_path, refused):
    contents = {text(): "time_s u y", text().partition("\n")[2]: "1 2 3", npz(a=U, b=Y): "a b", mat(c=U, d=Y): "c d"}
    for content, names in contents.items():
        (tmp_path / "log.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
        assert signals_in(tmp_path / "log.csv") == tuple(names.split())
    (tmp_path / "log.csv").write_bytes(npz(a=U)[:100])
    refused("is damaged", signals_in, tmp_path / "log.csv")


def file_of(write, *arguments, **arrays):
    write(content := io.BytesIO(), *arguments, **arrays)
    return content.getvalue()


def npz(**arrays):
    return file_of(np.savez_compressed, **arrays)


def mat(**arrays):
    return file_of(scipy.io.savemat, arrays)


def appended(content, name, member, size=None):
    archive = io.BytesIO(content)
    with zipfile.ZipFile(archive, "a") as file:
        file.writestr(f"{name}.npy", member)
        # The directory, which is written at the end, states what a member unpacks to.
        file.getinfo(f"{name}.npy").file_size = size or len(member)
    return archive.getvalue()


# The type of an array's elements, at byte 185, is none: SciPy's reader crashes or raises, as its memory happens to be.
CRASHING = (SOUND := mat(time_s=T, u=U, y=Y))[:185] + b"\x10" + SOUND[186:]
CLAIM = file_of(np.lib.format.write_array_header_1_0, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
SIGNALS = np.column_stack([U, Y])
OLD = file_of(np.save, T).replace(b"(40,), } ", b"(40L,), }")  # whose header NumPy warns of
ARRAYS = {
    "vectors": (npz(time_s=T, u=U, y=Y), {}),
    "integers and a matrix": (npz(time_ms=(1000 * T).astype(int), x=SIGNALS), {"time": "time_ms"}),
    "rows of a matrix": (npz(time_s=T, x=SIGNALS.T), {}),
    "names with brackets": (npz(**{"time_s": T, "x[0]": U, "x[1]": Y}), {}),
    "columns of MATLAB": (mat(time_s=T, u=U[:, None], y=Y[None]), {}),
    "a matrix of MATLAB": (mat(time_s=T, x=SIGNALS), {}),
    "an array of Python 2": (appended(npz(u=U, y=Y), "time_s", OLD), {}),
}
REFUSED |= {
    "objects": (npz(time_s=T, u=U.astype(object), y=Y), "not-a-number", "has objects .*allow_pickle"),
    "half an archive": (npz(time_s=T, u=U, y=Y)[:300], "damaged", "not a zip file"),
    "an array twice": (npz(time_s=T, u=U, v=U, y=Y).replace(b"v.npy", b"u.npy"), "column-twice", 'has 2 arrays "u"'),
    "a large array": (appended(npz(u=U, y=Y), "time_s", b"", 2**30), "too-large", "1024 MB, expected at most 512"),
    "a claim": (appended(npz(u=U, y=Y), "time_s", CLAIM), "damaged", "damaged.*(allocate|EOF)"),
    "another length": (npz(time_s=T, u=U[1:], y=Y), "length", "39 and 40 samples"),
    "no such array": (npz(time_s=T, u=U), "no-column", 'no array "y"; .*are "time_s", "u"; name them'),
    "a matrix": (npz(time_s=T, u=SIGNALS, y=Y), "no-column", r'shape \(40, 2\), expected one column; .*"u\[0\]"'),
    "an infinite element": (npz(time_s=T, u=U, y=np.where(T == 0.05, np.inf, Y)), "infinite", 'row 6: "y" is inf'),
    "half of MATLAB": (mat(time_s=T, u=U, y=Y)[:-200], "damaged", "is damaged"),
    "a cell": (mat(time_s=T, u=U, y=np.array([Y, U[:3]], dtype=object)), "not-a-number", "has objects"),
    "a bit of MATLAB that crashes its reader": (CRASHING, "damaged", "is damaged"),
    "complex numbers": (mat(time_s=T, u=U, y=Y + 1j), "not-a-number", "of type complex"),
    "MATLAB 7.3": (b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM", "unknown-format", "save it with -v7"),
}


@pytest.mark.parametrize(("content", "arguments"), ARRAYS.values(), ids=ARRAYS)
def test_arrays_are_read_by_name_and_by_column(tmp_path, content, arguments):
    names = {} if b"u.npy" in content or b"\0u\0" in content else {"inputs": "x[0]", "outputs": "x[1]"}
    log = read(tmp_path, content, **arguments, **names)
    assert_array_equal(np.hstack([log.recordings[0].inputs, log.recordings[0].outputs]), SIGNALS)
    assert (log.samples, log.recordings[0].period_s) == (COUNT, 0.01)


@pytest.mark.parametrize(("content", "code", "complaint"), REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_is_named_with_its_line_or_array(tmp_path, content, code, complaint, refused):
    error = refused(f"^{tmp_path}/log.csv: .*{complaint}", read, tmp_path, content)
    assert (error.code, len(str(error)) < 500) == (code, True)


def test_a_crash_of_the_reader_is_reported_as_a_damaged_file(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(sys, "executable", "false")
    refused(r"is damaged.*\(ValueError: the reader crashed\)", read, tmp_path, mat(time_s=T, u=U, y=Y))


def test_a_damaged_table_is_refused_in_one_line_or_gives_a_sound_recording(tmp_path, mutated):
    lengths, path = [], tmp_path / "log.csv"
    path.write_text(text())
    for log in mutated(path, lambda: read_log(path), 300):
        lengths += [len(each) for each in log.recordings]
        assert all(each.samples >= 0 and each.message.isprintable() for each in log.findings)
    assert (len(lengths) > 30, min(lengths) > 20) == (True, True)
