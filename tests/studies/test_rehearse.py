"""A rehearsal: its command shoots through bytes, counts, and writes."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.studies.rehearse import Rehearsal, RehearsedShot, rehearse
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
    printed = capsys.readouterr().out
    assert f"{stored.rate.hits} of 100 pellets hit" in printed
    assert "too few for an interval" in printed
    page = (robot / "rehearsal" / "report.html").read_text()
    assert "Rehearsal of kalman" in page
    assert page.count("<svg") == 3


def of_shots(hits, decisions_s=0.02, seconds=20):
    """Return a rehearsal with some pellets, which miss by 50 mm or 100 mm."""
    per_second = math.ceil(len(hits) / seconds)
    rows = np.resize(hits, (seconds, per_second)).sum(axis=1)
    pair = (0.1, 0.2)
    shots = [RehearsedShot(0.02 * n, hit, pair, pair, pair, (0.05 if hit else 0.1, 0.0)) for n, hit in enumerate(hits)]
    texts = dict.fromkeys(("robot", "virtual", "wire", "controller", "commit"), "x")
    counts = {"hits": tuple(map(int, rows)), "fired": (per_second,) * seconds, "messages": {}, "violations": {}}
    return Rehearsal(target=(3.0, 0.4, 0.25, 0.1), period_s=decisions_s, seed=0, shots=tuple(shots), **texts, **counts)


def test_hits_count_by_pellet_first_and_have_an_interval_where_there_are_enough(has_units):
    found = of_shots([True, True, True, False] * 125)
    value, low, high, _ = found.pellet_rate
    assert value == 75.0
    assert 65.0 < low < 75.0 < high < 83.0
    assert "375 of 500 pellets hit, 75.0 % (95 %: " in str(found)
    assert "375 of 1000 decisions hit, 37.5 %" in str(found)
    assert math.isnan(of_shots([True] * 480).pellet_rate.low)
    has_units(found.report, 3)
    nothing = of_shots([]).replace(fired=(0,) * 20, hits=(0,) * 20)
    assert "No pellet left." in str(nothing)
    assert len(nothing.report.figures) == 1


def test_what_cannot_be_rehearsed_is_refused_at_once(refused):
    refused("paper has no record of its camera and link, .*archerfish rehearse my-robot", rehearse, "kalman")
    refused("rm_vision: .* no pitch_rate", rehearse, "kalman", INFANTRY, wire="rm_vision", tuning="start")
    refused("seconds must be at least 2", rehearse, "kalman", INFANTRY, seconds=1)
    refused("there is no wire", load_wire, "canbus")
    refused("no robot 'worm'", rehearse, "kalman", INFANTRY, virtual="worm")


def test_with_the_referee_s_heat_a_burst_is_followed_by_what_cools():
    found = rehearse("no-lead", INFANTRY, wire=["sp_vision_25", "referee"], seconds=5, tuning="start")
    assert sum(found.fired[:2]) > 10
    assert found.fired[2:] == (4, 4, 4)
