import json

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.records.policy import PolicyRecord, write_policy
from archerfish.sensing.observation import UNLIMITED

MUZZLE = {"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0}


@pytest.fixture
def policy(tmp_path):
    """Path of a policy that aims at what it sees."""
    record = PolicyRecord(
        observation="paper",
        frames=0,
        weights=(np.zeros((6, 2), np.float32),),
        biases=(np.zeros(2, np.float32),),
        mean=np.zeros(6, np.float32),
        variance=np.ones(6, np.float32),
        action_scale=np.array([0.03, 0.1], np.float32),
        braking=np.full(2, UNLIMITED, np.float32),
        muzzle=MUZZLE,
        period_s=0.02,
        command_limit="gate",
    )
    write_policy(tmp_path / "policy.json", record)
    return tmp_path / "policy.json"


def test_the_file_lies_beside_the_policy_unless_told_otherwise(policy, tmp_path, capsys) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    main(["export", str(policy)])
    main(["export", str(policy), "--out", str(tmp_path / "deep" / "robot.onnx"), "--json", str(tmp_path / "told.json")])
    assert (tmp_path / "policy.onnx").read_bytes() == (tmp_path / "deep" / "robot.onnx").read_bytes()
    (tmp_path / "policy.onnx").unlink()
    main(["export", str(tmp_path), "--no-check"])  # the run folder
    assert (tmp_path / "policy.onnx").read_bytes() == (tmp_path / "deep" / "robot.onnx").read_bytes()
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["observation"]["kind"] == "paper"
    assert told["bytes"] == (tmp_path / "policy.onnx").stat().st_size
    said = capsys.readouterr().out
    assert "paper policy, opset 17" in said
    assert "angle_command (batch, 2)" in said
    assert "commands the same as NumPy" in said


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["nowhere.json"], "nowhere.json: no such file"),
        (["POLICY", "--out", "policy.bin"], "does not end in .onnx"),
        (["POLICY", "--format", "c"], "--format"),
        (["ARRAYS"], "can't be read"),
        (["EMPTY"], "is a folder without policy.json"),
    ],
)
def test_what_can_not_be_exported_ends_in_one_line_and_leaves_nothing(
    words, complaint, policy, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    before = sorted(tmp_path.iterdir())
    places = {"POLICY": str(policy), "ARRAYS": str(policy.with_suffix(".safetensors")), "EMPTY": "empty"}
    with pytest.raises(SystemExit) as ended:
        main(["export", *(places.get(word, word) for word in words)])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
