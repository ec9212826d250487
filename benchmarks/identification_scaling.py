"""What `archerfish identify gimbal` costs: CPU time by part on two logs of 10 s at 1 kHz, time and memory over samples.

Simulated logs of an axis of second order (8 Hz, damping 0.5, 6 samples late) with 2 % of noise, as CSV. Every run is
the whole command in a process of its own: imports, reading, fit, tests, page, pictures and record. CPU time is user and
system time together, memory the largest resident set of the process. Both depend on the machine: beside them stands the
time of a matrix product on one thread, measured in the same run.

Writes results/identification_scaling.json and docs/identification-time.svg.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from archerfish.figures.style import BLUE, INK, MUTED, label_axes, new_figure, plot_style, save_figure
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.records.provenance import provenance
from archerfish.records.storage import write_json
from coverage import second_order
from machine import describe_machine
from markdown_table import markdown

HERE = Path(__file__).parent
RESULT = HERE / "results" / "identification_scaling.json"
PICTURE = HERE.parent / "docs" / "identification-time.svg"
SEED = 2026
PERIOD_S = 1e-3
NOISE = 0.02
"""Standard deviation of the noise over that of the clean output."""
STEP_SHARE = 0.1
"""Share of a long log that a step takes, after the sweep."""
SAMPLES = (10_000, 30_000, 100_000, 300_000, 1_000_000)
ROUNDS = 5
"""Runs on two short logs; the fastest counts, as whatever else runs on the machine only ever adds time."""
BAR_S = 2.5
"""CPU time that two logs of 10 s may take [s]."""
LINEAR = 1.1
"""Largest slope, logarithm of time over logarithm of samples, over the last decade."""

_COMMAND = "from archerfish.cli.main import program; program()"
_PARTS = """
import time, sys, json
began = time.process_time()
import importlib
from archerfish.cli.main import main
module = importlib.import_module("archerfish.cli.identify_gimbal")
spent = {"imports": time.process_time() - began, "start": began}
def timed(part, name):
    inner = getattr(module, name)
    def outer(*arguments, **options):
        start = time.process_time()
        try:
            return inner(*arguments, **options)
        finally:
            spent[part] = spent.get(part, 0.0) + time.process_time() - start
    setattr(module, name, outer)
timed("reading and examining", "read_gimbal_logs")
timed("fit", "identify_axis")
timed("fit", "choose_order")
timed("options tried", "tried_advice")
timed("evidence", "gather_evidence")
timed("page", "axis_page")
timed("pictures", "axis_picture")
timed("pictures", "save_figure")
where = sys.argv.pop(1)
main(sys.argv[1:])
spent["all"] = time.process_time()
open(where, "w").write(json.dumps(spent))
"""


class Cost(NamedTuple):
    """What a process took."""

    cpu_s: float
    """User and system time [s]."""
    peak_mb: float
    """Largest resident set [MB]."""


@dataclass(frozen=True)
class Row:
    """The command on one log."""

    samples: int
    """Samples in the log."""
    cpu_s: float
    """User and system time of the whole command [s]."""
    peak_mb: float
    """Largest resident set [MB]."""
    products: float
    """Matrix products of order 1024 that one thread of the machine forms in that time."""


def main() -> None:
    """Run the command on all logs, write and draw the results; exit with 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="logs up to 30,000 samples, and nothing written")
    quick = parser.parse_args().quick
    product_s = _product_seconds()
    with tempfile.TemporaryDirectory() as folder:
        short, parts = _two_short_logs(Path(folder))
        print(f"two logs of 10 s: {short.cpu_s:.2f} s of CPU, {short.peak_mb:.0f} MB", flush=True)
        print(markdown(["part", "CPU time [s]"], [[name, f"{spent:.2f}"] for name, spent in parts.items()]))
        rows = []
        for samples in SAMPLES[: 2 if quick else None]:
            path = _write(Path(folder) / "long.csv", _long(samples), 0)
            cost = _run([sys.executable, "-c", _COMMAND], [path], Path(folder))
            rows.append(Row(samples, cost.cpu_s, cost.peak_mb, cost.cpu_s / product_s))
            print(f"{samples:9,} samples: {cost.cpu_s:7.2f} s of CPU, {cost.peak_mb:6.0f} MB", flush=True)
    missed = [f"{short.cpu_s:.2f} s of CPU on two logs of 10 s, above {BAR_S} s"] * (short.cpu_s > BAR_S)
    if not quick:
        steep = {name: _slope(rows, name) for name in ("cpu_s", "peak_mb")}
        missed += [f"{name} grows with power {value:.2f}" for name, value in steep.items() if value > LINEAR]
        content = {
            "conditions": {"seed": SEED, "period_s": PERIOD_S, "noise": NOISE, "rounds": ROUNDS, "bar_s": BAR_S},
            "machine": describe_machine() | {"one_thread_product_s": product_s},
            "provenance": provenance(SEED),
            "short": short._asdict() | {"products": short.cpu_s / product_s, "parts_s": parts},
            "rows": [asdict(row) for row in rows],
            "slopes_last_decade": steep,
        }
        write_json(RESULT, content)
        draw(rows)
    if missed:
        sys.exit(f"outside the bars: {'; '.join(missed)}")


