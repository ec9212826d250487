"""A rehearsal: its command shoots through bytes, counts, and writes."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.runtime.configuration import DeployConfig, DetectionsConfig
from archerfish.safety.rules import GateConfig
from archerfish.studies.rehearsal import Rehearsal, RehearsedShot
from archerfish.studies.rehearse import rehearse
from archerfish.virtual_robot.emulator import Fault
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
    assert f"About: archerfish rehearse {robot} --controller kalman" in printed
    assert "controller kalman; settings the defaults of deploy.toml." in printed
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


def test_decisions_count_over_all_seconds_where_none_has_a_whole_number():
    found = of_shots([True] * 600, decisions_s=0.03)
    rate = found.rate
    # Of the multiples of 30 ms those up to 1.5 s are 50, and those up to 21.5 s are 716.
    assert (rate.hits, rate.decisions) == (600, 666)
    assert 0.8 < rate.low < rate.rate < rate.high <= 1.0
    late = found.replace(hits=(34, *found.hits[1:]))
    assert late.rate.hits == 604, "a second of real time may have a decision more"


def test_what_the_settings_are_is_known_and_a_latency_in_seconds_is_in_doubt():
    detections = DetectionsConfig(position_m=(0.08, 0.0, 0.05), latency_ms=0.0351)
    config = DeployConfig(detections=detections, gate=GateConfig(shots_per_s=5.0))
    robot = {"robot": INFANTRY, "virtual": "identified"}
    found = rehearse("no-lead", **robot, config=config, seconds=2, tuning="start")
    assert (found.camera_m, found.hit_radius_m, found.shots_per_s) == ((0.08, 0.0, 0.05), 0.06, 5.0)
    [_, doubt] = found.report.doubts
    assert "is 0.0351 ms, and the records of infantry have 35.1 ms" in doubt
    known = "\n".join(found.report.known)
    assert "At most 5 pellets a second" in known
    assert "The camera is at (0.08, 0, 0.05) m" in known
    near = config.replace(detections=detections.replace(latency_ms=60.0))
    right = rehearse("no-lead", **robot, config=near, seconds=2, tuning="start")
    assert right.latencies_ms == pytest.approx((60.0, 35.1), abs=0.1)
    assert len(right.report.doubts) == 1
    assert "No gate.shots_per_s in deploy.toml" in str(of_shots([True] * 20))


@pytest.mark.parametrize("virtual", ["infantry", "identified"])
def test_a_camera_off_the_pivot_costs_no_hits_where_the_computer_has_its_place(virtual):
    if virtual == "infantry":
        pytest.importorskip("mujoco")
    config = DeployConfig(detections=DetectionsConfig(position_m=(0.08, 0.05, 0.05)))
    found = rehearse("kalman", INFANTRY, virtual=virtual, config=config, seconds=4, tuning="start")
    assert sum(found.fired) == 200
    assert sum(found.hits) > 160


def test_pictures_over_time_have_one_axis_with_the_faults_and_the_radius_of_a_hit():
    faults = (Fault("silence", 5.0, 6.0), Fault("hidden", 9.0, 9.5))
    found = of_shots([True, True, False] * 200).replace(faults=faults, hit_radius_m=0.06)
    seconds, aim, misses = (draw() for _, draw in found.report.figures)
    for panel in [*seconds.axes, *aim.axes]:
        assert panel.get_xlim() == (0.0, 21.5)
        shaded = [patch.get_x() for patch in panel.patches if patch.get_alpha() == 0.25]
        assert shaded == [5.0, 9.0]
    assert len({figure.get_figwidth() for figure in (seconds, aim, misses)}) == 1, "so that texts are of one size"
    texts = [[text.get_text() for text in figure.legends[0].get_texts()] for figure in (seconds, aim, misses)]
    assert texts[0] == ["fault", "pellets", "hits"]
    assert {"line of sight", "command", "gimbal", "radius of a hit"} < {*texts[1]}
    assert texts[2] == ["hit", "miss", "radius of a hit"]
    [outline] = [line for line in misses.axes[0].lines if line.get_label() == "radius of a hit"]
    assert np.hypot(*outline.get_data()) == pytest.approx(60.0)


@pytest.mark.parametrize("command", ["rehearse", "emulate"])
@pytest.mark.parametrize("words", [["silence", "5"], ["silence", "5", "six"], ["flip", "1", "2", "3"]])
def test_a_fault_is_a_kind_and_two_times(command, words, capsys):
    with pytest.raises(SystemExit):
        main([command, str(INFANTRY), "--virtual", "identified", "--fault", *words])
    printed = capsys.readouterr().err
    assert "--fault: expected three words for each fault, KIND BEGIN END" in printed
    assert "write for instance silence 3 4" in printed


def test_what_cannot_be_rehearsed_is_refused_at_once(refused):
    refused("paper has no record of its camera and link, .*archerfish rehearse my-robot", rehearse, "kalman")
    refused("rm_vision: .* no pitch_rate", rehearse, "kalman", INFANTRY, wire="rm_vision", tuning="start")
    refused("seconds must be at least 2", rehearse, "kalman", INFANTRY, seconds=1)
    refused("there is no wire", load_wire, "canbus")
    refused("no robot 'worm'", rehearse, "kalman", INFANTRY, virtual="worm")
    far = {"config": DeployConfig(detections=DetectionsConfig(position_m=(2.0, 0.0, 0.0))), "tuning": "start"}
    refused("deploy.toml: field detections.position_m: .*<= 1.0, got 2.0", rehearse, "kalman", INFANTRY, **far)


def test_with_the_referee_s_heat_a_burst_is_followed_by_what_cools():
    found = rehearse("no-lead", INFANTRY, wire=["sp_vision_25", "referee"], seconds=5, tuning="start")
    assert sum(found.fired[:2]) > 10
    assert found.fired[2:] == (4, 4, 4)
