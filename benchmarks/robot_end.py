"""How the fire ends, and how a port comes back: `deploy` in a process of its own, its robot emulated in this one.

`python benchmarks/robot_end.py`: kalman, settings before tuning, the infantry. For SIGINT and SIGTERM: from the signal
to the last frame that fires, and to the last frame. For SIGKILL: to the last pellet of a microcontroller that goes on
firing for 100 ms. For a port that goes and comes back: from its return to the first frame, and whether that idles.
Some minutes. Writes results/robot_end.json.
"""

import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.studies.rehearse import SwingingPlate, emulated_robot
from archerfish.virtual_robot.emulator_port import EmulatorPort
from archerfish.wires import Stream, load_wire
from archerfish.wires.wire import TableWire

RESULT = ROOT / "benchmarks" / "results" / "robot_end.json"
TIMES, ADDRESS = 10, f"127.0.0.1:{20_000 + os.getpid() % 20_000}"
WIRE = load_wire("sp_vision_25")
assert isinstance(WIRE, TableWire)
COMMAND = WIRE.layouts["command"]


class Robot:
    """An emulated robot behind a link that keeps its name, and the frames that it received with their times."""

    def __init__(self, link: Path) -> None:
        """Open the port, and let the link name it."""
        robot, task = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any")
        self.emulator = emulated_robot("infantry", robot, task, ["sp_vision_25"], SwingingPlate(), watchdog_s=0.1)
        self.frames = list[tuple[float, float]]()  # time [s], mode
        stream, take = Stream([COMMAND]), self.emulator.on_bytes

        def on_bytes(data: bytes) -> None:
            now = time.monotonic()
            self.frames += [(now, frame.layout.decode(frame.data)["mode"]) for frame in stream.feed(data)]
            take(data)

        self.emulator.on_bytes = on_bytes  # type: ignore[method-assign]
        self.port, self._is_stopped = EmulatorPort(self.emulator, ADDRESS), threading.Event()
        link.unlink(missing_ok=True)
        link.symlink_to(self.port.name)
        self.began_s = time.monotonic()
        self._thread = threading.Thread(target=self.port.run, args=[self._is_stopped.is_set], daemon=True)
        self._thread.start()

    def until(self, modes: set[float], seconds: float = 60.0) -> None:
        """Wait for frames of these modes alone."""
        end = time.monotonic() + seconds
        while {mode for _, mode in self.frames[-25:]} != modes or len(self.frames) < 25:
            if time.monotonic() > end:
                raise TimeoutError(f"no frames of the modes {modes}: {self.frames[-25:]}")
            time.sleep(0.05)

    def close(self) -> None:
        """Let the port go."""
        self._is_stopped.set()
        self._thread.join()
        self.port.__exit__()


def deployed(folder: Path, link: Path) -> subprocess.Popen[str]:
    """Start the computer."""
    words = [sys.executable, "-m", "archerfish", "deploy", str(folder), "--port", str(link), "--tuning", "start"]
    return subprocess.Popen(
        [*words, "--controller", "kalman"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(folder: Path, link: Path, how: signal.Signals) -> dict[str, float]:
    """Return what follows a signal [s]."""
    robot = Robot(link)
    computer = deployed(folder, link)
    robot.until({2.0})
    signalled = time.monotonic()
    computer.send_signal(how)
    computer.wait(20)
    time.sleep(0.5)
    robot.close()
    after = [(at - signalled, mode) for at, mode in robot.frames if at > signalled]
    fired = [at for at, mode in after if mode == 2.0]
    pellets = [pellet.time_s + robot.began_s - signalled for pellet in robot.emulator.pellets]
    found = {"last_fire_s": max(fired, default=0.0), "last_pellet_s": max(pellets)}
    return found | ({} if how == signal.SIGKILL else {"last_frame_s": after[-1][0], "last_mode": after[-1][1]})


def back(folder: Path, link: Path) -> dict[str, float]:
    """Return how long after its return a port has its first frame [s], and the modes of the first ten."""
    robot = Robot(link)
    computer = deployed(folder, link)
    robot.until({2.0})
    robot.close()
    time.sleep(1.0)
    returned = time.monotonic()
    robot = Robot(link)
    while len(robot.frames) < 10:
        time.sleep(0.01)
    computer.send_signal(signal.SIGINT)
    computer.wait(20)
    robot.close()
    return {"first_frame_s": robot.frames[0][0] - returned, "highest_mode": max(mode for _, mode in robot.frames[:10])}


def main() -> None:
    """Measure, print, write."""
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder, link = shutil.copytree(ROOT / "tests" / "infantry", Path(name) / "infantry"), Path(name) / "port"
        lines = f'yaw_reference = "fixed-chassis"\ndetections.address = "{ADDRESS}"\n'
        (folder / "deploy.toml").write_text(lines)
        trials = {sent.name: partial(ended, how=sent) for sent in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)}
        for label, trial in (trials | {"port back": back}).items():
            rows[label] = summary([trial(folder, link) for _ in range(TIMES)])
            print(label, json.dumps(rows[label]), flush=True)
    conditions = {"times": TIMES, "machine": platform.machine(), "cores": os.cpu_count(), "date": time.strftime("%F")}
    content = {"conditions": conditions | {"load": os.getloadavg()[0]}, "seconds": rows}
    RESULT.write_text(json.dumps(content, indent=1) + "\n")


def summary(trials: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Return the median and the largest of each figure."""
    columns = {name: [trial[name] for trial in trials] for name in trials[0]}
    return {name: {"median": float(np.median(column)), "most": max(column)} for name, column in columns.items()}


if __name__ == "__main__":
    main()
