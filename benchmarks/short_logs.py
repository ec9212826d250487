"""Short and awkward logs of known truth: against other tools, from rest, cut out of a motion, and a sweep with a step.

`python benchmarks/short_logs.py` writes results/short_logs.json; ten minutes of one core. `--quick` takes a tenth of
the logs, and writes nothing.

- 100 logs of 100 to 300 samples: a run from rest of a noise-free log of the rig, against the fits of the other tools
  that results/short_logs_peers.json has. These know the dead time; ours gets the file and nothing else.
- 100 logs of a step from rest under 1 % of noise: the steady gain, with order 2 and with the order chosen.
- 24 logs of 300 samples that begin within a motion, 20 samples late: the delay, and the steady gain.
- 100 sweeps, each with and without a step: a log more must not make the plant worse.
"""

import argparse
import json
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording, Values
from archerfish.records.plant import PlantRecord
from archerfish.reports.table import Table
from bars import RESULTS, Bar, finish, quiet, run, share
from rigs import COMMANDS, RATES_HZ, Array, Drawn, Rig, Rng, draw_noise, log_uniform, respond, usual_rig
from stranger_logs import File, StrangerLog, held_back, write_log

SEED, COUNTS = 2026, {"peers": 100, "steps": 100, "cut": 24, "pairs": 100}
EXCITATIONS = ("sweep", "step", "early step", "staircase", "held levels", "multisine", "binary")
SAMPLES, NOISE, NOISE_KINDS = (100, 300), (0.005, 0.1), {"white": 2 / 3, "AR(0.9)": 1 / 3}
SETTLED = 2.0  # times that the axis can settle within a log, at least; dead time counts thrice
NEAR, GAIN_ERROR, COST = 2.0, 0.5, 0.5  # points; % of a steady gain; points that a step may cost
PEERS = json.loads((RESULTS / "short_logs_peers.json").read_text())


def short_log(index: int) -> tuple[StrangerLog, Array, Array]:
    """Return a short log without a fault, and command and clean output of one that is held back, shape (M,) each."""
    rng = np.random.default_rng((SEED, index, 2))
    count = round(log_uniform(rng, *SAMPLES))
    rig, rate_hz = _settling(rng, count)
    log = _logged(rig, rate_hz, count, str(rng.choice(EXCITATIONS)), index, rng)
    return log, *held_back(log, log.period_s)


def _settling(rng: Rng, count: int) -> tuple[Rig, float]:
    """Draw sampling rates [Hz] and rigs until a rig can settle within so many samples."""
    while True:
        rate_hz = float(rng.choice(list(RATES_HZ), p=list(RATES_HZ.values())))
        rig = usual_rig(rng, rate_hz)
        if SETTLED * (rig.settle_s + 3 * rig.delay_s) * rate_hz <= count:
            return rig, rate_hz


def _logged(rig: Rig, rate_hz: float, count: int, kind: str, index: int, rng: Rng) -> StrangerLog:
    given = log_uniform(rng, 0.01, 30.0) * COMMANDS[kind](Drawn(count, 1 / rate_hz, rig, rng))
    clean = respond(rig, given, 1 / rate_hz)
    spread = float(np.std(clean))
    noise = log_uniform(rng, *NOISE)
    noise_kind = str(rng.choice(list(NOISE_KINDS), p=list(NOISE_KINDS.values())))
    zero = rng.uniform(-3, 3) * spread * (rng.random() < 0.5)
    measured = clean + zero + noise * spread * draw_noise(noise_kind, count, rng)
    file, peak = File(np.arange(count) / rate_hz, given, measured, given), float(np.abs(given).max())
    return StrangerLog(index, rig, "none", 0.0, kind, 1 / rate_hz, peak, noise, noise_kind, False, (file,))


def against_peers(index: int) -> dict[str, Any]:
    """Identify a short log from its file."""
    log, given, clean = short_log(index)
    with tempfile.TemporaryDirectory() as folder:
        paths = write_log(log, Path(folder))
        result = quiet(lambda: identify_axis(paths))
    best = max(fits[index] for fits in PEERS["peers"].values())
    facts = f"{log.rig.family}, {log.excitation}, {log.noise_kind}"
    if isinstance(result, str):
        return _row("peers", index, f"{facts}: {result}", fit=0.0, other=best)
    return _row("peers", index, facts, fit=_fit(result.record, given, clean), other=best, order=len(result.record.A))


