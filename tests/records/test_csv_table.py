import bz2
import gzip
import lzma

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from archerfish.records.csv_table import read_csv_columns, read_header, read_text_table
from archerfish.records.errors import InputError

NAMES = ["time_s", "u", "y"]
ROWS = [f"{k / 100:.2f},{k % 7}.5,{k / 8:.3f}" for k in range(20)]


def lines(changed=None, rows=ROWS, names="time_s,u,y"):
    """Lines of a table, some of them changed, by line number."""
    table = [names, *rows]
    for number, text in (changed or {}).items():
        table[number - 1] = text
    return table


def write(folder, table, end="\n"):
    path = folder / "log.csv"
    path.write_bytes((table if isinstance(table, str) else "\n".join(table) + end).encode())
    return path


def with_notes(changed=None):
    return lines(changed, rows=[f"{row},ok" for row in ROWS], names="time_s,u,y,note")


SHORTEST = ["0.0", *(repr(float(np.sin(k / 7))) for k in range(1, 19))]
"""Numbers with as many digits as they need."""


def ends_with(values):
    """Lines whose last column has other values."""
    return lines(rows=[f"{k / 100:.2f},{k % 7}.5,{value}" for k, value in enumerate(values)])


@pytest.mark.parametrize(
    ("table", "line"),
    [
        (lines({5: '0.03,"3.5,0.375'}), 5),
        (lines({2: '"0.00,0.5,0.000'}), 2),
        (lines({21: '0.19,"5.5,2.375'}), 21),
        (lines({1: 'time_s,u,"y'}), 1),
        (lines({5: '0.03,3.5,"0.375"1'}), 5),
        # A value is missing in line 3; the note that begins in line 5 would end in line 15 and hide ten samples.
        (with_notes({3: "0.01,,0.125,ok", 5: '0.03,3.5,0.375,"a', 15: '0.13,6.5,1.625,b"'}), 5),
        (with_notes({5: '0.03,3.5,0.375,"two\nlines"'}), 5),
        (with_notes({5: f'0.03,3.5,0.375,"{"a" * 140_000}"'}), 5),
        (lines({1: f'time_s,u,y,"{"a" * 140_000}"'}), 1),
    ],
)
@pytest.mark.parametrize("read", [read_text_table, read_csv_columns])
def test_a_quotation_mark_that_is_not_closed_on_its_line_is_refused(tmp_path, table, line, read) -> None:
    with pytest.raises(InputError, match=rf"log\.csv: line {line}: a quotation mark") as refused:
        read(write(tmp_path, table), NAMES)
    assert refused.value.code == "open-quote"


def test_quotation_marks_that_hide_no_line_are_read(tmp_path) -> None:
    table = with_notes({4: '0.02,2.5,0.250,"a, ""b"""', 6: '"0.04",4.5,0.500,5" plate'})
    read = read_text_table(write(tmp_path, table), NAMES)
    assert_array_equal(read.columns["time_s"], np.arange(20) / 100)
    assert_array_equal(read.columns["y"], np.arange(20) / 8)


@pytest.mark.parametrize(
    ("table", "line", "count"),
    [
        (lines({9: "0.07,0.875"}), 9, "2 fields"),
        (lines({9: "0.07"}), 9, "1 field"),
        (lines(rows=[f"{k},{row}" for k, row in enumerate(ROWS)]), 2, "4 fields"),  # R's row names
        (lines(names="id,time_s,u,y"), 2, "3 fields"),
        # Nothing between blanks: what follows would be taken for the missing value.
        ([line.replace(",", " ") for line in with_notes({9: "0.07,0.875,0"})], 9, "3 fields"),
        ([line.replace(",", "  ") for line in lines(rows=[f"{row},7" for row in ROWS])], 2, "4 fields"),
    ],
)
def test_a_line_with_other_fields_than_the_first_line_names_is_refused(tmp_path, table, line, count) -> None:
    with pytest.raises(InputError, match=rf"line {line}: has {count}, where the first line has") as refused:
        read_text_table(write(tmp_path, table), NAMES)
    assert refused.value.code == "row-length"


