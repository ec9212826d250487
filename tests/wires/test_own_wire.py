"""Wires that a team writes, a table and a class: frames made by hand, a rehearsal, and a robot behind a port."""

import math
import os
import re
import shutil
import struct
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from archerfish.dynamics.linear_axis import advance, gimbal_angle, rest_state
from archerfish.robot import Robot
from archerfish.runtime.configuration import DeployConfig, read_config
from archerfish.studies.deploy import deploy
from archerfish.task import Task
from archerfish.wires import Stream, load_wire
from archerfish.wires.wire import WireCommand

EXAMPLES, INFANTRY = Path(__file__).parents[2] / "examples", Path(__file__).parents[1] / "infantry"
TABLE, CLASS = f"{EXAMPLES}/our_wire.toml", f"{EXAMPLES}/our_wire.py:OurWire"
COMMANDS = [WireCommand(np.array([0.1, -0.2]), *state) for state in ((False, False), (True, False), (True, True))]


def summed(data):
    return data + bytes([sum(data) % 256])


def report(time_s, switch, pitch=0.1, yaw=0.5, encoder=0.2):
    """Return a report as the microcontroller of our_wire.py makes it."""
    numbers = struct.pack("<IBfffff", round(1e3 * time_s), switch, pitch, yaw, encoder, 0.0, 0.0)
    return summed(bytes.fromhex("5AA501") + numbers)


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
    return data + struct.pack("<H", value)


def test_the_table_reads_and_writes_what_is_made_by_hand():
    wire = load_wire(TABLE)
    wire.check_complete()
    up = crc(b"\xa5\x01" + struct.pack("<BBhhhhhH", 7, 1, -1000, 5000, 2000, 0, 300, 1580))
    reports = wire.decode(Stream(wire.received).feed(up))
    np.testing.assert_allclose(reports.feedback.angle, [[0.1, 0.5]])
    np.testing.assert_allclose(reports.feedback.rate, [[0.0, 0.3]])
    np.testing.assert_allclose([*reports.muzzle_speed, *reports.base_yaw, *reports.shots_left], [15.8, 0.3, np.nan])
    assert (reports.switch_on.tolist(), wire.has_base_yaw, wire.has_heat) == ([True], True, False)
    idle, control, fire = map(wire.encode, COMMANDS)
    assert idle == crc(b"\xa5\x02" + struct.pack("<BBhh", 0, 0, 0, 0))
    assert control == crc(b"\xa5\x02" + struct.pack("<BBhh", 1, 1, -1000, -2000))
    assert fire == crc(b"\xa5\x02" + struct.pack("<BBhh", 2, 2, -1000, -2000))


def test_the_class_reads_and_writes_what_is_made_by_hand():
    wire, good = load_wire(CLASS), report(12.5, 1)
    damaged = bytearray(report(12.6, 1))
    damaged[9] ^= 1
    reports = wire.decode(Stream(wire.received).feed(bytes(damaged) + good + report(12.7, 2)))
    np.testing.assert_allclose(reports.feedback.sampled_s, [12.5, 12.7])
    np.testing.assert_allclose(reports.feedback.angle[0], [0.1, 0.5], rtol=1e-6)
    np.testing.assert_allclose(reports.base_yaw, [0.3, 0.3], rtol=1e-6)
    assert (wire.has_base_yaw, reports.switch_on.tolist()) == (True, [True, False])
    for state, command in enumerate(COMMANDS):
        assert wire.encode(command) == summed(bytes.fromhex("5AA502") + struct.pack("<Bff", state, 0.1, -0.2))


@pytest.mark.parametrize(
    "old, new, pattern",
    [
        ("np.stack([pitch, yaw], axis=-1)", "pitch", r"angle: .*shape \(1, 2\) for 1 reports, got \(1,\)"),
        (".reshape(-1, 2)", ".ravel()", r"rate: .*shape \(1, 2\) for 1 reports, got \(2,\)"),
        ("muzzle_speed=unknown", "muzzle_speed=15.0", r"muzzle_speed: .*shape \(1,\) for 1 reports, got float"),
        ("self.report.decode(frame.data) for", "frame.missing for", r"line \d+: AttributeError: .*missing"),
    ],
)
def test_a_class_whose_reports_have_other_shapes_is_refused_by_file_and_name(old, new, pattern, tmp_path, refused):
    text = Path(f"{EXAMPLES}/our_wire.py").read_text()
    assert text.count(old) == 1
    (tmp_path / "mine.py").write_text(text.replace(old, new).replace(" if frame.data == with_sum(frame.data)", ""))
    refused(rf"mine\.py:OurWire: .*{pattern}", load_wire, f"{tmp_path}/mine.py:OurWire")


