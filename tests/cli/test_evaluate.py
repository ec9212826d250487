from pathlib import Path

import numpy as np
import pytest

from archerfish.evaluation.results import read_results
from archerfish.records.policy import TRACKER_FACTS, PolicyRecord, write_policy

pytest.importorskip("jax")


def policy(observation: str, size: int, **facts) -> PolicyRecord:
    """An untrained policy of one layer."""
    return PolicyRecord(
        observation=observation,
        frames=4,
        weights=(np.zeros((size, 2), np.float32),),
        biases=(np.zeros(2, np.float32),),
        mean=np.zeros(size, np.float32),
        variance=np.ones(size, np.float32),
        action_scale=np.full(2, 0.1, np.float32),
        braking=np.full(2, 0.03, np.float32),
        muzzle={"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0},
        period_s=0.02,
        command_limit="gate",
        tracker=dict.fromkeys(TRACKER_FACTS, 0.01) if observation == "tracked" else {},
        **facts,
    )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (policy("history", 35, training={"seed": 3}), policy("history", 35, training={"seed": 3})),
        # A tracked policy is called history in the results, and one without a seed has seed 0.
        (policy("history", 35, training={"seed": 3}), policy("tracked", 55, training={"seed": 3})),
        (policy("history", 35, training={"seed": 0}), policy("history", 35)),
    ],
)
def test_policies_that_results_can_not_tell_apart_are_refused(refused, tmp_path: Path, one, other) -> None:
    for name, each in (("one", one), ("other", other)):
        write_policy(tmp_path / f"{name}.json", each)
    assert "history policy of seed" in refused("evaluate", "one.json", "other.json")


def test_shooting_with_a_robot_is_checked_before_anything_is_tuned(refused) -> None:
    assert "robot" in refused("evaluate", "--on", "nobody", "--sensing", "sensing.json", "--robot", "me")
    assert "--on needs --sensing" in refused("evaluate", "--on", "infantry")
    assert "--motion takes the place of eq (7)" in refused("evaluate", "--target", "any", "--motion", "./a.py:Away")


def test_a_motion_is_shot_at_for_one_second_and_for_three(command, tmp_path: Path) -> None:
    few = ("--target", "pass", "--controllers", "no-lead", "--engagements", "2")
    status, out, err = command("evaluate", *few, "--out", "shot")
    assert status == 0, err
    assert "engagements of 3 s" in " ".join(out.split())
    cells = read_results(tmp_path / "shot" / "results.json").cells
    assert {(cell.table, cell.motion, cell.controller, cell.shots) for cell in cells} == {
        (table, "pass", name, shots)
        for table, shots in (("motions, 1 s", 100), ("motions, 3 s", 300))
        for name in ("perfect", "no-lead")
    }
    assert len(cells) == 2 * 2 * 4
    assert all(cell.bound is None and cell.paper is None for cell in cells)
    page = (tmp_path / "shot" / "report.html").read_text()
    assert "Other motions, engagements of 3 s, limit gate" in page
    assert "Table I" not in page.partition("The conditions")[0]
