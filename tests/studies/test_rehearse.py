"""A rehearsal: its command shoots through bytes, counts, and writes."""

import shutil
from pathlib import Path

import pytest

from archerfish.cli.main import main
from archerfish.studies.rehearse import Rehearsal, rehearse
from archerfish.wires import load_wire

INFANTRY = Path(__file__).parents[1] / "infantry"


def test_the_command_counts_every_decision_and_writes(tmp_path, capsys):
    pytest.importorskip("mujoco")
    robot = shutil.copytree(INFANTRY, tmp_path / "robot")
    main(["rehearse", str(robot), "--controller", "kalman", "--tuning", "start", "--seconds", "2", "--seed", "3"])
    stored = Rehearsal.load(robot / "rehearsal" / "rehearsal.json")
    assert (len(stored.hits), stored.fired, stored.rate.decisions) == (2, (50, 50), 100)
    assert stored.rate.rate > 0.7
    assert stored.violations == {}
    assert f"{stored.rate.hits} of 100 decisions hit" in capsys.readouterr().out
    assert "Rehearsal of kalman" in (robot / "rehearsal" / "report.html").read_text()


def test_what_cannot_be_rehearsed_is_refused_at_once(refused):
    refused("no latency of its camera", rehearse, "kalman", "paper")
    refused("rm_vision: no frame has pitch", rehearse, "kalman", INFANTRY, wire="rm_vision", tuning="start")
    refused("seconds must be at least 2", rehearse, "kalman", INFANTRY, seconds=1)
    refused("there is no wire", load_wire, "canbus")