def test_a_controller_and_a_table_of_our_own_are_rehearsed():
    pytest.importorskip("mujoco")
    from archerfish.studies.rehearse import rehearse

    own = f"{EXAMPLES}/line_fit.py:LineFit"
    found = rehearse(own, INFANTRY, wire=TABLE, seconds=2, tuning="start")
    assert (found.controller, found.wire, found.violations, found.fault) == ("LineFit", "our_wire", {}, "")
    assert found.rate.hits > 70


def test_the_files_of_the_page_are_read_and_cost_no_hits(tmp_path):
    pytest.importorskip("mujoco")
    from archerfish.studies.rehearse import rehearse

    page = (EXAMPLES.parent / "docs" / "deployment.md").read_text()
    configs = list[DeployConfig]()
    for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[:2]:
        (tmp_path / "deploy.toml").write_text(text)
        configs.append(read_config(tmp_path))
    least, whole = configs
    assert f"{least}" == f"{DeployConfig(yaw_reference='fixed-chassis')}"
    assert (whole.wires, whole.yaw_reference, whole.gate.near_deg) == (("sp_vision_25",), "fixed-chassis", 20.0)
    found = rehearse(whole.controller.mode, INFANTRY, config=whole, seconds=3, tuning="start")
    assert (found.violations, found.fault) == ({}, "")
    assert sum(found.hits) > 0.8 * sum(found.fired) > 30


class Microcontroller:
    """The robot's end of a pseudo-terminal: its gimbal follows its plants, its switch goes on after half a second."""

    def __init__(self):
        self._robot, self._computer = os.openpty()
        tty.setraw(self._computer)
        os.set_blocking(self._robot, False)
        self.name, self.states, self._is_open = os.ttyname(self._computer), [], True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        stream, model, begun = Stream([load_wire(CLASS).command]), Robot.load(INFANTRY).gimbal(0.002), time.monotonic()
        plant = rest_state(model, np.zeros(2))
        while self._is_open:
            since = time.monotonic() - begun
            try:
                data = os.read(self._robot, 4096)
            except BlockingIOError:
                data = b""
            for frame in stream.feed(data):
                values = frame.layout.decode(frame.data)
                self.states.append(values["state"])
                if values["state"]:
                    plant = advance(model, plant, np.array([values["pitch"], values["yaw"]]))
            pitch, yaw = gimbal_angle(model, plant).tolist()
            os.write(self._robot, report(since, since > 2.0 and math.fmod(since, 4.0) > 1.0, pitch, yaw, yaw))
            time.sleep(0.002)

    def close(self):
        self._is_open = False
        self._thread.join()
        os.close(self._robot)
        os.close(self._computer)


def test_a_controller_and_a_wire_of_our_own_are_deployed_by_deploy_toml_and_let_go_at_the_end(tmp_path):
    pytest.importorskip("serial", reason="pyserial is not installed")
    robot, hardware, armed = shutil.copytree(INFANTRY, tmp_path / "robot"), Microcontroller(), []
    for file in ("our_wire.py", "line_fit.py"):
        shutil.copy(EXAMPLES / file, robot)
    (robot / "deploy.toml").write_text(
        f'port = "{hardware.name}"\nwires = ["./our_wire.py:OurWire"]\ndetections.address = "127.0.0.1:0"\n'
        'controller = { mode = "./line_fit.py:LineFit", fallback = "" }\n'
    )

    def watch(pilot):
        armed.append(pilot.state_text == "armed")
        return armed[-5:] == 5 * [True]

    deployment = deploy("", Robot.load(robot), Task.load("any"), read_config(robot), seconds=30, watch=watch)
    time.sleep(0.1)
    hardware.close()
    assert armed[-1], "it was armed"
    assert (deployment.controller, deployment.port, deployment.fault) == ("LineFit", hardware.name, "")
    assert {1} <= {*hardware.states} <= {0, 1}
    assert hardware.states[-1] == 0
