"""How late the loop on the robot's computer is, through a pseudo-terminal; the emulated robot is another process.

`python benchmarks/robot_loop.py`: kalman, settings before tuning, the infantry; 60 s at the period of the task. It
prints lateness and duration of decisions, and hits; `--busy 16` runs so many busy processes beside. Real-time priority
is used where the system allows it, and the result says whether it did. Writes results/robot_loop.json.
"""

import argparse
import json
import multiprocessing
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import archerfish as af
from alternating import ROOT
from archerfish.runtime.configuration import DeployConfig, DetectionsConfig
from archerfish.studies.deploy import deploy

RESULT = ROOT / "benchmarks" / "results" / "robot_loop.json"


def busy() -> None:
    """Compute without end."""
    while True:
        sum(range(10_000))


def measured(seconds: float, processes: int) -> dict[str, object]:
    """Return the figures of one run beside some busy processes."""
    workers = [multiprocessing.Process(target=busy, daemon=True) for _ in range(processes)]
    for worker in workers:
        worker.start()
    with tempfile.TemporaryDirectory() as name:
        robot = shutil.copytree(ROOT / "tests" / "infantry", Path(name) / "infantry")
        address = f"127.0.0.1:{20_000 + os.getpid() % 20_000}"
        (robot / "deploy.toml").write_text(f'detections.address = "{address}"\n')
        words = [sys.executable, "-m", "archerfish", "emulate", str(robot), "--seconds", str(seconds + 1)]
        emulator = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert emulator.stdout is not None
        [port] = re.findall(r"^port (\S+)", emulator.stdout.readline())
        config = DeployConfig(detections=DetectionsConfig(address=address), yaw_reference="fixed-chassis")
        begun = time.process_time()
        found = deploy(
            "kalman", af.Robot.load(robot), af.Task.load("any"), config, port=port, seconds=seconds, tuning="start"
        )
        used = time.process_time() - begun
        printed, _ = emulator.communicate(timeout=60)
    for worker in workers:
        worker.terminate()
    timing = found.timing
    figures: dict[str, object] = {"busy": processes, "load": os.getloadavg()[0], "is_realtime": timing.is_realtime}
    figures |= {"decisions": len(timing.work), "missed": timing.missed, "processor_share": used / seconds}
    for label, durations in (("late_ms", timing.lateness), ("decision_ms", timing.work)):
        figures[label] = {str(share): 1e3 * durations.quantile(share) for share in (0.5, 0.99, 0.999)}
    hits = re.search(r"(\d+) of (\d+) pellets hit; violations of the limits: (.*)", printed)
    return figures | {"hits": hits.groups() if hits else printed}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--busy", type=int, nargs="+", default=[0, 16], help="busy processes beside, of each run")
    options = parser.parse_args()
    rows = [measured(options.seconds, processes) for processes in options.busy]
    for row in rows:
        print(json.dumps(row), flush=True)
    conditions = {
        "seconds": options.seconds,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "date": time.strftime("%F"),
    }
    RESULT.write_text(json.dumps({"conditions": conditions, "runs": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
