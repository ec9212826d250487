import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from archerfish2 import provenance, storage
from archerfish2.errors import InputError
from archerfish2.records.json_files import LARGEST, read_json


def run(out: Path, name: str = "a/x.txt", text: str = "new", inputs: Any = (), overwrite=False, **more: Any) -> None:
    with storage.output_folder(out, "excite", inputs, overwrite, **more) as folder:
        storage.write_bytes(folder / name, text.encode())


def tree(folder: Path) -> dict[str, str]:
    files = {each.relative_to(folder).as_posix(): each for each in folder.rglob("*") if each.is_file()}
    return {name: path.read_text() for name, path in files.items() if path.name not in ("run.lock", "run.json")}


def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    storage.write_bytes(tmp_path / "x", b"old")
    monkeypatch.setattr(os, "fsync", Mock(side_effect=OSError(28, "No space left on device")))
    with pytest.raises(InputError, match=r"x: can't be written \(No space left on device\); choose"):
        storage.write_bytes(tmp_path / "x", b"new")
    assert tree(tmp_path) == {"x": "old"}


@pytest.mark.parametrize("kind", ["folder", "symbolic link", "special file"])
def test_only_a_regular_file_is_replaced(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.txt"
    {"folder": path.mkdir, "special file": lambda: os.mkfifo(path)}.get(kind, lambda: path.symlink_to("y"))()
    for write in (lambda: storage.write_bytes(path, b""), lambda: run(tmp_path, "x.txt", overwrite=True)):
        with pytest.raises(InputError, match=f"x.txt: can't be written, since it is a {kind}; name another file"):
            write()


def test_what_is_not_json_or_not_to_be_read_is_refused(tmp_path: Path) -> None:
    contents = {b"": "Expecting", b"\xff\xfe": "utf-8", b'{"a": NaN}': "NaN is no number", b'{"a": 1, "a": 2}': "twice"}
    for content, complaint in {**contents, b"[" * 100_000: "recursion", b"1" * 5_000: "limit"}.items():
        (tmp_path / "x.json").write_bytes(content)
        with pytest.raises(InputError, match=f"x.json: is not JSON .*{complaint}.*write the file again"):
            read_json(tmp_path / "x.json")
    os.truncate(tmp_path / "x.json", LARGEST + 1)
    os.mkfifo(tmp_path / "pipe")
    for name, complaint in (("x.json", "has 64000001 bytes"), ("pipe", "no such file"), ("none", "no such file")):
        with pytest.raises(InputError, match=f"{name}: .*{complaint}"):
            read_json(tmp_path / name)


def test_files_and_the_list_appear_at_the_end_in_the_place_of_those_of_the_same_command(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    run(out, "a.txt", facts={"seed": 1})
    run(out, "b.txt", facts={"seed": 2})
    with storage.output_folder(out, "export", (), False) as folder:
        (folder / "c.txt").touch()
    assert tree(out) == {"b.txt": "new", "c.txt": ""}
    lists = {"excite": {"files": ["b.txt"], "seed": 2}, "export": {"files": ["c.txt"]}}
    assert json.loads((out / "run.json").read_text()) == {"schema": "archerfish.run/1", **lists}


def test_a_block_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    for before in ([], [tmp_path / "new"]):
        with pytest.raises(KeyboardInterrupt), storage.output_folder(tmp_path / "new" / "out", "excite", (), False):
            raise KeyboardInterrupt
        assert list(tmp_path.iterdir()) == before
        run(tmp_path / "new" / "out")
    assert tree(tmp_path / "new" / "out") == {"a/x.txt": "new"}


def test_inputs_and_files_of_others_are_refused_before_the_work_if_their_names_are_known(tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("mine")
    (tmp_path / "a").symlink_to(tmp_path.parent)
    others: Any = {"names": ["x.txt"]}
    for name, options, complaint in (
        ("y.txt", others, r"x.txt: was not written by this command; .*--overwrite"),
        ("x.txt", {}, r"x.txt: was not written by this command"),
        ("x.txt", {"inputs": [tmp_path / "x.txt"], "overwrite": True}, r"x.txt: is read by this command"),
        ("a/x.txt", {"overwrite": True}, r"x.txt: is reached through a link"),
    ):
        with pytest.raises(InputError, match=complaint):
            run(tmp_path, name, **options)
    assert tree(tmp_path) == {"x.txt": "mine"}
    run(tmp_path, "x.txt", overwrite=True)
    run(tmp_path, "x.txt", "again")
    assert tree(tmp_path) == {"x.txt": "again"}


@pytest.mark.parametrize("listed", [{"files": ["../x.txt"]}, {"files": [3]}, {}, None])
def test_a_list_that_is_not_ours_lists_nothing(tmp_path: Path, listed: Any) -> None:
    (tmp_path / "x.txt").write_text("mine")
    storage.write_bytes(
        tmp_path / "out" / "run.json", json.dumps({"schema": storage.RUN_SCHEMA, "excite": listed}).encode()
    )
    with pytest.raises(InputError, match=r"run.json: was not written by this command"):
        run(tmp_path / "out")
    run(tmp_path / "out", overwrite=True)
    assert tree(tmp_path) == {"out/a/x.txt": "new", "x.txt": "mine"}


def test_a_folder_has_one_writer_and_a_killed_one_leaves_old_results_and_no_lock(tmp_path: Path) -> None:
    run(tmp_path, text="old")
    script = (
        "import sys, time; from pathlib import Path; from archerfish2 import storage\n"
        "with storage.output_folder(Path(sys.argv[1]), 'excite', (), False) as folder:\n"
        "    (folder / 'x.txt').touch(); print('begun', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script, tmp_path], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "begun\n"
        with pytest.raises(InputError, match=f"{tmp_path}: is in use by another process; wait for it"):
            run(tmp_path)
        child.send_signal(signal.SIGKILL)
    assert tree(tmp_path)["a/x.txt"] == "old"
    run(tmp_path)
    assert tree(tmp_path) == {"a/x.txt": "new"}


def test_two_inputs_of_one_name_both_keep_their_hash(tmp_path: Path) -> None:
    paths = [tmp_path / name / "log.csv" for name in ("a", "b")]
    for path in paths:
        storage.write_bytes(path, path.parent.name.encode())
    made = provenance.provenance(3, paths)
    assert made["inputs"]["a/log.csv"] == "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb"
    assert [*made["inputs"], *provenance.provenance(0, paths[:1])["inputs"]] == ["a/log.csv", "b/log.csv", "log.csv"]
    assert {"python", "archerfish", "numpy"} <= made["versions"].keys()


@pytest.mark.parametrize("project", ["archerfish", "team"])
def test_the_commit_is_that_of_the_own_checkout_alone(tmp_path: Path, monkeypatch: Any, project: str) -> None:
    (tmp_path / "pyproject.toml").write_text(f'name = "{project}"')
    for words in ("init -q", "add .", "-c user.name=x -c user.email=x commit -qm x"):
        subprocess.run(["git", *words.split()], cwd=tmp_path, check=True)
    for place, own in (("src/archerfish2", project == "archerfish"), (".venv/archerfish2", False)):
        (tmp_path / place).mkdir(parents=True)
        monkeypatch.setattr(provenance, "_HERE", tmp_path / place)
        assert (len(provenance.code_commit.__wrapped__()) == 40) == own
