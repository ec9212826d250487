from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.cli.setting_remarks import policy_remarks, setting_remarks
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.limits import write_limits
from archerfish.records.muzzle import write_muzzle
from archerfish.records.plant import write_plant
from archerfish.records.policy import PolicyRecord
from archerfish.records.provenance import provenance
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord, write_sensing
from archerfish.records.storage import write_json
from archerfish.simulation.setting import paper_muzzle

ZEROS = np.zeros(2, np.float32)
POLICY = PolicyRecord(
    observation="paper",
    frames=1,
    weights=(np.zeros((2, 2), np.float32),),
    biases=(ZEROS,),
    mean=ZEROS,
    variance=ZEROS + 1,
    action_scale=ZEROS + 1,
    braking=ZEROS + 1,
    muzzle={"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0},
    period_s=0.02,
    command_limit="gate",
)
CAMERA = CameraRecord(80.0, 0.0, 0.0, 1e-3, 1e-3, 0.01, 3.0, 0.0, 0.0)


@pytest.fixture
def files(tmp_path: Path) -> SettingFiles:
    for axis, plant in printed_plants().items():
        write_plant(tmp_path / f"{axis}.json", plant)
    write_muzzle(tmp_path / "muzzle.json", paper_muzzle(assumed_conditions()))
    write_limits(tmp_path / "limits.json", gate_limits())
    write_sensing(tmp_path / "sensing.json", SensingRecord(CAMERA, LinkRecord(200.0, command_latency=0.01)))
    names = ("pitch", "yaw", "muzzle", "sensing", "limits")
    return SettingFiles(**{name: tmp_path / f"{name}.json" for name in names}, robot="infantry")


def said(files: SettingFiles) -> list[str]:
    return list(setting_remarks(files, load_setting(files)))


def test_a_robot_that_is_wholly_known_and_the_paper_s_need_no_remark(files: SettingFiles) -> None:
    assert said(files) == said(SettingFiles()) == []


def test_what_stands_in_for_a_file_is_named(files: SettingFiles) -> None:
    (told,) = said(replace(files, pitch=None, yaw=None))
    assert told == "identified-infantry is not all of your robot: it has the paper's plants (--pitch, --yaw)"


def test_a_command_latency_that_is_not_known_is_told(files: SettingFiles) -> None:
    write_sensing(files.sensing, SensingRecord(CAMERA, LinkRecord(200.0)))
    (told,) = said(files)
    assert "sensing.json: the command latency is not known" in told


def test_a_policy_that_was_trained_with_other_files_is_told_of(files: SettingFiles) -> None:
    setting, path = load_setting(files), Path("policy.json")
    same = replace(POLICY, provenance=provenance(0, setting.inputs))
    assert list(policy_remarks(path, same, setting)) == []
    write_sensing(files.sensing, SensingRecord(CAMERA, LinkRecord(100.0, command_latency=0.01)))
    (told,) = policy_remarks(path, same, setting)
    assert f"trained with sensing.json, which the evaluation has not and not with {files.sensing}" in told
    (told,) = policy_remarks(path, replace(POLICY, provenance=provenance(0)), setting)
    assert "was trained for the paper's gimbal and not with" in told


def test_the_files_that_a_policy_was_trained_for_are_told_as_options(files: SettingFiles, tmp_path: Path) -> None:
    setting, path = load_setting(SettingFiles()), tmp_path / "run" / "policy.json"
    policy = replace(POLICY, provenance=provenance(0, load_setting(files).inputs))
    write_json(path.with_name("config.json"), {"setting": {"sensing": str(files.sensing), "robot": "infantry"}})
    (told,) = policy_remarks(path, policy, setting)
    assert told.endswith(f"; for the one it was trained for add --sensing {files.sensing} --robot infantry")


def test_a_policy_that_was_trained_with_a_plant_in_code_is_named_with_what_to_type(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("")
    setting, path = load_setting(SettingFiles()), tmp_path / "run" / "policy.json"
    policy = replace(POLICY, provenance=provenance(0, [tmp_path / "mine.py"]))
    write_json(path.with_name("config.json"), {"setting": {"plant": "./my folder/mine.py:gimbal", "robot": "me"}})
    (remark,) = policy_remarks(path, policy, setting)
    assert "was trained with mine.py, which the evaluation has not" in remark
    assert remark.endswith("trained for read its code, then add --plant './my folder/mine.py:gimbal' --robot me")


def test_policies_of_unknown_making_and_those_made_from_logs_are_not_compared(files: SettingFiles) -> None:
    setting = load_setting(files)
    for origin in ({}, {"inputs": {"yaw_sweep.csv": "0" * 64}}):
        assert list(policy_remarks(Path("policy.json"), replace(POLICY, provenance=origin), setting)) == []
