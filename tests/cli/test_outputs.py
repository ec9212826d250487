"""What is there stays: no command writes over what it reads, over no regular file, or over what another one wrote."""

import dataclasses
import json
import os
import stat
import threading
from pathlib import Path
from typing import Any

import pytest

from archerfish.cli.inputs import read_files
from archerfish.cli.main import COMMANDS, load, main, run
from archerfish.cli.outputs import Outputs, command_name
from archerfish.cli.parsing import parse
from archerfish.cli.progress import note
from archerfish.cli.run_folder import run_folder
from archerfish.cli.training_folders import remove_training
from archerfish.cli.writer import Writer
from archerfish.figures import style
from archerfish.records import storage

IDENTIFY = ("identify", "gimbal", "train.csv", "--order", 1, "--max-delay", 2)


@dataclasses.dataclass(frozen=True)
class Stub:
    """Options of a command that takes no time."""

    json: Path | None = None
    seed: int = 0
    overwrite: bool = False
    log: Path | None = None

    def outputs(self) -> Outputs:
        return Outputs()


def answer(_: Any) -> dict[str, Any]:
    print("a table")  # noqa: T201
    return {"fit": 99.5}


def finished_run(out: Path, command: str, *names: str) -> None:
    """Make what a command leaves in a run folder."""
    with run_folder(out, Writer(command)) as folder:
        for name in names:
            storage.write_text(folder / name, "{}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_what_it_writes_and_may_be_allowed_to_overwrite(name):
    kind, _ = load(name)
    assert command_name(kind) == name
    assert callable(kind.outputs)
    assert [each.default for each in dataclasses.fields(kind) if each.name == "overwrite"] == [False]


@pytest.mark.parametrize("path", ["train.csv", "./sub/../train.csv", "hard.json", "soft.json"])
def test_json_never_replaces_what_the_command_reads(refused, logs, tmp_path, path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "hard.json").hardlink_to(logs[0])
    (tmp_path / "soft.json").symlink_to("train.csv")
    told = refused(*IDENTIFY, "--overwrite", "--json", path)
    assert ("since it is a symbolic link" if path == "soft.json" else "is read by this command") in told


@pytest.mark.parametrize("path", ["runs/pitch.json", "runs", "runs/.archerfish.json", "runs/../runs/pitch.svg/facts"])
def test_json_is_none_of_the_other_outputs(refused, logs, path):
    assert "is written by this command anyway" in refused(*IDENTIFY, "--axis", "pitch", "--out", "runs", "--json", path)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("notes.md", "mine", "holds no JSON, so it is no earlier --json; choose another --json, or pass --overwrite"),
        ("plant.json", '{"schema": "archerfish.plant/2"}', "is a record of Archerfish; choose another --json"),
        ("run/config.json", None, "belongs to a run of archerfish train; choose another --json"),
    ],
)
def test_json_replaces_an_earlier_one_and_else_only_what_it_may(tmp_path, refused, logs, name, content, told):
    finished_run(tmp_path / "run", "train", "config.json")
    if content:
        (tmp_path / name).write_text(content)
    assert told in refused(*IDENTIFY, "--json", name)
    run(Stub(tmp_path / name, overwrite=True), answer)
    assert json.loads((tmp_path / name).read_text()) == {"fit": 99.5}
    (tmp_path / "facts.json").write_text("")
    run(Stub(tmp_path / "facts.json"), lambda _: {"fit": 1.0})
    run(Stub(tmp_path / "facts.json"), answer)
    assert json.loads((tmp_path / "facts.json").read_text()) == {"fit": 99.5}


@pytest.mark.parametrize("content", ['{"cells": [], "nbformat": 4}', '{"fit": 1.0}', "[]"])
def test_json_replaces_no_json_of_others_and_no_edited_one(tmp_path, refused, logs, content):
    (tmp_path / "nb.ipynb").write_text(content)
    told = refused(*IDENTIFY, "--json", "nb.ipynb")
    assert "nb.ipynb: is there, and no earlier --json wrote it; choose another --json, or pass --overwrite" in told
    run(Stub(tmp_path / "facts.json"), lambda _: {"fit": 99.5})
    (tmp_path / "facts.json").write_text(content)
    told = refused(*IDENTIFY, "--json", "facts.json")
    assert "facts.json: was edited since --json wrote it; choose another --json" in told


