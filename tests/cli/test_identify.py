import re
from dataclasses import replace

import numpy as np
import pytest
import tyro
from rich.console import Console

from archerfish.cli.identify_gimbal import IdentifyGimbal, run_gimbal
from archerfish.records.errors import InputError
from archerfish.records.plant import read_plant


@pytest.fixture
def console():
    return Console(record=True, width=100)


def parsed(kind, *words):
    return tyro.cli(kind, args=[str(word) for word in words])


def test_gimbal_writes_record_picture_and_summary(tmp_path, logs, console):
    out = tmp_path / "out"
    words = [logs[0], "--time", "time_s", "--input", "u", "--output", "y", "--order", "2", "--validate", logs[1]]
    command = parsed(IdentifyGimbal, *words, "--axis", "pitch", "--out", out, "--seed", "5", "--max-delay", "3")
    summary = run_gimbal(command, console)
    assert [row["file"] for row in summary["validation"]] == [str(logs[1])]
    assert summary["validation"][0]["fit_percent"] == pytest.approx(98, abs=0.5)
    assert (summary["order"], summary["delay_samples"]) == (2, 1)
    assert summary["poles"][0]["real"] == pytest.approx(0.9, abs=0.01)
    endings = ("json", "safetensors", "html", "svg", "png")
    assert {path.name for path in out.iterdir()} == {".archerfish.json", *(f"pitch.{ending}" for ending in endings)}
    plant = read_plant(out / "pitch.json")
    assert plant.axis == "pitch"
    assert plant.provenance["seed"] == 5
    assert set(plant.provenance["inputs"]) == {"train.csv", "test.csv"}
    text = console.export_text()
    assert "fit, validation" in text
    assert "test.csv" in text


def test_without_a_validation_log_it_says_what_to_do(tmp_path, logs, console):
    summary = run_gimbal(IdentifyGimbal((logs[0],), order=2, max_delay=2, out=tmp_path / "out"), console)
    assert summary["validation"] == []
    assert "--validate LOG" in console.export_text().replace("\n", " ")


def rewritten(log, path, change):
    """Copy a log with its rows [time, u, y] changed."""
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    header = log.read_text().splitlines()[0]
    np.savetxt(path, change(rows), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_a_good_plant_raises_no_doubts(tmp_path, logs, console):
    command = IdentifyGimbal((logs[0],), order=2, max_delay=3, validate=((logs[1],),), out=tmp_path / "out")
    assert run_gimbal(command, console)["remarks"] == []


def test_a_useless_plant_is_called_so_with_what_to_check(tmp_path, logs, console):
    command = IdentifyGimbal(
        (logs[0],), input=(("y",),), output="u", order=2, max_delay=2, validate=((logs[1],),), out=tmp_path / "out"
    )
    summary = run_gimbal(command, console)
    assert summary["validation"][0]["fit_percent"] < 80
    assert not summary["usable"]
    assert "fit" in summary["reasons"]
    assert any("where 80 % is the least" in each for each in summary["remarks"])
    assert "is the least" in " ".join(console.export_text().split())


def test_swapped_columns_are_found_by_trying(tmp_path, logs, console):
    swapped = IdentifyGimbal((logs[0],), input=(("y",),), output="u", out=tmp_path / "out")
    summary = run_gimbal(swapped, console)
    assert summary["reasons"][0] == "swapped"
    (advice,) = summary["advice"]
    assert advice["option"] == "--input u --output y"
    assert advice["gained_points"] > 2


def test_the_training_fit_counts_where_no_log_was_held_back(tmp_path, logs, console):
    noise = np.random.default_rng(1).standard_normal(400)
    log = rewritten(logs[0], tmp_path / "noise.csv", lambda rows: rows + np.outer(noise * rows[:, 2].std(), [0, 0, 1]))
    summary = run_gimbal(IdentifyGimbal((log,), order=2, max_delay=2, out=tmp_path / "out"), console)
    assert summary["reasons"][0] == "fit"
    assert any("it is noise or a disturbance" in remark for remark in summary["remarks"])


@pytest.mark.parametrize("max_delay", [1, 2])
def test_a_delay_at_the_longest_tried_is_told(tmp_path, logs, console, max_delay):
    summary = run_gimbal(IdentifyGimbal((logs[0],), order=2, max_delay=max_delay, out=tmp_path / "out"), console)
    assert summary["delay_samples"] == 1
    assert any("leave --max-delay out" in remark for remark in summary["remarks"]) == (max_delay == 1)


@pytest.mark.parametrize(("factor", "told"), [(57.3, "degrees"), (1 / 57.3, "radians"), (30.0, None)])
def test_a_gain_between_degrees_and_radians_is_told(tmp_path, logs, console, factor, told):
    # The axis of the logs has a steady gain of 1.
    log = rewritten(logs[0], tmp_path / "units.csv", lambda rows: rows * [1, 1, factor])
    summary = run_gimbal(IdentifyGimbal((log,), order=2, max_delay=3, out=tmp_path / "out"), console)
    found = [remark for remark in summary["remarks"] if "log both in radians" in remark]
    assert len(found) == (told is not None)
    assert all(f"output seems to be in {told}" in remark for remark in found)


def test_inputs_can_be_listed_or_repeated():
    listed = parsed(IdentifyGimbal, "a.csv", "--input", "u1", "u2")
    repeated = parsed(IdentifyGimbal, "a.csv", "--input", "u1", "--input", "u2")
    assert [name for group in listed.input for name in group] == ["u1", "u2"]
    assert [name for group in repeated.input for name in group] == ["u1", "u2"]


def test_gimbal_faults_leave_nothing_behind(tmp_path, logs, console):
    good = IdentifyGimbal((logs[0],), out=tmp_path / "out")
    infinite = tmp_path / "infinite.csv"
    infinite.write_text(re.sub(r"\n0\.1,[^,]*", "\n0.1,inf", logs[0].read_text(), count=1))
    short = tmp_path / "short.csv"
    short.write_text("\n".join(logs[0].read_text().splitlines()[:30]))
    faults = [
        (replace(good, logs=()), "no log given"),
        (replace(good, logs=(tmp_path / "none.csv",)), "no such file"),
        (replace(good, output="angle"), 'no column "angle"'),
        (replace(good, logs=(infinite,)), 'column "u" is inf'),
        (replace(good, logs=(short,)), "too few for order 1"),
        (replace(good, validate=((tmp_path / "none.csv",),)), "no such file"),
        (replace(good, out=logs[0] / "out"), "can't be written"),
    ]
    for command, message in faults:
        with pytest.raises(InputError, match=message):
            run_gimbal(command, console)
    assert not (tmp_path / "out").exists()
