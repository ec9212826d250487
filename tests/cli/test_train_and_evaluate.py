import json
from pathlib import Path

import numpy as np
import pytest

from archerfish.evaluation.results import read_results
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import write_plant

pytest.importorskip("jax")

TRAINING = ["policy.json", "policy.safetensors", "checkpoint.json", "checkpoint.safetensors", "curve.svg", "log.jsonl"]


@pytest.fixture
def robot(tmp_path: Path) -> list[str]:
    """Options of a robot whose plants were identified."""
    options = ["--robot", "sentry"]
    for axis, plant in printed_plants().items():
        write_plant(tmp_path / f"{axis}.json", plant)
        options += [f"--{axis}", f"{axis}.json"]
    return options


def test_a_policy_is_trained_evaluated_and_reported(command, tmp_path, robot):
    small = ["--target", "paper", "--ppo.steps", "200", "--ppo.environments", "8", "--ppo.rollout", "6"]
    small += ["--ppo.hidden", "4", "--observation", "paper", "--seed", "3", "--no-tensorboard"]
    status, out, err = command("train", *small, *robot, "--out", "train", "--json", "train.json")
    assert status == 0
    lacking = "identified-sentry is not all of your robot: it has the assumed muzzle (--muzzle) and the paper's limits"
    assert lacking in err
    written = {path.name for path in (tmp_path / "train").iterdir() if not path.name.startswith("events.")}
    assert written == {*TRAINING, "config.json", ".archerfish.json"}
    told = json.loads((tmp_path / "train.json").read_text())
    assert told["policy"] == "train/policy.json"
    assert np.isfinite(told["mean_return"])
    assert "train/policy.json" in out
    configuration = json.loads((tmp_path / "train" / "config.json").read_text())
    assert configuration["ppo"]["hidden"] == 4
    assert configuration["setting_name"] == "identified-sentry"
    assert set(configuration["provenance"]["inputs"]) == {"pitch.json", "yaw.json"}

    few = ["--controllers", "no-lead", "--engagements", "2"]
    status, out, err = command("evaluate", "train/policy.json", *robot, *few, "--out", "shot", "--json", "shot.json")
    assert status == 0
    assert "was trained" not in err
    results = read_results(tmp_path / "shot" / "results.json")
    assert {(cell.controller, cell.policy_seed) for cell in results.cells} == {
        ("perfect", None),
        ("no-lead", None),
        ("paper", 3),
    }
    assert len(results.cells) == 3 * 8
    assert {cell.setting for cell in results.cells} == {"identified-sentry"}
    assert all(cell.shots == 100 for cell in results.cells)
    assert json.loads((tmp_path / "shot.json").read_text())["cells"][0]["shots"] == 100
    assert max(map(len, out.splitlines())) <= 80
    assert "paper (3)" in out

    page = (tmp_path / "shot" / "report.html").read_text()
    status, out, _ = command("report", "shot", "--out", "shot/again.html")
    assert (status, out) == (0, "report: shot/again.html\n")
    assert (tmp_path / "shot" / "again.html").read_text() == page


def test_a_policy_trained_by_gradients_is_evaluated_like_any_other(command, tmp_path):
    small = ["--gradient.steps", "100", "--gradient.environments", "4", "--gradient.window", "3"]
    small += [
        "--gradient.hidden",
        "4",
        "--target",
        "paper",
        "--observation",
        "paper",
        "--command-limit",
        "box",
        "--seed",
        "3",
    ]
    small += ["--no-tensorboard"]
    assert command("train", "--trainer", "gradient", *small, "--out", "train")[0] == 0
    assert {path.name for path in (tmp_path / "train").iterdir()} == {*TRAINING, "config.json", ".archerfish.json"}
    record = json.loads((tmp_path / "train" / "policy.json").read_text())
    assert record["training"]["gradient"]["window"] == 3
    few = ["--command-limit", "box", "--controllers", "no-lead", "--engagements", "2"]
    assert command("evaluate", "train/policy.json", *few, "--out", "shot")[0] == 0
    cells = read_results(tmp_path / "shot" / "results.json").cells
    assert sum(cell.controller == "paper" and cell.policy_seed == 3 for cell in cells) == 8