def test_json_to_a_dash_is_all_that_is_on_standard_output(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(Stub(Path("-")), answer)
    told = capsys.readouterr()
    assert json.loads(told.out) == {"fit": 99.5}
    assert told.err == "a table\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["link", "folder"])
@pytest.mark.parametrize("words", ["evaluate --out run", "train --out run", "train --json run/told.json"])
def test_an_unusable_list_is_named_before_the_work(refused, tmp_path, words, kind):
    pytest.importorskip("jax")
    (tmp_path / "run").mkdir()
    if kind == "folder":
        (tmp_path / "run" / ".archerfish.json").mkdir()
    else:
        (tmp_path / "run" / ".archerfish.json").symlink_to("other.json")
    told = refused(*words.split())
    assert "run/.archerfish.json: can't be written, since it is a " in told


def test_json_to_a_named_pipe_is_read_at_its_other_end(tmp_path):
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    run(Stub(pipe), answer)
    reader.join()
    assert json.loads(read[0]) == {"fit": 99.5}
    assert stat.S_ISFIFO(pipe.lstat().st_mode)
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_json_to_a_character_device_is_written_and_the_device_stays():
    ours, theirs = os.openpty()
    device = Path(os.ttyname(theirs))
    run(Stub(device), answer)
    assert json.loads(os.read(ours, 4096)) == {"fit": 99.5}
    assert stat.S_ISCHR(device.lstat().st_mode)
    os.close(ours)
    os.close(theirs)


def test_json_to_standard_output_follows_what_is_printed(capsys):
    run(Stub(Path("/dev/stdout")), answer)
    assert capsys.readouterr().out == 'a table\n{\n  "fit": 99.5\n}\n'


def test_a_results_folder_of_another_command_is_refused_before_the_work(refused, tmp_path):
    finished_run(tmp_path / "run", "train", "config.json", "policy.json")
    finished_run(tmp_path / "shots", "evaluate", "config.json", "results.json")
    assert "run/config.json: belongs to a run of archerfish train" in refused("evaluate", "--out", "run")
    assert "shots/config.json: belongs to a run of archerfish evaluate" in refused("train", "--out", "shots")
    told = refused("identify", "muzzle", "shots.csv", "--name", "policy", "--out", "run")
    assert "run/policy.json: belongs to a run of archerfish train; choose another --out, or pass --overwrite" in told


@pytest.mark.parametrize(
    ("words", "path", "told"),
    [
        ("report run --out run/results.json --overwrite", "run/results.json", "is read by this command"),
        ("record sweep --commands yaw_sweep.csv --out . --overwrite", "yaw_sweep.csv", "is read by this command"),
        ("record sweep --axis yaw --out .", "yaw_sweep.csv", "is there, and archerfish record did not write it"),
        ("excite --axis yaw --out .", "yaw_sweep_command.csv", "is there, and archerfish excite did not write it"),
        ("range --out .", "shots.csv", "is there, and archerfish range did not write it"),
        ("transfer --robot logs/robot.toml --out .", "logs/robot.toml", "is read by this command"),
        ("export policy.onnx --out policy.onnx", "policy.onnx", "is read by this command"),
        ("reproduce --quick --out .", "policies", "is in the place of a folder"),
        ("sweep --out .", "results.csv", "is there, and archerfish sweep did not write it"),
    ],
)
def test_a_file_that_would_be_lost_is_named_before_the_work(refused, tmp_path, words, path, told):
    storage.write_text(tmp_path / path, "not to be lost")
    assert f"{path}: {told}" in refused(*words.split())


@pytest.mark.parametrize("name", ["unfinished", "diverged", "tensorboard"])
def test_a_training_empties_no_folder_that_is_not_its_own(refused, tmp_path, name):
    pytest.importorskip("jax")
    storage.write_text(tmp_path / "run" / name / "chapter.txt", "a draft")
    assert f"run/{name}: holds files that no training left there" in refused("train", "--out", "run")


@pytest.mark.parametrize(
    ("words", "path"),
    [
        ("train --out run", "run/tensorboard"),
        ("train --resume run", "run/unfinished"),
        ("evaluate --out run", "run/figures"),
        ("reproduce --quick --out run", "run/policies/gate-history"),
        ("sweep --in-process --out run", "run/trials"),
        ("sweep --in-process --out run --resume", "run/trials"),
        ("sweep --in-process --out run", "run/results.jsonl"),
    ],
)
def test_a_link_in_the_place_of_a_folder_or_file_is_not_followed(refused, tmp_path, words, path):
    pytest.importorskip("jax")
    storage.write_text(tmp_path / "elsewhere" / "config.json", "{}")
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).symlink_to(tmp_path / "elsewhere")
    told = refused(*words.split())
    assert path in told
    assert "symbolic link" in told