def _two_short_logs(folder: Path) -> tuple[Cost, dict[str, float]]:
    """Return the cost of the command on a sweep and a step of 10 s, and the CPU time of its parts [s]."""
    logs = [
        _write(folder / "sweep.csv", linear_sweep(10.0, PERIOD_S), 1),
        _write(folder / "step.csv", step(10.0, PERIOD_S), 2),
    ]
    costs = [_run([sys.executable, "-c", _COMMAND], logs, folder) for _ in range(ROUNDS)]
    found: list[dict[str, float]] = []
    for _ in range(ROUNDS):
        where = folder / "parts.json"
        _run([sys.executable, "-c", _PARTS, str(where)], logs, folder)
        found.append(json.loads(where.read_text()))
    parts = min(found, key=lambda each: each["all"])
    whole = parts.pop("all")
    return min(costs), parts | {"command line, record and summary": whole - sum(parts.values())}


def _long(samples: int) -> NDArray[np.float64]:
    """Return the input of a long log: a sweep, then a step."""
    stepped = round(STEP_SHARE * samples)
    sweep = linear_sweep((samples - stepped) * PERIOD_S, PERIOD_S)
    return np.concatenate([sweep, step(stepped * PERIOD_S, PERIOD_S)])


def _write(path: Path, signal: NDArray[np.float64], stream: int) -> Path:
    clean = simulate(second_order(8.0, 0.5, 6), signal[:, None])[:, 0]
    noise = np.random.default_rng((SEED, stream, signal.size)).standard_normal(signal.size)
    columns = [PERIOD_S * np.arange(signal.size), signal, clean + NOISE * clean.std() * noise]
    np.savetxt(path, np.column_stack(columns), fmt="%.9g", delimiter=",", header="time_s,u,y", comments="")
    return path


def _run(program: Sequence[str], logs: Sequence[Path], folder: Path) -> Cost:
    """Run the command in a process of its own; it sets its number of threads itself."""
    words = [*program, "identify", "gimbal", *map(str, logs), "--out", str(folder / "out"), "--overwrite"]
    ours = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    with subprocess.Popen(words, env=ours, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"the command ended with status {process.returncode}: {' '.join(words[-6:])}")
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / unit)


def _product_seconds() -> float:
    """Return the time of a float32 matrix product of order 1024 on one thread [s]."""
    code = "from machine import SIZE, matrix_product_rate; print(2 * SIZE**3 / matrix_product_rate() / 1e9)"
    one = os.environ | {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    return float(
        subprocess.run([sys.executable, "-c", code], cwd=HERE, env=one, check=True, capture_output=True).stdout
    )


def _slope(rows: Sequence[Row], name: str) -> float:
    """Return the power of the samples with which a cost grows over the last decade."""
    last = [row for row in rows if 10 * row.samples >= rows[-1].samples]
    ratio = getattr(last[-1], name) / getattr(last[0], name)
    return float(np.log(ratio) / np.log(last[-1].samples / last[0].samples))


def draw(rows: Sequence[Row]) -> None:
    """Draw CPU time and memory over the samples of a log, each beside a line of slope one."""
    samples = np.array([row.samples for row in rows], dtype=np.float64)
    with plot_style():
        figure, axes = new_figure(1, 2, height=3.2)
        panels: list[tuple[Any, str, list[float]]] = [
            (axes[0, 0], "CPU time [s]", [row.cpu_s for row in rows]),
            (axes[0, 1], "Largest memory [MB]", [row.peak_mb for row in rows]),
        ]
        for panel, label, values in panels:
            panel.loglog(samples, values[-1] * samples / samples[-1], color=MUTED, linestyle=":", label="proportional")
            panel.loglog(samples, values, color=BLUE, marker="o", label="identify gimbal")
            for count, value in zip(samples, values, strict=True):
                panel.annotate(
                    f"{value:.3g}",
                    (count, value),
                    (0, 6),
                    textcoords="offset points",
                    ha="center",
                    color=INK,
                    fontsize=8,
                )
            panel.set_ylim(0.5 * min(values), 2.5 * max(values))
            panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            panel.yaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter(EngFormatter(sep=" "))
            label_axes(panel, title=label.partition(" [")[0], x="Samples in the log", y=label)
        axes[0, 0].legend(loc="lower right")
    save_figure(PICTURE, figure)


if __name__ == "__main__":
    main()