@pytest.mark.parametrize("first", ["1,,2", ",1,2", "nan,,2", "\n1,,2"])
def test_a_first_line_of_numbers_and_gaps_is_refused_since_it_can_be_a_sample(tmp_path, first) -> None:
    line = first.count("\n") + 1
    with pytest.raises(InputError, match=rf"log\.csv: line {line}: numbers and empty .*; put a line above") as refused:
        read_text_table(write(tmp_path, [first, "5,6,7", "6,7,8"]), ["1", "2"])
    assert refused.value.code == "unclear-names"


@pytest.mark.parametrize("word", ["NA", "null", "None", "n/a", "nan"])
def test_a_first_line_that_lacks_a_value_by_a_word_is_a_sample(tmp_path, word) -> None:
    read = read_text_table(write(tmp_path, [f"1,{word},2", "5,6,7", "6,7,8"]), ["2", "3"])
    assert_array_equal(read.columns["2"], [np.nan, 6, 7])
    assert_array_equal(read.columns["3"], [2, 7, 8])


@pytest.mark.parametrize("read", [read_text_table, read_csv_columns])
@pytest.mark.parametrize(("mark", "separator"), [("#", ","), ("%", ";"), ("  # ", "\t"), ("#", " ")])
def test_a_sample_that_a_mark_takes_out_is_refused(tmp_path, read, mark, separator) -> None:
    rows = [f"{k},{row}" for k, row in enumerate(ROWS)]
    table = lines({9: mark + rows[7]}, rows, "#count,time_s,u,y")
    with pytest.raises(InputError, match=f'line 9: begins with "{mark.strip()}".*; remove the line, or') as refused:
        read(write(tmp_path, [line.replace(",", separator) for line in table]), NAMES)
    assert refused.value.code == "comment"


@pytest.mark.parametrize("separator", [",", " "])
@pytest.mark.parametrize("ending", ["\r", "\r\n"])
def test_every_line_ending_separates_lines_and_nothing_else_does(tmp_path, separator, ending) -> None:
    table = [line.replace(",", separator) for line in with_notes()]
    if separator == ",":
        table[4] = "0.03,3.5,\f0.375,a\x85b\u2028c\x1cd\ve"
    path = write(tmp_path, table[0] + "\n" + ending.join(table[1:]) + "\n")
    read = read_text_table(path, NAMES)
    assert_array_equal(read.columns["y"], np.arange(20) / 8)
    assert_array_equal(read.places, np.arange(2, 22))


@pytest.mark.parametrize(
    ("last", "end", "where"),
    [
        ("0.19,5.5", "\n", "after 2 of 3 fields"),
        ("0.19,5.5", "", "after 2 of 3 fields"),
        ("0.19,5.5,", "", "before its last field"),
        ("0.19,5.5,-", "", "in its last field"),
        ("0.19,5.5,2.", "", "inside its last number"),
        ("0.19,5.5,2.37", "", "inside its last number"),
        ("0.19,5.5,2.375e-0", "", "inside its last number"),
        ("0.19,5.5,2.37", "\0" * 512, "inside its last number"),
        ('0.19,"5.5,2.37', "", "inside a quotation mark"),
    ],
)
def test_a_last_line_that_breaks_off_is_left_out_counted_and_said(tmp_path, last, end, where) -> None:
    path = write(tmp_path, lines({21: last}), end)
    read = read_text_table(path, NAMES)
    assert_array_equal(read.columns["y"], np.arange(19) / 8)
    (found,) = read.findings
    assert (found.code, found.severity, found.samples) == ("truncated", "repaired", 1)
    assert found.place == f"{path}: line 21"
    assert where in found.message
    # A reader that repairs nothing refuses it.
    with pytest.raises(InputError, match=f"line 21: the last line breaks off {where}.*; complete it") as refused:
        read_csv_columns(path, NAMES)
    assert refused.value.code == "truncated"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_zero_bytes_after_the_last_line_are_counted_and_said(tmp_path, encoding) -> None:
    path = write(tmp_path, "")
    path.write_bytes(("\n".join(lines()) + "\n").encode(encoding) + bytes(512))
    read = read_text_table(path, NAMES)
    assert_array_equal(read.columns["y"], np.arange(20) / 8)
    (found,) = read.findings
    assert (found.code, found.severity, found.place) == ("zero-bytes", "repaired", f"{path}: line 21")
    assert "512 zero bytes after the last line" in found.message
    with pytest.raises(InputError, match=r"line 21: 512 zero bytes after the last line.*; remove them if") as refused:
        read_csv_columns(path, NAMES)
    assert refused.value.code == "zero-bytes"


