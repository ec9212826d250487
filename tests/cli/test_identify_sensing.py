import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from archerfish.cli.identify_sensing import IdentifySensing, run_sensing
from archerfish.records.errors import InputError
from archerfish.records.sensing import read_sensing


@pytest.fixture(scope="module")
def files(sensing_recordings, tmp_path_factory):
    """Both recordings as files, in the columns that the command reads by default."""
    folder, rng = tmp_path_factory.mktemp("sensing"), np.random.default_rng(4)
    robot = sensing_recordings.Robot()
    gimbal, plate = sensing_recordings.sweep_recording(robot, rng, seconds=8.0)
    steps, target, moments = sensing_recordings.step_recording(robot, rng, steps=8)
    for name, log in (("sweep", gimbal), ("steps", steps)):
        columns = np.column_stack([log.time, log.yaw, log.pitch, log.command])
        np.savetxt(folder / f"{name}.csv", columns, "%.9g", ",", header="time_s,yaw,pitch,yaw_command", comments="")
    for name, log in (("plate", plate), ("target", target)):
        columns = np.column_stack([log.time, log.receive, log.position])
        np.savetxt(folder / f"{name}.csv", columns, "%.9g", ",", header="time_s,receive_s,x,y,z", comments="")
    np.savetxt(folder / "moments.csv", moments, "%.9g", header="time_s", comments="")
    return folder


def test_two_recordings_give_record_picture_and_summary(command, files, tmp_path):
    out = tmp_path / "out"
    words = ["sweep.csv", "steps.csv", "--detections", "plate.csv", "target.csv", "--target-steps", "moments.csv"]
    paths = [str(files / word) if word.endswith(".csv") else word for word in words]
    options = ["--out", str(out), "--name", "eyes", "--json", str(tmp_path / "told.json"), "--seed", "3"]
    status, text, err = command("identify", "sensing", *paths, *options)
    assert (status, err) == (0, "")
    assert {path.name for path in out.iterdir()} == {
        ".archerfish.json",
        "eyes.json",
        "eyes.html",
        "eyes.svg",
        "eyes.png",
    }
    record = read_sensing(out / "eyes.json")
    assert record.camera.time_offset == pytest.approx(0.003 - 0.137, abs=2e-3)
    assert record.camera.latency == pytest.approx(0.035, abs=5e-3)
    assert record.provenance["seed"] == 3
    assert len(record.provenance["inputs"]) == 5
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["camera"]["latency"] == record.camera.latency
    assert (told["command_steps"], told["target_steps"], told["missing"]) == (8, 8, told["missing"][:1])
    assert "Give --commands and --feedback" in told["missing"][0]
    for words_told in ("time offset to gimbal", "command to motion", "sum of command and feedback delay"):
        assert words_told in " ".join(text.split())


def test_a_sweep_alone_says_what_is_not_known(files, tmp_path):
    console = Console(record=True, width=200)
    alone = IdentifySensing((files / "sweep.csv",), (files / "plate.csv",), out=tmp_path / "out")
    summary = run_sensing(alone, console)
    assert summary["link"]["command_delay"] is None
    text = console.export_text()
    assert "not known" in text
    assert "camera latency less feedback delay" in text
    assert "Record a target that steps" in text


@pytest.fixture(scope="module")
def stamped(files):
    """Files of messages that were stamped at both ends: uniform 5…15 ms, and 1…3 ms."""
    rng = np.random.default_rng(5)
    for name, low, high, rate in (("sent", 0.005, 0.015, 200), ("told", 0.001, 0.003, 1000)):
        sent = np.arange(2000) / rate
        columns = np.column_stack([sent, sent + rng.uniform(low, high, sent.size)])
        np.savetxt(files / f"{name}.csv", columns, "%.9f", ",", header="sent_s,received_s", comments="")
    return files


def test_messages_stamped_at_both_ends_give_the_latency_of_each_direction(command, stamped, tmp_path):
    out = tmp_path / "out"
    words = ["sweep.csv", "--detections", "plate.csv", "--commands", "sent.csv", "--feedback", "told.csv"]
    paths = [str(stamped / word) if word.endswith(".csv") else word for word in words]
    status, text, err = command("identify", "sensing", *paths, "--out", str(out))
    assert (status, err) == (0, "")
    assert all(words in text for words in ("command latency", "feedback latency"))
    for told in (" ".join(text.split()), (out / "sensing.html").read_text()):
        assert "command latency is not known" not in told
    record = read_sensing(out / "sensing.json")
    # Means of 2000 within five standard errors, deviations of a uniform (high − low) / √12 likewise.
    for direction, mean, spread in (("command", 0.010, 0.010), ("feedback", 0.002, 0.002)):
        sd = spread / np.sqrt(12)
        latency, jitter = (getattr(record.link, f"{direction}_latency{end}") for end in ("", "_jitter"))
        assert latency == pytest.approx(mean, abs=5 * sd / np.sqrt(2000))
        assert jitter == pytest.approx(sd, rel=5 / np.sqrt(2 * 2000))
        for name, value in ((f"link.{direction}_latency", latency), (f"link.{direction}_latency_jitter", jitter)):
            low, high = record.intervals[name]
            assert low < value < high
    assert len(record.provenance["inputs"]) == 4


def test_a_sum_that_stamps_take_apart_is_not_said_to_show_no_more(command, stamped, tmp_path):
    paths = [str(stamped / f"{name}.csv") for name in ("sweep", "steps", "plate", "sent")]
    words = ["identify", "sensing", *paths[:2], "--detections", paths[2], "--commands", paths[3], "--out"]
    status, text, _ = command(*words, str(tmp_path / "out"))
    assert status == 0
    assert "how long the gimbal takes to start" in " ".join(text.split())
    assert "can't show more" not in " ".join(text.split())


def test_one_direction_alone_leaves_the_other_unknown(stamped, tmp_path):
    sweep = IdentifySensing((stamped / "sweep.csv",), (stamped / "plate.csv",), out=tmp_path / "out")
    run_sensing(replace(sweep, commands=stamped / "sent.csv"), Console(quiet=True))
    link = read_sensing(tmp_path / "out" / "sensing.json").link
    assert link.command_latency == pytest.approx(0.010, abs=1e-3)
    assert link.feedback_latency is None
    assert link.feedback_latency_jitter is None


def test_faults_are_told_and_leave_nothing_behind(files, tmp_path):
    good = IdentifySensing((files / "sweep.csv",), (files / "plate.csv",), out=tmp_path / "out")
    faults = [
        (replace(good, logs=()), "no gimbal log given"),
        (replace(good, detections=()), "no detections given"),
        (replace(good, detections=(files / "none.csv",)), "no such file"),
        (replace(good, yaw="angle"), 'no column "angle"'),
        (replace(good, frame="base"), 'no column "rotated_yaw"'),
        (replace(good, frame="optical"), "no offset|behind the camera|expected about"),
        (replace(good, degrees=True), "say --degrees"),
        (replace(good, max_offset_s=0.0), "--max-offset-s must be > 0"),
        (replace(good, target_steps=files / "moments.csv"), "expected 2"),
        (replace(good, logs=(files / "steps.csv",)), "at no offset|expected about"),
        (replace(good, name="a/b"), "--name"),
        (replace(good, commands=files / "none.csv"), "no such file"),
        (replace(good, feedback=files / "moments.csv"), 'no column "sent_s"'),
    ]
    for command, message in faults:
        with pytest.raises(InputError, match=message):
            run_sensing(command, Console(quiet=True))
    assert not (tmp_path / "out").exists()
