import dataclasses
import json
import os
import re
import subprocess
import sys
from typing import Any

import pytest

from archerfish import __version__
from archerfish.cli.main import COMMANDS, load, overview
from archerfish.cli.parsing import parse, summary
from archerfish.records.plant import read_plant


def test_version_is_printed(command):
    assert command("--version") == (0, f"archerfish {__version__}\n", "")


def test_overview_names_every_command_and_what_it_does(command):
    status, out, _ = command("--help")
    assert status == 0
    for name in COMMANDS:
        assert f"  {name} " in out
        assert summary(load(name)[0]) in out
    assert "examples:" in out


def test_help_of_identify_shows_its_commands_alone(command):
    status, out, _ = command("identify", "--help")
    assert status == 0
    assert "identify muzzle" in out
    assert "  evaluate  " not in out
    assert out == overview("identify") + "\n"


def leaf_options(kind: type, prefix: str = "") -> list[str]:
    """Return the options that a dataclass gives, as typed; the robot's files have no prefix."""
    names = []
    for field in dataclasses.fields(kind):
        # A factory may be a function that fills in other defaults; then the type tells.
        kinds = (field.default_factory, field.type)
        nested: Any = next((each for each in kinds if dataclasses.is_dataclass(each)), None)
        if nested is not None:
            names += leaf_options(nested, "" if field.name == "setting" else f"{prefix}{field.name.replace('_', '-')}.")
        elif "Positional" not in str(field.type) and field.name not in ("logs", "shots", "policies", "run"):
            flag = field.default is True
            names.append(f"--{prefix}{'no-' * flag}{field.name.replace('_', '-')}")
    return names


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("columns", ["80", "120"])
def test_help_names_and_explains_every_option(command, monkeypatch, name, columns):
    monkeypatch.setenv("COLUMNS", columns)
    status, out, err = command(*name.split(), "--help")
    assert (status, err) == (0, "")
    rows = out.split("╭─ ")
    explained = " ".join(line.strip("│ ") for line in out.splitlines())
    for option in leaf_options(load(name)[0]):
        assert re.search(rf"{option}( \S+)? +[^-\s]", explained), option
    assert "Examples:\n  archerfish " in rows[0]
    # Examples may be longer: they are there to be copied.
    assert all(len(line) <= int(columns) for line in out.splitlines() if not line.startswith("  archerfish"))


def test_examples_in_help_are_accepted(command):
    for name in COMMANDS:
        _, out, _ = command(*name.split(), "--help")
        examples = re.findall(r"^  archerfish (.*)$", out, re.MULTILINE)
        assert examples
        for example in examples:
            kind, _ = load(name)
            assert isinstance(parse(kind, name, example.removeprefix(name).split()), kind)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "no command given, expected one of reproduce"),
        (["shoot"], "no command 'shoot'"),
        (["trian"], "perhaps you meant train; see archerfish --help"),
        (["EVALUATE", "policy.json"], "perhaps you meant evaluate; see"),
        (["identify"], "no command 'identify'"),
        (["identify", "robot"], "identify muzzle, transfer, train, sweep, evaluate, report, export, view; see"),
        (["identify", "gimble", "log.csv"], "perhaps you meant identify gimbal; see"),
        (["idnetify", "gimbal"], "perhaps you meant identify gimbal; see"),
        (["train", "--nope"], "--nope; see archerfish train --help"),
        (["train", "--ppo.cilp", "1"], "perhaps you meant --ppo.clip; see archerfish train --help"),
        (["train", "--ppo.clip", "-1"], "> 0, got -1.0; see archerfish train --help"),
        (["train", "--ppo.clip", "nan"], "--ppo.clip must be "),
        (["train", "--ppo.steps", "many"], "--ppo.steps: expected a whole number, got 'many'"),
        (["train", "--ppo.steps"], "'--ppo.steps'"),
        (["train", "--trainer", "gradient", "--ppo.steps", "9"], "--ppo.… says nothing to --trainer gradient"),
        (["train", "--target", "paper", "--gradient.window", "9"], "--gradient.… says nothing to --trainer ppo"),
        (["train", "--ppo.minibatches", "7"], "must divide into minibatches × shards = 7 × 2"),
        (["train", "--target", "flying"], "'flying' for argument '--target'"),
        (["train", "--seed", "-1"], "--seed must be within"),
        (["train", "--seed", "99999999999"], "--seed must be within"),
        (
            ["train", "--target", "paper", "--frames", "1"],
            "--frames must be from 2 (one frame shows no motion) to 64, got 1",
        ),
        (["train", "--pitch", "plant.json", "--robot", "sentry"], "--pitch and --yaw must be given together"),
        (["train", "--pitch", "plant.json"], "; a gimbal has both axes; --robot must name the robot"),
        (["train", "--pitch", "plant.json", "--yaw", "plant.json"], "--robot must name the robot"),
        (["train", "--muzzle", "plant.json", "--robot", "sentry"], "expected 'archerfish.muzzle/1'"),
        (["evaluate", "--engagements", "1"], "--engagements must be at least 2, got 1"),
        (["evaluate", "--controllers", "kalman", "guess"], "got 'guess'"),
        (["evaluate", "--controllers", "kallman"], "got 'kallman'; perhaps you meant kalman"),
        (["evaluate", "none.json"], "none.json: no such file"),
        (["evaluate", "plant.json"], "expected 'archerfish.policy/1'"),
        (["evaluate", "--command-limit", "none"], "'--command-limit'"),
        (["reproduce", "--engagements", "0"], "--engagements must be at least 2"),
        (["reproduce", "--curve-seeds", "0"], "--curve-seeds must be at least 1"),
        (["reproduce", "--workers", "-1"], "--workers must be at least 0"),
        (["report"], "RUN"),
        (["report", "none"], "none/results.json: no such file"),
        (["identify", "gimbal"], "no log given"),
        (["identify", "gimbal", "none.csv"], "none.csv: no such file"),
        (["identify", "gimbal", "policy.json"], "policy.json"),
        (["identify", "gimbal", "none.csv", "--axis", "../up"], "--axis names files"),
        (["identify", "muzzle"], "no file of shots given"),
        (["identify", "muzzle", "none.csv", "--name", ""], "--name names files"),
        (["report", "a\nb"], "a b/results.json"),
    ],
)
def test_a_wrong_word_is_refused_in_one_line(refused, records, words, told):
    assert told in refused(*words)


