import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish2 import provenance, storage
from archerfish2.errors import InputError
from archerfish2.records.json_files import LARGEST, read_json


def run(out: Path, text: str = "new", name: str = "a/x.txt", inputs: tuple[Path, ...] = (), **options: object) -> None:
    with storage.output_folder(out, "excite", inputs, bool(options.pop("overwrite", False)), **options) as folder:  # type: ignore[arg-type]
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def tree(folder: Path) -> set[str]:
    return {each.relative_to(folder).as_posix() for each in folder.rglob("*") if each.is_file()} - {"run.lock"}


def test_a_write_that_fails_half_way_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    storage.write_bytes(tmp_path / "x", b"old")

    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(InputError, match=r"x: can't be written \(No space left on device\); choose"):
        storage.write_bytes(tmp_path / "x", b"new")
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("x", "old")]


@pytest.mark.parametrize("kind", ["folder", "symbolic link", "special file"])
def test_only_a_regular_file_is_replaced(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "out" / "a" / "x.txt"
    target.parent.mkdir(parents=True)
    {"folder": target.mkdir, "special file": lambda: os.mkfifo(target)}.get(kind, lambda: target.symlink_to("y"))()
    for write in (lambda: storage.write_bytes(target, b""), lambda: run(tmp_path / "out", overwrite=True)):
        with pytest.raises(InputError, match=f"x.txt: can't be written, since it is a {kind}; name another file"):
            write()
    assert target.is_symlink() or target.exists()


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is not JSON"),
        (b"\xff\xfe", "is not JSON"),
        (b'{"a": NaN}', "NaN is no number"),
        (b'{"a": 1, "a": 2}', "a field is there twice, among 'a'"),
        (b"[" * 100_000, "is not JSON"),
        (b"1" * 5_000, "is not JSON"),
    ],
)
def test_what_is_not_json_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    (tmp_path / "x.json").write_bytes(content)
    with pytest.raises(InputError, match=f"x.json: .*{complaint}.*write the file again"):
        read_json(tmp_path / "x.json")


def test_what_can_not_be_read_is_named_without_reading_it(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(LARGEST + 1)
    os.mkfifo(tmp_path / "pipe")
    for name, complaint in (("large", "has 64000001 bytes"), ("pipe", "no such file"), ("none", "no such file")):
        with pytest.raises(InputError, match=f"{name}: .*{complaint}"):
            read_json(tmp_path / name)


def test_files_and_the_list_appear_at_the_end_and_replace_those_of_the_same_command(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    run(out, "one", facts={"seed": 1})
    run(out, "two", name="b.txt", facts={"seed": 2})
    assert tree(out) == {"b.txt", "run.json"}
    listed = json.loads((out / "run.json").read_text())
    assert listed == {"schema": "archerfish.run/1", "excite": {"files": ["b.txt"], "seed": 2}}
    with storage.output_folder(out, "export", (), False) as folder:
        (folder / "c.txt").touch()
    assert json.loads((out / "run.json").read_text()) == {**listed, "export": {"files": ["c.txt"]}}
    assert tree(out) == {"b.txt", "c.txt", "run.json"}


def test_a_block_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    for number in range(2):
        with pytest.raises(KeyboardInterrupt), storage.output_folder(out, "excite", (), False) as folder:
            (folder / "x.txt").touch()
            raise KeyboardInterrupt
        assert (tree(out), list(tmp_path.iterdir())) == (
            (set(), []) if number == 0 else ({"a/x.txt", "run.json"}, [tmp_path / "new"])
        )
        run(out)


def test_files_of_others_and_inputs_are_refused_before_the_work_if_their_names_are_known(tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("mine")
    with pytest.raises(InputError, match=r"x.txt: was not written by this command; .*--overwrite"):
        run(tmp_path, name="x.txt")
    with (
        pytest.raises(InputError, match="was not written"),
        storage.output_folder(tmp_path, "excite", (), False, names=["x.txt"]),
    ):
        pytest.fail("worked")
    for overwrite in (False, True):
        with pytest.raises(InputError, match=r"x.txt: is read by this command"):
            run(tmp_path, name="x.txt", inputs=(tmp_path / "x.txt",), overwrite=overwrite)
    assert (tmp_path / "x.txt").read_text() == "mine"
    run(tmp_path, name="x.txt", overwrite=True)
    run(tmp_path, "again", name="x.txt")
    assert (tmp_path / "x.txt").read_text() == "again"


@pytest.mark.parametrize(
    "content", ["", "[]", '{"schema": "x"}', '{"schema": "archerfish.run/1", "excite": {"files": ["../x.txt"]}}']
)
def test_a_list_that_is_not_ours_lists_nothing(tmp_path: Path, content: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.json").write_text(content)
    (tmp_path / "x.txt").write_text("mine")
    with pytest.raises(InputError, match=r"run.json: was not written by this command"):
        run(out)
    run(out, overwrite=True)
    assert (tmp_path / "x.txt").exists()


def test_nothing_is_written_through_a_link_in_the_output_folder(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "out" / "a").symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="is reached through a link"):
        run(tmp_path / "out", overwrite=True)


def test_one_process_writes_at_a_time_and_a_killed_one_leaves_the_old_results_and_no_lock(tmp_path: Path) -> None:
    run(tmp_path, "old")
    script = (
        "import sys, time; from pathlib import Path; from archerfish2 import storage\n"
        "with storage.output_folder(Path(sys.argv[1]), 'excite', (), False) as folder:\n"
        "    (folder / 'x.txt').touch(); print('begun', flush=True); time.sleep(60)"
    )
    child = subprocess.Popen([sys.executable, "-c", script, tmp_path], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "begun\n"
    with pytest.raises(InputError, match=f"{tmp_path}: is in use by another process; wait for it"):
        run(tmp_path)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert (tmp_path / "a" / "x.txt").read_text() == "old"
    run(tmp_path, "new")
    assert tree(tmp_path) == {"a/x.txt", "run.json"}
    assert not list(tmp_path.glob(".unfinished-*"))


def test_two_inputs_of_one_name_both_keep_their_hash(tmp_path: Path) -> None:
    paths = [tmp_path / name / "log.csv" for name in ("a", "b")]
    for path in paths:
        storage.write_bytes(path, path.parent.name.encode())
    made = provenance.provenance(3, paths)
    assert made["inputs"] == {f"{path.parent.name}/log.csv": storage.file_hash(path) for path in paths}
    assert made["inputs"]["a/log.csv"] == "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb"
    assert (made["seed"], list(provenance.provenance(0, paths[:1])["inputs"])) == (3, ["log.csv"])
    assert {"python", "archerfish", "numpy"} <= made["versions"].keys()


@pytest.mark.parametrize("project", ["archerfish", "team"])
def test_the_commit_is_that_of_the_own_checkout_and_of_no_other_around_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, project: str
) -> None:
    package = tmp_path / "src" / "archerfish2"
    package.mkdir(parents=True)
    (tmp_path / "pyproject.toml").write_text(f'name = "{project}"')
    for words in (["init", "-q"], ["add", "."], ["-c", "user.name=x", "-c", "user.email=x", "commit", "-qm", "x"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    found = []
    for place in (package, tmp_path / ".venv" / "archerfish2"):
        place.mkdir(parents=True, exist_ok=True)
        monkeypatch.setattr(provenance, "_HERE", place)
        found.append(provenance.code_commit.__wrapped__())
    assert found[1] == "unknown"
    assert (len(found[0]) == 40) == (project == "archerfish")
