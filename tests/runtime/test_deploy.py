"""What stands between a controller and the robot on a real computer: a fallback, and the lines of deploy.toml."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from archerfish.errors import InputError
from archerfish.protocols import Command
from archerfish.robot import Robot
from archerfish.runtime.configuration import ControllerConfig, DeployConfig, DetectionsConfig, read_config
from archerfish.runtime.fallback import WithFallback
from archerfish.safety.rules import GateConfig
from archerfish.studies.deploy import deploy
from archerfish.task import Task
from archerfish.wires import load_wire

INFANTRY, TASK = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
WIDE = INFANTRY.limits.yaw.replace(high=2.0)
ENDLESS = INFANTRY.replace(limits=INFANTRY.limits.replace(yaw=WIDE.replace(low=None, high=None)))


class Seen(NamedTuple):
    """What a controller sees: the command in force is enough here."""

    command: np.ndarray


SEEN = Seen(np.zeros((1, 2)))


class Aims:
    """Commands an angle; fails in its own way from its third decision on."""

    def __init__(self, angle, fails=None):
        self.angle, self.fails = angle, fails

    def reset(self, seen):
        return 0

    def step(self, count, seen):
        failing = count >= 2 and self.fails
        if failing == "raises":
            raise ZeroDivisionError("by a distance")
        angle = np.full((1, 2), np.nan if failing == "nan" else self.angle)
        return count + 1, Command(angle, np.zeros_like(angle), np.array([True]), np.ones(1))


FAULTS = {
    "raises": "ZeroDivisionError: by a distance",
    "nan": "its command is not finite, or absurd",
    "late": "it took 30.0 ms, 3 times in a row",
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_answered_in_the_same_decision_and_for_good(kind):
    steps = [0.001, 0.001, *(3 * [0.03] if kind == "late" else [0.001])]
    times = iter([time for at, step in enumerate(steps) for time in (at, at + step)])
    both = WithFallback(Aims(0.1, kind), Aims(0.2), 0.01, lambda: next(times))
    memory, angles = both.reset(SEEN), []
    for _ in range(7):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    own = len(steps) - 1
    assert (angles, both.fault) == (own * [0.1] + (7 - own) * [0.2], FAULTS[kind])


def test_the_operator_may_choose_the_fallback_and_go_back():
    both, angles = WithFallback(Aims(0.1), Aims(0.2), 1.0), []
    memory = both.reset(SEEN)
    for both.is_fallback_chosen in (False, True, False):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    assert (angles, both.fault) == ([0.1, 0.2, 0.1], "")


def test_a_controller_that_fails_at_once_is_replaced():
    class Broken(Aims):
        def reset(self, seen):
            raise KeyError("plate")

    both = WithFallback(Broken(0.1), Aims(0.2), 1.0)
    _, command = both.step(both.reset(SEEN), SEEN)
    assert (command.angle[0, 0], both.fault) == (0.2, "KeyError: 'plate'")


def test_where_both_fail_there_is_no_command():
    both = WithFallback(Aims(0.1, "raises"), Aims(0.2, "raises"), 1.0)
    memory, angles = both.reset(SEEN), []
    for _ in range(4):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    np.testing.assert_array_equal(angles, [0.1, 0.1, np.nan, np.nan])
    assert not command.fire.any()


def test_files_of_deploy_toml_are_looked_for_from_its_folder(tmp_path, monkeypatch):
    robot, elsewhere = tmp_path / "robot", tmp_path / "elsewhere"
    robot.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    (robot / "own.toml").write_text("[up]\nfields = ['= 01']\n")
    (robot / "deploy.toml").write_text('wires = ["own.toml", "referee"]\ncontroller.mode = "./mine.py:Aim"\n')
    config = read_config(robot)
    assert config.wires == (f"{robot}/own.toml", "referee")
    assert "up" in load_wire(*config.wires).layouts
    assert (config.controller.mode, config.controller.fallback) == (f"{robot}/mine.py:Aim", "kalman")


WITHOUT_PORT = r"deploy\.toml: port /dev/ttyNone: there is no such port"


def sensing(**camera):
    return INFANTRY.sensing.replace(camera=INFANTRY.sensing.camera.replace(**camera))


def test_a_latency_counts_from_exposures_or_comes_from_deploy_toml(refused):
    usual = DetectionsConfig()
    assert usual.latency_s(INFANTRY) == INFANTRY.sensing.camera.latency
    relative = INFANTRY.replace(sensing=sensing(latency_basis="feedback"))
    refused(r"35\.1 ms, is less the delay of the gimbal's feedback.*write latency_ms to", usual.latency_s, relative)
    without = INFANTRY.replace(sensing=sensing(latency_basis="", latency=None))
    for robot in (without, INFANTRY.replace(sensing=None)):
        refused(r"no latency of its camera.*write latency_ms to \[detections\] of deploy.toml", usual.latency_s, robot)
    for robot in (relative, without):
        assert DetectionsConfig(latency_ms=20.0).latency_s(robot) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("lines", "robot", "pattern"),
    [
        ({}, INFANTRY, r"deploy\.toml: the yaw's range, -75° to 75°, is from .*add yaw_reference = \"encoder\" if"),
        ({"yaw_reference": "encoder"}, INFANTRY, WITHOUT_PORT),
        ({"yaw_reference": "fixed-chassis"}, INFANTRY, WITHOUT_PORT),
        ({"wires": ("roborts",)}, INFANTRY, WITHOUT_PORT),
        ({}, ENDLESS, WITHOUT_PORT),
        ({"gate": GateConfig(yaw=INFANTRY.limits.yaw)}, ENDLESS, "the yaw's range, -75° to 75°"),
        ({"wires": ("canbus",)}, INFANTRY, r"deploy\.toml: field wires: there is no wire 'canbus'"),
        ({"wires": ("rm_vision",)}, INFANTRY, r"deploy\.toml: field wires: wire rm_vision: no frame has pitch"),
        (
            {"gate": GateConfig(yaw=WIDE), "yaw_reference": "encoder"},
            INFANTRY,
            r"deploy\.toml: gate\.yaw: expected",
        ),
        ({"yaw_reference": "encoder", "port": ""}, INFANTRY, r"deploy\.toml: field port: expected that of the robot"),
    ],
)
def test_what_a_line_of_deploy_toml_makes_impossible_is_refused_with_its_name(lines, robot, pattern, refused):
    pytest.importorskip("serial", reason="pyserial is not installed")
    config = DeployConfig(**{"port": "/dev/ttyNone"} | lines)
    refused(pattern, deploy, "no-lead", robot, TASK, config, tuning="start")


def test_a_port_of_the_command_line_is_not_blamed_on_deploy_toml(refused):
    config = DeployConfig(yaw_reference="encoder")
    refused(r"^port /dev/ttyNone: there is no such", deploy, "no-lead", INFANTRY, TASK, config, port="/dev/ttyNone")
    robot, computer = os.openpty()
    port = os.ttyname(computer)
    for line in ("mode", "fallback"):
        config = DeployConfig(
            yaw_reference="encoder", controller=ControllerConfig(**{"mode": "no-lead", line: "kalmn"})
        )
        pattern = rf"deploy\.toml: field controller\.{line}: .*perhaps you meant kalman"
        refused(pattern, deploy, "", INFANTRY, TASK, config, port=port, tuning="start")
    refused("^controller must be one of", deploy, "kalmn", INFANTRY, TASK, config, port=port, tuning="start")
    os.close(robot)
    os.close(computer)


def test_deploy_toml_has_defaults_and_refuses_what_it_does_not_know(tmp_path):
    usual = read_config(tmp_path)
    assert (usual.wires, usual.controller.fallback, usual.detections.latency_ms) == (("sp_vision_25",), "kalman", None)
    assert read_config(None).port == DeployConfig().port == ""
    file = tmp_path / "deploy.toml"
    file.write_text('wires = ["sp_vision_25", "referee"]\n[gate]\nshots_per_s = 8.0\n[detections]\nlatency_ms = 12\n')
    config = read_config(tmp_path)
    assert (config.wires, config.gate.shots_per_s, config.detections.latency_ms) == (("sp_vision_25", "referee"), 8, 12)
    wrong = {
        "watchdog_ms = 500": "unknown field watchdog_ms",
        "baud = 5": "field baud: ",
        "[gate]\nstale = 1.0": "gate",
        "[detections]\nlatency_ms = -1": "field detections.latency_ms: ",
        "port = ": "is not TOML",
    }
    for text, expected in wrong.items():
        file.write_text(text)
        with pytest.raises(InputError, match=r"deploy\.toml: .*" + expected.replace(".", r"\.")):
            read_config(tmp_path)
