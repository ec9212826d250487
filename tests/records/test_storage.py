import json
import os
from pathlib import Path

import numpy as np
import pytest

from archerfish.records import storage
from archerfish.records.errors import InputError

SCHEMA = "archerfish.example/1"
ARRAYS = {
    "scalar": np.array(3.5, np.float32),
    "flags": np.array([True, False]),
    "matrix": np.arange(6.0).reshape(2, 3).T,
    "none": np.zeros((0, 4), np.int32),
}


@pytest.fixture
def record(tmp_path: Path) -> Path:
    path = tmp_path / "example.json"
    storage.write_record(path, SCHEMA, {"speed": 18.0, "note": "σ"}, ARRAYS)
    return path


def test_a_record_is_read_back_exactly(record: Path) -> None:
    facts, arrays = storage.read_record(record, SCHEMA)
    assert (facts["speed"], facts["note"]) == (18.0, "σ")
    assert arrays.keys() == ARRAYS.keys()
    for name, written in ARRAYS.items():
        assert arrays[name].dtype == written.dtype
        assert arrays[name].shape == written.shape
        np.testing.assert_array_equal(arrays[name], written)


def test_a_write_that_fails_half_way_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "notes.txt"
    storage.write_text(path, "old")

    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(InputError, match=r"notes\.txt: can't be written \(No space left on device\); choose another"):
        storage.write_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_facts_that_json_cannot_hold_leave_the_old_record_alone(record: Path) -> None:
    before = {path.name: path.read_bytes() for path in record.parent.iterdir()}
    with pytest.raises(ValueError, match="JSON"):
        storage.write_record(record, SCHEMA, {"speed": float("nan")}, {"scalar": np.array(1.0)})
    assert {path.name: path.read_bytes() for path in record.parent.iterdir()} == before


def test_a_result_can_be_read_by_others(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "notes.txt", "")
    storage.write_bytes(tmp_path / "plain", b"")
    plain = tmp_path / "as_open_makes_it"
    plain.write_text("")
    assert (tmp_path / "notes.txt").stat().st_mode == plain.stat().st_mode


def test_an_output_folder_that_is_a_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("")
    for write in (
        lambda: storage.write_text(tmp_path / "runs" / "report.html", ""),
        lambda: storage.check_writable(tmp_path / "runs" / "today"),
    ):
        with pytest.raises(InputError, match="can't be written") as caught:
            write()
        assert "\n" not in str(caught.value)
    assert (tmp_path / "runs").read_text() == ""


def test_checking_a_folder_leaves_nothing_behind(tmp_path: Path) -> None:
    storage.check_writable(tmp_path / "runs" / "today" / "first")
    assert list(tmp_path.iterdir()) == []


def test_checking_a_folder_keeps_what_is_in_it(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "runs" / "notes.txt", "mine")
    storage.check_writable(tmp_path / "runs")
    storage.check_writable(tmp_path / "runs" / "today")
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["notes.txt"]


def test_a_folder_may_be_checked_by_two_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def overtaken(path: Path, content: bytes) -> None:
        write_bytes(path, content)
        path.unlink()
        (path.parent / "theirs.txt").write_text("of another process")

    write_bytes = storage.write_bytes
    monkeypatch.setattr(storage, "write_bytes", overtaken)
    storage.check_writable(tmp_path / "runs")
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["theirs.txt"]


def test_another_schema_is_refused(record: Path) -> None:
    with pytest.raises(InputError, match=r"\"schema\" is 'archerfish\.example/1', expected 'archerfish\.plant/1'"):
        storage.read_record(record, "archerfish.plant/1")
    with pytest.raises(InputError, match="schema"):
        storage.read_facts(record, "archerfish.plant/1")


def test_json_that_is_no_record_is_refused(tmp_path: Path) -> None:
    storage.write_json(tmp_path / "list.json", [1, 2])
    with pytest.raises(InputError, match="\"schema\" is 'list'"):
        storage.read_facts(tmp_path / "list.json", SCHEMA)


def test_arrays_of_another_record_are_refused(record: Path) -> None:
    storage.write_record(record.with_name("other.json"), SCHEMA, {}, {"scalar": np.array(1.0)})
    record.with_name("other.safetensors").replace(record.with_suffix(".safetensors"))
    with pytest.raises(InputError, match=r"example\.safetensors: is not the file that example\.json was written with"):
        storage.read_record(record, SCHEMA)


def test_missing_arrays_are_refused(record: Path) -> None:
    record.with_suffix(".safetensors").unlink()
    with pytest.raises(InputError, match=r"example\.safetensors: can't be read .* belongs beside example\.json"):
        storage.read_record(record, SCHEMA)


@pytest.mark.parametrize("position", [0, 9, -1])
def test_a_damaged_byte_of_the_arrays_is_noticed(record: Path, position: int) -> None:
    arrays = record.with_suffix(".safetensors")
    content = bytearray(arrays.read_bytes())
    content[position] ^= 1
    arrays.write_bytes(content)
    with pytest.raises(InputError, match=r"example\.safetensors"):
        storage.read_record(record, SCHEMA)


def test_arrays_damaged_before_they_were_hashed_are_refused(record: Path) -> None:
    arrays = record.with_suffix(".safetensors")
    arrays.write_bytes(b"not tensors")
    facts = json.loads(record.read_text())
    record.write_text(json.dumps(facts | {"arrays_sha256": storage.file_hash(arrays)}))
    with pytest.raises(InputError, match="damaged"):
        storage.read_record(record, SCHEMA)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b'{"a": 1,\n "b": }', "line 2: not JSON"),
        (b'{"a": NaN}', "holds NaN"),
        (b'{"a": -Infinity}', "holds -Infinity"),
        (b"\xff\xfe", "can't be read"),
        (b"", "line 1: not JSON"),
    ],
)
def test_what_is_not_json_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    (tmp_path / "facts.json").write_bytes(content)
    with pytest.raises(InputError, match=complaint):
        storage.read_json(tmp_path / "facts.json")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.json: no such file; check the path"):
        storage.read_json(tmp_path / "nowhere.json")


@pytest.mark.parametrize(("value", "kind"), [("3", int), (True, int), (True, (int, float)), (None, float), (3, str)])
def test_a_fact_of_another_type_is_refused(tmp_path: Path, value: object, kind: type) -> None:
    with pytest.raises(InputError, match=r'f\.json: field "count" is .*, expected'):
        storage.field(tmp_path / "f.json", {"count": value}, "count", kind)


def test_a_missing_fact_is_refused_and_a_good_one_returned(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='field "count" is None, expected int'):
        storage.field(tmp_path / "f.json", {}, "count", int)
    assert storage.field(tmp_path / "f.json", {"count": 3}, "count", (int, float)) == 3
    assert storage.field(tmp_path / "f.json", {"on": True}, "on", bool) is True
