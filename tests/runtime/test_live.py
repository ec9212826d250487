"""Two programs over a pseudo-terminal: an emulated robot, and the computer that shoots with it."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("serial", reason="pyserial is not installed")
pytest.importorskip("mujoco", reason="the virtual robot needs MuJoCo")
from archerfish.robot import Robot
from archerfish.runtime.configuration import DeployConfig, DetectionsConfig
from archerfish.studies.live_rehearsal import rehearse_live
from archerfish.task import Task
from archerfish.virtual_robot.emulator import Fault

INFANTRY = Path(__file__).parents[1] / "infantry"


def program(*words):
    command = [sys.executable, "-m", "archerfish", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def until(stream, pattern):
    """Return the match in the first line that has it."""
    for line in stream:
        if match := re.search(pattern, line):
            return match
    raise AssertionError(f"no line has {pattern}")


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_an_emulated_robot_is_shot_with_and_the_fire_ends_with_the_program(tmp_path, how):
    robot = tmp_path / "robot"
    shutil.copytree(INFANTRY, robot)
    address = f"127.0.0.1:{20_000 + os.getpid() % 20_000}"
    lines = f'yaw_reference = "fixed-chassis"\ndetections.address = "{address}"\n'
    (robot / "deploy.toml").write_text(lines)
    emulator = pilot = program("emulate", robot, "--seconds", 4)
    try:
        port = until(emulator.stdout, r"^port (\S+)")[1]
        words = ("deploy", robot, "--port", port, "--controller", "kalman", "--tuning", "start")
        pilot = program(*words)
        threading.Timer(60, pilot.kill).start()  # ends the wait for a line that does not come
        until(pilot.stderr, "^armed")
        time.sleep(0.7)
        pilot.send_signal(how)
        found, _ = pilot.communicate(timeout=30)
        printed, errors = emulator.communicate(timeout=60)
    finally:
        for each in (emulator, pilot):
            each.kill()
    hits, pellets = map(int, until(printed.splitlines(), r"(\d+) of (\d+) pellets hit").groups())
    assert pellets < 100, f"the fire ended with the program: {errors}"
    assert hits <= pellets
    if how == signal.SIGTERM:
        assert "kalman on infantry through" in found
        assert "not fired: disarmed" in found


@pytest.mark.parametrize("virtual", ["infantry", "identified"])
def test_a_rehearsal_in_real_time_shoots_and_says_how_late_it_was(virtual):
    address = f"127.0.0.1:{20_000 + os.getpid() % 20_000}"
    config = DeployConfig(wires=("roborts",), detections=DetectionsConfig(address=address))
    robot, task = Robot.load(INFANTRY), Task.load("any")
    found = rehearse_live("no-lead", robot, task, config, virtual=virtual, seconds=2, tuning="start")
    assert 10 < sum(found.fired) <= 101
    assert "Real time, " in str(found)


def test_what_the_robot_s_process_refuses_is_said(refused):
    robot, task = Robot.load(INFANTRY), Task.load("any")
    faults = [Fault("flap", 1.0, 2.0)]
    refused("perhaps you meant flip", rehearse_live, "no-lead", robot, task, DeployConfig(), faults=faults)