def _fit(plant: PlantRecord, given: Array, clean: Array) -> float:
    """Return the fit of a run from rest [%], 0 if it is worse than none."""
    error = np.linalg.norm(clean - simulate(plant, given[:, None])[:, 0])
    fit = float(100 * (1 - error / np.linalg.norm(clean - clean.mean())))
    return max(fit, 0.0) if np.isfinite(fit) else 0.0


def _row(set_of_logs: str, index: int, facts: str, **found: Any) -> dict[str, Any]:
    fields = dict.fromkeys(
        (
            "fit",
            "other",
            "gain_error_percent",
            "delay_error",
            "chosen_gain_error_percent",
            "chosen_delay_error",
            "order",
        )
    )
    return {"set": set_of_logs, "index": index, "facts": facts, **fields, **found}


def _second_order(u: Values, natural: float, damping: float, delay: int) -> Array:
    """Simulate an axis of steady gain 1, its frequency in cycles per sample, shape (N,)."""
    pole = np.exp(2 * np.pi * natural * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = np.array([1.0, -2 * pole.real, abs(pole) ** 2])
    return np.asarray(lfilter(np.append(np.zeros(delay + 1), [a.sum() / 2] * 2), a, u))


def _estimated(name: str, index: int, u: Values, y: Values, delay: int) -> dict[str, Any]:
    """Compare the steady gain, which is 1, and the delay [samples], with order 2 and with the order chosen."""
    recording = Recording.from_arrays(u, y, 1e-3)
    row = _row(name, index, "")
    for order in (2, None):
        result = quiet(partial(identify_axis, [recording], order=order))
        if not isinstance(result, str):
            error = 100 * float(result.record.dc_gain.item() - 1)
            found = {"gain_error_percent": error, "delay_error": result.dead_time_samples.value - delay}
            row |= {name if order else f"chosen_{name}": value for name, value in found.items()}
            row["order"] = len(result.record.A)
    return row


def step_from_rest(index: int) -> dict[str, Any]:
    """Identify a step from rest under 1 % of noise."""
    rng = np.random.default_rng((1, index))
    count = int(log_uniform(rng, 300, 1500))
    at, damping = int(count * rng.uniform(0.04, 0.2)), rng.uniform(0.3, 1.0)
    natural = max(4 / (2 * np.pi * damping * (count - at)) / rng.uniform(0.15, 0.5), 0.004)
    delay, u = int(rng.integers(0, 16)), (np.arange(count) >= at) * rng.uniform(0.1, 10)
    clean = _second_order(u, natural, damping, delay)
    y = clean + 0.01 * clean.std() * rng.standard_normal(count) + rng.uniform(-3, 3)
    return _estimated("steps", index, u, y, delay)


def cut_in_motion(index: int) -> dict[str, Any]:
    """Identify a log that begins within a motion, under 1 % of noise."""
    rng = np.random.default_rng((2, index))
    damping, natural = rng.uniform(0.3, 1.0), rng.uniform(0.01, 0.03)
    levels = zip(rng.integers(5, 40, 60), rng.uniform(-1, 1, 60), strict=True)
    u = np.concatenate([np.full(count, level) for count, level in levels])
    clean = _second_order(u, natural, damping, 20)[200:500]
    return _estimated("cut", index, u[200:500], clean + 0.01 * clean.std() * rng.standard_normal(300), 20)


def sweep_and_step(index: int) -> dict[str, Any]:
    """Identify a sweep alone, and the same sweep with a step, and compare them on a log that is held back.

    Both have the same amplitude, and noise of the same kind and standard deviation.
    """
    rng = np.random.default_rng((SEED, index, 3))
    count = round(log_uniform(rng, 300, 3000))
    rig, rate_hz = _settling(rng, count)
    log = _logged(rig, rate_hz, count, "sweep", index, rng)
    u = log.amplitude * COMMANDS["step"](Drawn(count, log.period_s, rig, rng))
    noise = log.noise * np.std(respond(rig, log.files[0].command, log.period_s))
    y = respond(rig, u, log.period_s) + noise * draw_noise(log.noise_kind, count, rng)
    sweep = Recording.from_arrays(log.files[0].inputs, log.files[0].outputs, log.period_s)
    step = Recording.from_arrays(u, y, log.period_s)
    given, clean = held_back(log, log.period_s)
    fits = []
    for logs in ([sweep, step], [sweep]):
        result = quiet(partial(identify_axis, logs))
        fits.append(0.0 if isinstance(result, str) else _fit(result.record, given, clean))
    facts = f"{rig.family}, {count} samples, {100 * log.noise:.2g} % {log.noise_kind}"
    return _row("pairs", index, facts, fit=fits[0], other=fits[1])


SETS: dict[str, Callable[[int], dict[str, Any]]] = {
    "peers": against_peers,
    "steps": step_from_rest,
    "cut": cut_in_motion,
    "pairs": sweep_and_step,
}


def figures(rows: list[dict[str, Any]]) -> list[Bar]:
    """Return the figures with their limits."""
    of = {name: [row for row in rows if row["set"] == name] for name in SETS}
    bars = [
        share(f"within {NEAR:g} points of the best peer, %", (r["fit"] >= r["other"] - NEAR for r in of["peers"]), 90.0)
    ]
    ours = float(np.median([row["fit"] for row in of["peers"]])) if of["peers"] else np.nan
    for name, fits in PEERS["peers"].items():
        least = float(np.median([fits[row["index"]] for row in of["peers"]])) if of["peers"] else None
        bars.append(Bar(f"median fit, and that of {name}, %", ours, least))
    earlier = [PEERS["reference"][row["index"]] for row in of["peers"]]
    bars.append(Bar("median fit of release 0.1 (reference), %", float(np.median(earlier)) if earlier else np.nan))
    for name, field in (("order 2", "gain_error_percent"), ("order chosen", "chosen_gain_error_percent")):
        for logs in ("steps", "cut"):
            right = (row[field] is not None and abs(row[field]) <= GAIN_ERROR for row in of[logs])
            title = {"steps": "step from rest", "cut": "cut in motion"}[logs]
            bars.append(
                share(f"{title}, {name}: gain within {GAIN_ERROR} %, %", right, 100.0 if logs == "steps" else None)
            )
    for name, field in (("order 2", "delay_error"), ("order chosen", "chosen_delay_error")):
        errors = [np.inf if row[field] is None else abs(row[field]) for row in of["cut"]]
        bars.append(share(f"cut in motion, {name}: delay right within a sample, %", (e <= 1 for e in errors), 100.0))
        bars.append(share(f"cut in motion, {name}: delay exact, %", (e == 0 for e in errors)))
    costs = [row["other"] - row["fit"] for row in of["pairs"]]
    bars.append(Bar("most points that a step costs", max(costs, default=np.nan), most=COST))
    bars.append(share(f"a step costs more than {COST} points, %", (cost > COST for cost in costs)))
    return [each for each in bars if np.isfinite(each.found)]  # of the sets that were run


def main() -> None:
    """Identify all logs, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the logs; nothing is then written")
    parser.add_argument(
        "--sets", nargs="+", choices=tuple(SETS), default=list(SETS), help="these alone, nothing written"
    )
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for name in options.sets:
        count = -(-COUNTS[name] // 10) if options.quick else COUNTS[name]
        rows += run(SETS[name], range(count), options.workers)
    worst = sorted((row for row in rows if row["fit"] is not None), key=lambda row: row["fit"] - row["other"])[:8]
    lines = tuple((row["set"], row["index"], row["facts"], row["fit"], row["other"]) for row in worst)
    table = Table("furthest below the best peer, or below the sweep alone", ("", "log", "", "fit, %", "other"), lines)
    conditions = {"seed": SEED, "counts": COUNTS, "samples": SAMPLES, "noise": NOISE, "noise_kinds": NOISE_KINDS}
    complete = not options.quick and options.sets == list(SETS)
    finish("short_logs", figures(rows), [table], conditions, rows, complete)


if __name__ == "__main__":
    main()