@pytest.mark.parametrize("path", ["run/results.jsonl", "run/.lock", "run/trials/0000/x.json"])
@pytest.mark.parametrize("words", ["", "--resume"])
def test_json_is_none_of_what_a_sweep_goes_on_with(refused, path, words):
    told = refused("sweep", "--in-process", *words.split(), "--out", "run", "--json", path, "--overwrite")
    assert "is written by this command anyway" in told


BEGUN = json.dumps({"setting": {}, "ppo": {}, "provenance": {}})
FAULT = json.dumps({"iteration": 3, "first_not_finite": "reward", "message": "training diverged"})


@pytest.mark.parametrize(
    "files",
    [
        {"unfinished/config.json": "{}", "unfinished/notes.txt": "mine", "unfinished/chapters/1.txt": "mine"},
        {"unfinished/config.json": "{}"},
        {"unfinished/config.json": BEGUN, "unfinished/notes.txt": "mine"},
        {"unfinished/config.json": BEGUN, "unfinished/inputs/notes.txt": "mine"},
        {"unfinished/.lock": "mine"},
        {"unfinished/.lock": "", "unfinished/chapters/1.txt": "mine"},
        {"unfinished/log.jsonl": "mine"},
        {"diverged/fault.json": "{}"},
        {"diverged/fault.json": FAULT, "diverged/notes.txt": "mine"},
        {"tensorboard/events.out.tfevents.1700000000.host.0": "of another program"},
        {"tensorboard/events.out.tfevents.1700000000.host.0/notes.txt": "mine"},
    ],
)
def test_a_training_takes_no_folder_for_its_own_that_only_looks_like_it(refused, tmp_path, files):
    pytest.importorskip("jax")
    for name, content in files.items():
        storage.write_text(tmp_path / "run" / name, content)
    told = refused("train", "--out", "run")
    assert f"run/{next(iter(files)).partition('/')[0]}" in told
    assert "holds files that no training left there" in told or "is not the configuration of a training" in told


def test_of_a_training_s_folder_only_its_own_files_are_removed(tmp_path):
    for name in ("config.json", ".lock", "checkpoints/000000004.json", "inputs/yaw/mine.json", "results/curve.svg"):
        storage.write_text(tmp_path / "run" / name, "{}")
        storage.write_text(tmp_path / "other" / name, "{}")
    for name in ("notes.txt", "checkpoints/chapter.txt"):
        storage.write_text(tmp_path / "run" / name, "mine")
    assert not remove_training(tmp_path / "run")
    assert [path.name for path in sorted((tmp_path / "run").rglob("*"))] == ["checkpoints", "chapter.txt", "notes.txt"]
    assert remove_training(tmp_path / "other")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_folder_in_the_place_of_one_result_keeps_all_from_being_written(refused, logs, tmp_path):
    (tmp_path / "runs" / "pitch.svg").mkdir(parents=True)
    told = refused(*IDENTIFY, "--axis", "pitch", "--out", "runs", "--overwrite")
    assert "runs/pitch.svg: can't be written, since it is a folder" in told