def test_zero_bytes_after_a_line_that_breaks_off_are_counted_with_it(tmp_path) -> None:
    (found,) = read_text_table(write(tmp_path, lines({21: "0.19,5.5"}), "\0" * 512), NAMES).findings
    assert "after 2 of 3 fields, with 512 zero bytes after it" in found.message


@pytest.mark.parametrize(
    ("table", "wanted"),
    [
        (lines(), NAMES),
        (lines({21: "0.19,5.5,12.375"}), NAMES),
        (lines({21: "0.19,5.5,2.3"}), NAMES[:2]),
        (with_notes({21: "0.19,5.5,2.375,o"}), NAMES),
        (with_notes({21: "0.19,5.5,2.375,"}), NAMES),
        (lines(rows=[f"{k},{k},{k * k}" for k in range(20)]), NAMES),
        (lines(rows=[f"{k},{k},{k:.3e}" for k in range(20)]), NAMES),
        (ends_with([f"{k % 2}" for k in range(20)]), NAMES),
        (ends_with([f"{k + 995:04d}" for k in range(20)]), NAMES),
        (ends_with([f"{k / 10:.1f}" for k in range(20)]), NAMES),
        (ends_with([f"{np.sin(k):.4g}" for k in range(20)]), NAMES),
        (ends_with([*SHORTEST, "-0.123456789012345"]), NAMES),
        (ends_with([*SHORTEST, '"0.6"']), NAMES),
        ([line.replace(",", " ") for line in ends_with([*SHORTEST, "0.6 "])], NAMES),
    ],
)
def test_a_last_line_without_line_break_is_whole_where_its_number_is_as_long_as_others(tmp_path, table, wanted) -> None:
    assert len(read_csv_columns(write(tmp_path, table, end=""), wanted).lines) == 20


@pytest.mark.parametrize(
    "values",
    [
        [*(f"{1000 + 13 * k}" for k in range(50)), "16"],
        [*(f"{k}" for k in range(990, 1000)), "100"],  # of 1000
        [*(f"{k}" for k in range(-40, 40)), "4"],
        ["0"] * 20 + ["1"],
        [*(f"{k:04d}" for k in range(20)), "002"],
        [*SHORTEST, "0.6"],
        ["0.0"] * 2000 + ["0.6"],
        ["0.0", "0.5"] * 10 + ["0.6"],
        [*SHORTEST, "1.0", "0.12345678901234"],
        [*(f"{k / 8:.3f}" for k in range(20)), "0.25", "2.37"],
        [*(f"{k / 8}" for k in range(100)), "12.37"],
        ["1e-05", *SHORTEST, "5.1234567890123455"],
        [f"{k:.3e}" for k in range(20)] + ["1.900"],
        ["nan"] * 20 + ["0.6"],
        ["0.6"],
        [f"{k}," for k in range(50, 70)] + ["7"],
    ],
)
def test_a_last_number_that_can_be_the_beginning_of_a_longer_one_is_left_out_and_counted(tmp_path, values) -> None:
    table = ends_with(values)
    path = write(tmp_path, table, end="")
    with pytest.raises(InputError, match=f'line {len(table)}: .* its last number, or lacks only.*: "{values[-1]}"'):
        read_csv_columns(path, NAMES)
    if len(values) > 1:
        read = read_text_table(path, NAMES)
        assert [each.samples for each in read.findings if each.code == "truncated"] == [1]
        assert len(read.places) == len(values) - 1
    # A line break is all that a whole line lacks.
    assert len(read_csv_columns(write(tmp_path, table), NAMES[:2]).lines) == len(values)


