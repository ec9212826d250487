"""What `archerfish identify axis` costs: time and memory over the samples of a log, and on two logs of 10 s at 1 kHz.

`python benchmarks/identification_scaling.py` writes results/identification_scaling.json; two minutes of one core.
`--quick` stops at 100,000 samples, and writes nothing. Simulated logs of an axis of second order (8 Hz, damping 0.5, 6
samples late) with 2 % of noise, as CSV. Every run is the command in a process of its own: imports, reading, fit, draws,
page and record. CPU time is user and system time, memory the largest resident set; the fastest of some runs counts, as
what else runs on the machine only adds time. The reader of text is compared with `numpy.loadtxt` on the longest log:
both take turns in one process, and the medians of their CPU and wall times count.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.identification.simulation import simulate
from archerfish.logs.log import read_log
from bars import Bar, finish
from coverage import LATE, PERIOD_S, linear_sweep, step
from rigs import Array

SEED, NOISE, STEP_SHARE = 2026, 0.02, 0.1
SAMPLES, ROUNDS, READS = (10_000, 100_000, 1_000_000), 3, 9
CPU_S, LINEAR, MEMORY_MB, READING = 2.5, 1.1, 1200.0, 2.0


def written(path: Path, u: Array, stream: int) -> Path:
    """Write the log of an input, shape (N,)."""
    clean = simulate(LATE, u[:, None])[:, 0]
    noise = np.random.default_rng((SEED, stream, u.size)).standard_normal(u.size)
    columns = np.column_stack([PERIOD_S * np.arange(u.size), u, clean + NOISE * clean.std() * noise])
    np.savetxt(path, columns, fmt="%.9g", delimiter=",", header="time_s,u,y", comments="")
    return path


def long_input(samples: int) -> Array:
    """Return a sweep, then a step, shape (N,)."""
    stepped = round(STEP_SHARE * samples)
    return np.concatenate([linear_sweep((samples - stepped) * PERIOD_S, PERIOD_S), step(stepped * PERIOD_S, PERIOD_S)])


def cost(logs: list[Path]) -> tuple[float, float]:
    """Run the command in a process of its own; return its CPU time [s] and largest memory [MB]."""
    words = [sys.executable, "-m", "archerfish", "identify", "axis", *map(str, logs)]
    words += ["--out", str(logs[0].parent / "out"), "--overwrite"]
    plain = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}  # its own count
    with subprocess.Popen(words, env=plain, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):
        raise RuntimeError(f"the command ended with status {process.returncode}: {' '.join(words)}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def spent(*functions: Callable[[], Any]) -> Array:
    """Call F functions in turns; return the medians of their CPU and wall times [s], shape (F, 2)."""
    times = np.empty((READS, len(functions), 2))
    for turn in times:
        for row, function in zip(turn, functions, strict=True):
            begun = np.array([time.process_time(), time.perf_counter()])
            function()
            row[:] = np.array([time.process_time(), time.perf_counter()]) - begun
    return np.median(times, axis=0)


def main() -> None:
    """Run the command on all logs, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="up to 100,000 samples; nothing is then written")
    quick = parser.parse_args().quick
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        short = [written(place / "sweep.csv", linear_sweep(10.0, PERIOD_S), 1)]
        short.append(written(place / "step.csv", step(10.0, PERIOD_S), 2))
        cpu_s, peak_mb = min(cost(short) for _ in range(ROUNDS))
        rows.append({"logs": 2, "samples": 20_000, "cpu_s": cpu_s, "peak_mb": peak_mb})
        for samples in SAMPLES[: 2 if quick else None]:
            path = written(place / "long.csv", long_input(samples), 0)
            cpu_s, peak_mb = min(cost([path]) for _ in range(1 if samples == max(SAMPLES) else ROUNDS))
            rows.append({"logs": 1, "samples": samples, "cpu_s": cpu_s, "peak_mb": peak_mb})
            print(rows[-1], flush=True)
        read_s, loaded_s = spent(lambda: read_log(path), lambda: np.loadtxt(path, delimiter=",", skiprows=1))
    last, before = rows[-1], rows[-2]
    power = np.log(last["cpu_s"] / before["cpu_s"]) / np.log(last["samples"] / before["samples"])
    bars = [
        Bar("two logs of 10 s at 1 kHz: CPU time, s", rows[0]["cpu_s"], most=CPU_S),
        *(Bar(f"{row['samples']:,} samples: CPU time, s", row["cpu_s"]) for row in rows[1:]),
        Bar("power of the samples with which time grows, last decade", float(power), most=LINEAR),
        Bar(f"{last['samples']:,} samples: largest memory, MB", last["peak_mb"], most=MEMORY_MB),
        *(
            Bar(
                f"{last['samples']:,} rows of CSV: {kind} time of read_log over numpy.loadtxt's",
                float(ratio),
                most=READING,
            )
            for kind, ratio in zip(("CPU", "wall"), read_s / loaded_s, strict=True)
        ),
    ]
    conditions = {"seed": SEED, "period_s": PERIOD_S, "noise": NOISE, "rounds": ROUNDS, "load": os.getloadavg()[0]}
    finish(
        "identification_scaling",
        bars,
        [],
        conditions,
        rows,
        not quick,
        read_log_s=read_s.tolist(),
        loadtxt_s=loaded_s.tolist(),
    )


if __name__ == "__main__":
    main()
