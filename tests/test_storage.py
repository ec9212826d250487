import json
import os
import subprocess
import sys
from unittest.mock import Mock

import pytest

from archerfish import provenance, storage
from archerfish.records.json_files import read_json

WRITER = """import sys, time; from pathlib import Path; from archerfish import storage
with storage.output_folder(Path(sys.argv[1]), 'excite', (), False) as folder:
    (folder / 'x.txt').touch(); print('begun', flush=True); time.sleep(60)"""


def run(out, name="a/x.txt", text="new", command="excite", inputs=(), overwrite=False, **more):
    with storage.output_folder(out, command, inputs, overwrite, **more) as folder:
        storage.write_bytes(folder / name, text.encode())


def tree(folder):
    files = (each for each in folder.rglob("*") if each.is_file() and each.name not in ("run.lock", "run.json"))
    return {each.relative_to(folder).as_posix(): each.read_text() for each in files}


def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path, monkeypatch, refused):
    storage.write_bytes(tmp_path / "x", b"old")
    monkeypatch.setattr(os, "fsync", Mock(side_effect=OSError(28, "No space left on device")))
    refused(r"x: can't be written \(No space left on device\); choose", storage.write_bytes, tmp_path / "x", b"new")
    assert tree(tmp_path) == {"x": "old"}


@pytest.mark.parametrize("kind", ["folder", "symbolic link", "special file"])
def test_only_a_regular_file_is_replaced(tmp_path, kind, refused):
    path, complaint = tmp_path / "x.txt", f"x.txt: can't be written, since it is a {kind}; name another file"
    {"folder": path.mkdir, "special file": lambda: os.mkfifo(path)}.get(kind, lambda: path.symlink_to("y"))()
    refused(complaint, storage.write_bytes, path, b"")
    refused(complaint, run, tmp_path, "x.txt", overwrite=True)


def test_what_is_not_json_or_not_to_be_read_is_refused(tmp_path, refused):
    contents = {b"": "Expecting", b"\xff": "utf-8", b'{"a": NaN}': "NaN is no number", b'{"a": 1, "a": 2}': "twice"}
    for content, complaint in {**contents, b"[" * 100_000: "recursion", b"1" * 5_000: "limit"}.items():
        (tmp_path / "x.json").write_bytes(content)
        refused(f"x.json: is not JSON .*{complaint}.*write the file again", read_json, tmp_path / "x.json")
    os.truncate(tmp_path / "x.json", storage.MOST_BYTES + 1)
    os.mkfifo(tmp_path / "pipe")
    for name, complaint in (("x.json", "has 64000001 bytes"), ("pipe", "no such file"), ("none", "no such file")):
        refused(f"{name}: .*{complaint}", read_json, tmp_path / name)


def test_files_and_the_list_appear_at_the_end_in_the_place_of_those_of_the_same_command(tmp_path):
    run(out := tmp_path / "new" / "out", "a.txt", facts={"seed": 1})
    run(out, "b.txt", facts={"seed": 2})
    run(out, "c.txt", command="export")
    assert tree(out) == {"b.txt": "new", "c.txt": "new"}
    lists = {"excite": {"files": ["b.txt"], "seed": 2}, "export": {"files": ["c.txt"]}}
    assert json.loads((out / "run.json").read_text()) == {"schema": "archerfish.run/1", **lists}


def test_a_block_that_fails_leaves_what_was_there(tmp_path):
    for before in ([], [tmp_path / "new"]):
        with pytest.raises(KeyboardInterrupt), storage.output_folder(tmp_path / "new" / "out", "excite", (), False):
            raise KeyboardInterrupt
        assert list(tmp_path.iterdir()) == before
        run(tmp_path / "new" / "out")
    assert tree(tmp_path / "new" / "out") == {"a/x.txt": "new"}


def test_inputs_and_files_of_others_are_refused_before_the_work_if_their_names_are_known(tmp_path, refused):
    (tmp_path / "x.txt").write_text("mine")
    out = tmp_path / "out"
    (tmp_path / "a").symlink_to(tmp_path.parent)
    refused("x.txt: was not written by this command; .*--overwrite", run, tmp_path, "y.txt", names=["x.txt"])
    refused("x.txt: was not written by this command", run, tmp_path, "x.txt")
    refused("x.txt: is read by this command", run, tmp_path, "x.txt", inputs=[tmp_path / "x.txt"], overwrite=True)
    refused("x.txt: is reached through a link", run, tmp_path, "a/x.txt", overwrite=True)
    for listed in ({"files": ["../x.txt"]}, {"files": [3]}, {}, None):  # a list that is not ours lists nothing
        storage.write_bytes(out / "run.json", json.dumps({"schema": storage.RUN_SCHEMA, "excite": listed}).encode())
        refused("was not written by this command", run, out)
        run(out, overwrite=True)
    assert tree(tmp_path) == {"x.txt": "mine", "out/a/x.txt": "new"}
    run(tmp_path, "x.txt", overwrite=True)
    run(tmp_path, "x.txt", "again")
    assert (tmp_path / "x.txt").read_text() == "again"


def test_a_folder_has_one_writer_and_a_killed_one_leaves_old_results_and_no_lock(tmp_path, refused):
    run(tmp_path, text="old")
    with subprocess.Popen([sys.executable, "-c", WRITER, tmp_path], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "begun\n"
        refused(f"{tmp_path}: is in use by another process; wait for it", run, tmp_path)
        child.kill()
    assert tree(tmp_path)["a/x.txt"] == "old"
    run(tmp_path)
    assert tree(tmp_path) == {"a/x.txt": "new"}


def test_two_inputs_of_one_name_both_keep_their_hash(tmp_path):
    for path in (paths := [tmp_path / name / "log.csv" for name in ("a", "b")]):
        storage.write_bytes(path, path.parent.name.encode())
    made = provenance.provenance(3, paths)
    assert made["inputs"]["a/log.csv"] == "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb"
    assert [*made["inputs"], *provenance.provenance(0, paths[:1])["inputs"]] == ["a/log.csv", "b/log.csv", "log.csv"]
    assert {"python", "archerfish", "numpy"} <= made["versions"].keys()


def test_the_commit_is_that_of_the_own_checkout_alone(tmp_path, monkeypatch):
    for words in ("init -q", "-c user.name=x -c user.email=x commit -qm x --allow-empty"):
        subprocess.run(["git", *words.split()], cwd=tmp_path, check=True)
    for project, place in (("archerfish", "src/archerfish"), ("team", "src/archerfish"), ("archerfish", ".venv/a")):
        (tmp_path / "pyproject.toml").write_text(f'name = "{project}"')
        (tmp_path / place).mkdir(parents=True, exist_ok=True)
        monkeypatch.setattr(provenance, "_HERE", tmp_path / place)
        assert (len(provenance.code_commit.__wrapped__()) == 40) == ((project, place[:3]) == ("archerfish", "src"))