@pytest.mark.parametrize("out", ["plant.json", "plant.json/deeper", "/proc/nowhere/run"])
@pytest.mark.parametrize("name", ["train", "evaluate", "reproduce", "identify gimbal"])
def test_an_unwritable_output_folder_is_refused_before_the_work(refused, records, logs, name, out):
    words = [*name.split(), *(["train.csv"] if name == "identify gimbal" else [])]
    assert "can't be written" in refused(*words, "--out", out)


@pytest.mark.parametrize(
    ("json_file", "told"), [(".", "names a folder"), ("plant.json/facts.json", "can't be written")]
)
def test_an_unwritable_json_file_is_refused_before_the_work(refused, records, json_file, told):
    assert told in refused("train", "--json", json_file)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: text.replace("time_s,u,y", "time_s,u,angle"), 'line 1: no column "y"; the columns are'),
        (lambda text: re.sub(r"\n0\.1,[^,]*", "\n0.1,inf", text, count=1), 'line 12: column "u" is inf'),
        (lambda text: re.sub(r"\n0\.1,[^,]*", "\n0.1,high", text, count=1), 'line 12: column "u" is "high"'),
        (lambda text: text.replace("\n0.1,", "\n0.5,", 1), "log.csv"),
        (lambda text: "\n".join(text.splitlines()[:30]), "too few for order 1"),
        (lambda text: text.splitlines()[0], "no data"),
        (lambda text: "", "is empty"),
        (lambda text: "\xff", "can't be read"),
    ],
    ids=["wrong column", "infinity", "no number", "jump in time", "too short", "no data", "empty", "binary"],
)
def test_a_log_that_cant_be_used_is_refused(refused, logs, tmp_path, change, told):
    (tmp_path / "log.csv").write_text(change(logs[0].read_text()), encoding="latin-1")
    assert told in refused("identify", "gimbal", "log.csv", "--json", "facts.json")


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ("pitch_deg,range", 'no column "distance_m"'),
        ("pitch_deg,distance_m", "shots.csv"),
    ],
)
def test_shots_that_cant_be_used_are_refused(refused, tmp_path, columns, told):
    (tmp_path / "shots.csv").write_text(f"{columns}\n0,nan\n")
    assert told in refused("identify", "muzzle", "shots.csv")


def test_a_damaged_plant_is_refused(refused, records):
    robot = ["--pitch", "plant.json", "--yaw", "plant.json", "--robot", "sentry"]
    (records / "plant.safetensors").write_bytes(b"nothing")
    assert "is not the file" in refused("train", *robot)
    (records / "plant.json").write_text('{"schema": "archerfish.plant/0"}')
    assert "expected 'archerfish.plant/2'" in refused("train", *robot)


def test_a_damaged_policy_is_refused(refused, edited, records):
    arrays = records / "policy.safetensors"
    whole = arrays.read_bytes()
    for changes, told in [
        ({"frames": 4, "observation": "history"}, "edited.json"),
        ({"observation": "smell"}, "edited.json"),
        ({"muzzle": {"speed": 18.0}}, "edited.json"),
        ({"period_s": "soon"}, 'field "period_s"'),
        ({"period_s": 0.01}, "trained for decisions every 0.01 s"),
        ({"arrays_sha256": "0"}, "is not the file"),
    ]:
        assert told in refused("evaluate", edited(**changes))
    arrays.write_bytes(whole[:-4])
    assert "is not the file" in refused("evaluate", "policy.json")
    arrays.unlink()
    assert "can't be read" in refused("evaluate", "policy.json")


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"schema": "archerfish.results/1"}', "\x00"])
def test_damaged_results_are_refused(refused, tmp_path, content):
    (tmp_path / "results.json").write_text(content)
    assert "results.json" in refused("report", ".")


def test_identify_writes_files_and_json(command, logs, tmp_path):
    status, out, err = command(
        "identify", "gimbal", "train.csv", "--validate", "test.csv", "--order", 2, "--max-delay", 3, "--axis", "pitch",
        "--out", "made/here", "--json", "facts/pitch.json",
    )  # fmt: skip
    assert (status, err) == (0, "")
    assert {path.name for path in (tmp_path / "made/here").iterdir()} == {
        "pitch.json", "pitch.safetensors", "pitch.html", "pitch.svg", "pitch.png", ".archerfish.json",
    }  # fmt: skip
    facts = json.loads((tmp_path / "facts/pitch.json").read_text())
    assert facts["files"][0] == "made/here/pitch.json"
    assert facts["validation"][0]["fit_percent"] > 97
    assert "fit, validation" in out
    assert read_plant(tmp_path / "made/here/pitch.json").axis == "pitch"


def test_a_reader_that_leaves_is_no_fault():
    program = [sys.executable, "-c", "from archerfish.cli.main import main; main()", "--help"]
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(program, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert done.returncode == 1
    assert done.stderr == b""
