"""Whether the stated interval of the steady gain holds the truth, and the draws have that spread.

`python benchmarks/plateaus.py` identifies 200 simulated axes of steady gain 1 from a sweep and steps each: lags of
5 ms to 0.5 s, every second one with dry friction, steps that are held for 0.3 to 3 s, noise of 0.1 to 3 % of the step.
It writes results/plateaus.json. Ten minutes with `--workers 2`; `--axes 40` takes the first ones, and writes nothing.
"""

import argparse
from typing import Any, NamedTuple

import numpy as np

from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.axis.plateaus import plateau_gain
from archerfish.logs.recording import Recording
from archerfish.reports.table import Estimate
from bars import Bar, finish, run, share
from rigs import Array, Rig, log_uniform, respond

AXES, SEED = 200, 4242
LAGS_S, HOLDS_S, NOISES, FRICTIONS = (5e-3, 0.5), (0.3, 3.0), (1e-3, 3e-2), (3e-3, 3e-2)
RATES_HZ = (100.0, 200.0, 500.0)
LEVELS = (1.0, 0.0, -1.0, 0.0)
SWEEP_S, STEPS_S, FEWEST_STEPS = 6.0, 8.0, 8


class Axis(NamedTuple):
    """A simulated axis, and how it is logged."""

    rig: Rig
    lag_s: float
    hold_s: float
    noise: float
    friction: float
    rate_hz: float
    seed: int


class Outcome(NamedTuple):
    """What is stated of its steady gain, whose truth is 1."""

    axis: Axis
    plateaus: Estimate | None
    stated: Estimate
    spread: float  # width of the draws' interval over that of the stated one
    usable: bool


def draw_axis(number: int) -> Axis:
    """Draw an axis; every second one has friction."""
    rng = np.random.default_rng([SEED, number])
    lag_s, hold_s, noise = (log_uniform(rng, *limits) for limits in (LAGS_S, HOLDS_S, NOISES))
    friction = log_uniform(rng, *FRICTIONS) if number % 2 else 0.0
    # A loop of second order near critical damping, whose slowest motion has about that time constant.
    damping, rate_hz = float(rng.uniform(0.7, 1.3)), float(rng.choice(RATES_HZ))
    frequency = (damping + np.sqrt(max(damping**2 - 1, 0.0))) / lag_s
    A = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    B, C = np.array([0.0, frequency**2]), np.array([1.0, 0.0])
    bandwidth_hz = frequency / (2 * np.pi)
    rig = Rig("second order", A, B, C, bandwidth_hz, 4 * lag_s, (frequency, damping), delay_s=2 / rate_hz)
    rig = Rig(**{**vars(rig), "friction": friction, "stiction": friction})
    return Axis(rig, lag_s, hold_s, noise, friction, rate_hz, number)


def logs_of(axis: Axis) -> list[Recording]:
    """Simulate a sweep and steps."""
    rng, period_s = np.random.default_rng([SEED, axis.seed, 1]), 1 / axis.rate_hz
    time = period_s * np.arange(round(SWEEP_S / period_s))
    highest_hz = min(0.3 * axis.rate_hz, max(2.0, 2 * axis.rig.bandwidth_hz))
    sweep = np.sin(2 * np.pi * (0.3 * time + 0.5 * (highest_hz - 0.3) / SWEEP_S * time**2))
    count = max(FEWEST_STEPS, round(STEPS_S / axis.hold_s))
    levels = np.resize(LEVELS, count)
    steps = np.concatenate([np.zeros(round(0.2 / period_s)), levels.repeat(round(axis.hold_s / period_s))])
    return [_log(axis, command, period_s, rng) for command in (sweep, steps)]


def _log(axis: Axis, command: Array, period_s: float, rng: np.random.Generator) -> Recording:
    output = respond(axis.rig, command, period_s)
    return Recording.from_arrays(command, output + axis.noise * rng.standard_normal(len(output)), period_s)


def identified(axis: Axis) -> Outcome:
    """Identify an axis as a robot's is."""
    logs = logs_of(axis)
    result = identify_axis(logs, feedthrough=False, dc_gain="plateaus")
    stated = result.dc_gain[0]
    A, B, C, D = (result.record.draws[name] for name in "ABCD")
    drawn = (C @ np.linalg.solve(np.eye(A.shape[1]) - A, B) + D).ravel()
    low, high = np.quantile(drawn, [0.025, 0.975], method="weibull")
    spread = float((high - low) / max(stated.high - stated.low, 1e-12))
    return Outcome(axis, plateau_gain(logs), stated, spread, bool(result.report.usable))


def _holds(estimate: Estimate) -> bool:
    return estimate.low <= 1 <= estimate.high


def row_of(outcome: Outcome) -> dict[str, Any]:
    """Return what is written of an axis."""
    axis, stated, plateaus = outcome.axis, outcome.stated, outcome.plateaus
    facts = {"lag_s": axis.lag_s, "hold_s": axis.hold_s, "noise": axis.noise, "friction": axis.friction}
    levels = list(plateaus[:3]) if plateaus else None
    gains = {"plateaus": levels, "stated": list(stated[:3]), "spread": outcome.spread, "usable": outcome.usable}
    return facts | {"rate_hz": axis.rate_hz} | gains


def bars(outcomes: list[Outcome]) -> list[Bar]:
    """Return the figures and their limits."""
    with_plateaus = [outcome for outcome in outcomes if outcome.plateaus is not None]
    others = [outcome for outcome in outcomes if outcome.plateaus is None]
    found = [
        share("plateaus: their interval holds the gain [%]", (_holds(o.plateaus) for o in with_plateaus if o.plateaus)),
        share("with plateaus: the stated interval holds the gain [%]", (_holds(o.stated) for o in with_plateaus), 90),
    ]
    for friction in (False, True):
        name = "with friction" if friction else "without friction"
        for heading, among in (("...", with_plateaus), ("no plateaus,", others)):
            group = [outcome for outcome in among if bool(outcome.axis.friction) == friction]
            found.append(share(f"{heading} {name}: the stated interval [%]", (_holds(o.stated) for o in group)))
    alike = (0.8 <= outcome.spread <= 1.2 for outcome in with_plateaus)
    spreads = share("draws' spread within 20 % of the interval [%]", alike, 95)
    usable = share("called usable [%]", (outcome.usable for outcome in outcomes))
    off = (outcome.usable and abs(outcome.stated.value - 1) > 0.05 for outcome in outcomes)
    wrong = share("usable with a gain that is 5 % off [%]", off)
    width = float(np.median([o.stated.high - o.stated.low for o in with_plateaus])) if with_plateaus else float("nan")
    return [*found, spreads, Bar("median width of the stated interval", width), usable, wrong]


def main() -> None:
    """Identify the axes, print and write; exit with 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axes", type=int, help="so many of them; nothing is then written")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    axes = [draw_axis(number) for number in range(options.axes or AXES)]
    outcomes = list(run(identified, axes, options.workers))
    rows = [row_of(outcome) for outcome in outcomes]
    conditions = {"seed": SEED, "lags_s": LAGS_S, "holds_s": HOLDS_S, "noises": NOISES, "frictions": FRICTIONS}
    finish("plateaus", bars(outcomes), [], conditions, rows, options.axes is None)


if __name__ == "__main__":
    main()
