"""Identification on recorded logs and on the printed axes, with order 4 and with the order chosen, against its limits.

`python benchmarks/identification.py` writes results/identification.json; five minutes of one core. `--quick` takes the
logs that have limits and two seeds, and writes nothing. The recorded logs are those of ../shared/data, beside the
repository; each is fitted in its first half and run free in its second (drone, steps: multisine and steps; hoop: random
and fixed steps), inputs and output less their training means, the constant from the training part. Beside the figures
is the reference, what release 0.1 found (results/identification_reference.json).
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy import io

from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.simulation import free_run, simulate
from archerfish.logs.recording import Recording
from archerfish.paper.gimbal import printed_plants
from archerfish.reports.table import Table
from bars import RESULTS, Bar, finish, quiet, run, share
from coverage import PERIOD_S, linear_sweep, step
from rigs import Array

PLACES = [each / "shared" / "data" / "identification" for each in Path(__file__).parents[2:]]
DATA = next(filter(Path.is_dir, PLACES), PLACES[0])
REFERENCE = RESULTS / "identification_reference.json"
Signals: TypeAlias = tuple[Array, Array]  # inputs (N, m) and output (N, 1)
LIMITS = {
    "robot arm": (96.3, 97.1),
    "CD player arm": (84.0, 87.8),
    "hair dryer": (86.5, 89.9),
    "Silverbox": (87.2, 86.0),
    "quarter drone, steps": (88.0, 87.7),
}
"""Recorded log → least test and training fit with order 4 [%]."""
TESTED = (
    *LIMITS,
    "quarter drone, sweep",
    "ball and hoop",
    "flexible structure",
)  # of the rest a half predicts no other
PRINTED_LIMITS = {0.01: (99.95, 99.8), 0.05: (99.8, 99.6)}  # noise → least median fit of sweep and step [%]
FITTED, BELOW = 50.0, 1.0  # least fit of a log that counts [%], points by which one may be below the reference
SEEDS, DELAYS, STRUCTURE = 20, (0, 5, 13, 20), (4, None)
SWEEP, STEP = linear_sweep(10.0, PERIOD_S), step(1.0, PERIOD_S)
WHITE = np.random.default_rng(1_000_000).standard_normal(3000)


def _table(file: str, inputs: list[int], output: int, rows: slice = slice(None), **how: Any) -> Signals:
    table = np.loadtxt(DATA / file, **how)[rows]
    return table[:, inputs], table[:, [output]]


def _matrix(name: str, inputs: list[int], output: int) -> Signals:
    table = io.loadmat(DATA / "slicot_sysid" / f"{name}.mat")[name].astype(float)
    return table[:, inputs], table[:, [output]]


def _variables(file: str, u: str, y: str) -> Signals:
    variables = io.loadmat(DATA / file)
    inputs, output = (np.asarray(variables[name], dtype=float) for name in (u, y))
    return inputs.reshape(-1, output.size)[:1].T, output.reshape(-1, 1)


def _drone(name: str, u: int = 1) -> Signals:
    return _table(f"quarter_drone/{name}_malha_fechada.csv", [u], 2, slice(200, None), delimiter=",", skiprows=1)


def _arm(name: str, u: int, rows: slice) -> Signals:
    return _table(f"quarter_drone/{name}.csv", [u], 1, rows, delimiter=",", skiprows=1)


def _halves(read: Callable[[], Signals]) -> tuple[Signals, Signals]:
    u, y = read()
    middle = len(y) // 2
    return (u[:middle], y[:middle]), (u[middle:], y[middle:])


def _split(period_s: float, function: Callable[..., Signals], *arguments: Any, **named: Any) -> Any:
    return period_s, lambda: _halves(partial(function, *arguments, **named))


def _pair(period_s: float, function: Callable[..., Signals], first: Sequence[Any], second: Sequence[Any]) -> Any:
    return period_s, lambda: (function(*first), function(*second))


CSV = {"delimiter": ",", "skiprows": 40_651, "max_rows": 20_000, "usecols": (0, 1)}
HOOP = "ball_and_hoop/{}StepSequence.mat"
LOGS: dict[str, tuple[float, Callable[[], tuple[Signals, Signals]]]] = {
    "robot arm": _split(0.01, _matrix, "robot_arm_dat", [0], 1),
    "CD player arm": _split(0.01, _matrix, "CD_player_arm_dat", [0, 1], 3),
    "hair dryer": _split(0.08, _table, "rgp/dryer.dat", [0], 1),
    "Silverbox": _split(1 / 610.35, _table, "silverbox/SNLS80mV.csv", [0], 1, **CSV),
    "quarter drone, steps": _pair(0.01, _drone, ["sinal4_multiseno"], ["sinal2_degraus"]),
    "quarter drone, sweep": _split(0.01, _drone, "sinal3_swept_sine"),
    "quarter drone, sweep, thrust": _split(0.01, _drone, "sinal3_swept_sine", 3),
    "quarter drone, slow": _split(0.01, _drone, "sinal1_semi_estatica"),
    "quarter drone, slow, thrust": _split(0.01, _drone, "sinal1_semi_estatica", 3),
    "quarter drone, multisine, thrust": _split(0.01, _drone, "sinal4_multiseno", 3),
    "quarter drone, arm": _split(0.01, _arm, "dados_14_drone", 3, slice(None)),
    "quarter drone, arm, thrust": _split(0.01, _arm, "dados_14_drone", 2, slice(None)),
    "quarter drone, arm, short": _split(0.01, _arm, "14_drone_seq_20260529_195254", 3, slice(1500)),
    "ball and hoop": _pair(0.1, _variables, [HOOP.format("random"), "u", "y"], [HOOP.format("fixed"), "u", "y"]),
    "ball and hoop, closed loop": _split(0.1, _variables, "ball_and_hoop/closedLoop.mat", "u", "y"),
    "flexible structure": _split(0.01, _matrix, "flexible_structure_dat", [0, 1], 2),
    "ball and beam": _split(0.1, _table, "rgp/ballbeam.dat", [0], 1),
    "wing flutter": _split(0.01, _table, "rgp/flutter.dat", [0], 1),
    "actuator": _split(0.05, _variables, "drgp_vss/actuator.mat", "X", "y"),
    "cascaded tanks": _split(4.0, _variables, "drgp_vss/cascaded.mat", "X", "y"),
    "damper": _split(0.005, _variables, "drgp_vss/damper.mat", "X", "y"),
    **{f"coupled drives, {k}": _split(0.02, _variables, "drgp_vss/drive.mat", f"u{k}", f"z{k}") for k in "123"},
}
"""Name → sampling period [s], or 0.01 s where the source states none, and what reads its training and test part."""


def centred(name: str) -> tuple[float, Signals, Signals]:
    """Return period [s], training and test part of a recorded log, less their training means."""
    period_s, read = LOGS[name]
    (u, y), (u_test, y_test) = read()
    return period_s, (u - u.mean(0), y - y.mean(0)), (u_test - u.mean(0), y_test - y.mean(0))


def recorded(job: tuple[str, int | None]) -> dict[str, Any]:
    """Identify a recorded log, and score the plant on both parts."""
    name, order = job
    period_s, training, test = centred(name)
    names = tuple(f"u{number}" for number in range(training[0].shape[1]))
    recording, begun = Recording.from_arrays(*training, period_s, input_names=names), time.process_time()
    result = quiet(lambda: identify_axis([recording], order=order))
    row = dict.fromkeys(("test", "training", "found_order", "delay", "seconds", "reason"))
    row |= {"log": name, "order": order or "chosen", "seconds": time.process_time() - begun}
    if isinstance(result, str):
        return {**row, "reason": result}
    plant = result.record
    known = result.fits[0].run  # with the drift that was found
    found = {"training": float(known.fit_percent[0]), "found_order": len(plant.A), "delay": plant.delay_samples}
    return {**row, **found, "test": float(free_run(plant, *test, known.offset).fit_percent[0])}


def printed(job: tuple[str, float, int, int | None]) -> dict[str, Any]:
    """Identify a noisy sweep of a printed axis, and compare the plant with the truth, from rest."""
    axis, noise, seed, order = job
    true, rng = printed_plants()[axis], np.random.default_rng(seed)
    clean = simulate(true, SWEEP[:, None])
    measured = clean + noise * clean.std() * rng.standard_normal(clean.shape)
    result = identify_axis([Recording.from_arrays(SWEEP, measured, PERIOD_S)], order=order)
    plant = result.record
    row: dict[str, Any] = {"axis": axis, "noise": noise, "seed": seed, "order": order or "chosen"}
    for name, signal in {"sweep": SWEEP, "step": STEP, "white": WHITE}.items():
        wanted, got = (simulate(each, signal[:, None]) for each in (true, plant))
        row[name] = float(100 * (1 - np.linalg.norm(wanted - got) / np.linalg.norm(wanted - wanted.mean())))
    poles, known = np.linalg.eigvals(plant.A), np.linalg.eigvals(true.A)
    dominant = known[np.argmax(np.abs(known))]
    fast = [each for each in result.poles if each.frequency_hz.value > 100]
    flagged = not any(each.determined for each in fast)
    return {**row, "pole_error": float(np.abs(poles - dominant).min()), "fast_pole_flagged": flagged}


def clean(job: tuple[str, int, int | None]) -> dict[str, Any]:
    """Identify a log without noise of a printed axis that is late."""
    axis, delay, order = job
    true = printed_plants()[axis].replace(delay_samples=delay)
    y = simulate(true, SWEEP[:, None]) + 4
    y[:delay] = 4  # before the log the input was zero
    plant = identify_axis([Recording.from_arrays(SWEEP, y, PERIOD_S)], order=order).record
    poles = np.linalg.eigvals(plant.A)
    worst = max(float(np.abs(poles - pole).min()) for pole in np.linalg.eigvals(true.A))
    row: dict[str, Any] = {"axis": axis, "delay": delay, "order": order or "chosen", "pole_error": worst}
    right = plant.delay_samples == delay and not plant.D.any()
    return {**row, "delay_right": right, "gain_error": float(abs(plant.dc_gain.item() / true.dc_gain.item() - 1))}


def figures(
    rows: list[dict[str, Any]], sweeps: list[dict[str, Any]], exact: list[dict[str, Any]], reference: dict[str, Any]
) -> list[Bar]:
    """Return the figures with their limits."""
    found = {(row["log"], row["order"]): row for row in rows}
    bars = []
    for name, limits in LIMITS.items():
        for part, least in zip(("test", "training"), limits, strict=True):
            bars.append(Bar(f"{name}, order 4: {part} fit, %", found[name, 4][part] or -np.inf, least))
    for part, names in (("test", TESTED), ("training", tuple(LOGS))):
        pins = {name: reference[name]["chosen"][part] or 0.0 for name in names if (name, "chosen") in found}
        leads = [(found[name, "chosen"][part] or 0.0) - pin for name, pin in pins.items() if pin >= FITTED]
        words, bound = f"order chosen, {part} fit of {len(leads)} logs over the reference's", part == "test"
        bars.append(Bar(f"{words}: mean, points", float(np.mean(leads)), 0.0 if bound else None))
        bars.append(Bar(f"{words}: least, points", min(leads), -BELOW if bound else None))
    for noise, limits in PRINTED_LIMITS.items():
        for axis in ("pitch", "yaw"):
            some = [row for row in sweeps if (row["axis"], row["noise"], row["order"]) == (axis, noise, 4)]
            for name, least in zip(("sweep", "step"), limits, strict=True):
                median = float(np.median([row[name] for row in some]))
                bars.append(Bar(f"printed {axis}, {noise:.0%} noise: {name} fit, median, %", median, least))
    flagged = (row["fast_pole_flagged"] for row in sweeps if (row["axis"], row["order"]) == ("pitch", 4))
    bars.append(share("printed pitch: the pair at 0.4 of the sampling rate not determined, %", flagged, 100.0))
    bars.append(share("clean logs: delay exact, %", (row["delay_right"] for row in exact), 100.0))
    for name, most in {"pole_error": 1e-7, "gain_error": 1e-6}.items():
        worst = max(row[name] for row in exact)
        bars.append(Bar(f"clean logs: largest {name.replace('_', ' ')}", worst, most=most))
    return bars


def tables(rows: list[dict[str, Any]], sweeps: list[dict[str, Any]], reference: dict[str, Any]) -> list[Table]:
    """Return recorded logs and the reference, and printed axes."""
    lines: list[tuple[Any, ...]] = []
    for row in rows:
        pin = reference.get(row["log"], {}).get(str(row["order"]), {})
        found = (row["test"], row["training"], pin.get("test"), pin.get("training"))
        structure = (row["found_order"], pin.get("found_order"), row["delay"], pin.get("delay"))
        lines.append((f"{row['log']}, order {row['order']}", *found, *structure, row["seconds"]))
    headings = ("", "test", "training", "reference: test", "training", "order", "reference", "delay", "reference", "s")
    medians: list[tuple[Any, ...]] = []
    for key in dict.fromkeys((row["axis"], row["noise"], row["order"]) for row in sweeps):
        some = [row for row in sweeps if (row["axis"], row["noise"], row["order"]) == key]
        values = [float(np.median([row[name] for row in some])) for name in ("sweep", "step", "white", "pole_error")]
        medians.append((f"{key[0]}, {key[1]:.0%}, order {key[2]}", *values))
    return [
        Table("recorded logs, fit of a free run, %", headings, tuple(lines)),
        Table(
            "a sweep of a printed axis, medians", ("", "sweep, %", "step, %", "white, %", "pole error"), tuple(medians)
        ),
    ]


def main() -> None:
    """Identify all logs, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the logs with limits, two seeds; nothing is written")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    if not DATA.is_dir():
        parser.exit(2, f"{DATA}: there is no such folder; the recorded logs belong there\n")
    names, seeds = (list(LIMITS), 2) if options.quick else (list(LOGS), SEEDS)
    reference = json.loads(REFERENCE.read_text())["logs"]
    rows = list(run(recorded, [(name, order) for name in names for order in STRUCTURE], options.workers))
    noisy = [(axis, noise, seed, 4) for axis in printed_plants() for noise in PRINTED_LIMITS for seed in range(seeds)]
    chosen = [(axis, noise, seed, None) for axis, noise, seed, _ in noisy if seed < 3]
    sweeps = list(run(printed, [*noisy, *chosen], options.workers))
    late = [(axis, delay, order) for axis in printed_plants() for delay in DELAYS for order in STRUCTURE]
    exact = list(run(clean, late, options.workers))
    conditions = {"seeds": seeds, "noises": list(PRINTED_LIMITS), "delays": DELAYS, "limits": LIMITS}
    bars, shown = figures(rows, sweeps, exact, reference), tables(rows, sweeps, reference)
    others = {"reference": reference, "printed": sweeps, "clean": exact}
    finish("identification", bars, shown, conditions, rows, not options.quick, **others)


if __name__ == "__main__":
    main()
