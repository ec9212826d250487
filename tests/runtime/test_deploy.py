"""What stands between a controller and the robot on a real computer: a fallback, and the lines of deploy.toml."""

import os
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.deploy import _obey
from archerfish.codegen.decision import FIELDS
from archerfish.codegen.library import find_compiler
from archerfish.controllers.registry import make_controller
from archerfish.errors import InputError
from archerfish.protocols import aim
from archerfish.robot import Robot
from archerfish.runtime.configuration import ControllerConfig, DeployConfig, DetectionsConfig, read_config
from archerfish.runtime.deciders import WithFallback, make_decider
from archerfish.safety.gate import Mode
from archerfish.safety.rules import GateConfig
from archerfish.studies.deploy import deploy
from archerfish.task import Task
from archerfish.wires import load_wire

INFANTRY, TASK = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
WIDE = INFANTRY.limits.yaw.replace(high=2.0)
ENDLESS = INFANTRY.replace(limits=INFANTRY.limits.replace(yaw=WIDE.replace(low=None, high=None)))

GIVEN = {name: np.zeros((size,) * (size > 1), np.float32) for name, size in FIELDS.items()}
GIVEN |= {"elapsed": np.float32(0.02), "muzzle_speed": np.float32(18.0), "plate": np.float32([3.0, 0.0, 0.0])}
GIVEN |= {"shots_left": np.float32(9.0), "found": np.array(True), "distrusted": np.array(False)}


class Aims:
    """Asks for a yaw; fails in its own way from its third decision after the switch went on."""

    def __init__(self, yaw, fails=None):
        self.yaw, self.fails, self.asked = yaw, fails, 0

    def reset(self, seen):
        if self.fails == "raises at once":
            raise KeyError("plate")
        return np.zeros(1)

    def step(self, state, seen):
        self.asked += 1
        failing = self.asked > ARMED_AFTER + 2 and self.fails
        if failing == "raises":
            raise ZeroDivisionError("by a distance")
        return state, aim(np.array([[0.0, np.nan if failing == "nan" else self.yaw]]))


ARMED_AFTER = 30
"""Decisions before the operator's switch goes on."""


def decider(*controller):
    return make_decider("own", Aims(*controller), INFANTRY, TASK, GateConfig())


def decided(decider, decisions=7):
    """Return the signs of the yaw commands after the switch went on, and the modes."""
    for _ in range(ARMED_AFTER):
        decider.decide(GIVEN | {"switch_on": np.array(False)})
    verdicts = [decider.decide(GIVEN | {"switch_on": np.array(True)})[0] for _ in range(decisions)]
    angles = np.array([0.0, *(verdict.angle[1] for verdict in verdicts)])
    return np.sign(np.diff(angles)).tolist()[1:], [int(verdict.mode) for verdict in verdicts]


FAULTS = {
    "raises": "ZeroDivisionError: by a distance",
    "nan": "its command is not finite, or absurd",
    "late": "it took 30.0 ms, 3 times in a row",
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_answered_in_the_same_decision_and_for_good(kind):
    slow = {ARMED_AFTER + at for at in (0, 1, 2)} if kind == "late" else {}
    times = iter([time for at in range(99) for time in (at, at + (0.03 if at in slow else 0.001))])
    both = WithFallback(decider(0.5, kind), decider(-0.5), 0.01, lambda: next(times))
    signs, modes = decided(both)
    # The first of both moves to the left for a decision; then the fallback has it brake, and move to the right.
    assert (signs[0], signs[-2:], both.fault.partition(" (")[0]) == (1.0, [-1.0, -1.0], FAULTS[kind])
    assert set(modes) == {Mode.ARMED}


def test_the_operator_may_choose_the_fallback_and_go_back():
    both = WithFallback(decider(0.5), decider(-0.5), 1.0)
    for both.is_fallback_chosen, sign in ((False, 1.0), (True, -1.0), (False, 1.0)):
        signs, _ = decided(both)
        assert signs[-1] == sign
    assert both.fault == ""


def test_what_is_typed_is_switch_and_choice_of_the_fallback():
    class Typed:
        def __init__(self, has_switch):
            self.has_switch, self.switch = has_switch, True
            self.decider = WithFallback(decider(0.5), decider(-0.5), 1.0)

    for has_switch, text, expected in [
        (False, "", (False, "")),
        (False, "\nf\n\n", (False, "it was chosen")),
        (True, "f\nf\n\nf\nx\n", (True, "it was chosen")),
    ]:
        pilot = Typed(has_switch)
        _obey(pilot, text.splitlines(keepends=True))
        assert (pilot.switch, pilot.decider.why_fallback) == expected


def test_a_controller_that_fails_at_once_is_replaced():
    both = WithFallback(decider(0.5, "raises at once"), decider(-0.5), 1.0)
    assert (decided(both)[0][-1], both.fault.partition(" (")[0]) == (-1.0, "KeyError: 'plate'")


@pytest.mark.parametrize("alone", [True, False])
def test_where_all_fail_the_gate_holds_and_is_a_fault_and_the_switch_ends_it(alone):
    kept = decider(0.5, "raises") if alone else WithFallback(decider(0.5, "raises"), decider(-0.5, "raises"), 1.0)
    signs, modes = decided(kept, 12)
    assert modes == [Mode.ARMED] * 2 + [Mode.HOLD] * 4 + [Mode.FAULT] * 6
    assert (kept.error.partition(" (")[0], signs[-5:]) == ("ZeroDivisionError: by a distance", [0.0] * 5)


def test_c_and_numpy_take_a_decision_back_alike():
    if find_compiler() is None:
        pytest.skip("no C compiler is at hand")
    kalman = make_controller("kalman", INFANTRY, TASK)
    in_c, in_numpy = (make_decider("kalman", kalman, INFANTRY, TASK, GateConfig(), in_c=in_c) for in_c in (True, False))
    assert (in_c.language, in_numpy.language) == ("C", "NumPy")
    for both in (in_c, in_numpy):
        decided(both)
        before = both.gate
        first, _ = both.decide(GIVEN | {"switch_on": np.array(True)})
        both.gate = before
        second, _ = both.decide(GIVEN | {"switch_on": np.array(True)})
        assert first.mode == second.mode == Mode.ARMED
    for one, other in zip(in_c.gate, in_numpy.gate, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


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
        ({"wires": ("rm_vision",)}, INFANTRY, r"deploy\.toml: field wires: wire rm_vision: .* no pitch_rate"),
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
    boxed = TASK.replace(command_limit="box")
    refused("box: it has no rate and no acceleration", deploy, "no-lead", INFANTRY, boxed, config, port=port)
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
