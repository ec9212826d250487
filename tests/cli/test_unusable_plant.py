"""What its identification called useless is not trained on without a word."""

import json
from dataclasses import replace

import numpy as np
import pytest

from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.paper.gimbal import printed_plants
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantQuality, read_plant, write_plant
from archerfish.records.recording import make_recording, write_recording_csv

GOOD = PlantQuality(True, 97.1, "step_2.csv", True)
BAD = PlantQuality(False, 3.0, "sweep.csv", False)


@pytest.fixture
def files(tmp_path):
    def write(**quality):
        for axis, plant in printed_plants().items():
            write_plant(tmp_path / f"{axis}.json", replace(plant, quality=quality.get(axis)))
        return SettingFiles(pitch=tmp_path / "pitch.json", yaw=tmp_path / "yaw.json", robot="sentry")

    return write


def test_a_plant_that_was_found_useless_is_refused_with_its_fit_and_the_remedy(files):
    with pytest.raises(
        InputError, match=r"yaw.json: .* sweep.csv \(fitted\) to 3.0 %, expected 80 % or more"
    ) as caught:
        load_setting(files(pitch=GOOD, yaw=BAD))
    assert "yaw.html says what to record" in str(caught.value)
    assert "--accept-unusable" in str(caught.value)


def test_it_may_be_accepted_on_purpose(files):
    assert load_setting(replace(files(yaw=BAD), accept_unusable=True)).yaw.quality == BAD


def test_a_good_plant_and_one_without_a_verdict_are_taken(files):
    assert load_setting(files(pitch=GOOD)).yaw.quality is None


@pytest.mark.parametrize("name", ["train", "evaluate"])
def test_both_commands_refuse_it(files, refused, name):
    pytest.importorskip("jax")
    files(pitch=BAD, yaw=GOOD)
    assert "the plant is not to be used" in " ".join(
        refused(name, "--pitch", "pitch.json", "--yaw", "yaw.json", "--robot", "sentry").split()
    )


@pytest.mark.parametrize(("noise", "usable"), [(0.02, True), (1.5, False)])
def test_identification_writes_its_verdict_into_the_record(command, tmp_path, noise, usable):
    rng = np.random.default_rng(0)
    inputs = rng.standard_normal(600)
    outputs = np.convolve(inputs, 0.3 * 0.7 ** np.arange(20))[:600]
    outputs += noise * outputs.std() * rng.standard_normal(600)
    write_recording_csv(tmp_path / "log.csv", make_recording(inputs, outputs, 0.01))
    status, _, _ = command("identify", "gimbal", "log.csv", "--order", "1", "--axis", "yaw", "--out", "out")
    assert status == 0
    quality = read_plant(tmp_path / "out" / "yaw.json").quality
    assert (quality.usable, quality.log, quality.held_back) == (usable, "log.csv", False)


def test_a_damaged_verdict_is_refused(files, tmp_path):
    files(yaw=GOOD)
    path = tmp_path / "yaw.json"
    facts = json.loads(path.read_text())
    for quality in ({"usable": True}, {**facts["quality"], "usable": "yes"}, 3):
        path.write_text(json.dumps({**facts, "quality": quality}))
        with pytest.raises(InputError, match=r"quality|usable"):
            read_plant(path)