def test_a_missing_value_at_the_end_is_whole(tmp_path) -> None:
    read = read_text_table(write(tmp_path, ends_with([*SHORTEST, "nan"]), end=""), NAMES)
    assert not read.findings
    assert_array_equal(np.flatnonzero(np.isnan(read.columns["y"])), [19])


def test_a_line_of_separators_alone_is_a_row_without_values(tmp_path) -> None:
    path = write(tmp_path, [*lines({9: ",,"}), ",,", ",,,,"])
    read = read_text_table(path, ["u", "y"])
    assert len(read.places) == 20  # those at the end are a spreadsheet's, and no rows
    assert_array_equal(np.flatnonzero(np.isnan(read.columns["y"])), [7])
    # A list of records has no record there, and its lines are known.
    assert_array_equal(read_csv_columns(path, NAMES).lines, [*range(2, 9), *range(10, 22)])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_text_that_cannot_be_decoded_is_refused_with_its_line(tmp_path, encoding) -> None:
    path = tmp_path / "log.csv"
    content = ("\n".join(with_notes()) + "\n").encode(encoding)
    path.write_bytes(content[:-1] if encoding == "utf-16" else content[:-2] + b"\xff\n")
    with pytest.raises(InputError, match=rf"line 21: can't be read as {encoding.upper()} text") as refused:
        read_text_table(path, NAMES)
    assert refused.value.code == "encoding"


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (gzip.compress(b"time_s,u,y\n", mtime=0), "is compressed; unpack it first"),
        (bz2.compress(b"time_s,u,y\n"), "is compressed; unpack it first"),
        (lzma.compress(b"time_s,u,y\n"), "is compressed; unpack it first"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "is an HDF5 file"),
        (b"PK\x03\x04" + bytes(100), "is an archive"),
    ],
    ids=["gzip", "bz2", "xz", "hdf5", "zip"],
)
@pytest.mark.parametrize("read", [read_text_table, read_csv_columns])
def test_what_is_no_text_is_refused_by_its_format(tmp_path, content, problem, read) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=problem) as refused:
        read(path, NAMES)
    assert refused.value.code == "unknown-format"


def test_a_field_that_is_too_long_is_not_called_an_open_quotation_mark(tmp_path) -> None:
    path = write(tmp_path, with_notes({5: f'0.03,3.5,0.375,"{"a" * 140_000}"'}))
    with pytest.raises(InputError, match=r"line 5: a quotation mark encloses more than 131072 characters; shorten"):
        read_text_table(path, NAMES)


def test_a_message_shows_the_beginning_of_a_long_field_only(tmp_path) -> None:
    path = write(tmp_path, lines({9: f"0.07,0.5,{'x' * 5000}"}))
    with pytest.raises(InputError, match="line 9") as refused:
        read_text_table(path, NAMES)
    assert len(str(refused.value)) < 300


def test_names_are_found_whatever_the_encoding_and_the_separator(tmp_path) -> None:
    for line, content in ((3, "\n\n# a b missed\n1 2 0\n"), (1, "a;b;missed\n1;2;0\n")):
        path = tmp_path / "log.csv"
        path.write_bytes(content.encode("utf-16"))
        assert read_header(path) == (["a", "b", "missed"], line)