def test_axes_go_into_one_folder_and_are_identified_again_over_their_own_records(command, logs, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "_rendered", lambda *_: b"<svg")  # drawing takes long
    for axis in ("pitch", "yaw", "pitch"):
        words = (*IDENTIFY, "--axis", axis, "--out", "runs/infantry", "--json", "runs/infantry/facts.json")
        assert command(*words)[0] == 0
    assert json.loads((tmp_path / "runs/infantry/facts.json").read_text())["files"][0] == "runs/infantry/pitch.json"


def test_files_are_found_wherever_options_name_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = ("a.csv", "b.csv", "run/policy.json", "run/config.json", "run/policy.safetensors", "mine.py", "me.toml")
    for name in (*names, "a=b,c.py", "plants/pitch.json", "plants/policy.json", "infantry"):
        storage.write_text(tmp_path / name, "")

    def read(name: str, words: str) -> set[str]:
        return {str(path) for path in read_files(parse(load(name)[0], name, words.split())) if path.exists()}

    assert read("identify gimbal", "a.csv --validate b.csv --out run --json mine.py") == {"a.csv", "b.csv"}
    assert read("export", "run") == {"run/policy.json", "run/policy.safetensors", "run/config.json"}
    assert read("train", "--plant plants --motion ./mine.py:Still") == {"plants/pitch.json", "mine.py"}
    assert read("sweep", "--vary records=paper,plants ppo.clip=0.1") == {"plants/pitch.json"}
    assert read("train", "--plant a=b,c.py:Gimbal") == {"a=b,c.py"}
    assert "a=b,c.py" in read("evaluate", "--controllers kalman ./a=b,c.py:Mine")
    assert "me.toml" in read("evaluate", "run/policy.json --on me.toml")
    assert "plants/policy.json" not in read("train", "--plant plants --robot infantry")


def test_a_page_is_made_again_over_the_one_of_its_run(tmp_path, monkeypatch):
    from archerfish.cli import report
    from archerfish.evaluation.results import Results

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report, "read_results", lambda _: Results)
    monkeypatch.setattr(report, "write_report", lambda results, path, folder: storage.write_text(path, "again"))
    finished_run(tmp_path / "run", "evaluate", "results.json", "report.html")
    (tmp_path / "old.html").write_text("a page of another program")
    for _ in range(2):
        for words in ([], ["--out", "old.html"], ["--out", "run/other.html"]):
            main(["report", "run", *words])
    assert (tmp_path / "run" / "report.html").read_text() == (tmp_path / "old.html").read_text() == "again"
    finished_run(tmp_path / "run", "evaluate", "results.json", "report.html")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            "view run/policy.json --export run/page.html",
            "run/page.html: belongs to a run of archerfish evaluate; choose",
        ),
        ("view run/policy.json --export run/policy.json", "run/policy.json: is read by this command, which never"),
    ],
)
def test_an_export_that_is_in_the_way_is_put_right_by_another_export(refused, tmp_path, words, told):
    finished_run(tmp_path / "run", "evaluate", "page.html", "policy.json")
    message = refused(*words.split())
    assert told in message
    assert "choose another --export" in message


def test_figures_of_others_are_named_before_a_page_is_made_from_results(refused, tmp_path):
    finished_run(tmp_path / "run", "evaluate", "results.json")
    finished_run(tmp_path / "shots", "transfer", "figures/a.svg")
    told = refused("report", "run", "--out", "shots/page.html")
    assert "shots/figures/a.svg: belongs to a run of archerfish transfer" in told


def test_what_a_name_or_a_file_holds_reaches_the_terminal_only_as_print(refused, tmp_path, capsys):
    assert "/a\\x1b[31mb\\x07\\u202ec.json: no such file" in refused("export", tmp_path / "a\x1b[31mb\x07\u202ec.json")
    note("red \x1b[31m\nand\x9b µ")
    assert capsys.readouterr().err == "archerfish: red \\x1b[31m and\\x9b µ\n"
