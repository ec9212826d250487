"""How late the loop on the robot's computer is, through a pseudo-terminal; the emulated robot is another process.

`python benchmarks/robot_loop.py`: kalman, settings before tuning, the infantry. Each run has a decision period, decides
in C or in NumPy, and has some busy processes beside. Real-time priority is used where the system allows it, and the
result says whether it did. `--soak 600` runs ten minutes at 200 Hz instead, with a fault a minute, and looks at memory
and file descriptors. Writes results/robot_loop.json, or results/robot_soak.json.
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
import threading
import time
from pathlib import Path

import archerfish as af
from alternating import ROOT
from archerfish.runtime.configuration import DeployConfig, DetectionsConfig
from archerfish.runtime.pilot import Pilot
from archerfish.studies.deploy import deploy

RESULTS = ROOT / "benchmarks" / "results"
RUNS = ((20.0, True, 0), (5.0, True, 0), (5.0, True, 16), (20.0, True, 16), (20.0, False, 0))
"""Period [ms], whether in C, and busy processes beside."""
FAULTS = ("silence", "flip", "late", "garbage", "camera-clock", "blind", "burst", "frozen", "nan")
"""Of a soak, each 0.5 s long."""


def busy() -> None:
    """Compute without end."""
    while True:
        sum(range(10_000))


def measured(
    seconds: float, period_ms: float, processes: int, faults: list[str] | None = None, *, in_c: bool = True
) -> dict[str, object]:
    """Return the figures of one run beside some busy processes.

    Args:
      seconds: that it takes.
      period_ms: of the decisions.
      processes: busy ones beside.
      faults: kind, begin and end of each, of the robot.
      in_c: whether it decides in C.
    """
    workers = [multiprocessing.Process(target=busy, daemon=True) for _ in range(processes)]
    for worker in workers:
        worker.start()
    task = af.Task.load("any").replace(name="loop", period_s=1e-3 * period_ms)
    with tempfile.TemporaryDirectory() as name:
        robot = shutil.copytree(ROOT / "tests" / "infantry", Path(name) / "infantry")
        address = f"127.0.0.1:{20_000 + os.getpid() % 20_000}"
        (robot / "deploy.toml").write_text(f'detections.address = "{address}"\n')
        task.save(Path(name) / "task.toml")
        words = [sys.executable, "-m", "archerfish", "emulate", str(robot), "--seconds", str(seconds + 1)]
        words += ["--task", str(Path(name) / "task.toml")]
        words += ["--fault", *faults] if faults else []
        emulator = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert emulator.stdout is not None
        [port] = re.findall(r"^port (\S+)", emulator.stdout.readline())
        config = DeployConfig(detections=DetectionsConfig(address=address), yaw_reference="fixed-chassis")
        begun, resources = time.process_time(), Resources()
        found = deploy(
            "kalman",
            af.Robot.load(robot),
            task,
            config,
            port=port,
            seconds=seconds,
            tuning="start",
            in_c=in_c,
            watch=resources,
        )
        used = time.process_time() - begun
        printed, _ = emulator.communicate(timeout=60)
    for worker in workers:
        worker.terminate()
    timing = found.timing
    figures: dict[str, object] = {"period_ms": period_ms, "language": found.language, "busy": processes}
    figures |= {"load": os.getloadavg()[0], "is_realtime": timing.is_realtime, "decisions": len(timing.work)}
    figures |= {"missed": timing.missed, "stalls": timing.stalls, "processor_share": used / seconds}
    for label, durations in (("late_ms", timing.lateness), ("decision_ms", timing.work)):
        figures[label] = {str(share): 1e3 * durations.quantile(share) for share in (0.5, 0.99, 0.999)}
    hits = re.search(r"(\d+) of (\d+) pellets hit; violations of the limits: (.*)", printed)
    return figures | resources.figures() | {"hits": hits.groups() if hits else printed, "counts": found.counts}


class Resources:
    """Memory, file descriptors and modes of the process while it runs; the operator's switch is the emulator's."""

    def __init__(self) -> None:
        self._rows = list[tuple[float, int]]()
        self._modes = dict[str, int]()
        self._last = ""
        self._next_s = time.monotonic() + 10.0  # the start is left out

    def __call__(self, pilot: Pilot) -> bool:
        """Look every ten seconds, in a thread of its own."""
        if pilot.state_text != self._last:
            self._last = pilot.state_text
            self._modes[self._last] = self._modes.get(self._last, 0) + 1
        if time.monotonic() >= self._next_s:
            self._next_s += 10.0
            threading.Thread(target=self._look).start()
        return False

    def _look(self) -> None:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        megabytes = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
        self._rows.append((megabytes, len([*Path("/proc/self/fd").iterdir()])))

    def figures(self) -> dict[str, object]:
        """Return what was seen: the first and the last of memory [MB] and of file descriptors."""
        ends = [self._rows[0], self._rows[-1]] if self._rows else []
        return {
            "memory_mb": [row[0] for row in ends],
            "descriptors": [row[1] for row in ends],
            "states_entered": self._modes,
        }


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--soak", type=float, default=0.0, help="seconds of a soak with a fault a minute")
    options = parser.parse_args()
    rows = []
    if options.soak:
        faults = list[str]()
        for minute in range(int(options.soak // 60)):
            begin = 60 * minute + 40
            faults += [FAULTS[minute % len(FAULTS)], str(begin), str(begin + 0.5)]
        rows.append(measured(options.soak, 5.0, 0, faults))
    else:
        for period_ms, in_c, processes in RUNS:
            rows.append(measured(options.seconds, period_ms, processes, in_c=in_c))
    for row in rows:
        print(json.dumps(row), flush=True)
    conditions = {"seconds": options.soak or options.seconds, "cores": os.cpu_count(), "machine": platform.machine()}
    content = {"conditions": conditions | {"date": time.strftime("%F")}, "runs": rows}
    name = "robot_soak.json" if options.soak else "robot_loop.json"
    (RESULTS / name).write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
